"""Between the legs of the reduced-order model (phi, gamma, r of T23) and the robot's joints.

The model's leg is a line from the hip to the foot; the robot's is a hip frontal joint about x, an
offset, and a hip sagittal joint and a knee about y. They meet at the foot: both place it at the
same point in base. Angles are not converted one by one: phi is not the hip sagittal angle, since a
bent knee lies between, nor gamma the hip frontal one, since the offset turns with the latter.
"""

from __future__ import annotations

import math

import numpy as np

from husky_control.planning.array_namespace import checked_vector
from husky_control.planning.reduced_order import LEG_STATES, leg_jacobian, leg_vector
from husky_control.planning.rom_parameters import hips_in_base
from husky_description.arrays import Array
from husky_description.kinematics import JOINTS, LEGS, Kinematics
from husky_description.robot import Robot

SINGULAR = 1e-9
"""Least reciprocal condition of a Jacobian that is inverted."""


class LegCoordinates:
    """Converts q_L (12), [phi rad, gamma rad, r m] of each leg, and the joints (12) of a robot."""

    def __init__(self, robot: Robot) -> None:
        """Conversions of a robot."""
        self._kinematics = Kinematics(robot)
        self._hips = hips_in_base(robot)

    def feet(self, leg_position: Array) -> Array:
        """Foot centres (4, 3) m in base, for q_L (12,)."""
        q = checked_vector("leg_position", leg_position, LEG_STATES).reshape(LEGS, 3)
        feet: Array = self._hips + np.array([leg_vector(*leg) for leg in q])
        return feet

    def from_feet(self, foot_position: Array) -> Array:
        """q_L (12,) for foot centres (4, 3) m in base; gamma within a quarter turn.

        Raises:
            ValueError: a foot lies in its hip, where the angles are undefined, or a wrong shape.
        """
        feet = np.asarray(foot_position, dtype=np.float64)
        if feet.shape != (LEGS, 3):
            raise ValueError(f"foot_position must have shape (4, 3), not {feet.shape}")
        result = np.empty(LEG_STATES)
        for leg, (x, y, z) in enumerate((feet - self._hips).tolist()):
            in_plane = math.hypot(x, z)
            length = math.hypot(in_plane, y)
            if not length > 0.0:
                raise ValueError(f"foot {leg} lies in its hip: phi and gamma are undefined")
            result[3 * leg : 3 * leg + 3] = math.atan2(-x, -z), math.atan2(y, in_plane), length
        return result

    def from_joints(self, joint_position: Array) -> Array:
        """q_L (12,) of joint positions (12,) rad."""
        return self.from_feet(self._kinematics.foot_positions(joint_position))

    def to_joints(self, leg_position: Array) -> Array:
        """Joint positions (12,) rad, knees bent backward, of q_L (12,).

        Raises:
            ValueError: a foot is out of reach of the robot's leg, or the shape is wrong.
        """
        return self._kinematics.joint_positions(self.feet(leg_position))

    def velocity_from_joints(self, joint_position: Array, joint_velocity: Array) -> Array:
        """Rates of q_L (12,) for joint positions (12,) rad and velocities (12,) rad/s.

        Raises:
            ValueError: a leg of the model points sideways, where phi is undefined; a wrong shape.
        """
        rates = checked_vector("joint_velocity", joint_velocity, JOINTS).reshape(LEGS, 3)
        robot, model = self._jacobians(joint_position)
        return self._mapped(model, robot, rates, "the model's leg points sideways")

    def velocity_to_joints(self, joint_position: Array, leg_velocity: Array) -> Array:
        """Joint velocities (12,) rad/s at joint positions (12,) rad for rates of q_L (12,).

        Raises:
            ValueError: a leg of the robot is straight, or its foot level with the hip frontal axis,
                where it cannot move in every direction; a wrong shape.
        """
        rates = checked_vector("leg_velocity", leg_velocity, LEG_STATES).reshape(LEGS, 3)
        robot, model = self._jacobians(joint_position)
        return self._mapped(robot, model, rates, "the robot's leg is straight, flat or level")

    def _jacobians(self, joint_position: Array) -> tuple[Array, Array]:
        """Jacobians (4, 3, 3) of the feet in the robot's joints and in the model's coordinates."""
        feet, robot = self._kinematics.foot_positions_and_jacobians(joint_position)
        q = self.from_feet(feet).reshape(LEGS, 3)
        return robot, np.array([leg_jacobian(*leg) for leg in q])

    @staticmethod
    def _mapped(left: Array, right: Array, rates: Array, singular: str) -> Array:
        """left^-1 right rates, leg by leg, (12,)."""
        result = np.empty((LEGS, 3))
        for leg in range(LEGS):
            if 1.0 / np.linalg.cond(left[leg]) < SINGULAR:
                raise ValueError(f"leg {leg} has no such velocity: {singular}")
            result[leg] = np.linalg.solve(left[leg], right[leg] @ rates[leg])
        return result.reshape(-1)
