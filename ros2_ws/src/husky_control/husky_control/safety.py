"""Safety checks of one tick: each says in words why it trips."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.kinematics import JOINTS

if TYPE_CHECKING:
    from husky_control.parameters import Parameters
    from husky_control.tick_data import JointCommand, Measurements
    from husky_description.robot import Robot


class JointLimits(NamedTuple):
    """What the joints may do, (12,) each."""

    lower: Array  # rad
    upper: Array  # rad
    velocity: Array  # rad/s
    torque: Array  # N m


@njit(cache=True)
def check_joints(
    position: Array,
    torque: Array,
    limits: JointLimits,
    margin: float,
    share: float,
    dt: float,
    overload: Array,
) -> tuple[int, int]:
    """Check the joints of one tick.

    Args:
        position: (12,) rad.
        torque: (12,) N m.
        limits: of the joints.
        margin: rad that a joint may be beyond its range.
        share: of the torque's limit that counts as overload.
        dt: s.
        overload: (12,) s of overload, counted up by overload and down without, updated.

    Returns:
        The first joint out of range and the joint overloaded for longest, or -1.
    """
    outside, longest = -1, -1
    for i in range(JOINTS):
        least, most = limits.lower[i] - margin, limits.upper[i] + margin
        if outside < 0 and not least <= position[i] <= most:
            outside = i
        overloaded = abs(torque[i]) >= share * limits.torque[i]
        overload[i] = overload[i] + dt if overloaded else max(0.0, overload[i] - dt)
        if overload[i] > 0.0 and (longest < 0 or overload[i] > overload[longest]):
            longest = i
    return outside, longest


@njit(cache=True)
def limit_command(position: Array, velocity: Array, effort: Array, limits: JointLimits) -> None:
    """Cut the targets (12,) of a command to the joints' limits: rad, rad/s, N m."""
    for i in range(JOINTS):
        fastest, strongest = limits.velocity[i], limits.torque[i]
        position[i] = min(limits.upper[i], max(limits.lower[i], position[i]))
        velocity[i] = min(fastest, max(-fastest, velocity[i]))
        effort[i] = min(strongest, max(-strongest, effort[i]))


class Safety:
    """Judges each tick's measurements while the robot is active."""

    def __init__(self, robot: Robot, parameters: Parameters) -> None:
        """Checks for one robot with live limits."""
        self.parameters = parameters
        self.joint_names = tuple(robot.joint_names)
        limits = (
            robot.joint_lower,
            robot.joint_upper,
            robot.joint_velocity_limit,
            robot.joint_torque_limit,
        )
        self._limits = JointLimits(*(np.array(limit, dtype=np.float64) for limit in limits))
        self._overload = np.zeros(JOINTS)
        self._check, self._limit = Compiled(check_joints), Compiled(limit_command)

    def reset(self) -> None:
        """Forget past overload."""
        self._overload.fill(0.0)

    def limit(self, command: JointCommand) -> JointCommand:
        """Keep a command within the joints' limits: the drives refuse one that is not, whole."""
        self._limit.call(command.position, command.velocity, command.effort, self._limits)
        return command

    def stale(self, m: Measurements) -> str | None:
        """Why the measurements are too old, or None."""
        p = self.parameters
        if m.joint_age_ticks > p["safety.joint_age"]:
            return f"joint states are {m.joint_age_ticks} ticks old"
        if m.imu_age > p["safety.imu_age"]:
            return f"IMU sample is {1e3 * m.imu_age:.1f} ms old"
        return None

    def check(self, m: Measurements, tilt: float, dt: float) -> str | None:
        """Why the robot must give up, or None.

        Args:
            m: the tick's.
            tilt: rad, of the body from where it is to point.
            dt: s.
        """
        p, limits = self.parameters, self._limits
        margin, share = p["safety.joint_margin"], p["safety.torque_share"]
        outside, longest = self._check.call(
            m.joint_position, m.joint_torque, limits, margin, share, dt, self._overload
        )
        if not m.drives_operational:
            return "drives are not operational"
        reason = self.stale(m)
        if reason is not None:
            return reason
        if tilt > p["safety.max_tilt"]:
            return f"body is tilted by {tilt:.2f} rad (limit {p['safety.max_tilt']:.2f})"
        if outside >= 0:
            return (
                f"joint {self.joint_names[outside]} is out of range at "
                f"{m.joint_position[outside]:.2f} rad "
                f"({limits.lower[outside]:.2f} to {limits.upper[outside]:.2f})"
            )
        if longest >= 0 and self._overload[longest] > p["safety.torque_time"]:
            return (
                f"joint {self.joint_names[longest]} at its torque limit "
                f"for {self._overload[longest]:.2f} s"
            )
        return None
