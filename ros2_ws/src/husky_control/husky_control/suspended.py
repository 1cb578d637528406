"""Legs of a robot that hangs: a posture, and stepping in place with the feet in the base's frame.

Nothing is known of the ground, so feet go up and down under their hips whatever the body does: the
position-based trot of the thesis (T18), as under the propulsion unit in the gantry (T40).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from husky_control.gait import Gait, GaitClock
from husky_control.kinematics import JOINTS, LEGS, forward_kinematics, leg_commands, leg_geometry
from husky_control.posture import PostureMove
from husky_control.swing import swing_feet

if TYPE_CHECKING:
    from husky_description.robot import Robot

Array = NDArray[np.float64]


class Suspended:
    """Joint targets of a hanging robot.

    Attributes:
        clock: of the gait, for telemetry.
        joint_position: targets (12,) [rad].
        joint_velocity: targets (12,) [rad/s].
    """

    def __init__(self, robot: Robot, gait: Gait) -> None:
        """Legs at zero, at rest."""
        self.clock = GaitClock(gait)
        self.joint_position = np.zeros(JOINTS)
        self.joint_velocity = np.zeros(JOINTS)
        self._geometry = leg_geometry(robot)
        self._lower = np.array(robot.joint_lower)
        self._upper = np.array(robot.joint_upper)
        self._move = PostureMove()
        self._treading = False
        self._nominal = np.zeros((LEGS, 3))
        self._place = np.zeros((LEGS, 2))
        self._ground = np.zeros(LEGS)
        self._foot = np.zeros((LEGS, 3))
        self._foot_velocity = np.zeros((LEGS, 3))
        self._no_force = np.zeros((LEGS, 3))
        self._torque = np.zeros(JOINTS)
        self._scratch_foot = np.zeros((LEGS, 3))
        self._scratch_jacobian = np.zeros((LEGS, 3, 3))
        self._no_contact = np.zeros(LEGS, dtype=np.bool_)

    def begin(self, start: Array, posture: Array, duration: float) -> None:
        """Move from joint positions `start` to `posture` (12,) [rad] in a time [s], and hold it."""
        self._treading = False
        self.clock.start(self.clock.gait)
        self._move.start([np.stack((start, posture))], [duration])
        forward_kinematics(
            self._geometry, np.ascontiguousarray(posture), self._nominal, self._scratch_jacobian
        )
        self._foot[:] = self._nominal
        self._place[:], self._ground[:] = self._nominal[:, :2], self._nominal[:, 2]
        self._foot_velocity.fill(0.0)

    @property
    def ready(self) -> bool:
        """Whether the posture is reached."""
        return self._move.done

    @property
    def at_rest(self) -> bool:
        """Whether all feet are down and none is to lift again."""
        return not (self._treading or self.clock.swinging.any())

    def tread(self, gait: Gait) -> None:
        """Step in place from now on, in a gait."""
        self.clock.start(gait)
        self._treading = True

    def stop(self) -> None:
        """Let the feet in the air come down, and lift no more."""
        self._treading = False

    def tick(self, dt: float) -> None:
        """Advance the targets by dt [s]."""
        if not self._move.done:
            self._move.tick(dt)
            self.joint_position[:] = self._move.joint_position
            self.joint_velocity[:] = self._move.joint_velocity
            return
        clock, gait = self.clock, self.clock.gait
        clock.tick(self._no_contact, self._treading, 0.0, dt)
        down = clock.touchdown | (~clock.swinging)
        self._foot[down] = self._nominal[down]
        self._foot_velocity[down] = 0.0
        swing_feet(
            clock.swinging, clock.swing_progress, clock.swing_time, self._place, self._ground,
            gait.swing_height, 0.0, 0.0, self._ground, dt, self._foot, self._foot_velocity,
        )
        leg_commands(
            self._geometry, self._foot, self._foot_velocity, self._no_force, self._lower,
            self._upper, self._scratch_foot, self._scratch_jacobian, self.joint_position,
            self.joint_velocity, self._torque,
        )
