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

from husky_control.tick_data import TICK
from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.kinematics import JOINTS, LEGS
from husky_description.vectors import Vector, column, cross, dot, product, vector, write

if TYPE_CHECKING:
    from husky_description.robot import Robot

Mask = NDArray[np.bool_]

OBSERVER_GAIN = 200.0  # 1/s


class ContactThresholds(NamedTuple):
    """Vertical foot forces at which contact begins and ends, N."""

    touchdown: float  # above it a leg late in its swing has touched down
    early: float  # above it a leg early in its swing has hit something
    standing: float  # above it a leg that is to stand has contact
    liftoff: float  # below it a leg in contact has lost it


class LegLoads(NamedTuple):
    """What one tick measures of the loads on the legs."""

    joint_velocity: Array  # (12,) rad/s
    joint_torque: Array  # (12,) N m, of the motors at the joint side
    jacobian: Array  # (4, 3, 3) m/rad in base
    rotation: Array  # (3, 3), base to world
    swing_progress: Array  # (4,) 0 to 1 during the swing, negative in stance


class FeltContact(NamedTuple):
    """What the observer has made of them, updated in place."""

    momentum_integral: Array  # (12,) N m s
    external_torque: Array  # (12,) N m
    foot_force: Array  # (4, 3) N in world, of the ground on the foot
    contact: Mask  # (4,)


@njit(cache=True)
def _force_at_foot(jacobian: Array, torque: Vector) -> Vector:
    """Return the force f with J^T f = torque, by Cramer's rule; finite for a singular leg too."""
    a, b, c = column(jacobian, 0), column(jacobian, 1), column(jacobian, 2)
    bc, ca, ab = cross(b, c), cross(c, a), cross(a, b)
    determinant = dot(a, bc)
    if abs(determinant) < 1e-4:
        determinant = 1e-4 if determinant >= 0.0 else -1e-4
    return (
        (torque[0] * bc[0] + torque[1] * ca[0] + torque[2] * ab[0]) / determinant,
        (torque[0] * bc[1] + torque[1] * ca[1] + torque[2] * ab[1]) / determinant,
        (torque[0] * bc[2] + torque[1] * ca[2] + torque[2] * ab[2]) / determinant,
    )


@njit(cache=True)
def observe_contact(
    felt: FeltContact,
    measured: LegLoads,
    joint_inertia: Array,
    thresholds: ContactThresholds,
    gain: float,
    dt: float,
) -> None:
    """One step of the observer and of the contact decision.

    Args:
        felt: updated.
        measured: in this tick.
        joint_inertia: (12,) kg m^2, reflected rotor and leg about each joint.
        thresholds: of the vertical force.
        gain: of the observer, 1/s.
        dt: s.
    """
    integral, external, contact = felt.momentum_integral, felt.external_torque, felt.contact
    for joint in range(JOINTS):
        integral[joint] += (measured.joint_torque[joint] + external[joint]) * dt
        momentum = joint_inertia[joint] * measured.joint_velocity[joint]
        external[joint] = gain * (momentum - integral[joint])
    for leg in range(LEGS):
        torque = vector(external[3 * leg : 3 * leg + 3])
        force = product(measured.rotation, _force_at_foot(measured.jacobian[leg], torque))
        write(felt.foot_force[leg], force)
        if contact[leg]:
            contact[leg] = force[2] > thresholds.liftoff
        elif measured.swing_progress[leg] < 0.0:
            contact[leg] = force[2] > thresholds.standing
        elif measured.swing_progress[leg] < 0.5:
            contact[leg] = force[2] > thresholds.early
        else:
            contact[leg] = force[2] > thresholds.touchdown


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
    about_hip += robot.knee_mass * robot.leg.thigh_link**2
    swung = robot.hip_mass + robot.thigh_mass + robot.shin_mass + robot.knee_mass
    about_frontal = about_hip + swung * offset**2
    about_knee = robot.shin_mass * robot.shin_length**2 / 3
    link = np.array([about_frontal, about_hip, about_knee])
    inertia: Array = np.asarray(robot.armature) + np.tile(link, LEGS)
    return inertia


class ContactObserver:
    """Foot forces and contacts of one robot, tick by tick."""

    def __init__(self, robot: Robot, gain: float = OBSERVER_GAIN) -> None:
        """An observer at rest, no foot in contact; slower by as much as joints are read slower."""
        servo = robot.own_sections.get("bus_servo")
        self.gain = gain if servo is None else gain * min(1.0, TICK / servo.cycle)
        self.contact = np.zeros(LEGS, dtype=np.bool_)
        self.foot_force = np.zeros((LEGS, 3))
        self.external_torque = np.zeros(JOINTS)
        self._joint_inertia = joint_inertias(robot)
        self._integral = np.zeros(JOINTS)
        self._felt = FeltContact(
            self._integral, self.external_torque, self.foot_force, self.contact
        )
        self._observe = Compiled(observe_contact)

    def reset(self, joint_velocity: Array) -> None:
        """Begin again, without an external torque, at joint velocities (12,) rad/s."""
        np.multiply(self._joint_inertia, joint_velocity, out=self._integral)
        self.external_torque.fill(0.0)
        self.foot_force.fill(0.0)
        self.contact.fill(False)

    def update(self, measured: LegLoads, thresholds: ContactThresholds, dt: float) -> None:
        """Take one tick's measurements, dt [s] after the last ones."""
        self._observe.call(self._felt, measured, self._joint_inertia, thresholds, self.gain, dt)
