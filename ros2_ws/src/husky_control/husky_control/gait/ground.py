"""What the ground is that a robot walks on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from husky_description.arrays import Array
from husky_description.gravity import GRAVITY


@dataclass(frozen=True)
class Ground:
    """The ground under a walk, and how the body keeps itself over it; level by default.

    A walk takes place in the frame of the ground: origin of world, z the outward normal, turned
    from world by the least rotation.

    Attributes:
        plane: (3, 3) rotation, world to the frame of the ground.
        bend: (4, 2), rise over the plane per way along x and y of the ground where each foot stood
            last; None where a foot is expected to land at the height of the others.
        curve: (2, 2), change of that rise per way along x and y, symmetric [1/m].
        load_slope: tangential over normal load of the feet, along x and y.
        shift: of the feet from under the body, along x and y, so that the load passes through it
            [m].
        pitch: of the body relative to the ground, nose down positive [rad].
        sink: how much lower than usual the body is carried [m].
    """

    plane: Array = field(default_factory=lambda: np.eye(3))
    bend: Array | None = None
    curve: Array = field(default_factory=lambda: np.zeros((2, 2)))
    load_slope: tuple[float, float] = (0.0, 0.0)
    shift: tuple[float, float] = (0.0, 0.0)
    pitch: float = 0.0
    sink: float = 0.0

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        self.plane.flags.writeable = self.curve.flags.writeable = False
        if self.bend is not None:
            self.bend.flags.writeable = False

    @property
    def gravity(self) -> float:
        """Acceleration of gravity into the ground [m/s^2]."""
        return GRAVITY * float(self.plane[2, 2])


LEVEL_GROUND = Ground()
