"""Where a robot's rotors are and which way they push, by its joints where the legs carry them.

The propellers of Husky-beta hang on its femora (T17): splayed by 90 degrees about the hip frontal
axes they point up, and a sweep of the legs about the hip sagittal axes moves them forward and back,
until the centre of lift is at the centre of mass (T19).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_description.parameters import frozen
from husky_description.robot import Robot

_SWEEP = 1.0
"""Sweep of the legs within which the centre of lift is looked for, both ways [rad]."""


class RotorGeometry(NamedTuple):
    """The rotors, ordered as their names, in base's axes.

    Attributes:
        position: of each from what their moments are about [m] (n, 3).
        axis: direction of its thrust, unit vectors (n, 3).
        spin: its sense of rotation about that direction, -1 or 1 (n,).
    """

    position: Array
    axis: Array
    spin: Array

    def effectiveness(self, moment_per_thrust: float) -> Array:
        """Return the matrix from thrusts [N] (n,) to force [N] and moment [N m], (6, n), in base.

        Args:
            moment_per_thrust: steady torque of a rotor on what carries it over its thrust [m].
        """
        drag = -moment_per_thrust * self.spin[:, None] * self.axis
        return np.hstack((self.axis, np.cross(self.position, self.axis) + drag)).T


def rotor_geometry(robot: Robot, joint_position: Array) -> RotorGeometry:
    """Return where propellers are that the legs carry, about the robot's centre of mass.

    Args:
        robot: one with propellers.
        joint_position: [rad] (12,).

    Raises:
        AbsentSection: it has none.
    """
    spin = robot.propellers.spin
    masses = [robot.base_mass, robot.payload_mass]
    centers = [robot.body.center_of_mass, robot.payload_center]
    position, axis = np.empty((4, 3)), np.empty((4, 3))
    for leg, (frontal, sagittal, knee) in enumerate(np.reshape(joint_position, (4, 3))):
        hip = _about_x(frontal)
        thigh = hip @ _about_y(sagittal)
        shin = thigh @ _about_y(knee)
        plane = robot.hip_position[leg] + hip @ (0.0, robot.lateral_offset[leg], 0.0)
        bend = plane + thigh @ (0.0, 0.0, -robot.thigh_length)
        position[leg] = plane + thigh @ robot.propeller_in_thigh[leg]
        axis[leg] = thigh @ (0.0, robot.side[leg], 0.0)
        masses += [robot.hip_mass, robot.thigh_mass, robot.knee_mass, robot.shin_mass]
        centers += [
            plane,
            plane + thigh @ (0.0, 0.0, -robot.thigh_length / 2.0),
            plane + thigh @ robot.knee_pod_in_thigh[leg],
            bend + shin @ (0.0, 0.0, -robot.shin_length / 2.0),
        ]
    center = np.average(centers, axis=0, weights=masses)
    return RotorGeometry(frozen(position - center), frozen(axis), spin)


def fan_geometry(robot: Robot) -> RotorGeometry:
    """Return where fans are that the body carries, about base's origin.

    Raises:
        AbsentSection: it has none.
    """
    position = robot.fan_position
    axis = np.tile((0.0, 0.0, 1.0), (len(position), 1))
    return RotorGeometry(position, frozen(axis), robot.fans.spin)


def flight_posture(robot: Robot) -> Array:
    """Return the joint angles of flight [rad] (12,): level femora, lift at the centre of mass.

    Femur and tibia are parallel to the floor, the knees bent by `propellers.flight_knee` (T19).

    Raises:
        AbsentSection: the robot has no propellers.
    """
    # Here, for it takes a third of a second of each node, of robots without propellers too.
    from scipy.optimize import brentq

    def posture(sweep: float) -> Array:
        legs = [(side * math.pi / 2.0, sweep, robot.propellers.flight_knee) for side in robot.side]
        return np.ravel(legs)

    def ahead(sweep: float) -> float:
        return float(rotor_geometry(robot, posture(sweep)).position[:, 0].mean())

    return frozen(posture(brentq(ahead, -_SWEEP, _SWEEP)))


def _about_x(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c)))


def _about_y(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))
