"""Figure of an elevation map beside the ground's true height."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from husky_description.arrays import Array
from husky_experiments.figures.style import label, make_figure, save
from husky_experiments.metrics.mapping import RADIUS, JudgedMap

_ERROR = 0.06
"""End of the scale of errors [m]."""


def draw_map(maps: Sequence[JudgedMap], directory: Path) -> Path:
    """Draw the last map of a walk, the truth, and the map's error; return the PNG's path.

    Args:
        maps: of the walk, in their order.
        directory: that gets `map.png`.
    """
    last = maps[-1]
    known = last.truth[np.isfinite(last.truth)]
    low, high = float(known.min()) - 0.02, float(known.max()) + 0.02
    figure, axes = make_figure(
        2, 2, f"Elevation map at {last.map.time:.1f} s, and the ground", (11.0, 10.0)
    )
    near = np.isfinite(last.truth)
    heights: dict[str, Any] = {"cmap": "viridis", "vmin": low, "vmax": high}
    errors: dict[str, Any] = {"cmap": "coolwarm", "vmin": -_ERROR, "vmax": _ERROR}
    rmse = float(np.sqrt(np.mean(last.error**2)))
    _draw(axes[0, 0], last, np.where(near, last.height, np.nan), "map [m]", **heights)
    _draw(
        axes[0, 1],
        last,
        np.where(last.in_view, last.truth, np.nan),
        "ground that was in view [m]",
        **heights,
    )
    _draw(axes[1, 0], last, last.height - last.truth, f"error [m], RMSE {rmse:.3f}", **errors)
    easy = np.where(near, last.map.traversability, np.nan)
    _draw(axes[1, 1], last, easy, "traversability [-]", cmap="RdYlGn", vmin=0.0, vmax=1.0)
    directory.mkdir(parents=True, exist_ok=True)
    return save(figure, directory, "map")


def _draw(axis: Axes, judged: JudgedMap, values: Array, title: str, **scale: Any) -> None:
    """Draw the cells around the robot from above."""
    mesh = axis.pcolormesh(judged.x, judged.y, values, shading="nearest", **scale)
    x, y = float(judged.x.mean()), float(judged.y.mean())
    axis.plot([x], [y], marker=">", color="black", markersize=9)
    axis.set_xlim(x - RADIUS, x + RADIUS)
    axis.set_ylim(y - RADIUS, y + RADIUS)
    axis.set_aspect("equal")
    label(axis, "y [m]", "x [m]", title)
    axis.figure.colorbar(mesh, ax=axis, shrink=0.8)
