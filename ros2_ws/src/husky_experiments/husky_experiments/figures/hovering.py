"""Figures of a robot that hovers: how it keeps its place, and steps of its heading."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from husky_experiments.figures.style import (
    DESIRED,
    ESTIMATE,
    LEG_COLOURS,
    TRUTH,
    finish,
    label_rows,
    line,
    make_figure,
)
from husky_experiments.metrics.hovering import HeadingStep, Stray

_LOOKS = {"off": ("drag of the propellers", TRUTH), "on": ("tilted propellers too", ESTIMATE)}
"""Name in words and colour of a turn without and with thrust vectoring."""


def hold_figure(estimated: Stray, true: Stray, directory: Path) -> Path:
    """Draw the way from the place along x, y, z by estimate and truth, and the tilt."""
    figure, axes = make_figure(4, 1, "Hover: distance from its place", sharex=True)
    for stray, colour in ((true, TRUTH), (estimated, ESTIMATE)):
        for axis, offset in zip(axes[:3, 0], stray.offset.T, strict=True):
            line(axis, stray.time, 1e3 * offset, colour)
        line(axes[3, 0], stray.time, np.degrees(stray.tilt), colour)
    label_rows(axes[:, 0], ("x [mm]", "y [mm]", "z [mm]", "tilt [deg]"))
    entries = [("truth", {"color": TRUTH}), ("estimate", {"color": ESTIMATE})]
    return finish(figure, entries, directory, "hover")


def turn_figure(turns: Mapping[str, HeadingStep], directory: Path) -> Path:
    """Draw heading, motors' commands and hips of turns, by `on` and `off`, on one clock."""
    title = "Step of the heading without and with thrust vectoring (T21)"
    figure, axes = make_figure(3, 1, title, sharex=True)
    heading, motors, hips = axes[:, 0]
    for key, turn in turns.items():
        colour = _LOOKS[key][1]
        line(heading, turn.time, np.degrees(turn.heading), colour, linewidth=1.5)
        for motor in turn.motors.T:
            line(motors, turn.time, 100.0 * motor, colour, linewidth=0.8)
        heading.axhline(np.degrees(turn.step), color=DESIRED, linewidth=0.9, linestyle="--")
    if "on" in turns:
        for leg, colour in zip(turns["on"].hips.T, LEG_COLOURS, strict=True):
            line(hips, turns["on"].time, np.degrees(leg), colour)
    label_rows(axes[:, 0], ("heading [deg]", "motors' commands [%]", "hip frontal angles [deg]"))
    entries = [(_LOOKS[key][0], {"color": _LOOKS[key][1]}) for key in turns]
    return finish(figure, [*entries, ("asked", {"color": DESIRED})], directory, "yaw_step")
