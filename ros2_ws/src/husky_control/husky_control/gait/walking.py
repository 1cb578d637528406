"""Standing and walking: clock, footholds, swing and stance targets of one tick.

What works on this robot: stance feet are latched at touchdown and a reference body moves over them
at v_d + follow (v - v_d); stance targets are taken in the desired attitude, swing targets in the
measured one; footholds answer the velocity error; the position error goes into v_d.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from husky_control.gait.bearing import Bearing
from husky_control.gait.body_motion import Hop, Sway, sway_interval
from husky_control.gait.foothold import Approach
from husky_control.gait.ground import LEVEL_GROUND, Ground
from husky_control.gait.stability import static_margin
from husky_control.gait.stance import (
    FeetInGround,
    ReferenceBody,
    Rolling,
    foot_targets,
    internal_load,
)
from husky_control.gait.state import BodyInGround, FeetState
from husky_control.gait.steps import Steps
from husky_control.gait.table import Gait, GaitClock
from husky_control.gait.velocity_reference import Pace, VelocityReference
from husky_control.rotation import matrix_from_roll_pitch_yaw, yaw_of
from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.gravity import GRAVITY
from husky_description.kinematics import LEGS, LegTargets

if TYPE_CHECKING:
    from husky_control.parameters import Parameters
    from husky_description.robot import Robot


STOP_SPEED = 0.10  # m/s, of the velocity error, below which feet may stay down when walking stops
CATCH_UP_SHARE = 0.3  # of its greatest speed, at which a static gait makes up for position error
RANGE_MARGIN = 0.03  # rad, that joint targets keep from the ends of their ranges
READY_SHARE = 0.7  # of the gait's static margin, at which a leg of the crawl may lift


class Walking:
    """Keeps the body over its feet, and steps when it is allowed to.

    All takes place in the frame of the ground, see `Ground`.

    Attributes:
        ground: that is walked on.
        clock: of the gait.
        reference: desired velocity and heading.
        stepping: feet may lift off.
        joint_position, joint_velocity, joint_torque: targets (12,) [rad, rad/s, N m].
        body_position, body_velocity, body_rotation: of the reference body [m, m/s].
        foothold: of the swinging feet, their centres, (4, 3) m; z is the expected ground's.
        out_of_reach: feet and joint targets beyond their range, since it was made.
    """

    def __init__(self, robot: Robot, parameters: Parameters, gait: Gait) -> None:
        """A body at rest with all feet on level ground."""
        self.parameters = parameters
        self.mass = float(robot.mass)
        self.ground = LEVEL_GROUND
        self.clock = GaitClock(gait)
        self.reference = VelocityReference(parameters)
        self.stepping = False
        self.out_of_reach = 0
        self.body_position = np.zeros(3)
        self.body_velocity = np.zeros(3)
        self.body_rotation = np.eye(3)
        self._legs = LegTargets(robot, RANGE_MARGIN)
        self.joint_position, self.joint_velocity, self.joint_torque = self._legs.joints
        self._steps = Steps(self._legs.geometry, parameters, self.clock, robot.size.length)
        self._bearing = Bearing(robot, parameters, self._legs)
        paths = self._steps.paths
        self.foothold = paths.foothold
        anchor, blend = np.zeros((2, LEGS, 3))
        self._feet = FeetInGround(
            self.clock.swinging, anchor, blend, paths.position, paths.velocity
        )
        self._foot_targets = Compiled(foot_targets)
        self._lifting = False
        self._hold = False  # the clock waits for the sway
        self._velocity_at_event = np.zeros(2)
        self._sway, self._sway_leg = Sway(), -1
        self._hop = Hop()
        self._stand_height = float(robot.stand_height)
        self._foot_radius = float(robot.foot_radius)
        self._height = self._stand_height  # m, of the body over the feet's plane
        self._plane_height = 0.0  # m, of the feet's plane
        self._load = np.zeros(LEGS)
        self._stray = np.zeros(2)  # m, from the estimated body to the reference body

    def begin(self, rotation: Array, position: Array, foot_in_base: Array, gait: Gait) -> None:
        """Take over a standing robot whose legs were commanded to place the feet at foot_in_base.

        Args:
            rotation: (3, 3), base to world.
            position: (3,) m, base in world.
            foot_in_base: (4, 3) m.
            gait: the gait to walk in when stepping begins.
        """
        self.stepping = self._lifting = self._hold = False
        self.clock.start(gait)
        yaw = yaw_of(rotation)
        self.reference.reset(position, yaw)
        matrix_from_roll_pitch_yaw(0.0, 0.0, yaw, self.body_rotation)
        self._height = float(-foot_in_base[:, 2].mean())
        self._plane_height = float(position[2]) - self._height
        self.body_position[:] = position
        self.body_velocity.fill(0.0)
        self._stray.fill(0.0)
        self._feet.anchor[:] = self.body_position + foot_in_base @ self.body_rotation.T
        self._feet.blend.fill(0.0)
        self._legs.feet.position[:] = foot_in_base
        self._bearing.share.fill(1.0)
        self._sway.reset()
        self._hop = Hop()
        self.joint_velocity.fill(0.0)

    def start_stepping(self, gait: Gait, position: Array) -> None:
        """Let the feet lift off, in a gait."""
        self.clock.start(gait)
        self.stepping, self._hold = True, False
        self.reference.reset(position, self.reference.yaw)
        self._sway.reset()
        self._sway_leg = -1
        self._hop.touchdown(0.0, 0.0, gait.hop_speed)
        self._steps.begin()

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
        """Return whether feet step, or the body still comes to rest from a hop.

        A static gait that slows down sways for its last steps too, with all feet on the ground.
        """
        clock = self.clock
        landing = clock.gait.hop_speed > 0.0 and abs(self._hop.height) > 1e-3
        slowing = clock.gait.static_margin > 0.0 and self._lifting
        return self.stepping or landing or slowing or bool(clock.swinging.any())

    def stand_on(self, ground: Ground) -> None:
        """Walk on a ground from now on; what is remembered turns with its frame."""
        if ground.plane is not self.ground.plane:
            self._turn(ground.plane @ self.ground.plane.T)
        self.ground = ground

    def tick(self, body: BodyInGround, feet: FeetState, lift: float, dt: float) -> None:
        """Compute joint_position, joint_velocity and joint_torque of one tick.

        Args:
            body: measured and estimated.
            feet: measured and estimated.
            lift: of the fans, away from the ground [N].
            dt: s.
        """
        p, clock = self.parameters, self.clock
        yaw, static = yaw_of(body.rotation), clock.gait.static_margin > 0.0
        self._follow_command(yaw, body.position, dt)
        sways = static and self._moving()
        hold = self._hold = sways and self._sway_body(body.position, feet.in_ground, dt)
        # A hop once begun is finished: what counts is what was decided at its touchdown.
        hops = clock.gait.hop_speed > 0.0
        self._lifting = self._hop.end_speed > 0.0 if hops else self._again(body.velocity)
        clock.tick(feet.contact, self._lifting, p["walk.late_limit"], 0.0 if hold else dt)
        moving = self._moving()
        anew = self._note_events(body, feet)
        self._move_body(body.velocity, moving, hold, dt)
        self._stray[:] = self.body_position[:2] - body.position[:2]
        if moving:
            approach = self._approach(yaw, body) if anew else None
            self._steps.tick(self.ground, self._plane_height, approach, dt)
        if (static or not moving) and not clock.swinging.any() and feet.contact.all():
            self._even_out(feet, dt)
        decay = math.exp(-dt / max(p["walk.touchdown_blend"], 1e-4))
        self._foot_targets.call(
            self._feet,
            body,
            ReferenceBody(
                self.body_rotation,
                self.body_position,
                self.body_velocity,
                0.0 if hold else float(self.reference.ramped[2]),
            ),
            self._legs.joints,
            Rolling(self._foot_radius, decay, dt),
            self._legs.feet,
        )
        self._bearing.shift(clock, moving=moving, dt=dt)
        weight = self.mass * (self._hop.acceleration + self.ground.gravity) * p["walk.weight_share"]
        carried = max(0.0, weight - lift)
        self._bearing.carry(body, feet.in_base, self.ground, carried, self._height)
        self.out_of_reach += self._legs.place_feet()

    def _follow_command(self, yaw: float, position: Array, dt: float) -> None:
        """Advance the desired velocity."""
        gait, sway, pace = self.clock.gait, self._sway.offset, Pace()
        if gait.static_margin > 0.0:
            # Up to speed in one cycle: the body must not run ahead of feet that wait their turn.
            acceleration = gait.max_speed / gait.period
            yaw_acceleration = gait.max_yaw_rate / gait.period
            pace = Pace(CATCH_UP_SHARE * gait.max_speed, acceleration, yaw_acceleration)
        x, y = float(position[0]) - sway[0], float(position[1]) - sway[1]
        self.reference.tick(yaw, x, y, pace, self._hold, dt)

    def _again(self, velocity: Array) -> bool:
        """Whether feet shall lift again: until the body is as slow as it is asked to be."""
        if self.stepping or not self.reference.at_rest:
            return True
        speed = math.hypot(velocity[0], velocity[1])
        return self.clock.gait.static_margin == 0.0 and speed >= STOP_SPEED

    def _sway_body(self, position: Array, foot_in_ground: Array, dt: float) -> bool:
        """Sway over the triangle of the feet that stay; True while the clock must wait for it."""
        clock, sway, p = self.clock, self._sway, self.parameters
        swinging = [leg for leg in range(LEGS) if clock.swinging[leg]]
        leg, wait = (swinging[0], 0.0) if swinging else clock.next_to_lift()
        margin, rotation = clock.gait.static_margin, self.body_rotation
        # The centre of mass, not the base's origin, goes over the feet.
        center = self._bearing.center
        cx = float(rotation[0, 0] * center[0] + rotation[0, 1] * center[1])
        cy = float(rotation[1, 0] * center[0] + rotation[1, 1] * center[1])
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
        sway.move_towards(shift * side[0], shift * side[1], p["walk.sway_limit"], dt)
        gate = p["walk.static_load_time"]
        if swinging or not gate < wait <= gate + 2.0 * dt:
            return False
        # The zero-moment point, not only the centre of mass, must be inside when the leg unloads.
        x, y = float(position[0]), float(position[1])
        zmp = (x + cx - lever * sway.acceleration[0], y + cy - lever * sway.acceleration[1])
        others = [k for k in range(LEGS) if k != leg]
        return static_margin(zmp, foot_in_ground[others]) < READY_SHARE * margin

    def _shift(
        self, leg: int, path: tuple[float, float], side: tuple[float, float], margin: float
    ) -> float:
        """Sway sideways that a leg's swing needs, from its beginning to its end, m."""
        desired = self.reference.velocity
        corners = [self._feet.anchor[k] for k in range(LEGS) if k != leg]
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
            if static:
                body[:2] = self._sway.velocity + (0.0 if hold else desired)
            else:
                most = self.parameters["walk.hold_back"]
                lag = (1.0 - gait.velocity_follow) * (velocity[:2] - desired)
                body[:2] = velocity[:2] - np.minimum(most, np.maximum(-most, lag))
            height = gait.stance_height - self.ground.sink
            if gait.hop_speed > 0.0 and not self.clock.swinging[0]:
                self._hop.follow(self.clock.stance_progress, self.clock.stance_time)
                hop = self._hop.height
        else:
            self._sway.reset()
            self._hop.height = self._hop.acceleration = self._hop.end_speed = 0.0
            centre = self._feet.anchor[:, :2].mean(axis=0) - self.ground.shift
            body[:2] = np.clip(2.0 * (centre - self.body_position[:2]), -0.05, 0.05)
            if not self._lifting:  # else the body would follow its feet as they step on
                self.reference.position[:] = centre
            height = self._stand_height + self.parameters["stand.height_offset"] - self.ground.sink
        limit = self.parameters["walk.height_rate"] * dt
        step = min(limit, max(-limit, height - self._height))
        self._height += step
        body[2] = step / dt + (self._hop.speed if hop else 0.0)
        self.body_position[:2] += body[:2] * dt
        self.body_position[2] = self._plane_height + self._height + hop
        matrix_from_roll_pitch_yaw(0.0, self.ground.pitch, self.reference.yaw, self.body_rotation)

    def _turn(self, turn: Array) -> None:
        """Express all that is remembered in a frame of the ground that has turned.

        Args:
            turn: (3, 3), the old frame to the new one, about their common origin.
        """
        # A point that is off by the stray turns to another height than the feet.
        self.body_position[:2] -= self._stray
        self._feet.anchor[:, :2] -= self._stray
        self._stray.fill(0.0)
        below = np.array([self.body_position[0], self.body_position[1], self._plane_height])
        lag = self.reference.position - self.body_position[:2]
        yaw = self.reference.yaw
        self._steps.turn(turn, self._plane_height)
        self._plane_height = float(turn[2] @ below)
        self._feet.anchor[:] = self._feet.anchor @ turn.T
        self.body_position[:] = turn @ self.body_position
        self.body_velocity[:] = turn @ self.body_velocity
        self.reference.position[:] = self.body_position[:2] + lag
        ahead = turn @ np.array([math.cos(yaw), math.sin(yaw), 0.0])
        self.reference.yaw = math.atan2(float(ahead[1]), float(ahead[0]))

    def _note_events(self, body: BodyInGround, feet: FeetState) -> bool:
        """Latch what belongs to touchdowns and liftoffs; True where footholds are placed (T13)."""
        clock, event = self.clock, False
        for leg in range(LEGS):
            if clock.touchdown[leg]:
                event = True
                self._touchdown(leg, body, feet)
            elif clock.liftoff[leg]:
                event = True
                target = self._legs.feet.position[leg]
                self._steps.lift(leg, body.position + body.rotation @ target)
        dx, dy = body.velocity[:2] - self._velocity_at_event
        if event or math.hypot(dx, dy) >= self.parameters["foothold.disturbance"]:
            self._velocity_at_event[:] = body.velocity[:2]
            return True
        return False

    def _touchdown(self, leg: int, body: BodyInGround, feet: FeetState) -> None:
        """Latch a foot that has come down, and the height of the ground under the feet."""
        clock, follow = self.clock, self.parameters["walk.terrain_follow"]
        standing = [k for k in range(LEGS) if not clock.swinging[k]]
        height = sum(float(feet.in_ground[k, 2]) for k in standing) / len(standing)
        self._plane_height += 0.5 * (height - self._plane_height)
        if clock.gait.hop_speed > 0.0 and len(standing) == int(clock.touchdown.sum()):
            speed = min(0.0, max(-1.5, float(body.velocity[2])))
            raised = float(body.position[2]) - self._plane_height - self._height
            again = clock.gait.hop_speed if self._again(body.velocity) else 0.0
            self._hop.touchdown(raised, speed, again)
        anchor = self.body_position + body.rotation @ feet.in_base[leg]
        anchor[2] = self._plane_height + follow * (feet.in_ground[leg, 2] - self._plane_height)
        self._feet.anchor[leg] = anchor
        raw = self.body_rotation.T @ (anchor - self.body_position)
        self._feet.blend[leg] = self._legs.feet.position[leg] - raw
        self._bearing.share[leg] = 0.0

    def _approach(self, yaw: float, body: BodyInGround) -> Approach:
        """Return how the body comes to its footholds, without its sway."""
        sway, (shift_x, shift_y) = self._sway, self.ground.shift
        x, y = (body.position[:2] - sway.offset).tolist()
        vx, vy = (body.velocity[:2] - sway.velocity).tolist()
        wish_x, wish_y = self.reference.velocity.tolist()
        yaw_rate = float(self.reference.ramped[2])
        return Approach((x + shift_x, y + shift_y), (vx, vy), yaw, (wish_x, wish_y), yaw_rate)

    def _even_out(self, feet: FeetState, dt: float) -> None:
        """Let four standing feet share the load: legs yield where they press against each other."""
        internal_load(feet.in_base, feet.force, self._legs.feet.force, self._load)
        rate = self.parameters["walk.load_compliance"] * dt
        self._feet.anchor[:, 2] += rate * np.clip(self._load, -20.0, 20.0)
