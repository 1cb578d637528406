"""Flying on the fans: from where the T265 sees the body to an attitude and a collective force.

Position error -> velocity -> acceleration -> tilt (each with a limit); height error -> climb rate
-> force, with an integral that finds the weight. The flight controller holds the attitude. Errors
are taken in the heading frame: x ahead of the body, y to its left, both level.

Without usable poses for `LOST_AFTER` it lands blind: level, on the force that carried it, with the
vertical speed integrated from the IMU.
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from husky_control.estimation.t265_pose import BaseTracker
from husky_control.flight.hover_gains import HoverGains
from husky_control.flight.wished_motion import WishedMotion
from husky_control.slew import slewed
from husky_control.tick_data import T265Pose
from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.robot import Robot

LOST_AFTER = 0.25
"""Time without a usable pose after which the camera counts as lost [s]."""
_LEASH = 0.4
"""How far the place may be ahead of the body as it goes on [m]."""
FAN_LAG = 0.16
"""Of thrust after a command: the rotor's 0.08 s, and as much for the way over MAVLink [s]."""


class HoverPhase(Enum):
    """What a flight is doing."""

    OFF = "off"
    TAKE_OFF = "taking off"
    HOLD = "holding"
    LAND = "landing"
    BLIND = "landing blind"
    WEIGH = "giving the weight to the legs"
    FADE = "thrust fades"


AIRBORNE = frozenset({HoverPhase.HOLD, HoverPhase.LAND, HoverPhase.BLIND})


class Hover:
    """One flight at a time: take-off, hold, landing.

    Attributes:
        phase: see `HoverPhase`.
        force: collective that is asked for, along base z [N].
        attitude: of base in the world of the flight controller, quaternion (x, y, z, w).
        lift: force that the fans are taken to give now [N].
        error: from the body to its place in the heading frame, up [m] (3,).
        velocity: of the body in the heading frame, up [m/s] (3,).
        height: of the body above where it took off [m].
        jumps: of the camera in this flight; the body was not moved by them.
        velocity_wish: velocity of the place over the ground in the heading frame [m/s] (2,).
        yaw_rate: at which the heading that is held turns [rad/s].
        lead: of the heading that the flight controller is told over the one that is held [rad].
        top: height of the hold above where the body took off [m].
        lands_anywhere: it may come down higher or lower than where it took off.
        note: what happened last, in words, "" for nothing.
        failed: why the flight ended by itself, "" if it did not.
    """

    def __init__(self, robot: Robot, gains: HoverGains | None = None) -> None:
        """On the ground, fans off."""
        self.gains = gains or HoverGains()
        self.mass = float(robot.mass)
        self.most = len(robot.rotor_names) * FanModel.of(robot).max_thrust
        self._tracker = BaseTracker(robot)
        self.phase = HoverPhase.OFF
        self.force = self.lift = self.height = 0.0
        self.attitude = np.array([0.0, 0.0, 0.0, 1.0])
        self.error, self.velocity = np.zeros(3), np.zeros(3)
        self.velocity_wish = (0.0, 0.0)
        self.yaw_rate = self.lead = 0.0
        self.top = self.gains.height
        self.lands_anywhere = False
        self.note = self.failed = ""
        self._motion = WishedMotion()  # of the place
        self._place = np.zeros(3)  # in t265_odom; z is the reference on its way
        self._ground = 0.0  # height of the body in t265_odom before take-off
        self._gone = np.zeros(2)  # in t265_odom, of the place since take-off, as was wished [m]
        self._trim = np.zeros(2)
        self._raise = 0.0
        self._yaw = 0.0
        self._full_for = self._still_for = self._down_for = 0.0

    @property
    def active(self) -> bool:
        """Whether the flight controller is to be told an attitude."""
        return self.phase is not HoverPhase.OFF

    @property
    def jumps(self) -> int:
        """How often the camera has jumped, so far."""
        return self._tracker.jumps

    @property
    def heading(self) -> float:
        """That is held, in the world of the flight controller [rad]."""
        return self._yaw

    @property
    def weight(self) -> float:
        """Of the robot as it is configured [N]."""
        return self.mass * GRAVITY

    @property
    def way(self) -> Array:
        """From where the body took off to where it is, in the heading frame, up [m] (3,)."""
        c, s = math.cos(self._tracker.yaw), math.sin(self._tracker.yaw)
        x, y = self._gone.tolist()
        ahead, left, _ = self.error.tolist()
        return np.array((c * x + s * y - ahead, c * y - s * x - left, self.height))

    def begin(self, pose: T265Pose, imu_yaw: float, yaw: float, force: float) -> None:
        """Take off from where the body stands.

        Args:
            pose: a usable one.
            imu_yaw: heading by the IMU [rad].
            yaw: heading to hold, in the world of the flight controller [rad].
            force: that the fans are asked for already [N].
        """
        self._tracker.begin(pose, imu_yaw)
        self._place[:] = self._tracker.position
        self._ground = float(self._place[2])
        self._gone.fill(0.0)
        self._trim.fill(0.0)
        self._motion.reset()
        self._raise = 0.0
        self._yaw = yaw
        self._full_for = self._still_for = self._down_for = 0.0
        self.force = self.lift = force
        self.height = 0.0
        self.error.fill(0.0)
        self.note = self.failed = ""
        self.velocity_wish, self.yaw_rate = (0.0, 0.0), 0.0
        self.lead = 0.0
        self.phase = HoverPhase.TAKE_OFF
        self._tilt(0.0, 0.0)

    def land(self) -> None:
        """Come down, or stay down."""
        if self.phase is HoverPhase.HOLD:
            self.phase = HoverPhase.LAND
            self._still_for = self._down_for = 0.0
        elif self.phase is HoverPhase.TAKE_OFF:
            self.phase = HoverPhase.WEIGH

    def hold(self) -> None:
        """Break a landing off: up again to the height of the hold."""
        if self.phase is HoverPhase.LAND:
            self.phase = HoverPhase.HOLD

    def end(self, *, at_once: bool = False) -> None:
        """Leave flight, whatever is going on: thrust fades, or ends at once."""
        if self.active:
            self.phase = HoverPhase.FADE
            self._tilt(0.0, 0.0)
            if at_once:
                self.force = 0.0

    def fade(self, dt: float) -> None:
        """Let the thrust go after `end`, for dt s; otherwise do nothing."""
        if self.phase is not HoverPhase.FADE:
            return
        self.force = max(0.0, self.force - self.gains.fade_rate * self.weight * dt)
        self._follow_lift(dt)
        if self.lift < 0.02 * self.weight:
            self.phase, self.force, self.lift = HoverPhase.OFF, 0.0, 0.0

    @property
    def done(self) -> bool:
        """Whether the legs have the weight again."""
        weighs = self.phase is HoverPhase.WEIGH
        return weighs and self.lift < 0.05 * self.weight and self.force <= 0.0

    def finish(self) -> None:
        """Landed: fans off."""
        self.phase, self.force, self.lift = HoverPhase.OFF, 0.0, 0.0

    # Every tick ---------------------------------------------------------------------------------
    def tick(
        self,
        time: float,
        pose: T265Pose,
        rotation: Array,
        specific_force: Array,
        feet_down: int,
        imu_yaw: float,
        dt: float,
    ) -> None:
        """Update force and attitude.

        Args:
            time: of the tick [s].
            pose: newest of the camera, usable or not.
            rotation: base to world by the IMU (3, 3).
            specific_force: of base [m/s^2] (3,).
            feet_down: how many feet touch the ground.
            imu_yaw: heading by the IMU [rad].
            dt: [s].
        """
        self._see(time, pose, imu_yaw, float(rotation[2] @ specific_force) - GRAVITY, dt)
        g, phase = self.gains, self.phase
        if phase is HoverPhase.TAKE_OFF:
            self._take_off(dt)
        elif phase in AIRBORNE:
            self._fly(float(rotation[2, 2]), dt)
            if phase is not HoverPhase.HOLD and self._touched(feet_down, dt):
                self.phase = HoverPhase.WEIGH
        if self.phase is HoverPhase.WEIGH:
            self.force = max(0.0, self.force - g.weigh_rate * self.weight * dt)
            self._tilt(0.0, 0.0)
        self._follow_lift(dt)

    def _see(
        self, time: float, pose: T265Pose, imu_yaw: float, acceleration: float, dt: float
    ) -> None:
        """Know where the body is; the camera's delay is bridged with its velocity."""
        tracker = self._tracker
        if self.phase is not HoverPhase.BLIND and pose.stamp > tracker.stamp and pose.usable(time):
            jump = tracker.follow(pose, imu_yaw)
            if jump is not None:
                self._move_place(*jump)
        age = time - tracker.stamp
        if age > LOST_AFTER and self.phase is not HoverPhase.BLIND:
            self._lose(age)
        if self.phase is HoverPhase.BLIND:
            self.velocity[2] += acceleration * dt
            self.height += self.velocity[2] * dt
            self.error[2] = 0.0
            return
        c, s = math.cos(tracker.yaw), math.sin(tracker.yaw)
        vx, vy, vz = tracker.velocity.tolist()
        x, y, z = (self._place - tracker.position - age * tracker.velocity).tolist()
        self.velocity[:] = c * vx + s * vy, c * vy - s * vx, vz
        self.error[:] = c * x + s * y, c * y - s * x, z
        self.height = float(tracker.position[2]) + age * vz - self._ground

    def _move_place(self, expected: Array, expected_yaw: float) -> None:
        """The camera has jumped, the body has not: its place is where it was, seen from it."""
        tracker = self._tracker
        turn = tracker.yaw - expected_yaw
        c, s = math.cos(turn), math.sin(turn)
        x, y, z = (self._place - expected).tolist()
        self._ground += float(tracker.position[2] - expected[2])
        self._place[:] = tracker.position + np.array((c * x - s * y, s * x + c * y, z))
        x, y = self._gone.tolist()
        self._gone[:] = c * x - s * y, s * x + c * y
        self.note = f"T265 jumped by {math.dist(tracker.position, expected):.2f} m: place moved"

    def _lose(self, age: float) -> None:
        """No pose to fly by any more."""
        if self.phase in (HoverPhase.HOLD, HoverPhase.LAND):
            self.phase = HoverPhase.BLIND
        elif self.phase is HoverPhase.TAKE_OFF:
            self.phase = HoverPhase.WEIGH
        else:
            return
        self.note = self.failed = f"T265 lost for {age:.2f} s: landing on the IMU"
        self._still_for = self._down_for = 0.0

    def _take_off(self, dt: float) -> None:
        """Raise the force until the body is off the ground."""
        g = self.gains
        rate = g.take_off_rate if self.force < 0.9 * self.weight else g.last_rate
        self.force = min(self.most, self.force + rate * self.weight * dt)
        share = min(1.0, self.force / self.weight)
        self._steer(share, trim=False, dt=dt)
        if self.height > 0.02:
            self.phase = HoverPhase.HOLD
            self._place[2] = self._ground + self.height
        elif self.force >= self.most:
            self._full_for += dt
            if self._full_for > g.patience:
                self.phase = HoverPhase.WEIGH
                self.note = self.failed = "the fans do not lift the robot"

    def _fly(self, upright: float, dt: float) -> None:
        """Hold the place, go up or down to it."""
        g, blind = self.gains, self.phase is HoverPhase.BLIND
        if blind:
            self._raise -= g.blind_bleed * GRAVITY * dt
            wanted = -g.blind_speed
            self._tilt(0.0, 0.0)
        else:
            self._go_on(dt)
            if self.phase is HoverPhase.HOLD:
                self._yaw += self.yaw_rate * dt
                top = self._ground + self.top
                step, lead = g.climb_speed * dt, 0.1
                self._place[2] = slewed(self._place[2], top, step)
            else:
                lead = 0.1
                self._place[2] -= g.sink_speed * dt
            # The reference does not run away from a body that cannot follow.
            here = self._ground + self.height
            self._place[2] = min(here + lead, max(here - lead, self._place[2]))
            error = _within(float(self._place[2]) - here, lead)
            wanted = g.height_gain * error
            if self.phase is HoverPhase.LAND:
                wanted = max(-1.3 * g.sink_speed, wanted - 0.5 * g.sink_speed)
            elif self._place[2] < self._ground + self.top - 1e-6:
                wanted = min(g.climb_speed, wanted + 0.5 * g.climb_speed)
            self._steer(1.0, trim=True, dt=dt)
            full = self.force >= self.most and error > 0.0
            if not full:
                self._raise = _within(self._raise + g.lift_gain * error * dt, g.lift_limit)
        acceleration = g.climb_gain * (wanted - float(self.velocity[2])) + self._raise
        force = self.mass * (GRAVITY + acceleration) / max(0.9, upright)
        self.force = min(self.most, max(0.5 * self.weight, force))

    def _go_on(self, dt: float) -> None:
        """Move the place as is wished, in the hold; in a landing come to a stop."""
        wish = self.velocity_wish if self.phase is HoverPhase.HOLD else (0.0, 0.0)
        ahead, left = self._motion.advance(wish, dt).tolist()
        if ahead or left:
            c, s = math.cos(self._tracker.yaw), math.sin(self._tracker.yaw)
            here = self._place[:2] - self._tracker.position[:2]
            way = dt * np.array((c * ahead - s * left, s * ahead + c * left))
            # The place does not run away from a body that cannot follow.
            if math.hypot(*(here + way)) < max(_LEASH, math.hypot(*here)):
                self._place[:2] += way
                self._gone += way

    def _steer(self, share: float, *, trim: bool, dt: float) -> None:
        """Tilt towards the place; on the ground less, by the share of the weight in the air."""
        g, motion = self.gains, self._motion
        wanted = [0.0, 0.0]
        for axis in range(2):
            error = float(self.error[axis])
            if trim and not self._motion.moves:  # what a body lags behind on its way is no wind
                grown = float(self._trim[axis]) + g.trim_gain * _within(error, 0.2) * dt
                self._trim[axis] = _within(grown, g.trim_limit)
            speed = _within(g.position_gain * error, g.speed_limit) + float(motion.velocity[axis])
            brake = g.velocity_gain * (speed - float(self.velocity[axis]))
            wanted[axis] = share * (brake + float(self._trim[axis]) + float(motion.push[axis]))
        size, most = math.hypot(*wanted), GRAVITY * math.tan(g.tilt_limit)
        scale = min(1.0, most / size) if size > 0.0 else 1.0
        self._tilt(scale * wanted[0], scale * wanted[1])

    def _tilt(self, forward: float, left: float) -> None:
        """Set the attitude that accelerates the body, m/s^2 in the heading frame."""
        roll = math.atan2(-left, math.hypot(GRAVITY, forward))
        pitch = math.atan2(forward, GRAVITY)
        cr, sr = math.cos(roll / 2), math.sin(roll / 2)
        cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
        yaw = self._yaw + self.lead
        cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
        self.attitude[:] = (
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
            cy * cp * cr + sy * sp * sr,
        )

    def _touched(self, feet_down: int, dt: float) -> bool:
        """Whether the feet have come down: they feel it, or the body does not sink any further."""
        speed, g = float(self.velocity[2]), self.gains
        self._down_for += dt
        if self.phase is HoverPhase.BLIND:
            slow = self._down_for > 1.0 and speed > -0.5 * g.blind_speed
            down, patience = feet_down >= 2 or slow or self.height < -0.05, 0.1
        else:
            slow = abs(speed) < 0.05 and (self.lands_anywhere or self.height < 0.5 * g.height)
            down = feet_down >= 3 or (slow and self.height < 0.03)
            # Anywhere lower than halfway it may be the ground, too, but for the first moments.
            patience = 0.1 if down else 0.5
            down = down or (slow and self._down_for > 1.0)
        self._still_for = self._still_for + dt if down else 0.0
        return self._still_for > patience

    def _follow_lift(self, dt: float) -> None:
        self.lift += (self.force - self.lift) * min(1.0, dt / FAN_LAG)


def _within(value: float, limit: float) -> float:
    return min(limit, max(-limit, value))
