"""Legs of different length under a level body: where the ground gives way unevenly."""

from __future__ import annotations

import numpy as np

from husky_description.arrays import Array

MOST = 0.3
"""Farthest that a joint is moved [rad]."""
DAMPING = 1e-4
"""Keeps a straight leg's joints where they are [m^2]."""


def tilt_off(rotation: Array, axis: Array | None = None) -> Array:
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
        squares = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING * np.eye(3)
        solved = np.linalg.solve(squares, moved[..., None])
        self.joints += (jacobian.transpose(0, 2, 1) @ solved).ravel()
        np.clip(self.joints, -MOST, MOST, out=self.joints)
