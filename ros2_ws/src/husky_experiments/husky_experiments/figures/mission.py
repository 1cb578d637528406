"""Figure of a mission: its ways from the side and from above, and the power that they took."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_experiments.figures.navigate import MODE_COLOURS, modes_at_base
from husky_experiments.figures.style import (
    TRUTH,
    frame,
    label,
    line,
    make_figure,
    modes_of,
    save,
    span_of,
)
from husky_experiments.metrics.cycle import power_of
from husky_experiments.recordings.recording import Recording


class Stage(NamedTuple):
    """The way to one goal of a mission: its name, and when it was gone [s]."""

    name: str
    start: float
    end: float


def draw_mission(recording: Recording, stages: Sequence[Stage], directory: Path) -> Path:
    """Draw the true way in the colours of the modes, and the pack's power; return the PNG's path.

    Args:
        recording: of the mission.
        stages: of it, in order.
        directory: that gets `mission.png`.
    """
    title = "Mission: blue walked, orange climbed, purple flown"
    figure, axes = make_figure(3, 1, title, (13.0, 11.0), height_ratios=(1.0, 1.2, 1.0))
    side, above, power = axes[:, 0]
    base, mode = recording.base, modes_at_base(recording)
    ways = {name: mode == name for name in MODE_COLOURS}
    ways[""] = ~np.any(list(ways.values()), axis=0)
    for axis, height, unit in ((side, 2, "z [m]"), (above, 1, "y [m]")):
        for name, gone in ways.items():
            way: Array = np.where(gone[:, None], base.position[:, [0, height]], np.nan)
            axis.plot(*way.T, color=MODE_COLOURS.get(name, TRUTH), linewidth=1.8)
        for stage in stages:
            at = int(np.searchsorted(base.time, stage.end).clip(max=len(base) - 1))
            place = base.position[at, [0, height]]
            axis.plot(*place, "*", color="tab:red", markersize=9)
            axis.annotate(stage.name, place, textcoords="offset points", xytext=(4, 6))
        axis.set_aspect("equal", adjustable="datalim")
        label(axis, unit, "x [m]")
    fans = recording.fans
    line(power, fans.time, power_of(fans)[0], TRUTH)
    frame(power, span_of(recording), modes_of(recording), names=True)
    label(power, "power of the pack [W]", "time [s]")
    return save(figure, directory, "mission")
