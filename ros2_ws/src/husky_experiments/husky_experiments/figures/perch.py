"""Figure of a robot on its perch: balance and tilt while its legs become arms and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from husky_experiments.figures.style import TRUTH, frame, label_rows, line, make_figure, save
from husky_experiments.figures.style import modes_of as bands_of
from husky_experiments.metrics.morph import MorphTimes, PerchStability
from husky_experiments.recordings.recording import Recording

_MARKS = {
    "touch": "perch touches",
    "armed": "legs are arms",
    "lift_off": "lift-off",
    "landed": "landed",
}
"""Attributes of `MorphTimes` that are marked, and in words."""
_MARK = "#8b1a1a"


def perch_figure(
    stability: PerchStability, times: MorphTimes, recording: Recording, directory: Path
) -> Path:
    """Draw margin of the centre of mass on the perch and tilt of the body, steps marked."""
    title = "On the perch: static margin and tilt"
    figure, axes = make_figure(2, 1, title, size=(13.0, 6.5), sharex=True)
    margin, tilt = axes[:, 0]
    rests = np.where(stability.resting, 1.0, np.nan)
    line(margin, stability.time, 1e3 * stability.margin * rests, TRUTH, linewidth=1.5)
    line(tilt, stability.time, np.degrees(stability.tilt), TRUTH, linewidth=1.2)
    margin.axhline(0.0, color=_MARK, linewidth=0.8)
    span = float(stability.time[0]), float(stability.time[-1])
    for row, axis in enumerate(axes[:, 0]):
        frame(axis, span, bands_of(recording), names=row == 0)
        for name, words in _MARKS.items():
            at = getattr(times, name)
            axis.axvline(at, color=_MARK, linewidth=0.9, linestyle=(0, (4, 2)))
            if row == 1:
                axis.annotate(
                    words,
                    (at, 0.96),
                    xycoords=("data", "axes fraction"),
                    xytext=(3, 0),
                    textcoords="offset points",
                    va="top",
                    rotation=90,
                    fontsize=7,
                    color=_MARK,
                )
    label_rows(axes[:, 0], ("margin on the perch [mm]", "tilt [deg]"))
    return save(figure, directory, "perch")
