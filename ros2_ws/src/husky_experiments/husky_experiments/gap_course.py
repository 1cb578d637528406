"""The course of Husky-beta's whole way: ground, a gap, a step up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from husky_bringup.system import ParameterValue
from husky_description.arrays import Array
from husky_sim.gap import Gap


@dataclass(frozen=True)
class GapCourse:
    """Where the ground is."""

    approach: float = 4.0  # from the robot's start to the gap [m]
    width: float = 1.0  # of the gap [m]
    step: float = 0.5  # how much higher the ground behind it is [m]
    top: float = 6.0  # ground behind it [m]

    @property
    def surface(self) -> Gap:
        """As the plant builds it."""
        return Gap(self.approach, self.width, self.step, self.top)

    @property
    def far_edge(self) -> float:
        """Where the ground behind the gap begins, x in world [m]."""
        return self.approach + self.width

    def plant(self) -> dict[str, ParameterValue]:
        """Return the plant's parameters."""
        return {
            "terrain": "gap",
            "terrain_approach": self.approach,
            "terrain_size": self.width,
            "terrain_height": self.step,
            "terrain_top": self.top,
        }

    def height(self, position: Array) -> Array:
        """Return the height of the ground under positions in world [m] (n, 3), [m] (n,)."""
        return np.array([self.surface.height(float(x)) for x in position[:, 0]])
