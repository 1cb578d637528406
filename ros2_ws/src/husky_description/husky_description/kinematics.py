"""Closed-form kinematics of the four legs: foot positions, Jacobians and inverse kinematics.

A parallelogram leg whose ankle link stays parallel to the thigh is exactly a serial leg whose
thigh is thigh + ankle long (T1). All quantities are in the base frame (x forward, y left, z up);
a foot position is the centre of the foot's sphere. The kernels work on the four legs at once and
write into arrays of the caller, so that a control tick allocates nothing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.vectors import (
    Vector,
    dot,
    scaled,
    solve_symmetric,
    transposed_product,
    vector,
    write,
)

if TYPE_CHECKING:
    from husky_description.robot import Robot


LEGS = 4
JOINTS = 12
DAMPING = 1e-4
"""Keeps a straight leg's joints where they are, where joint rates are asked for [m^2]."""


class LegGeometry(NamedTuple):
    """What the kinematics of the legs depend on; lengths in m."""

    hip_position: Array  # (4, 3), hip frontal axes in base
    lateral_offset: Array  # (4,), hip frontal axis to leg plane, positive to the left
    thigh_length: float  # knee to hip sagittal axis, thigh and ankle links together
    shin_length: float  # foot centre to knee axis


def leg_geometry(robot: Robot) -> LegGeometry:
    """The geometry of a robot's legs, as contiguous arrays for the kernels."""
    return LegGeometry(
        np.array(robot.hip_position, dtype=np.float64, order="C"),
        np.array(robot.lateral_offset, dtype=np.float64, order="C"),
        float(robot.thigh_length),
        float(robot.shin_length),
    )


@njit(cache=True)
def forward_kinematics(
    geometry: LegGeometry, joint_position: Array, foot_position: Array, jacobian: Array
) -> None:
    """Foot positions and their Jacobians for 12 joint positions.

    Args:
        geometry: the legs.
        joint_position: (12,) rad, hip frontal, hip sagittal, knee of each leg.
        foot_position: (4, 3) m in base, written.
        jacobian: (4, 3, 3) m/rad, d foot_position_in_base / d joint_position, written.
    """
    l1, l2 = geometry.thigh_length, geometry.shin_length
    for leg in range(LEGS):
        frontal = joint_position[3 * leg]
        sagittal = joint_position[3 * leg + 1]
        shin_angle = sagittal + joint_position[3 * leg + 2]
        ca, sa = math.cos(frontal), math.sin(frontal)
        # In the leg plane: x forward, z along the leg, both from the hip sagittal axis.
        shin_x, shin_z = -l2 * math.sin(shin_angle), -l2 * math.cos(shin_angle)
        x = -l1 * math.sin(sagittal) + shin_x
        z = -l1 * math.cos(sagittal) + shin_z
        d = geometry.lateral_offset[leg]
        y_hip, z_hip = d * ca - z * sa, d * sa + z * ca
        foot_position[leg, 0] = geometry.hip_position[leg, 0] + x
        foot_position[leg, 1] = geometry.hip_position[leg, 1] + y_hip
        foot_position[leg, 2] = geometry.hip_position[leg, 2] + z_hip
        jacobian[leg, 0, 0], jacobian[leg, 1, 0], jacobian[leg, 2, 0] = 0.0, -z_hip, y_hip
        jacobian[leg, 0, 1], jacobian[leg, 1, 1], jacobian[leg, 2, 1] = z, x * sa, -x * ca
        jacobian[leg, 0, 2] = shin_z
        jacobian[leg, 1, 2] = shin_x * sa
        jacobian[leg, 2, 2] = -shin_x * ca


@njit(cache=True)
def inverse_kinematics(geometry: LegGeometry, foot_position: Array, joint_position: Array) -> int:
    """Joint positions that place the feet; a foot out of reach is placed as near as the leg can.

    The knee bends backward (knee angle negative), as the robot stands.

    Args:
        geometry: the legs.
        foot_position: (4, 3) m in base.
        joint_position: (12,) rad, written.

    Returns:
        How many of the four feet were out of reach.
    """
    l1, l2 = geometry.thigh_length, geometry.shin_length
    out_of_reach = 0
    for leg in range(LEGS):
        x = foot_position[leg, 0] - geometry.hip_position[leg, 0]
        y = foot_position[leg, 1] - geometry.hip_position[leg, 1]
        z = foot_position[leg, 2] - geometry.hip_position[leg, 2]
        d = geometry.lateral_offset[leg]
        in_plane = y * y + z * z - d * d
        depth = math.sqrt(in_plane) if in_plane > 0.0 else 0.0
        frontal = math.atan2(z, y) - math.atan2(-depth, d)
        if frontal > math.pi:
            frontal -= 2.0 * math.pi
        elif frontal < -math.pi:
            frontal += 2.0 * math.pi
        cos_knee = (x * x + depth * depth - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
        if in_plane < 0.0 or cos_knee > 1.0 or cos_knee < -1.0:
            out_of_reach += 1
            cos_knee = min(1.0, max(-1.0, cos_knee))
        knee = -math.acos(cos_knee)
        leg_angle = math.atan2(-x, depth)
        sagittal = leg_angle - math.atan2(l2 * math.sin(knee), l1 + l2 * cos_knee)
        joint_position[3 * leg] = frontal
        joint_position[3 * leg + 1] = sagittal
        joint_position[3 * leg + 2] = knee
    return out_of_reach


class LegMasses(NamedTuple):
    """Masses of one leg's links and of the rest of the robot; kg."""

    body: float
    body_center: tuple[float, float, float]  # m in base
    hip: float  # at the plane of the leg
    thigh: float
    shin: float
    knee: float  # fixed to the thigh
    knee_share: float  # of the thigh's length, from the hip, at which that is
    knee_offset: Array  # (4,) m, from the plane of the leg to its centre, positive to the left


def leg_masses(robot: Robot) -> LegMasses:
    """The masses of a robot's links."""
    hip, thigh, shin = float(robot.hip_mass), float(robot.thigh_mass), float(robot.shin_mass)
    knee = float(robot.knee_mass)
    body = float(robot.mass) - LEGS * (hip + thigh + shin + knee)
    moment = robot.base_mass * robot.body.center_of_mass
    x, y, z = ((moment + robot.payload_mass * robot.payload_center) / body).tolist()
    share = robot.leg.thigh_link / robot.thigh_length
    offset = np.array(robot.knee_pod_in_thigh[:, 1]) if knee > 0.0 else np.zeros(LEGS)
    return LegMasses(body, (x, y, z), hip, thigh, shin, knee, share, offset)


@njit(cache=True)
def center_of_mass(
    geometry: LegGeometry,
    masses: LegMasses,
    joint_position: Array,
    foot_position: Array,
    center: Array,
) -> None:
    """Centre of mass in base; links weigh at their middles.

    Args:
        geometry: of the legs.
        masses: of the links.
        joint_position: (12,) rad.
        foot_position: (4, 3) m in base.
        center: (3,) m, written.
    """
    total = masses.body + LEGS * (masses.hip + masses.thigh + masses.shin + masses.knee)
    for i in range(3):
        center[i] = masses.body * masses.body_center[i] / total
    for leg in range(LEGS):
        ca, sa = math.cos(joint_position[3 * leg]), math.sin(joint_position[3 * leg])
        sagittal, d = joint_position[3 * leg + 1], geometry.lateral_offset[leg]
        x = -geometry.thigh_length * math.sin(sagittal)
        z = -geometry.thigh_length * math.cos(sagittal)
        hip = (
            geometry.hip_position[leg, 0],
            geometry.hip_position[leg, 1] + d * ca,
            geometry.hip_position[leg, 2] + d * sa,
        )
        knee = (hip[0] + x, hip[1] - z * sa, hip[2] + z * ca)
        offset = masses.knee_offset[leg]
        aside = (0.0, offset * ca, offset * sa)
        for i in range(3):
            center[i] += (
                masses.hip * hip[i]
                + masses.thigh * 0.5 * (hip[i] + knee[i])
                + masses.shin * 0.5 * (knee[i] + foot_position[leg, i])
                + masses.knee * (hip[i] + masses.knee_share * (knee[i] - hip[i]) + aside[i])
            ) / total


class JointRange(NamedTuple):
    """Least and greatest joint targets; rad."""

    lower: Array  # (12,)
    upper: Array  # (12,)


class FootTargets(NamedTuple):
    """What the feet are to do, in base."""

    position: Array  # (4, 3) m
    velocity: Array  # (4, 3) m/s, relative to the base
    force: Array  # (4, 3) N, of the ground on the foot


class JointTargets(NamedTuple):
    """What the joints are to do for it."""

    position: Array  # (12,) rad
    velocity: Array  # (12,) rad/s
    torque: Array  # (12,) N m, that holds against the foot force: -J^T f


class PlacedLegs(NamedTuple):
    """Where joint targets place the feet."""

    foot: Array  # (4, 3) m in base
    jacobian: Array  # (4, 3, 3) m/rad in base


@njit(cache=True)
def solve_leg(jacobian: Array, foot: Vector, damping: float) -> Vector:
    """Return the joint rates [rad/s] that move one foot at a velocity: J^-1 foot, damped.

    Solves (J J^T + damping I) y = foot and gives J^T y, which stays bounded for a straight leg.

    Args:
        jacobian: (3, 3) m/rad, of the leg.
        foot: m/s in base.
        damping: m^2; 0 gives the plain inverse.
    """
    x, y, z = vector(jacobian[0]), vector(jacobian[1]), vector(jacobian[2])
    diagonal = dot(x, x) + damping, dot(y, y) + damping, dot(z, z) + damping
    beside = dot(x, y), dot(x, z), dot(y, z)
    return transposed_product(jacobian, solve_symmetric(diagonal, beside, foot))


@njit(cache=True)
def leg_commands(
    geometry: LegGeometry,
    limits: JointRange,
    feet: FootTargets,
    placed: PlacedLegs,
    joints: JointTargets,
) -> int:
    """Write joint targets for foot targets: inverse kinematics, rates, torques of foot forces.

    `placed` and `joints` are written.

    Returns:
        How many feet were out of reach, and joint targets beyond their range.
    """
    out_of_reach = inverse_kinematics(geometry, feet.position, joints.position)
    for joint in range(JOINTS):
        wanted = joints.position[joint]
        joints.position[joint] = min(limits.upper[joint], max(limits.lower[joint], wanted))
        out_of_reach += joints.position[joint] != wanted
    forward_kinematics(geometry, joints.position, placed.foot, placed.jacobian)
    for leg in range(LEGS):
        jacobian, own = placed.jacobian[leg], slice(3 * leg, 3 * leg + 3)
        write(joints.velocity[own], solve_leg(jacobian, vector(feet.velocity[leg]), DAMPING))
        torque = transposed_product(jacobian, vector(feet.force[leg]))
        write(joints.torque[own], scaled(-1.0, torque))
    return out_of_reach


class LegTargets:
    """Targets of the feet of one robot, and of the joints that place them.

    Attributes:
        geometry: the legs.
        feet: targets in base, to be set.
        joints: targets, of the last `place_feet`.
        placed: where these place the feet.
    """

    def __init__(self, robot: Robot, margin: float = 0.0) -> None:
        """Targets at zero; those of joints keep a margin [rad] from the ends of their ranges."""
        self.geometry = leg_geometry(robot)
        self.feet = FootTargets(*np.zeros((3, LEGS, 3)))
        self.joints = JointTargets(*np.zeros((3, JOINTS)))
        self.placed = PlacedLegs(np.zeros((LEGS, 3)), np.zeros((LEGS, 3, 3)))
        self._commands = Compiled(leg_commands)
        self._range = JointRange(
            np.array(robot.joint_lower) + margin, np.array(robot.joint_upper) - margin
        )

    def place_feet(self) -> int:
        """Compute joint targets for the foot targets; see leg_commands."""
        missed: int = self._commands.call(
            self.geometry, self._range, self.feet, self.placed, self.joints
        )
        return missed


class Kinematics:
    """The kinematics of one robot, allocating its results; for use outside the control tick."""

    def __init__(self, robot: Robot) -> None:
        """Kinematics of a robot's legs."""
        self.geometry = leg_geometry(robot)
        self._masses = leg_masses(robot)

    def center_of_mass(self, joint_position: Array) -> Array:
        """Centre of mass of the whole robot in base, (3,) m, for joint positions (12,) rad."""
        foot, center = self.foot_positions(joint_position), np.empty(3)
        joints = np.ascontiguousarray(joint_position, dtype=np.float64)
        center_of_mass(self.geometry, self._masses, joints, foot, center)
        return center

    def foot_positions(self, joint_position: Array) -> Array:
        """Foot centres in base, (4, 3) m, for joint positions (12,) rad."""
        return self.foot_positions_and_jacobians(joint_position)[0]

    def foot_positions_and_jacobians(self, joint_position: Array) -> tuple[Array, Array]:
        """Foot centres (4, 3) m and Jacobians (4, 3, 3) m/rad in base for (12,) rad."""
        foot, jacobian = np.empty((LEGS, 3)), np.empty((LEGS, 3, 3))
        joints = np.ascontiguousarray(joint_position, dtype=np.float64)
        if joints.shape != (JOINTS,):
            raise ValueError(f"joint_position must have shape (12,), not {joints.shape}")
        forward_kinematics(self.geometry, joints, foot, jacobian)
        return foot, jacobian

    def joint_positions(self, foot_position: Array) -> Array:
        """Joint positions (12,) rad that place the feet at (4, 3) m in base.

        Raises:
            ValueError: a foot is out of reach, or the shape is wrong.
        """
        feet = np.ascontiguousarray(foot_position, dtype=np.float64)
        if feet.shape != (LEGS, 3):
            raise ValueError(f"foot_position must have shape (4, 3), not {feet.shape}")
        joints = np.empty(JOINTS)
        if inverse_kinematics(self.geometry, feet, joints):
            raise ValueError(f"a foot is out of reach of its leg: {feet.tolist()}")
        return joints
