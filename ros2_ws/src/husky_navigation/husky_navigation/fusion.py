"""Fusion of measured heights into cells: Kalman update, outliers, contradicting heights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_navigation.cells import Cells, Indices
from husky_navigation.map_parameters import MapParameters

_MOST_SUPPORT = 50.0
"""Of a cell: more would make it slow to change."""
_AS_SURE = 4.0
"""Variance of another height over that of the cell's, up to which it may replace it."""


class HeightMeasurements(NamedTuple):
    """Heights of the ground that were measured in k cells, arrays (k,).

    Attributes:
        height: in odom [m].
        variance: of that [m^2].
        lasting: the part of the variance that further measurements have in common [m^2].
        points: that were measured.
        offset_x, offset_y: mean of their places, from the cell's centre [m].
    """

    height: Array
    variance: Array
    lasting: Array
    points: Array
    offset_x: Array
    offset_y: Array

    def of(self, which: NDArray[np.bool_]) -> HeightMeasurements:
        """Return those of some of the cells."""
        return HeightMeasurements(*(values[which] for values in self))


class FusionOutcome(NamedTuple):
    """Effect of measurements on the map.

    Attributes:
        contradicted: cells that were contradicted and keep their height.
        replaced: cells that have taken another height.
        believed: whether the measurements' pose was.
    """

    contradicted: int
    replaced: int
    believed: bool


def level_cells(height: Array, variance: float, points: float) -> HeightMeasurements:
    """Return measurements of heights (k,) [m] that fill their cells, with one variance [m^2]."""
    none = np.zeros(height.shape)
    return HeightMeasurements(
        height, np.full(height.shape, variance), none, np.full(height.shape, points), none, none
    )


def fuse(
    cells: Cells, places: Indices, seen: HeightMeasurements, parameters: MapParameters
) -> FusionOutcome:
    """Fuse measurements into cells.

    A measurement within the gate updates its cell as a Kalman filter of one state does. One beyond
    it is remembered as another height of the cell, which replaces the first when it has been
    measured often enough. Measurements most of which contradict the map have a wrong pose, or the
    map has: they tell other heights only, so that a stumble leaves the map as it was.

    Args:
        cells: the map.
        places: of the cells that were measured (k,), each at most once.
        seen: what was measured in them.
        parameters: of the map.
    """
    flat = Cells(*(values.reshape(-1) for values in cells))
    height, variance = flat.height[places], flat.variance[places]
    unseen = np.isnan(height)
    differs = seen.height - height
    # NaN agrees with nothing.
    agrees = differs * differs <= parameters.gate**2 * (variance + seen.variance)
    against = ~agrees & ~unseen
    contradicted, agreed = int(np.count_nonzero(against)), int(np.count_nonzero(agrees))
    believed = contradicted <= parameters.contradicted_most * (contradicted + agreed)
    if believed:
        _update(flat, places[agrees], seen.of(agrees), differs[agrees], parameters)
        _begin(flat, places[unseen], seen.of(unseen))
    replaced = _contradict(flat, places[against], seen.of(against), parameters)
    return FusionOutcome(contradicted - replaced, replaced, believed)


def raise_tops(cells: Cells, places: Indices, edges: Array) -> None:
    """Let the tops of cells rise to upper edges that were seen in them (k,) [m], NaN for none.

    They are believed at once: a camera that rises sees the edge of a wall higher in each image, and
    little else where the wall is near.
    """
    top, looked_over = cells.top.reshape(-1), cells.looked_over.reshape(-1)
    top[places] = np.fmax(top[places], edges)
    measured = places[~np.isnan(edges)]
    looked_over[measured] = cells.age.reshape(-1)[measured] = 0.0


def _begin(flat: Cells, places: Indices, seen: HeightMeasurements) -> None:
    """Let cells begin anew with a height."""
    flat.height[places] = seen.height
    flat.variance[places] = seen.variance
    flat.support[places] = np.minimum(_MOST_SUPPORT, seen.points)
    flat.expected[places] = 0.0
    flat.offset_x[places] = seen.offset_x
    flat.offset_y[places] = seen.offset_y
    flat.contradictions[places] = 0
    flat.looked_through[places] = 0
    flat.age[places] = 0.0


def _update(
    flat: Cells,
    places: Indices,
    seen: HeightMeasurements,
    differs: Array,
    parameters: MapParameters,
) -> None:
    """Update cells with measurements that agree with them."""
    before = flat.variance[places]
    gain = before / (before + seen.variance)
    flat.height[places] += gain * differs
    # What measurements have in common does not average out.
    least = np.maximum(parameters.least_variance, np.minimum(before, seen.lasting))
    flat.variance[places] = np.maximum((1.0 - gain) * before, least)
    support = np.minimum(_MOST_SUPPORT, flat.support[places] + seen.points)
    flat.support[places] = support
    share = np.minimum(1.0, seen.points / support)
    flat.offset_x[places] += share * (seen.offset_x - flat.offset_x[places])
    flat.offset_y[places] += share * (seen.offset_y - flat.offset_y[places])
    flat.contradictions[places] = np.maximum(0, flat.contradictions[places] - 1)
    through = flat.looked_through[places] - 1.0
    flat.looked_through[places] = np.maximum(0, through)
    flat.age[places] = 0.0


def _contradict(
    flat: Cells, places: Indices, seen: HeightMeasurements, parameters: MapParameters
) -> int:
    """Remember heights that contradict cells; return how many cells have taken them over.

    A cell does so when measurements agree on the other height for long enough, and about as surely
    as on the first: a blurred view from afar does not replace a good one, unless it lasts.
    """
    other, variance = flat.other_height[places], flat.other_variance[places]
    support, count = flat.other_support[places], flat.contradictions[places]
    differs = seen.height - other
    same = differs * differs < parameters.gate**2 * (variance + seen.variance)
    same &= count > 0
    gain = variance / (variance + seen.variance)
    other = np.where(same, other + gain * differs, seen.height)
    variance = np.where(same, (1.0 - gain) * variance, seen.variance)
    support = np.where(same, support + seen.points, seen.points)
    count = np.where(same, count + 1.0, 1.0)
    flat.other_height[places], flat.other_variance[places] = other, variance
    flat.other_support[places], flat.contradictions[places] = support, count

    agreed = count >= parameters.least_contradictions
    agreed &= variance < _AS_SURE * flat.variance[places]
    agreed |= count >= parameters.lasting_contradictions
    least = np.maximum(parameters.least_variance, seen.lasting)
    taken = seen._replace(height=other, variance=np.maximum(variance, least), points=support)
    _begin(flat, places[agreed], taken.of(agreed))
    return int(np.count_nonzero(agreed))
