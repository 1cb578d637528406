"""How a frame that bends shows: attitude and footholds over its eigenfrequency (T6)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from husky_experiments.figures.style import FAN_COLOURS, finish, label, make_figure

_ROWS = {
    "roll_rms_deg": "roll, rms [deg]",
    "pitch_rms_deg": "pitch, rms [deg]",
    "foot_placement_rms_mm": "foot placement error, rms [mm]",
    "attitude_margin_deg": "tilt left until a fall [deg]",
}

_LEAST_SCALE = 0.1
"""Of an axis, in its unit."""


def draw_compliance(
    found: Mapping[str, Mapping[float, Mapping[str, Any]]], directory: Path
) -> Path:
    """Draw figures of several cases over the frame's frequency; a cross is a criterion not met.

    Axes are scaled to the runs that meet their criteria.

    Args:
        found: figures of a case by its name and the frequency [Hz], 0 for a stiff frame.
        directory: where the PNG file goes; made if need be.

    Returns:
        The file written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    figure, grid = make_figure(2, 2, "The frame bends", (11.0, 7.5))
    frequencies = list(next(iter(found.values())))
    names = [f"{hz:g}" if hz else "stiff" for hz in frequencies]
    places = np.arange(len(frequencies))
    holds = np.array([[rows[hz]["ok"] for hz in frequencies] for rows in found.values()])
    for axis, (key, title) in zip(grid.flat, _ROWS.items(), strict=True):
        values = np.array(
            [[rows[hz].get(key) for hz in frequencies] for rows in found.values()], dtype=float
        )
        # A robot that falls leaves the others' scale: its cross stands at the edge.
        top = 1.15 * np.nanmax(np.where(holds, values, np.nan), initial=_LEAST_SCALE)
        for colour, line, ok in zip(FAN_COLOURS, values, holds, strict=False):
            axis.plot(places, line, "o-", color=colour, linewidth=1.2, markersize=4)
            crosses = np.clip(line[~ok], 0.03 * top, 0.97 * top)
            axis.plot(places[~ok], crosses, "x", color=colour, markersize=11)
        axis.set_xticks(places, names)
        axis.set_ylim(0.0, top)
        label(axis, title, "eigenfrequency of the loaded frame [Hz]")
    entries: list[tuple[str, dict[str, Any]]] = [
        (case.replace("_", " "), {"color": colour})
        for case, colour in zip(found, FAN_COLOURS, strict=False)
    ]
    entries.append(("a criterion not met", {"linestyle": "", "marker": "x", "color": "black"}))
    return finish(figure, entries, directory, "compliance")
