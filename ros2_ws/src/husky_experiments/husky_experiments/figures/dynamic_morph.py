"""Figure of legs that become arms while others stand: feet, balance, thrust, tilt and heading."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from husky_description.robot import LEG_NAMES
from husky_experiments.figures.style import (
    LEG_COLOURS,
    TRUTH,
    frame_rows,
    label_rows,
    leg_entries,
    legend,
    line,
    make_figure,
    save,
)
from husky_experiments.metrics.dynamic_morph import Balancing
from husky_experiments.recordings.recording import Recording

_YAW = "#e07a00"


def dynamic_morph_figure(morphs: list[Balancing], recording: Recording, directory: Path) -> Path:
    """Draw all morphs of a recording, one after the other."""
    title = "Legs that become arms while others stand"
    figure, axes = make_figure(4, 1, title, size=(13.0, 9.0), sharex=True)
    feet, balance, thrust, attitude = axes[:, 0]
    for morph in morphs:
        for leg, colour in enumerate(LEG_COLOURS):
            line(feet, morph.time, 1e3 * morph.foot[:, leg], colour)
            line(thrust, morph.time, morph.thrust[:, leg], colour)
        line(balance, morph.time, 1e3 * morph.inside, TRUTH)
        line(attitude, morph.time, np.degrees(morph.tilt), TRUTH)
        line(attitude, morph.time, np.degrees(morph.yaw), _YAW)
    balance.axhline(0.0, color="#8b1a1a", linewidth=0.8)
    frame_rows(recording, axes[:, 0])
    lines = [("tilt", {"color": TRUTH}), ("heading", {"color": _YAW})]
    legend(figure, [*leg_entries(LEG_NAMES), *lines])
    label_rows(
        axes[:, 0],
        (
            "feet [mm]",
            "centre of mass inside\nof two feet's line [mm]",
            "thrust [N]",
            "tilt, heading [deg]",
        ),
    )
    return save(figure, directory, "dynamic_morph")
