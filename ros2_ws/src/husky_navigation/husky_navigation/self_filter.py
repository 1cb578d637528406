"""The robot's legs as capsules, so that points on them are not taken for ground."""

from __future__ import annotations

import math

import numpy as np

from husky_description.arrays import Array
from husky_description.robot import Robot


class LegCapsules:
    """Capsules that hold the legs of one robot.

    A leg is a parallelogram: from the hip along the thigh to the knee's pins, along the calf to the
    ankle, along the ankle link to the foot. The simulated leg is its serial equivalent, with the
    knee elsewhere (T1); both are held. A propeller at the knee is held by a ball.
    """

    def __init__(self, robot: Robot, margin: float = 0.03) -> None:
        """Hold the legs of a robot with a margin around its tubes [m]."""
        leg = robot.leg
        self._hip = robot.hip_position
        self._offset = robot.lateral_offset
        self._thigh, self._shin = robot.thigh_length, robot.shin_length
        self._upper = leg.thigh_link
        tube = margin + max(leg.tube_outer_radius + leg.rod_offset, robot.foot_radius)
        self._radius = np.full(4, tube)
        self._ball: float | None = None
        if robot.legs_carry_propellers:
            self._ball = margin + math.hypot(robot.propellers.diameter / 2, robot.propellers.offset)

    def in_base(self, joint_position: Array) -> Array:
        """Return the capsules at joint positions (12,) rad.

        Returns:
            (k, 7): the two ends of each capsule's line in base [m], its radius [m].

        Raises:
            ValueError: the shape is wrong, or a position is not finite.
        """
        joints = np.asarray(joint_position, dtype=np.float64)
        if joints.shape != (12,) or not np.isfinite(joints).all():
            raise ValueError(f"joint_position is {joints.tolist()}, it must be 12 finite numbers")
        rows = []
        for leg in range(4):
            frontal, sagittal, knee = joints[3 * leg : 3 * leg + 3]
            down, side = np.array([0.0, math.sin(frontal), -math.cos(frontal)]), self._offset[leg]
            hip = self._hip[leg] + side * np.array([0.0, math.cos(frontal), math.sin(frontal)])
            thigh = _along(sagittal, down)
            shin = _along(sagittal + knee, down)
            serial_knee = hip + self._thigh * thigh
            pins = hip + self._upper * thigh
            foot = serial_knee + self._shin * shin
            ankle = pins + self._shin * shin
            for start, end in (
                (hip, serial_knee),
                (serial_knee, foot),
                (pins, ankle),
                (ankle, foot),
            ):
                rows.append([*start, *end, self._radius[leg]])
            if self._ball is not None:
                rows.append([*pins, *pins, self._ball])
        return np.array(rows)

    def in_odom(self, joint_position: Array, rotation: Array, position: Array) -> Array:
        """Return the capsules as `in_base` does, with their ends in odom.

        Args:
            joint_position: (12,) rad.
            rotation: (3, 3), base to odom.
            position: of the base in odom [m] (3,).
        """
        capsules = self.in_base(joint_position)
        for ends in (slice(0, 3), slice(3, 6)):
            capsules[:, ends] = capsules[:, ends] @ rotation.T + position
        return capsules


def _along(angle: float, down: Array) -> Array:
    """Return the direction of a link at an angle about y [rad] from `down`, in the leg's plane."""
    direction: Array = math.cos(angle) * down - math.sin(angle) * np.array([1.0, 0.0, 0.0])
    return direction
