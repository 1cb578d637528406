"""Figure of journeys through worlds of obstacles, from above."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from husky_description.arrays import Array
from husky_experiments.figures.style import label, make_figure, save
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Words
from husky_navigation.planning.route import PlanePose, Route
from husky_navigation.planning.world_map import WorldMap

_COLUMNS, _SIZE = 4, 4.5
"""Worlds in a row, and the size of each in the figure [inch]."""
MODE_COLOURS = {"wair": "tab:orange", "walk": "tab:blue", "quadrotor": "tab:purple"}
"""Of the way, by the controller's mode."""
_VIEW = (-2.0, 11.0), (-6.5, 6.5)
"""Ground that is drawn: x and y [m]."""


class Journey(NamedTuple):
    """One journey.

    Attributes:
        title: what it was.
        ground: its map, all of it seen.
        best: cheapest route on it, None where there is none.
        goal: of the robot.
        position: of the base on its way, x and y (n, 2) [m].
        mode: of the controller there (n,).
    """

    title: str
    ground: WorldMap
    best: Route | None
    goal: PlanePose
    position: Array
    mode: Words


def draw_journeys(journeys: Sequence[Journey], directory: Path) -> Path:
    """Draw ground, true way in the colours of the modes, and best route; return the PNG's path.

    Args:
        journeys: one or more.
        directory: that gets `journeys.png`.
    """
    columns = min(_COLUMNS, len(journeys))
    rows = math.ceil(len(journeys) / columns)
    size = _SIZE * columns, _SIZE * rows + 0.5
    figure, axes = make_figure(rows, columns, "Walk blue, climb orange, fly purple", size)
    for axis in axes.flat[len(journeys) :]:
        axis.set_axis_off()
    for axis, journey in zip(axes.flat, journeys, strict=False):
        _draw(axis, journey)
    return save(figure, directory, "journeys")


def modes_at_base(recording: Recording) -> Words:
    """Return the controller's mode at each of the base's times (n,)."""
    states, times = recording.controller, recording.base.time
    newest = np.searchsorted(states.time, times).clip(max=len(states.time) - 1)
    modes: Words = states.mode[newest]
    return modes


def _draw(axis: Axes, journey: Journey) -> None:
    ground = journey.ground
    x, y = ground.lattice.cell_centers()
    axis.pcolormesh(x, y, ground.elevation.T, cmap="Greys", vmin=-0.8, vmax=1.6, shading="nearest")
    if journey.best is not None:
        for leg in journey.best.legs:
            axis.plot(*leg.points.T, color="tab:green", linestyle=":", linewidth=1.5)
    for name, colour in MODE_COLOURS.items():
        way: Array = np.where((journey.mode == name)[:, None], journey.position, np.nan)
        axis.plot(*way.T, color=colour, linewidth=2.0)
    axis.plot([journey.goal.x], [journey.goal.y], marker="*", color="tab:red", markersize=10)
    axis.set_xlim(*_VIEW[0])
    axis.set_ylim(*_VIEW[1])
    axis.set_aspect("equal")
    label(axis, "y [m]", "x [m]", journey.title)
