"""Figure of a campaign: a metric over the first option that differs, with confidence intervals."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd

from husky_experiments.figures.style import FAN_COLOURS, label, make_figure, save

_MARKERS = "osD^v<>P"
_SPREAD = 0.4
"""Width that the points of all lines take at one place, as a share of that between places."""
_MOST_NAMES = 16
"""Lines that are named in the figure."""


@matplotlib.rc_context({"text.parse_math": False})  # a `$` in a name is no mathematics
def draw_summary(summary: pd.DataFrame, conditions: Sequence[str], directory: Path) -> Path:
    """Draw mean, interval and extremes of one metric for each condition.

    Args:
        summary: rows of that metric, with the columns of `report.summarise`.
        conditions: options that differ; the first one gives the axis, all others the lines.
        directory: to write into, made if need be.
    """
    directory.mkdir(parents=True, exist_ok=True)
    metric = str(summary["metric"].iloc[0])
    figure, axes = make_figure(1, 1, metric, size=(9.0, 5.0))
    axis = axes[0, 0]
    across, others = (conditions[0] if conditions else ""), list(conditions[1:])
    places = list(dict.fromkeys(summary[across])) if across else [""]
    numeric = len(places) > 1 and all(isinstance(p, int | float) for p in places)
    at = np.array(sorted(places), float) if numeric else np.arange(float(len(places)))
    lines = list(summary.groupby(others, sort=False, dropna=False)) if others else [((), summary)]
    step = _SPREAD * (float(np.diff(at).min()) if len(at) > 1 else 1.0) / max(8, len(lines))
    for number, (chosen, line) in enumerate(lines):
        x = (
            line[across].to_numpy(float)
            if numeric
            else (
                np.array([places.index(p) for p in line[across]], float) if across else np.zeros(1)
            )
        )
        x = x + step * (number - (len(lines) - 1) / 2)
        colour = FAN_COLOURS[number % len(FAN_COLOURS)]
        mean = line["mean"].to_numpy()
        reach = np.vstack((mean - line["low"], line["high"] - mean))
        axis.errorbar(
            x,
            mean,
            yerr=np.nan_to_num(np.clip(reach, 0.0, None)),
            color=colour,
            marker=_MARKERS[number // len(FAN_COLOURS) % len(_MARKERS)],
            markersize=5,
            capsize=3,
            linewidth=1.2 if numeric else 0.0,
            elinewidth=1.4,
            label=", ".join(f"{n} {v}" for n, v in zip(others, chosen, strict=True)),
        )
        extremes = itertools.chain(line["least"], line["greatest"])
        axis.scatter(np.tile(x, 2), list(extremes), color=colour, marker="_", s=40, alpha=0.5)
    if not numeric:
        axis.set_xticks(at, [str(place) for place in places], rotation=30 * (len(places) > 6))
    if others and len(lines) <= _MOST_NAMES:
        axis.legend(fontsize=7, frameon=False)
    sizes = " to ".join(str(n) for n in sorted({summary["n"].min(), summary["n"].max()}))
    label(axis, metric, across or "all runs")
    note = f"mean, 95 % interval, least and greatest of {sizes} runs each"
    axis.set_title(note, fontsize=8, loc="left", color="#555555")
    return save(figure, directory, metric.replace("/", "_"))
