"""By how much an image lies above the map, and the drift of odometry's height.

Tilt between image and map is not corrected: each correction would be exact to the map and wrong by
the map's own tilt, which would grow without bound; errors of attitude average out over images.
"""

from __future__ import annotations

import numpy as np

from husky_navigation.cells import Cells, Indices
from husky_navigation.depth_view import SeenCells
from husky_navigation.map_parameters import MapParameters

_ITERATIONS = 3
"""Of the robust mean: the weights of cells that disagree have settled to 1 % by then."""


def height_over_map(
    cells: Cells, seen: SeenCells, places: Indices, parameters: MapParameters
) -> tuple[int, float | None]:
    """Return by how much an image stands above the map.

    It is the mean over the cells that are seen again, edges apart, weighted by their variances,
    with a normal prior; cells that disagree with the rest lose weight (Cauchy).

    Args:
        cells: the map.
        seen: what the image says of it.
        places: of the cells that it has seen.
        parameters: of the map.

    Returns:
        How many cells were compared, and the height [m]; None if these are too few, or if it is
        beyond four deviations: then the pose is another, and single cells tell what is right.
    """
    again = cells.support.reshape(-1)[places] >= parameters.least_support
    again &= seen.edge.reshape(-1)[places] == 0.0
    compared = int(np.count_nonzero(again))
    if compared < parameters.correction_cells:
        return compared, None
    which = places[again]
    differs = seen.height.reshape(-1)[which] - cells.height.reshape(-1)[which]
    variance = seen.variance.reshape(-1)[which] + cells.variance.reshape(-1)[which]
    prior = 1.0 / parameters.correction_deviation**2
    height = 0.0
    for _ in range(_ITERATIONS):
        weight = 1.0 / (variance + ((differs - height) / parameters.gate) ** 2)
        height = float(weight @ differs) / (prior + float(weight.sum()))
    near = abs(height) <= 4.0 * parameters.correction_deviation
    return compared, height if near else None


class HeightDrift:
    """Drift of odometry's height since the map's cells were seen, and its variance.

    A Kalman filter of one state, which is zero after each correction: the map moves instead. The
    drift grows with the distance walked alone, so that a robot that treads on the spot moves
    nothing.

    Attributes:
        variance: of the drift [m^2].
    """

    def __init__(self, growth: float) -> None:
        """Start without drift; its variance grows by `growth` [m^2/m]."""
        self.variance = 0.0
        self._growth = growth

    def walk(self, distance: float) -> None:
        """Let the robot move by a distance [m]."""
        self.variance += self._growth * distance

    def correct(self, difference: float, variance: float) -> float:
        """Return by how much to lift the map that lies below what is measured.

        Args:
            difference: measured height less the map's [m].
            variance: of that, the drift apart [m^2].
        """
        gain = self.variance / (self.variance + variance)
        self.variance *= 1.0 - gain
        return gain * difference
