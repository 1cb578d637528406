"""Standing and walking: clock, footholds, swing and stance targets of one tick.

What works on this robot: stance feet are latched at touchdown and a reference body moves over them
at v_d + follow (v - v_d); stance targets are taken in the desired attitude, swing targets in the
measured one; footholds answer the velocity error; the position error goes into v_d.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from husky_control.body_motion import Hop, Sway, sway_interval
from husky_control.estimator import GRAVITY
from husky_control.foothold import nominal_footholds, place_footholds
from husky_control.gait import Gait, GaitClock
from husky_control.kinematics import (
    JOINTS,
    LEGS,
    center_of_mass,
    leg_commands,
    leg_geometry,
    leg_masses,
)
from husky_control.rotation import matrix_from_roll_pitch_yaw, yaw_of
from husky_control.stability import static_margin
from husky_control.stance import distribute_weight, foot_targets, internal_load, lean_forces
from husky_control.swing import swing_feet
from husky_control.velocity_reference import VelocityReference

if TYPE_CHECKING:
    from husky_control.parameters import Parameters
    from husky_description.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STOP_SPEED = 0.10  # m/s, of the velocity error, below which feet may stay down when walking stops
CATCH_UP_SHARE = 0.3  # of its greatest speed, at which a static gait makes up for position error
RANGE_MARGIN = 0.03  # rad, that joint targets keep from the ends of their ranges
MOST_SHARE = 0.7  # of the weight that one foot carries, also when it lands before its partner
MOST_RISE = 0.10  # m, of a foot's own ground over the feet's plane
GROUND_RATE = 0.35  # m/s, at which the expected height of the ground changes within a step
LEANING_ACCELERATION = 60.0  # m/s^2, of a leaning body's foot towards a foothold that moves
READY_SHARE = 0.7  # of the gait's static margin, at which a leg of the crawl may lift


class Walking:
    """Keeps the body over its feet, and steps when it is allowed to."""

    def __init__(self, robot: Robot, parameters: Parameters, gait: Gait) -> None:
        """A body at rest with all feet on the ground."""
        self.geometry = leg_geometry(robot)
        self.parameters = parameters
        self.mass = float(robot.mass)
        # In the frame of the ground, z its normal: world, or the plane of an incline.
        self.gravity = np.array([0.0, 0.0, -GRAVITY])  # m/s^2
        self.thrust = np.zeros(3)  # N, force on the body that something else than the legs gives
        self.shift = np.zeros(2)  # m, of the feet, so that the load passes through the body
        self.load_slope = (0.0, 0.0)  # tangential over normal load of the feet, along x and y
        self.sink = 0.0  # m, lower than the gait says
        self.bend: Array | None = None  # (4, 2) -, rise per way where each foot stood, if it bends
        self.pitch = 0.0  # rad, desired, relative to the ground
        self.stand_height = float(robot.stand_height)
        self.foot_radius = float(robot.foot_radius)
        self.clock = GaitClock(gait)
        self.reference = VelocityReference(parameters)
        self.stepping = False
        self._lifting = False

        self.joint_position = np.zeros(JOINTS)
        self.joint_velocity = np.zeros(JOINTS)
        self.joint_torque = np.zeros(JOINTS)
        self.body_position = np.zeros(3)  # m, reference body in world
        self.body_velocity = np.zeros(3)  # m/s
        self.body_rotation = np.eye(3)
        self.foothold = np.zeros((LEGS, 2))  # m in world
        self.out_of_reach = 0

        self._sway = Sway()
        self._sway_leg = -1
        self._hop = Hop()
        self._nominal = np.zeros((LEGS, 2))
        self._leaning = np.zeros((LEGS, 2))  # the same under a body that is pitched
        self._masses = leg_masses(robot)
        self._lower = np.array(robot.joint_lower) + RANGE_MARGIN
        self._upper = np.array(robot.joint_upper) - RANGE_MARGIN
        self._center = np.zeros(3)
        self._height = self.stand_height
        self._ground = 0.0
        self._anchor = np.zeros((LEGS, 3))
        self._swing_position = np.zeros((LEGS, 3))
        self._swing_velocity = np.zeros((LEGS, 3))
        self._start_height = np.zeros(LEGS)
        self._start_place = np.zeros((LEGS, 2))
        self._grounds = np.zeros(LEGS)
        self._rise = np.zeros(LEGS)  # m, of the expected ground over where the foot stood
        self._remaining = np.zeros(LEGS)
        self._place = np.zeros(LEGS, dtype=np.bool_)
        self._placed = np.zeros((LEGS, 2))
        self._velocity_at_event = np.zeros(2)
        self._blend = np.zeros((LEGS, 3))
        self._share = np.ones(LEGS)
        self._foot_target = np.zeros((LEGS, 3))
        self._foot_velocity = np.zeros((LEGS, 3))
        self._foot_force = np.zeros((LEGS, 3))
        self._load = np.zeros(LEGS)
        self._scratch_foot = np.zeros((LEGS, 3))
        self._scratch_jacobian = np.zeros((LEGS, 3, 3))

    def begin(self, rotation: Array, position: Array, foot_in_base: Array, gait: Gait) -> None:
        """Take over a standing robot whose legs were commanded to place the feet at foot_in_base.

        Args:
            rotation: (3, 3), base to world.
            position: (3,) m, base in world.
            foot_in_base: (4, 3) m.
            gait: the gait to walk in when stepping begins.
        """
        self.stepping = False
        self.clock.start(gait)
        yaw = yaw_of(rotation)
        self.reference.reset(position, yaw)
        matrix_from_roll_pitch_yaw(0.0, 0.0, yaw, self.body_rotation)
        self._height = float(-foot_in_base[:, 2].mean())
        self._ground = float(position[2]) - self._height
        self.body_position[:] = position
        self.body_velocity.fill(0.0)
        self._anchor[:] = self.body_position + foot_in_base @ self.body_rotation.T
        self._foot_target[:] = foot_in_base
        self._blend.fill(0.0)
        self._share.fill(1.0)
        self._sway.reset()
        self._hop = Hop()
        self.joint_velocity.fill(0.0)

    def start_stepping(self, gait: Gait, position: Array) -> None:
        """Let the feet lift off, in a gait."""
        self.clock.start(gait)
        self.stepping = True
        self.reference.reset(position, self.reference.yaw)
        self._sway.reset()
        self._sway_leg = -1
        self._hop.touchdown(0.0, 0.0, gait.hop_speed)
        self._nominal = nominal_footholds(
            self.geometry.hip_position,
            self.geometry.lateral_offset,
            gait.forward_spread,
            gait.lateral_spread,
        )

    def stop_stepping(self) -> None:
        """Bring the velocity to zero, then keep each foot on the ground where it comes down."""
        self.reference.command.fill(0.0)
        self.stepping = False

    @property
    def height(self) -> float:
        """Of the reference body over the feet's plane, m."""
        return self._height

    @property
    def stopped(self) -> bool:
        """Whether stepping was stopped, all feet are down, and none is to lift again."""
        return not self.stepping and not self._moving() and not self._lifting

    def _moving(self) -> bool:
        """Whether feet step, or the body still comes to rest from a hop."""
        clock = self.clock
        landing = clock.gait.hop_speed > 0.0 and abs(self._hop.height) > 1e-3
        return self.stepping or landing or bool(clock.swinging.any())

    def tick(
        self,
        rotation: Array,
        angular_velocity: Array,
        position: Array,
        velocity: Array,
        foot_in_base: Array,
        foot_in_world: Array,
        contact: Mask,
        foot_force: Array,
        dt: float,
    ) -> None:
        """Compute joint_position, joint_velocity and joint_torque of one tick.

        Args:
            rotation: (3, 3), base to world.
            angular_velocity: (3,) rad/s in base.
            position: (3,) m, base in world.
            velocity: (3,) m/s, base in world.
            foot_in_base: (4, 3) m, measured.
            foot_in_world: (4, 3) m, estimated.
            contact: (4,) bool.
            foot_force: (4, 3) N, of the ground on the feet in world, estimated.
            dt: s.
        """
        p, clock, sway = self.parameters, self.clock, self._sway
        yaw = yaw_of(rotation)
        px, py = float(position[0]), float(position[1])
        gait, most, acceleration = clock.gait, math.inf, math.inf
        static = gait.static_margin > 0.0
        if static:
            most = CATCH_UP_SHARE * gait.max_speed
            # Up to speed in one cycle: the body must not run ahead of feet that wait their turn.
            acceleration = gait.max_speed / gait.period
        self.reference.tick(
            yaw, px - sway.offset[0], py - sway.offset[1], most, acceleration, dt
        )
        hold = static and self._moving() and self._sway_body(px, py, foot_in_world, dt)
        # A hop once begun is finished: what counts is what was decided at its touchdown.
        lift = self._hop.end_speed > 0.0 if clock.gait.hop_speed > 0.0 else self._again(velocity)
        self._lifting = lift
        clock.tick(contact, lift, p["walk.late_limit"], 0.0 if hold else dt)
        moving = self._moving()
        self._events(rotation, position, velocity, foot_in_base, foot_in_world)
        self._move_body(velocity, moving, hold, dt)
        if moving:
            self._swing(yaw, position, velocity, dt)
        if (static or not moving) and not clock.swinging.any() and contact.all():
            self._even_out(foot_in_base, foot_force, dt)
        foot_targets(
            clock.swinging, rotation, self.body_rotation, position, velocity,
            angular_velocity, self.body_position, self.body_velocity,
            float(self.reference.ramped[2]), self.foot_radius, self.joint_position,
            self.joint_velocity, dt, self._anchor, self._swing_position, self._swing_velocity,
            self._blend, math.exp(-dt / max(p["walk.touchdown_blend"], 1e-4)),
            self._foot_target, self._foot_velocity,
        )
        self._carry(rotation, angular_velocity, foot_in_base, dt)
        self.out_of_reach += leg_commands(
            self.geometry, self._foot_target, self._foot_velocity, self._foot_force,
            self._lower, self._upper, self._scratch_foot, self._scratch_jacobian,
            self.joint_position, self.joint_velocity, self.joint_torque,
        )

    def _again(self, velocity: Array) -> bool:
        """Whether feet shall lift again: until the body is as slow as it is asked to be."""
        if self.stepping or not self.reference.at_rest:
            return True
        speed = math.hypot(velocity[0], velocity[1])
        return self.clock.gait.static_margin == 0.0 and speed >= STOP_SPEED

    def _sway_body(self, x: float, y: float, foot_in_world: Array, dt: float) -> bool:
        """Sway over the triangle of the feet that stay; True while the clock must wait for it."""
        clock, sway, p = self.clock, self._sway, self.parameters
        swinging = [leg for leg in range(LEGS) if clock.swinging[leg]]
        leg, wait = (swinging[0], 0.0) if swinging else clock.next_to_lift()
        margin, rotation = clock.gait.static_margin, self.body_rotation
        # The centre of mass, not the base's origin, goes over the feet.
        cx = float(rotation[0, 0] * self._center[0] + rotation[0, 1] * self._center[1])
        cy = float(rotation[1, 0] * self._center[0] + rotation[1, 1] * self._center[1])
        path = (
            float(self.body_position[0] - sway.offset[0]) + cx,
            float(self.body_position[1] - sway.offset[1]) + cy,
        )
        side = (float(rotation[0, 1]), float(rotation[1, 1]))
        shift = self._shift(leg, path, side, margin)
        lever = self._height / GRAVITY
        if leg != self._sway_leg:
            self._sway_leg = leg
            way = math.hypot(shift * side[0] - sway.offset[0], shift * side[1] - sway.offset[1])
            # A quintic peaks at 5.77 way / time^2, and so far does it push the zero-moment point.
            sway.begin(math.sqrt(5.77 * way * lever / p["walk.sway_excursion"]))
        sway.tick(shift * side[0], shift * side[1], p["walk.sway_limit"], dt)
        gate = p["walk.static_load_time"]
        if swinging or not gate < wait <= gate + 2.0 * dt:
            return False
        # The zero-moment point, not only the centre of mass, must be inside when the leg unloads.
        zmp = (x + cx - lever * sway.acceleration[0], y + cy - lever * sway.acceleration[1])
        others = [k for k in range(LEGS) if k != leg]
        return static_margin(zmp, foot_in_world[others]) < READY_SHARE * margin

    def _shift(
        self, leg: int, path: tuple[float, float], side: tuple[float, float], margin: float
    ) -> float:
        """Sway sideways that a leg's swing needs, from its beginning to its end, m."""
        desired = self.reference.velocity
        corners = [self._anchor[k] for k in range(LEGS) if k != leg]
        low, high = -math.inf, math.inf
        for time in self.clock.swing_window(leg):
            point = (path[0] + desired[0] * time, path[1] + desired[1] * time)
            least, greatest = sway_interval(point, side, corners, margin)
            low, high = max(low, least), min(high, greatest)
        # Where no sway keeps the margin, the middle keeps most of it.
        return 0.5 * (low + high) if low > high else min(high, max(low, 0.0))

    def _move_body(self, velocity: Array, moving: bool, hold: bool, dt: float) -> None:
        """Move the reference body over the stance feet."""
        gait, desired, body = self.clock.gait, self.reference.velocity, self.body_velocity
        static = gait.static_margin > 0.0
        hop = 0.0
        if moving:
            hold_back, sway = 1.0 - gait.velocity_follow, self._sway.velocity
            most = self.parameters["walk.hold_back"]
            for i in range(2):
                if static:
                    body[i] = sway[i] + (0.0 if hold else desired[i])
                else:
                    lag = hold_back * (velocity[i] - desired[i])
                    body[i] = velocity[i] - min(most, max(-most, lag))
            height = gait.stance_height - self.sink
            if gait.hop_speed > 0.0 and not self.clock.swinging[0]:
                self._hop.tick(self.clock.stance_progress, self.clock.stance_time)
                hop = self._hop.height
        else:
            self._sway.reset()
            self._hop.height = self._hop.acceleration = self._hop.end_speed = 0.0
            centre = self._anchor[:, :2].mean(axis=0) - self.shift
            for i in range(2):
                body[i] = min(0.05, max(-0.05, 2.0 * (centre[i] - self.body_position[i])))
            self.reference.position[:] = centre
            height = self.stand_height + self.parameters["stand.height_offset"] - self.sink
        limit = self.parameters["walk.height_rate"] * dt
        step = min(limit, max(-limit, height - self._height))
        self._height += step
        body[2] = step / dt + (self._hop.speed if hop else 0.0)
        self.body_position[:2] += body[:2] * dt
        self.body_position[2] = self._ground + self._height + hop
        matrix_from_roll_pitch_yaw(0.0, self.pitch, self.reference.yaw, self.body_rotation)

    def turn(self, turn: Array) -> None:
        """Express all that is remembered in a frame of the ground that has turned.

        Args:
            turn: (3, 3), the old frame to the new one, about their common origin.
        """
        below = np.array([self.body_position[0], self.body_position[1], self._ground])
        lag = self.reference.position - self.body_position[:2]
        yaw = self.reference.yaw
        starts = np.column_stack((self._start_place, self._start_height)) @ turn.T
        holds = np.column_stack((self.foothold, np.full(LEGS, self._ground))) @ turn.T
        self._ground = float(turn[2] @ below)
        self._start_place[:], self._start_height[:] = starts[:, :2], starts[:, 2]
        self.foothold[:] = holds[:, :2]
        for points in (self._anchor, self._swing_position, self._swing_velocity):
            points[:] = points @ turn.T
        self.body_position[:] = turn @ self.body_position
        self.body_velocity[:] = turn @ self.body_velocity
        self.reference.position[:] = self.body_position[:2] + lag
        ahead = turn @ np.array([math.cos(yaw), math.sin(yaw), 0.0])
        self.reference.yaw = math.atan2(float(ahead[1]), float(ahead[0]))

    def _events(
        self,
        rotation: Array,
        position: Array,
        velocity: Array,
        foot_in_base: Array,
        foot_in_world: Array,
    ) -> None:
        """Latch what belongs to a touchdown or a liftoff (T13)."""
        clock = self.clock
        any_event = False
        for leg in range(LEGS):
            if clock.touchdown[leg]:
                any_event = True
                self._touchdown(leg, rotation, position, velocity, foot_in_base, foot_in_world)
            elif clock.liftoff[leg]:
                any_event = True
                self._swing_position[leg] = position + rotation @ self._foot_target[leg]
                self._swing_velocity[leg] = 0.0
                self._start_height[leg] = self._swing_position[leg, 2]
                self._start_place[leg] = self._swing_position[leg, :2]
        dx = velocity[0] - self._velocity_at_event[0]
        dy = velocity[1] - self._velocity_at_event[1]
        if any_event or math.hypot(dx, dy) >= self.parameters["foothold.disturbance"]:
            self._velocity_at_event[:] = velocity[:2]
            self._place[:] = clock.swinging

    def _touchdown(
        self,
        leg: int,
        rotation: Array,
        position: Array,
        velocity: Array,
        foot_in_base: Array,
        foot_in_world: Array,
    ) -> None:
        """Latch a foot that has come down, and the height of the ground under the feet."""
        clock, follow = self.clock, self.parameters["walk.terrain_follow"]
        standing = [k for k in range(LEGS) if not clock.swinging[k]]
        ground = sum(float(foot_in_world[k, 2]) for k in standing) / len(standing)
        self._ground += 0.5 * (ground - self._ground)
        if clock.gait.hop_speed > 0.0 and len(standing) == int(clock.touchdown.sum()):
            speed = min(0.0, max(-1.5, float(velocity[2])))
            height = float(position[2]) - self._ground - self._height
            again = clock.gait.hop_speed if self._again(velocity) else 0.0
            self._hop.touchdown(height, speed, again)
        anchor = self.body_position + rotation @ foot_in_base[leg]
        anchor[2] = self._ground + follow * (foot_in_world[leg, 2] - self._ground)
        self._anchor[leg] = anchor
        raw = self.body_rotation.T @ (anchor - self.body_position)
        self._blend[leg] = self._foot_target[leg] - raw
        self._share[leg] = 0.0

    def _swing(self, yaw: float, position: Array, velocity: Array, dt: float) -> None:
        """Place footholds and move the swing feet."""
        p, clock, gait, sway = self.parameters, self.clock, self.clock.gait, self._sway
        np.subtract(1.0, clock.swing_progress, out=self._remaining)
        self._remaining *= clock.swing_time
        np.multiply(self._nominal, (math.cos(self.pitch), 1.0), out=self._leaning)
        place_footholds(
            self._leaning, math.cos(yaw), math.sin(yaw),
            float(position[0] - sway.offset[0] + self.shift[0]),
            float(position[1] - sway.offset[1] + self.shift[1]),
            float(velocity[0] - sway.velocity[0]), float(velocity[1] - sway.velocity[1]),
            self.reference.velocity, float(self.reference.ramped[2]), self._remaining,
            clock.stance_time, p["foothold.velocity_gain"], p["foothold.reach"],
            self._place, self._placed,
        )
        self._move_footholds()
        swing_feet(
            clock.swinging, clock.swing_progress, clock.swing_time, self.foothold,
            self._expected_grounds(dt), gait.swing_height, p["walk.search_speed"],
            p["walk.search_depth"], self._start_height, dt,
            self._swing_position, self._swing_velocity,
        )

    def _move_footholds(self) -> None:
        """Take over footholds placed anew; under a leaning body as far as the time left allows.

        Its feet bear so little that a leg that jerks feels a touchdown.
        """
        for leg in range(LEGS):
            if not self._place[leg]:
                continue
            way = self._placed[leg] - self.foothold[leg]
            if self.pitch and not self.clock.liftoff[leg]:
                most = LEANING_ACCELERATION * float(self._remaining[leg]) ** 2 / 6.0
                way *= min(1.0, most / max(math.hypot(way[0], way[1]), 1e-9))
            self.foothold[leg] += way
        self._place.fill(False)

    def _expected_grounds(self, dt: float) -> Array:
        """Heights (4,) m at the footholds: of the feet's plane, or as a foot's ground goes on.

        Within a step they change smoothly, though other feet land and footholds are placed anew: a
        leg that jerks feels a touchdown that is none.
        """
        most = GROUND_RATE * dt
        for leg in range(LEGS):
            start = self._start_height[leg]
            rise = self._ground - start
            if self.bend is not None:
                way = self.foothold[leg] - self._start_place[leg]
                # Ground that bends upward comes a little early: better than late.
                bent = float(self.bend[leg] @ way) - rise
                rise += min(MOST_RISE, max(-MOST_RISE, bent))
            if not self.clock.liftoff[leg]:
                rise = self._rise[leg] + min(most, max(-most, rise - self._rise[leg]))
            self._rise[leg] = rise
            self._grounds[leg] = start + rise
        return self._grounds

    def _even_out(self, foot_in_base: Array, foot_force: Array, dt: float) -> None:
        """Let four standing feet share the load: legs yield where they press against each other."""
        internal_load(foot_in_base, foot_force, self._foot_force, self._load)
        rate = self.parameters["walk.load_compliance"] * dt
        for leg in range(LEGS):
            self._anchor[leg, 2] += rate * min(20.0, max(-20.0, self._load[leg]))

    def _carry(
        self, rotation: Array, angular_velocity: Array, foot_in_base: Array, dt: float
    ) -> None:
        """Torque feed-forward: the weight, and moments against tilt."""
        p = self.parameters
        static = self.clock.gait.static_margin > 0.0
        rate = dt / max(p["walk.static_load_time" if static else "walk.load_time"], dt)
        lifting, wait = self.clock.next_to_lift() if static and self._moving() else (-1, 0.0)
        for leg in range(LEGS):
            share = self._share[leg]
            if self.clock.swinging[leg]:
                share = 0.0
            elif leg == lifting and wait < p["walk.static_load_time"]:
                share = max(0.0, share - rate)
            else:
                share = min(1.0, share + rate)
            self._share[leg] = share
        center_of_mass(
            self.geometry, self._masses, self.joint_position, self._scratch_foot, self._center
        )
        stiffness, damping = p["walk.attitude_stiffness"], p["walk.attitude_damping"]
        weight = self.mass * (self._hop.acceleration - self.gravity[2]) * p["walk.weight_share"]
        weight = max(0.0, weight - self.thrust[2])
        moment_x = moment_y = 0.0
        if stiffness or damping:
            w = rotation @ angular_velocity
            # Tilt as a rotation vector in world: z_base x z_world.
            moment_x = stiffness * rotation[1, 2] - damping * w[0]
            moment_y = -stiffness * rotation[0, 2] - damping * w[1]
        slope_x, slope_y = self.load_slope
        if slope_x or slope_y:
            # Tangential forces act below the centre of mass and turn the body as well.
            moment_x -= self._height * slope_y * weight
            moment_y += self._height * slope_x * weight
        distribute_weight(
            foot_in_base, self._center, self._share, rotation, weight, moment_x, moment_y,
            MOST_SHARE * weight, self._foot_force,
        )
        if slope_x or slope_y:
            lean_forces(rotation, slope_x, slope_y, self._foot_force)
