"""Legs that know nothing of the ground: a posture, and steps with the feet in the base's frame.

Feet go up and down whatever the body does, in place as under the propulsion unit in the gantry
(T40), or at a velocity, as the position-based trot of the thesis (T18).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from husky_control.gait.swing import SwingPaths, SwingShape, swing_feet
from husky_control.gait.table import Gait, GaitClock
from husky_control.posture import PostureMove
from husky_description.arrays import Array
from husky_description.kinematics import LEGS, LegTargets, forward_kinematics

if TYPE_CHECKING:
    from husky_description.robot import Robot

IN_PLACE = 0.005
"""How far from its place a foot may stay at the end of the steps [m]."""


class Suspended:
    """Joint targets of a robot that hangs, or trots blindly.

    Attributes:
        clock: of the gait, for telemetry.
        treading: feet are to lift off when the gait says so; else they come to rest.
        velocity: of the body over the feet that stand: ahead, left [m/s], turning [rad/s] (3,).
        joint_position: targets (12,) [rad].
        joint_velocity: targets (12,) [rad/s].
    """

    def __init__(self, robot: Robot, gait: Gait) -> None:
        """Legs at zero, at rest."""
        self.clock = GaitClock(gait)
        self._legs = LegTargets(robot)
        self.joint_position, self.joint_velocity, _ = self._legs.joints
        self._move = PostureMove()
        self.treading = False
        self.velocity = np.zeros(3)
        self._nominal = np.zeros((LEGS, 3))
        start, foothold, over_ground = np.zeros((3, LEGS, 3))
        self._paths = SwingPaths(start, foothold, self._legs.feet.position, over_ground)
        self._no_contact = np.zeros(LEGS, dtype=np.bool_)

    def begin(self, start: Array, posture: Array, duration: float) -> None:
        """Move from joint positions `start` to `posture` (12,) [rad] in a time [s], and hold it."""
        self.take_over(posture, posture)
        self._move.start([np.stack((start, posture))], [duration])

    def take_over(self, start: Array, posture: Array) -> None:
        """Go on from joint positions `start`; feet come down where `posture` has them [rad]."""
        self.stop()
        self.velocity.fill(0.0)
        self.clock.start(self.clock.gait)
        legs = self._legs
        for joints, feet in ((start, legs.feet.position), (posture, self._nominal)):
            forward_kinematics(
                legs.geometry, np.ascontiguousarray(joints), feet, legs.placed.jacobian
            )
        self._paths.velocity.fill(0.0)
        self._move.start([], [])

    @property
    def ready(self) -> bool:
        """Whether the posture is reached."""
        return self._move.done

    @property
    def at_rest(self) -> bool:
        """Whether all feet are down, in their places, and none is to lift again."""
        return not (self._stepping or self.clock.swinging.any())

    @property
    def _stepping(self) -> bool:
        """Whether feet are to lift: a foot that is out of its place must step to get there."""
        away = np.abs(self._legs.feet.position[:, :2] - self._nominal[:, :2]).max()
        return self.treading or bool(self.velocity.any()) or float(away) > IN_PLACE

    def tread(self, gait: Gait) -> None:
        """Step in place from now on, in a gait."""
        self.clock.start(gait)
        self.treading = True

    def stop(self) -> None:
        """Let the feet come down where the posture has them, and lift no more."""
        self.treading = False

    def tick(self, dt: float) -> None:
        """Advance the targets by dt [s]."""
        if not self._move.done:
            self._move.tick(dt)
            self.joint_position[:] = self._move.joint_position
            self.joint_velocity[:] = self._move.joint_velocity
            return
        clock, gait = self.clock, self.clock.gait
        clock.tick(self._no_contact, self._stepping, 0.0, dt)
        feet, paths, drift = self._legs.feet, self._paths, self._drift()
        down = ~clock.swinging
        paths.velocity[down] = 0.0
        paths.position[clock.touchdown, 2] = self._nominal[clock.touchdown, 2]
        paths.start[clock.liftoff] = paths.position[clock.liftoff]
        paths.position[:] += drift * dt
        # A foot comes down half a stance's way ahead, at rest on a ground that drifts meanwhile.
        ahead = (1.0 - clock.swing_progress) * clock.swing_time + 0.5 * clock.stance_time
        paths.foothold[:] = self._nominal - ahead[:, None] * drift
        shape = SwingShape(clock.swing_time, gait.swing_height, 0.0, 0.0)
        swing_feet(clock.swinging, clock.swing_progress, paths, shape, dt)
        np.add(paths.velocity, drift, out=feet.velocity)
        self._legs.place_feet()

    def _drift(self) -> Array:
        """Return the velocity of the ground in base, at each foot's place (4, 3) [m/s]."""
        ahead, left, turning = self.velocity
        drift = np.zeros((LEGS, 3))
        drift[:, 0] = turning * self._nominal[:, 1] - ahead
        drift[:, 1] = -turning * self._nominal[:, 0] - left
        return drift
