"""Legs of different length under a level body: where the ground gives way unevenly."""

from __future__ import annotations

import numpy as np

from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.kinematics import DAMPING, LEGS, solve_leg

MOST = 0.3
"""Farthest that a joint is moved [rad]."""


def turn_to_level(rotation: Array, axis: Array | None = None) -> Array:
    """Return the turn that brings a tilted body back to level, in base (3,) [rad].

    Args:
        rotation: base to world (3, 3).
        axis: unit vector in world (3,) about which nothing is to turn; None for none.
    """
    turn = np.cross(rotation[:, 2], (0.0, 0.0, 1.0))
    if axis is not None:
        turn -= (turn @ axis) * axis
    level: Array = rotation.T @ turn
    return level


class Levelling:
    """Turns the body about the middle of its standing feet, by their legs' lengths.

    A leg in the air keeps what it was given, for where it stood it comes down again.

    Attributes:
        joints: to be added to what each leg is told when it stands (12,) [rad].
    """

    def __init__(self) -> None:
        """Legs as they are told."""
        self.joints = np.zeros(12)
        self._solve = Compiled(solve_leg)
        self._solve.call(np.eye(3), (0.0, 0.0, 0.0), DAMPING)  # not when a leg is in the air

    def reset(self) -> None:
        """Begin with legs as they are told."""
        self.joints.fill(0.0)

    def turn(self, by: Array, feet: Array, jacobian: Array, standing: Array) -> None:
        """Turn the body a little further, as far as joints may be moved by `MOST`.

        Args:
            by: in base (3,) [rad].
            feet: in base (4, 3) [m].
            jacobian: of each foot by its leg's joints (4, 3, 3) [m/rad].
            standing: 1 for legs that stand, 0 for others, between for those on their way (4,).
        """
        moved = -standing[:, None] * np.cross(by, feet - standing @ feet / standing.sum())
        for leg in range(LEGS):
            turned = self._solve.call(jacobian[leg], tuple(moved[leg].tolist()), DAMPING)
            self.joints[3 * leg : 3 * leg + 3] += turned
        np.clip(self.joints, -MOST, MOST, out=self.joints)
