"""Safety checks of one tick: each says in words why it trips."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.kinematics import JOINTS

if TYPE_CHECKING:
    from husky_control.parameters import Parameters
    from husky_description.robot import Robot

Array = NDArray[np.float64]


@njit(cache=True)
def check_joints(
    position: Array,
    torque: Array,
    lower: Array,
    upper: Array,
    limit: Array,
    margin: float,
    share: float,
    dt: float,
    overload: Array,
) -> tuple[int, int]:
    """Check the joints of one tick.

    Args:
        position: (12,) rad.
        torque: (12,) N m.
        lower: (12,) rad.
        upper: (12,) rad.
        limit: (12,) N m.
        margin: rad that a joint may be beyond its range.
        share: of the limit that counts as overload.
        dt: s.
        overload: (12,) s of overload, counted up by overload and down without, updated.

    Returns:
        The first joint out of range and the joint overloaded for longest, or -1.
    """
    outside, longest = -1, -1
    for i in range(JOINTS):
        if outside < 0 and not lower[i] - margin <= position[i] <= upper[i] + margin:
            outside = i
        overloaded = abs(torque[i]) >= share * limit[i]
        overload[i] = overload[i] + dt if overloaded else max(0.0, overload[i] - dt)
        if overload[i] > 0.0 and (longest < 0 or overload[i] > overload[longest]):
            longest = i
    return outside, longest


@njit(cache=True)
def all_finite(
    a: Array, b: Array, c: Array, d: Array, e: Array, f: Array
) -> bool:
    """Whether all numbers of six vectors are finite."""
    total = 0.0
    for vector in (a, b, c, d, e, f):
        for value in vector:
            total += value * 0.0  # nan for nan and for infinity
    return total == 0.0


@njit(cache=True)
def limit_command(
    position: Array,
    velocity: Array,
    effort: Array,
    lower: Array,
    upper: Array,
    velocity_limit: Array,
    torque_limit: Array,
) -> None:
    """Cut the targets (12,) of a command to the joints' limits: rad, rad/s, N m."""
    for i in range(JOINTS):
        position[i] = min(upper[i], max(lower[i], position[i]))
        velocity[i] = min(velocity_limit[i], max(-velocity_limit[i], velocity[i]))
        effort[i] = min(torque_limit[i], max(-torque_limit[i], effort[i]))


class Safety:
    """Judges each tick's measurements while the robot is active."""

    def __init__(self, robot: Robot, parameters: Parameters) -> None:
        """Checks for one robot with live limits."""
        self.parameters = parameters
        self.joint_names = tuple(robot.joint_names)
        self._lower = np.array(robot.joint_lower, dtype=np.float64)
        self._upper = np.array(robot.joint_upper, dtype=np.float64)
        self._limit = np.array(robot.joint_torque_limit, dtype=np.float64)
        self._overload = np.zeros(JOINTS)

    def reset(self) -> None:
        """Forget past overload."""
        self._overload.fill(0.0)

    def stale(self, joint_age_ticks: int, imu_age: float) -> str | None:
        """Why the measurements are too old, or None."""
        p = self.parameters
        if joint_age_ticks > p["safety.joint_age"]:
            return f"joint states are {joint_age_ticks} ticks old"
        if imu_age > p["safety.imu_age"]:
            return f"IMU sample is {1e3 * imu_age:.1f} ms old"
        return None

    def check(
        self,
        joint_position: Array,
        joint_torque: Array,
        tilt: float,
        joint_age_ticks: int,
        imu_age: float,
        drives_operational: bool,
        dt: float,
    ) -> str | None:
        """Why the robot must give up, or None.

        Args:
            joint_position: (12,) rad.
            joint_torque: (12,) N m.
            tilt: rad, of the body from the vertical.
            joint_age_ticks: age of the joint states in ticks.
            imu_age: s, age of the IMU sample.
            drives_operational: whether all drives follow commands.
            dt: s.
        """
        p = self.parameters
        outside, longest = check_joints(
            joint_position,
            joint_torque,
            self._lower,
            self._upper,
            self._limit,
            p["safety.joint_margin"],
            p["safety.torque_share"],
            dt,
            self._overload,
        )
        if not drives_operational:
            return "drives are not operational"
        reason = self.stale(joint_age_ticks, imu_age)
        if reason is not None:
            return reason
        if tilt > p["safety.max_tilt"]:
            return f"body is tilted by {tilt:.2f} rad (limit {p['safety.max_tilt']:.2f})"
        if outside >= 0:
            return (
                f"joint {self.joint_names[outside]} is out of range at "
                f"{joint_position[outside]:.2f} rad "
                f"({self._lower[outside]:.2f} to {self._upper[outside]:.2f})"
            )
        if longest >= 0 and self._overload[longest] > p["safety.torque_time"]:
            return (
                f"joint {self.joint_names[longest]} at its torque limit "
                f"for {self._overload[longest]:.2f} s"
            )
        return None
