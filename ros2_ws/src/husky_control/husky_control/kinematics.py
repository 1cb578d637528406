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
from numpy.typing import NDArray

if TYPE_CHECKING:
    from husky_description.robot import Robot

Array = NDArray[np.float64]

LEGS = 4
JOINTS = 12


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
def inverse_kinematics(
    geometry: LegGeometry, foot_position: Array, joint_position: Array
) -> int:
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
    hip: float  # at the plane of the leg
    thigh: float
    shin: float


def leg_masses(robot: Robot) -> LegMasses:
    """The masses of a robot's links."""
    hip, thigh, shin = float(robot.hip_mass), float(robot.thigh_mass), float(robot.shin_mass)
    return LegMasses(float(robot.mass) - LEGS * (hip + thigh + shin), hip, thigh, shin)


@njit(cache=True)
def center_of_mass(
    geometry: LegGeometry,
    masses: LegMasses,
    joint_position: Array,
    foot_position: Array,
    center: Array,
) -> None:
    """Centre of mass in base; links weigh at their middles, body and payload at the origin.

    Args:
        geometry: of the legs.
        masses: of the links.
        joint_position: (12,) rad.
        foot_position: (4, 3) m in base.
        center: (3,) m, written.
    """
    total = masses.body + LEGS * (masses.hip + masses.thigh + masses.shin)
    center[:] = 0.0
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
        for i in range(3):
            center[i] += (
                masses.hip * hip[i]
                + masses.thigh * 0.5 * (hip[i] + knee[i])
                + masses.shin * 0.5 * (knee[i] + foot_position[leg, i])
            ) / total


@njit(cache=True)
def solve_leg(jacobian: Array, leg: int, foot: Array, joint: Array, damping: float) -> None:
    """Joint rates that move one foot at a given velocity: joint = J^-1 foot, damped near singular.

    Solves (J J^T + damping I) y = foot, joint = J^T y, which stays bounded for a straight leg.

    Args:
        jacobian: (4, 3, 3) m/rad.
        leg: which leg.
        foot: (3,) m/s in base.
        joint: (3,) rad/s, written.
        damping: m^2; 0 gives the plain inverse.
    """
    j = jacobian[leg]
    a00 = j[0, 0] * j[0, 0] + j[0, 1] * j[0, 1] + j[0, 2] * j[0, 2] + damping
    a01 = j[0, 0] * j[1, 0] + j[0, 1] * j[1, 1] + j[0, 2] * j[1, 2]
    a02 = j[0, 0] * j[2, 0] + j[0, 1] * j[2, 1] + j[0, 2] * j[2, 2]
    a11 = j[1, 0] * j[1, 0] + j[1, 1] * j[1, 1] + j[1, 2] * j[1, 2] + damping
    a12 = j[1, 0] * j[2, 0] + j[1, 1] * j[2, 1] + j[1, 2] * j[2, 2]
    a22 = j[2, 0] * j[2, 0] + j[2, 1] * j[2, 1] + j[2, 2] * j[2, 2] + damping
    c00, c01, c02 = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    determinant = a00 * c00 + a01 * c01 + a02 * c02
    if determinant < 1e-18:
        joint[0] = joint[1] = joint[2] = 0.0
        return
    c11, c12, c22 = a00 * a22 - a02 * a02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
    y0 = (c00 * foot[0] + c01 * foot[1] + c02 * foot[2]) / determinant
    y1 = (c01 * foot[0] + c11 * foot[1] + c12 * foot[2]) / determinant
    y2 = (c02 * foot[0] + c12 * foot[1] + c22 * foot[2]) / determinant
    for i in range(3):
        joint[i] = j[0, i] * y0 + j[1, i] * y1 + j[2, i] * y2


@njit(cache=True)
def leg_commands(
    geometry: LegGeometry,
    foot_position: Array,
    foot_velocity: Array,
    foot_force: Array,
    lower: Array,
    upper: Array,
    scratch_foot: Array,
    jacobian: Array,
    joint_position: Array,
    joint_velocity: Array,
    joint_torque: Array,
) -> int:
    """Joint targets for foot targets: inverse kinematics, rates, and the torque of a foot force.

    Args:
        geometry: the legs.
        foot_position: (4, 3) m in base.
        foot_velocity: (4, 3) m/s of the foot relative to the base, in base.
        foot_force: (4, 3) N of the ground on the foot, in base.
        lower: (12,) rad, least joint targets.
        upper: (12,) rad, greatest joint targets.
        scratch_foot: (4, 3) m in base, where the joint targets place the feet, written.
        jacobian: (4, 3, 3) m/rad at the joint targets, written.
        joint_position: (12,) rad, written.
        joint_velocity: (12,) rad/s, written.
        joint_torque: (12,) N m that holds against the foot force, -J^T f, written.

    Returns:
        How many feet were out of reach, and joint targets beyond their range.
    """
    out_of_reach = inverse_kinematics(geometry, foot_position, joint_position)
    for joint in range(JOINTS):
        if joint_position[joint] < lower[joint]:
            joint_position[joint] = lower[joint]
            out_of_reach += 1
        elif joint_position[joint] > upper[joint]:
            joint_position[joint] = upper[joint]
            out_of_reach += 1
    forward_kinematics(geometry, joint_position, scratch_foot, jacobian)
    for leg in range(LEGS):
        solve_leg(
            jacobian, leg, foot_velocity[leg], joint_velocity[3 * leg : 3 * leg + 3], 1e-4
        )
        for k in range(3):
            joint_torque[3 * leg + k] = -(
                jacobian[leg, 0, k] * foot_force[leg, 0]
                + jacobian[leg, 1, k] * foot_force[leg, 1]
                + jacobian[leg, 2, k] * foot_force[leg, 2]
            )
    return out_of_reach


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
