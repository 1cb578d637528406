"""Contact of the feet from drive currents: a momentum observer, the Jacobian transpose, the phase.

The drive's current gives the torque that the motor exerts; what the joint's own inertia does not
take up is external. A first-order momentum observer (gain 200 1/s, as in the lab's own reduced
order code) estimates it without differentiating velocity; J^-T turns it into a foot force.
The gait phase sets how much force is believed to be a touchdown: little late in the swing, much
early in it, where only an obstacle could touch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.kinematics import JOINTS, LEGS

if TYPE_CHECKING:
    from husky_description.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OBSERVER_GAIN = 200.0  # 1/s


class ContactThresholds(NamedTuple):
    """Vertical foot forces at which contact begins and ends, N."""

    touchdown: float  # above it a leg late in its swing has touched down
    early: float  # above it a leg early in its swing has hit something
    liftoff: float  # below it a leg in contact has lost it


@njit(cache=True)
def observe_contact(
    joint_velocity: Array,
    joint_torque: Array,
    joint_inertia: Array,
    jacobian: Array,
    rotation: Array,
    swing_progress: Array,
    thresholds: ContactThresholds,
    gain: float,
    dt: float,
    momentum_integral: Array,
    external_torque: Array,
    foot_force: Array,
    contact: Mask,
) -> None:
    """One step of the observer and of the contact decision.

    Args:
        joint_velocity: (12,) rad/s.
        joint_torque: (12,) N m, of the motors at the joint side.
        joint_inertia: (12,) kg m^2, reflected rotor and leg about each joint.
        jacobian: (4, 3, 3) m/rad in base.
        rotation: (3, 3), base to world.
        swing_progress: (4,) 0 to 1 during the swing, negative in stance.
        thresholds: of the vertical force.
        gain: of the observer, 1/s.
        dt: s.
        momentum_integral: (12,) N m s, state, updated.
        external_torque: (12,) N m, state, updated.
        foot_force: (4, 3) N in world, of the ground on the foot, written.
        contact: (4,) bool, updated.
    """
    for joint in range(JOINTS):
        momentum_integral[joint] += (joint_torque[joint] + external_torque[joint]) * dt
        momentum = joint_inertia[joint] * joint_velocity[joint]
        external_torque[joint] = gain * (momentum - momentum_integral[joint])
    for leg in range(LEGS):
        j = jacobian[leg]
        t0, t1, t2 = (
            external_torque[3 * leg],
            external_torque[3 * leg + 1],
            external_torque[3 * leg + 2],
        )
        # J^T f = t by Cramer's rule; the rows of J^T are the columns of J.
        c0 = j[1, 1] * j[2, 2] - j[2, 1] * j[1, 2]
        c1 = j[2, 1] * j[0, 2] - j[0, 1] * j[2, 2]
        c2 = j[0, 1] * j[1, 2] - j[1, 1] * j[0, 2]
        determinant = j[0, 0] * c0 + j[1, 0] * c1 + j[2, 0] * c2
        if abs(determinant) < 1e-4:
            determinant = 1e-4 if determinant >= 0.0 else -1e-4
        fx = (
            t0 * c0
            + t1 * (j[2, 0] * j[1, 2] - j[1, 0] * j[2, 2])
            + t2 * (j[1, 0] * j[2, 1] - j[2, 0] * j[1, 1])
        ) / determinant
        fy = (
            t0 * c1
            + t1 * (j[0, 0] * j[2, 2] - j[2, 0] * j[0, 2])
            + t2 * (j[2, 0] * j[0, 1] - j[0, 0] * j[2, 1])
        ) / determinant
        fz = (
            t0 * c2
            + t1 * (j[1, 0] * j[0, 2] - j[0, 0] * j[1, 2])
            + t2 * (j[0, 0] * j[1, 1] - j[1, 0] * j[0, 1])
        ) / determinant
        for i in range(3):
            foot_force[leg, i] = (
                rotation[i, 0] * fx + rotation[i, 1] * fy + rotation[i, 2] * fz
            )
        if contact[leg]:
            contact[leg] = foot_force[leg, 2] > thresholds.liftoff
        elif 0.0 <= swing_progress[leg] < 0.5:
            contact[leg] = foot_force[leg, 2] > thresholds.early
        else:
            contact[leg] = foot_force[leg, 2] > thresholds.touchdown


def joint_inertias(robot: Robot) -> Array:
    """Inertia about each joint that its motor must accelerate, (12,) kg m^2, in the stand posture.

    The links as point masses at their middles, beside the reflected rotor, which outweighs them.
    """
    feet, thigh = -robot.stand_height, robot.thigh_length
    knee_x = -thigh * np.sin(robot.stand_joint_position[1])
    knee_z = -thigh * np.cos(robot.stand_joint_position[1])
    offset = abs(float(robot.lateral_offset[0]))
    thigh_squared = (knee_x**2 + knee_z**2) / 4
    shin_squared = knee_x**2 / 4 + (knee_z + feet) ** 2 / 4
    about_hip = robot.thigh_mass * thigh_squared + robot.shin_mass * shin_squared
    about_frontal = about_hip + (robot.hip_mass + robot.thigh_mass + robot.shin_mass) * offset**2
    about_knee = robot.shin_mass * robot.shin_length**2 / 3
    link = np.array([about_frontal, about_hip, about_knee])
    inertia: Array = np.asarray(robot.armature) + np.tile(link, LEGS)
    return inertia


class ContactObserver:
    """Foot forces and contacts of one robot, tick by tick."""

    def __init__(self, robot: Robot, gain: float = OBSERVER_GAIN) -> None:
        """An observer at rest, no foot in contact."""
        self.gain = gain
        self.joint_inertia = joint_inertias(robot)
        self.contact = np.zeros(LEGS, dtype=np.bool_)
        self.foot_force = np.zeros((LEGS, 3))
        self.external_torque = np.zeros(JOINTS)
        self._integral = np.zeros(JOINTS)

    def reset(self, joint_velocity: Array) -> None:
        """Begin again, without an external torque, at joint velocities (12,) rad/s."""
        np.multiply(self.joint_inertia, joint_velocity, out=self._integral)
        self.external_torque.fill(0.0)
        self.foot_force.fill(0.0)
        self.contact.fill(False)

    def update(
        self,
        joint_velocity: Array,
        joint_torque: Array,
        jacobian: Array,
        rotation: Array,
        swing_progress: Array,
        thresholds: ContactThresholds,
        dt: float,
    ) -> None:
        """Take one tick's measurements; see observe_contact for shapes, units and frames."""
        observe_contact(
            joint_velocity,
            joint_torque,
            self.joint_inertia,
            jacobian,
            rotation,
            swing_progress,
            thresholds,
            self.gain,
            dt,
            self._integral,
            self.external_torque,
            self.foot_force,
            self.contact,
        )
