"""Postures in which legs become the arms of a quadrotor (T19)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from husky_description.arrays import Array
from husky_description.rotor_geometry import flight_posture, rotor_geometry

if TYPE_CHECKING:
    from husky_description.robot import Robot

FOLDED_KNEE = -2.6
"""Knee angle while the legs splay: feet clear of ground and blades [rad]."""
DISC_MARGIN = 0.012
"""Least distance from a propeller's disc to the plane between left and right, splayed [m]."""
UPRIGHT_AXES = math.cos(math.radians(4.0))
"""Least share of each propeller's thrust that points up in flight."""


def _widest_fold(robot: Robot) -> float:
    """Greatest hip sagittal angle at which splayed discs of left and right stay apart [rad]."""
    beside = robot.propellers.diameter / 2.0 + DISC_MARGIN - robot.leg.hip_y
    return math.acos(min(1.0, max(0.0, beside / robot.leg.thigh_link)))


class MorphPostures:
    """The postures between legs and arms."""

    def __init__(self, robot: Robot):
        """Reckon them for a robot with propellers on its legs."""
        self._robot = robot
        self.flight = np.array(flight_posture(robot))
        sagittal = min(float(robot.sit_joint_position[1]), _widest_fold(robot))
        self.folded = np.tile((0.0, sagittal, FOLDED_KNEE), 4)
        self.splayed = self.folded.copy()
        self.splayed[0::3] = self.flight[0::3]

    def splay(self, joint_position: Array) -> bool:
        """Return whether joint positions (12,) [rad] are those of arms: a hip is past halfway."""
        return bool(np.abs(joint_position[0::3]).max() > 0.5 * np.abs(self.flight[0::3]).min())

    def off_centre(self, joint_position: Array) -> float:
        """Return how far the centre of lift is from the centre of mass, level [m].

        Infinite where a propeller does not point up.
        """
        geometry = rotor_geometry(self._robot, joint_position)
        if geometry.axis[:, 2].min() < UPRIGHT_AXES:
            return math.inf
        return math.hypot(*geometry.position[:, :2].mean(axis=0))
