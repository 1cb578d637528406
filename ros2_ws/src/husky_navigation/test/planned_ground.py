"""Grounds that were seen whole, for tests of the planner."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.abilities import Abilities
from husky_navigation.planning.planning_grid import PlanningGrid, grid_of
from husky_navigation.planning.travel_costs import (
    METRE,
    ONCE,
    RADIAN,
    SECOND,
    TravelCost,
    TravelCosts,
)
from husky_navigation.planning.world_map import WorldMap

CARBON = Abilities()
HIGH = 0.8
"""Of walls [m]."""
RADIUS = 1.5
"""Of a ridge's feet and crests [m]."""


def seen(height: Callable[[Array, Array], Array], cells: int = 280) -> WorldMap:
    """Return the map of a ground whose height at x, y [m] is told; NaN where it was not seen."""
    world = WorldMap(cells=cells)
    x, y = world.lattice.cell_centers()
    world.elevation[:] = height(*np.meshgrid(x, y, indexing="ij"))
    return world


def grid_seen(height: Callable[[Array, Array], Array]) -> PlanningGrid:
    """Return the planning grid of such a map."""
    return grid_of(seen(height), CARBON)


def level(x: Array, y: Array) -> Array:
    """Return level ground."""
    return np.zeros_like(x)


def wall(x: Array, y: Array) -> Array:
    """Return a wall across x = 2 that is open for y > 2."""
    return np.where((np.abs(x - 2.0) < 0.1) & (y < 2.0), HIGH, 0.0)


class Ridge:
    """A ridge across x, 1 m high, from x = -4 on; level ground 1.4 m long is its top.

    Attributes:
        slope: of both sides [rad].
        rise: level way from the beginning of a side to its end [m].
        crest, far_crest: where the level top begins and ends [m].
        end: where the level ground behind begins [m].
    """

    def __init__(self, slope_deg: float) -> None:
        """Shape it."""
        self.slope = math.radians(slope_deg)
        self._arc, self._sag = RADIUS * math.sin(self.slope), RADIUS * (1.0 - math.cos(self.slope))
        self._straight = (1.0 - 2.0 * self._sag) / math.tan(self.slope)
        self.rise = 2.0 * self._arc + self._straight
        self.crest = self.rise - 4.0
        self.far_crest = self.crest + 1.4
        self.end = self.far_crest + self.rise

    def __call__(self, x: Array, y: Array) -> Array:
        """Return the height of the ground [m]."""
        arc, straight, rise = self._arc, self._straight, self.rise
        along = np.clip(np.minimum(x + 4.0, self.end - x), 0.0, rise)
        foot = RADIUS - np.sqrt(RADIUS**2 - np.minimum(along, arc) ** 2)
        middle = np.clip(along - arc, 0.0, straight) * math.tan(self.slope)
        left = np.minimum(rise - along, arc)
        crest = self._sag - (RADIUS - np.sqrt(RADIUS**2 - left**2))
        height: Array = foot + middle + np.where(along > arc + straight, crest, 0.0)
        return height


def costs(robot: str = "carbon") -> TravelCosts:
    """Return round numbers: 100 J a metre at 0.4 m/s, 1 kJ where it climbs at 45 deg or hovers."""

    def cost(mode: str, unit: str, time: float, energy: float, **more: float) -> TravelCost:
        each = {"slope_deg": 0.0, "thrust_share": 0.0, "speed": 0.0, **more}
        return TravelCost(robot=robot, mode=mode, unit=unit, time=time, energy=energy, **each)

    return TravelCosts(
        [
            cost("walk", METRE, 2.5, 100.0, speed=0.4),
            cost("walk", RADIAN, 2.0, 80.0, speed=0.5),
            cost("to_climb", ONCE, 2.0, 100.0),
            cost("from_climb", ONCE, 1.0, 50.0),
            *(
                cost("climb", METRE, 4.0, 200.0 + 20.0 * abs(slope), speed=0.25, slope_deg=slope)
                for slope in (-45.0, 0.0, 45.0)
            ),
            cost("to_arms", ONCE, 3.0, 100.0),
            cost("take_off", ONCE, 6.0, 3000.0),
            cost("hover", SECOND, 1.0, 1000.0),
            cost("fly", METRE, 2.0, 2000.0, speed=0.48),
            cost("land", ONCE, 5.0, 4000.0),
            cost("to_legs", ONCE, 4.0, 200.0),
        ]
    )
