"""Figure of the whole way: seen from the side over the course, and the power that it took."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from husky_experiments.figures.style import (
    DESIRED,
    ESTIMATE,
    TRUTH,
    finish,
    frame,
    label,
    line,
    make_figure,
    modes_of,
    span_of,
)
from husky_experiments.gap_course import GapCourse
from husky_experiments.metrics.cycle import Leg, power_of
from husky_experiments.recordings.recording import Recording
from husky_sim.gap import DEPTH

_GROUND = "#d8cfbf"


def cycle_figure(
    recording: Recording, course: GapCourse, legs: Sequence[Leg], directory: Path
) -> Path:
    """Draw the way of the base over the course from its right side, and the pack's power."""
    size = (13.0, 7.0)
    figure, axes = make_figure(2, 1, "The whole way", size=size, height_ratios=(1.1, 1.0))
    side, power = axes[:, 0]
    _draw_ground(side, course)
    base, estimate = recording.base, recording.estimate
    line(side, base.position[:, 0], base.position[:, 2], TRUTH, linewidth=1.8)
    line(side, estimate.position[:, 0], estimate.position[:, 2], ESTIMATE, linewidth=0.9)
    for leg in legs:
        at = int(np.searchsorted(base.time, leg.start))
        if at < len(base):
            side.plot(*base.position[at, [0, 2]], "o", markersize=4, color=DESIRED)
    side.set_aspect("equal", adjustable="box")
    label(side, "z [m]", "x [m]", "base over the course; dots: where its legs of the way begin")
    fans = recording.fans
    whole, rotors = power_of(fans)
    line(power, fans.time, whole, TRUTH)
    line(power, fans.time, rotors, DESIRED)
    frame(power, span_of(recording), modes_of(recording), names=True)
    label(power, "power of the pack [W]", "time [s]")
    entries = [
        ("truth, whole power", {"color": TRUTH}),
        ("estimate", {"color": ESTIMATE}),
        ("rotors", {"color": DESIRED}),
    ]
    return finish(figure, entries, directory, "cycle")


def _draw_ground(axis: Axes, course: GapCourse) -> None:
    """Fill the ground as seen from the side, from the pit's bottom down to nothing."""
    bottom = -DEPTH - 0.1
    start, end = course.surface.blocks[0].start, course.surface.blocks[-1].end
    axis.fill_between((start, end), bottom, -DEPTH, color=_GROUND, linewidth=0)
    for block in course.surface.blocks:
        axis.fill_between((block.start, block.end), bottom, block.top, color=_GROUND, linewidth=0)
    axis.set_xlim(-0.5, end)
