"""Parameters of the elevation map, each with unit, range and reason."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

from husky_description.parameters import bounds_of, count, number, read_value

MOST_CELLS = 1000
"""Along an edge of the map: one of 6 layers then takes 24 MB."""


@dataclass(frozen=True)
class MapParameters:
    """Parameters of `ElevationMap`.

    The sensor's figures are those that ANYbotics' elevation_mapping uses for the D435
    (`realsense_d435.yaml`), after Nguyen et al. 2012; so are gate and least variance.

    Attributes:
        resolution: edge of a cell [m].
        length: edge of the map [m]; a whole, even number of cells.

        least_depth, most_depth: nearer and farther depths are not used [m]; beyond, the axial
            deviation exceeds 3 cm.
        axial_floor, axial_growth, axial_depth: deviation of a depth d along the optical axis,
            floor + growth (d - depth)^2 [m, 1/m, m].
        lateral: deviation of a ray's direction, over the focal length [-].
        headroom: points higher above the camera than this are no ground [m].
        height_deviation: of the camera's height in one image [m].
        attitude_deviation: of the camera's roll and pitch in one image [rad].

        edge_gate: deviations within which a neighbouring pixel sees the same surface [-].
        edge_share: share of the neighbours that must do so, or the pixel is a flying one [-]; a
            straight edge leaves 5 of 8, mixed depths stand alone.

        gate: deviations beyond which a measurement contradicts a cell [-].
        least_variance: of a cell [m^2].
        lasting_share: of the pose's variance that images have in common, so that it does not
            average out [-].
        travel_variance: growth of a cell's variance with the distance walked [m^2/m]: 3 mm per
            root metre of odometry's drift.
        time_variance: growth of a cell's variance with time [m^2/s]: the world changes.
        least_support: points that a cell needs to be seen [-]: one may be a stray.
        least_share: of the points that images which had a cell in view would have given to ground
            there, those that it must have got [-]: else it is noise of an edge, over hidden ground.
        most_offset: distance of their mean from the cell's centre beyond which they do not tell the
            height there [-], in edges of a cell: they end at an edge of the ground.
        least_contradictions: images that must agree on another height, about as sure as the
            cell's, before a cell takes it [-].
        lasting_contradictions: images that must agree on another height that is less sure [-].
        contradicted_most: share of the cells seen again beyond which an image that contradicts
            them changes nothing else [-]: then its pose is wrong, or the map's.
        wall_deviation: deviation of heights in a cell, noise apart, from which on it holds an edge
            [m]: 1.2 cm is that of a step of 4 cm.

        correction_cells: cells seen again that a correction of an image needs [-].
        correction_deviation: of the corrections of an image's height [m]; beyond four of them
            nothing is corrected.
        drift_variance: growth of the variance of odometry's height drift with distance [m^2/m].
        image_deviation: of the drift that one image shows [m]; large, for errors of images last.
        foothold_deviation: of the ground's height at a foothold, drift apart [m].

        see_through_margin: height by which the seen ground must lie under a cell [m].
        see_through_images: images that must look through a cell before it is removed [-].
        see_through_most: share of the cells in view beyond which an image removes none [-]: then
            its pose is wrong, not the map.

        plane_cells: cells to each side of one in the plane fitted through it [-].
        most_slope, most_step, most_roughness: limits [rad, m, m], of traversability_estimation.
        critical_cells: cells around that must stand at a step beyond the limit before it counts in
            full [-].
    """

    resolution: Annotated[float, number(0.01, 0.5)] = 0.04
    length: Annotated[float, number(1.0, 40.0)] = 8.0

    least_depth: Annotated[float, number(0.05, 2.0)] = 0.2
    most_depth: Annotated[float, number(0.5, 20.0)] = 3.25
    axial_floor: Annotated[float, number(1e-5, 0.1)] = 0.000611
    axial_growth: Annotated[float, number(0.0, 0.1)] = 0.003587
    axial_depth: Annotated[float, number(0.0, 2.0)] = 0.3515
    lateral: Annotated[float, number(0.0, 0.1)] = 0.01576
    headroom: Annotated[float, number(-0.5, 5.0)] = 0.3
    height_deviation: Annotated[float, number(1e-4, 0.1)] = 0.003
    attitude_deviation: Annotated[float, number(1e-4, 0.1)] = 0.005

    edge_gate: Annotated[float, number(1.0, 10.0)] = 1.5
    edge_share: Annotated[float, number(0.0, 1.0)] = 0.55

    gate: Annotated[float, number(1.0, 10.0)] = 2.5
    least_variance: Annotated[float, number(1e-8, 1e-2)] = 9e-6
    lasting_share: Annotated[float, number(0.0, 1.0)] = 0.25
    travel_variance: Annotated[float, number(0.0, 1e-2)] = 9e-6
    time_variance: Annotated[float, number(0.0, 1e-2)] = 1e-7
    least_support: Annotated[int, count(1, 100)] = 6
    least_share: Annotated[float, number(0.0, 1.0)] = 0.45
    most_offset: Annotated[float, number(0.1, 1.0)] = 0.2
    least_contradictions: Annotated[int, count(1, 100)] = 3
    lasting_contradictions: Annotated[int, count(1, 1000)] = 8
    contradicted_most: Annotated[float, number(0.0, 1.0)] = 0.5
    wall_deviation: Annotated[float, number(0.001, 0.5)] = 0.012

    correction_cells: Annotated[int, count(3, 100000)] = 100
    correction_deviation: Annotated[float, number(1e-4, 0.1)] = 0.01
    drift_variance: Annotated[float, number(0.0, 1e-2)] = 1.6e-5
    image_deviation: Annotated[float, number(1e-4, 1.0)] = 0.02
    foothold_deviation: Annotated[float, number(1e-4, 0.1)] = 0.008

    see_through_margin: Annotated[float, number(0.0, 1.0)] = 0.05
    see_through_images: Annotated[int, count(1, 100)] = 3
    see_through_most: Annotated[float, number(0.0, 1.0)] = 0.3

    plane_cells: Annotated[int, count(1, 10)] = 2
    most_slope: Annotated[float, number(0.01, 1.57)] = 1.0
    most_step: Annotated[float, number(0.01, 1.0)] = 0.12
    most_roughness: Annotated[float, number(0.001, 1.0)] = 0.05
    critical_cells: Annotated[int, count(1, 9)] = 4

    def __post_init__(self) -> None:
        """Check every number.

        Raises:
            ValueError: one is not a number, out of range, or contradicts another; names it, its
                value and what is allowed.
        """
        bounds = bounds_of(type(self))
        for field in fields(self):
            read_value(getattr(self, field.name), bounds[field.name], field.name)
        if self.least_depth >= self.most_depth:
            raise ValueError(
                f"least_depth: {self.least_depth} is not below most_depth, {self.most_depth}"
            )
        cells = self.length / self.resolution
        if abs(cells - round(cells)) > 1e-6 or round(cells) % 2:
            raise ValueError(
                f"length: {self.length} is not an even number of cells of {self.resolution} m"
            )
        if round(cells) > MOST_CELLS:
            raise ValueError(
                f"length: {self.length} is {round(cells)} cells of {self.resolution} m, it must be "
                f"{MOST_CELLS} at most"
            )

    @property
    def cells(self) -> int:
        """Cells along an edge of the map."""
        return round(self.length / self.resolution)
