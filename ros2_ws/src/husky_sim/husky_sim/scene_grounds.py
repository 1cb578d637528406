"""Scenes for a depth camera beside a flat lane and ahead: rough ground, boxes, tiers, banks.

The robot starts at x = 0 and walks along +x in the lane, whose centre line is y = 0. A scene is a
list of boxes on the plane z = 0. It has no height fields, through which rays are slow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array

START = 0.8
"""Where a scene begins, before the feet of a robot at x = 0 [m]."""
WIDTH = 6.0
"""Of a scene, half of it to each side of the lane's centre line [m]."""
WIDEST_LANE = 4.0
"""It leaves 1 m of scene on each side [m]."""
MOST_TIERS = 5
"""Of `rising_tiers`; the highest is a plateau up to the end of the scene."""
MIXED_ROUGHNESS = 0.2
"""Greatest height of the facets of a mixed scene, as a share of the scene's."""

STEEPEST_BANK = math.radians(45.0)
"""Of `rising_banks` [rad]."""

_LEAST_AHEAD = 1.0
"""Least depth of the scene behind the end of the lane [m]."""
_BURIED = 0.1
"""Depth of every box below the plane [m]."""
_FACET_SIZES = 0.2, 0.8
"""Allowed edges of a facet [m]: a smaller one needs too many, a larger one is as wide as a side."""
_CORNER_RANGE = 1 / 6, 5 / 6
"""Heights of the corners of facets, as shares of the greatest height. A plane through four corners
is above or below the furthest corner by at most a quarter of this range, so it stays within 0 to 1.
"""
_BOX_WIDTH = 0.2, 0.6
"""Edges of a scattered box [m]."""
_LOWEST_BOX = 0.06
"""Height of a scattered box above the ground around it, unless the greatest is less [m]."""
_CLEARANCE = 0.1
"""Between the circles around two scattered obstacles [m]: the ground between them is seen."""
_TRIES = 30
"""Draws for a free spot before an obstacle is left out."""
_BOX_DENSITY = 1.0
"""Boxes per square metre; they cover about a seventh of the ground."""
_MIXED_DENSITY = 0.6
"""Boxes per square metre beside flights of steps."""
_FLIGHT_DENSITY = 0.12
"""Flights of steps per square metre."""
_FLIGHT_STEPS, _FLIGHT_DEPTH, _FLIGHT_WIDTH = 3, 0.3, 0.9
"""Steps of a flight, depth of one and its width [m]."""


class SolidBox(NamedTuple):
    """A box in the world.

    Attributes:
        centre: of the box [m] (3,).
        half_size: half edges along its own axes [m] (3,).
        quaternion: orientation of its axes, (w, x, y, z) as MuJoCo has it.
    """

    centre: Array
    half_size: Array
    quaternion: tuple[float, float, float, float]


class Patch(NamedTuple):
    """A rectangle of ground [m]."""

    x_start: float
    x_end: float
    y_start: float
    y_end: float


class _Spot(NamedTuple):
    """A circle of ground that an obstacle takes [m]."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class SceneArea:
    """The ground that a scene takes, from x = START on.

    Attributes:
        lane: width of the flat ground that it leaves free, 0 for none [m].
        approach: where the lane ends; behind it the scene takes the whole width [m].
        length: of the scene along +x [m].
    """

    lane: float
    approach: float
    length: float

    def __post_init__(self) -> None:
        """Raise ValueError for a lane that leaves no scene ahead: value, what is allowed."""
        if self.lane and self.length < _LEAST_AHEAD:
            raise ValueError(
                f"terrain length is {self.length}, with a lane it must be {_LEAST_AHEAD:.3g} or "
                "more"
            )
        furthest = self.end - _LEAST_AHEAD
        if self.lane and not START <= self.approach <= furthest:
            raise ValueError(
                f"terrain approach is {self.approach}, with a lane and a terrain length of "
                f"{self.length} it must be {START:.3g} to {furthest:.3g}"
            )

    @property
    def end(self) -> float:
        """Return where the scene ends along +x [m]."""
        return START + self.length

    @property
    def surface(self) -> float:
        """Return the surface of the area [m^2]."""
        free = self.lane * (self.approach - START) if self.lane else 0.0
        return WIDTH * self.length - free

    def patches(self, inset: float) -> list[Patch]:
        """Return the rectangles that make up the area, `inset` away from the lane [m]."""
        edge = WIDTH / 2
        if not self.lane:
            return [Patch(START, self.end, -edge, edge)]
        inner, ahead = self.lane / 2 + inset, self.approach + inset
        return [
            Patch(START, ahead, inner, edge),
            Patch(START, ahead, -edge, -inner),
            Patch(ahead, self.end, -edge, edge),
        ]

    def holds(self, spot: _Spot) -> bool:
        """Return True if a circle is in the area, away from the lane."""
        within = START <= spot.x - spot.radius and spot.x + spot.radius <= self.end
        within = within and abs(spot.y) + spot.radius <= WIDTH / 2
        beside = not self.lane or abs(spot.y) - spot.radius >= self.lane / 2
        return within and (beside or spot.x - spot.radius >= self.approach)


def check_facets(height: float, size: float, share: float = 1.0) -> None:
    """Raise ValueError for facets that are too small, too large or too steep.

    Args:
        height: greatest height of the scene [m].
        size: least edge of a facet [m].
        share: of the height that facets have; `MIXED_ROUGHNESS` in a mixed scene.
    """
    lower, upper = _FACET_SIZES
    if not lower <= size <= upper:
        raise ValueError(
            f"terrain size is {size}, on rough ground it must be {lower:.3g} to {upper:.3g}"
        )
    highest = size / 2 / share
    if height > highest:
        raise ValueError(
            f"terrain height is {height}, on rough ground of size {size} it must be 0 to "
            f"{highest:.3g}"
        )


def rough_facets(
    area: SceneArea, height: float, size: float, rng: np.random.Generator
) -> list[SolidBox]:
    """Return tilted boxes whose upper faces undulate, with small ledges between them.

    Args:
        area: the ground that they take.
        height: greatest height of a face [m], at most half of `size`.
        size: least edge of a face, seen from above [m].
        rng: generator of the heights.
    """
    # The foot of a tilted box reaches out from under its upper edge, by height times slope.
    low, high = _CORNER_RANGE
    overhang = (high - low) * height**2 / size
    boxes = []
    for patch in area.patches(overhang):
        boxes += _facets_of(patch, height, size, rng)
    return boxes


def _facets_of(
    patch: Patch, height: float, size: float, rng: np.random.Generator
) -> list[SolidBox]:
    """Return a grid of facets, each the plane that fits best to the heights of its four corners."""
    rows = max(1, int((patch.x_end - patch.x_start) / size))
    columns = max(1, int((patch.y_end - patch.y_start) / size))
    x, edge_x = np.linspace(patch.x_start, patch.x_end, rows + 1, retstep=True)
    y, edge_y = np.linspace(patch.y_start, patch.y_end, columns + 1, retstep=True)
    corners = height * rng.uniform(*_CORNER_RANGE, (rows + 1, columns + 1))
    near_right, near_left = corners[:-1, :-1], corners[:-1, 1:]
    far_right, far_left = corners[1:, :-1], corners[1:, 1:]
    tops = (near_right + near_left + far_right + far_left) / 4
    slopes_x = (far_right + far_left - near_right - near_left) / (2 * edge_x)
    slopes_y = (near_left + far_left - near_right - far_right) / (2 * edge_y)
    boxes = []
    for row, column in np.ndindex(rows, columns):
        face = np.array((x[row] + edge_x / 2, y[column] + edge_y / 2, tops[row, column]))
        slope_x, slope_y = float(slopes_x[row, column]), float(slopes_y[row, column])
        boxes.append(_facet(face, (float(edge_x), float(edge_y)), (slope_x, slope_y), height))
    return boxes


def _facet(
    face: Array, edges: tuple[float, float], slopes: tuple[float, float], height: float
) -> SolidBox:
    """Return a box under a tilted face.

    Args:
        face: middle of the upper face [m] (3,).
        edges: of the face along x and y, seen from above [m].
        slopes: of the face along x and y.
        height: greatest height of a face [m].
    """
    normal = np.array((-slopes[0], -slopes[1], 1.0))
    normal /= np.linalg.norm(normal)
    # The shortest turn from z to the normal, and the face so long that its shadow fills the cell.
    turn = np.array((1.0 + normal[2], -normal[1], normal[0], 0.0))
    w, i, j, k = (turn / np.linalg.norm(turn)).tolist()
    half_edges = (edge / 2 * math.hypot(1.0, s) for edge, s in zip(edges, slopes, strict=True))
    half_size = np.array((*half_edges, (height + _BURIED) / 2))
    return SolidBox(face - half_size[2] * normal, half_size, (w, i, j, k))


def scattered_boxes(area: SceneArea, height: float, rng: np.random.Generator) -> list[SolidBox]:
    """Return boxes of random size, yaw and height, with much ground between them.

    Args:
        area: the ground on which they stand.
        height: greatest height of a box [m].
        rng: generator of everything about them.
    """
    return _scattered(area, (0.0, height), _BOX_DENSITY, [], rng)


def rising_tiers(area: SceneArea, height: float, size: float) -> list[SolidBox]:
    """Return tiers that rise away from the lane, to both sides and ahead.

    Args:
        area: the ground that they take.
        height: of each tier above the one before it [m].
        size: depth of each tier but the last [m].
    """
    edge = WIDTH / 2
    count = min(MOST_TIERS, max(1, int((edge - area.lane / 2) / size)))
    boxes = []
    for tier in range(count):
        inner, ahead = area.lane / 2 + tier * size, area.approach + tier * size
        patches = [Patch(START, area.end, inner, edge), Patch(START, area.end, -edge, -inner)]
        if ahead < area.end:
            patches.append(Patch(ahead, area.end, -inner, inner))
        boxes += [_tier(patch, (tier + 1) * height) for patch in patches]
    return boxes


def rising_banks(area: SceneArea, slope: float) -> list[SolidBox]:
    """Return planes that rise away from the lane, to both sides and ahead.

    Args:
        area: the ground that they take.
        slope: of the planes [rad], 0 to `STEEPEST_BANK`.
    """
    edge, rise = WIDTH / 2, math.tan(slope)
    inner, ahead = area.lane / 2, area.approach
    left, right = Patch(START, area.end, inner, edge), Patch(START, area.end, -edge, -inner)
    banks = [(left, (0.0, rise)), (right, (0.0, -rise))]
    if area.lane:
        banks.append((Patch(ahead, area.end, -edge, edge), (rise, 0.0)))
    return [_bank(patch, slopes) for patch, slopes in banks]


def _bank(patch: Patch, slopes: tuple[float, float]) -> SolidBox:
    """Return a plane of slopes along x and y whose lower edge lies on the ground."""
    edges = patch.x_end - patch.x_start, patch.y_end - patch.y_start
    height = abs(slopes[0]) * edges[0] + abs(slopes[1]) * edges[1]
    centre = (patch.x_start + patch.x_end) / 2, (patch.y_start + patch.y_end) / 2
    return _facet(np.array((*centre, height / 2)), edges, slopes, height)


def _tier(patch: Patch, top: float) -> SolidBox:
    centre = (patch.x_start + patch.x_end) / 2, (patch.y_start + patch.y_end) / 2
    edges = patch.x_end - patch.x_start, patch.y_end - patch.y_start
    return _upright_box(centre, edges, 0.0, top)


def mixed_scene(
    area: SceneArea, height: float, size: float, rng: np.random.Generator
) -> list[SolidBox]:
    """Return rough ground with boxes and short flights of steps on it.

    Args:
        area: the ground that they take.
        height: greatest height of boxes and steps [m]; a fifth of it is the facets'.
        size: least edge of a facet [m].
        rng: generator of everything about them.
    """
    ground = MIXED_ROUGHNESS * height
    taken: list[_Spot] = []
    boxes = rough_facets(area, ground, size, rng)
    boxes += _flights(area, (ground, height), taken, rng)
    boxes += _scattered(area, (ground, height), _MIXED_DENSITY, taken, rng)
    return boxes


def _scattered(
    area: SceneArea,
    heights: tuple[float, float],
    density: float,
    taken: list[_Spot],
    rng: np.random.Generator,
) -> list[SolidBox]:
    """Return boxes at spots that are free.

    Args:
        area: the ground on which they stand.
        heights: of the ground around them and the greatest of a box [m].
        density: of boxes [1/m^2].
        taken: spots that are taken; those of the boxes are added.
        rng: generator of everything about them.
    """
    ground, highest = heights
    lowest = min(ground + _LOWEST_BOX, highest)
    boxes = []
    for _ in range(round(density * area.surface)):
        edges = rng.uniform(*_BOX_WIDTH, 2)
        yaw, top = rng.uniform(0.0, math.pi), rng.uniform(lowest, highest)
        spot = _free_spot(area, math.hypot(*edges) / 2, taken, rng)
        if spot is not None:
            boxes.append(_upright_box((spot.x, spot.y), (edges[0], edges[1]), yaw, top))
    return boxes


def _flights(
    area: SceneArea, heights: tuple[float, float], taken: list[_Spot], rng: np.random.Generator
) -> list[SolidBox]:
    """Return flights of steps at spots that are free, each up to the greatest height.

    Args:
        area: the ground on which they stand.
        heights: of the ground around them and of the highest step [m].
        taken: spots that are taken; those of the flights are added.
        rng: generator of places and directions.
    """
    ground, highest = heights
    radius = math.hypot(_FLIGHT_STEPS * _FLIGHT_DEPTH, _FLIGHT_WIDTH) / 2
    boxes = []
    for _ in range(round(_FLIGHT_DENSITY * area.surface)):
        yaw = rng.uniform(-math.pi, math.pi)
        spot = _free_spot(area, radius, taken, rng)
        if spot is None:
            continue
        for step in range(_FLIGHT_STEPS):
            along = (step - (_FLIGHT_STEPS - 1) / 2) * _FLIGHT_DEPTH
            centre = spot.x + along * math.cos(yaw), spot.y + along * math.sin(yaw)
            top = ground + (highest - ground) * (step + 1) / _FLIGHT_STEPS
            boxes.append(_upright_box(centre, (_FLIGHT_DEPTH, _FLIGHT_WIDTH), yaw, top))
    return boxes


def _free_spot(
    area: SceneArea, radius: float, taken: list[_Spot], rng: np.random.Generator
) -> _Spot | None:
    """Draw a spot that keeps its distance from those taken, and take it; None if none is found."""
    for _ in range(_TRIES):
        x, y = rng.uniform(START, area.end), rng.uniform(-WIDTH / 2, WIDTH / 2)
        spot = _Spot(x, y, radius)
        if area.holds(spot) and all(
            math.hypot(x - other.x, y - other.y) >= radius + other.radius + _CLEARANCE
            for other in taken
        ):
            taken.append(spot)
            return spot
    return None


def _upright_box(
    centre: tuple[float, float], edges: tuple[float, float], yaw: float, top: float
) -> SolidBox:
    """Return a box from below the plane up to `top`; all in metres and radians."""
    half_height = (top + _BURIED) / 2
    return SolidBox(
        np.array((*centre, top - half_height)),
        np.array((edges[0] / 2, edges[1] / 2, half_height)),
        (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)),
    )
