"""Figures of the feet: forces of the ground, and which leg stands when."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_experiments.figures.style import (
    LEG_COLOURS,
    PARTS,
    TIME,
    TRUTH,
    close_look,
    each_leg,
    finish,
    frame,
    label,
    leg_entries,
    line,
    make_figure,
    modes_of,
    save,
    span_of,
)
from husky_experiments.recordings.recording import Recording


def contact_forces(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Forces of the ground on each foot: vertical and horizontal."""
    contacts = recording.contacts
    vertical = contacts.force[..., 2]
    horizontal = np.linalg.norm(contacts.force[..., :2], axis=-1)
    figure, axes = make_figure(
        4,
        2,
        "Forces of the ground on the feet",
        size=(13.0, 8.6),
        sharex="col",
        sharey=True,
        gridspec_kw={"width_ratios": (1.4, 1.0)},
    )
    modes = modes_of(recording)
    for column, span in enumerate((span_of(recording), close_look(recording))):
        inside = (contacts.time >= span[0]) & (contacts.time <= span[1])
        time = contacts.time[inside]
        for leg, axis, words, colour in each_leg(axes[:, column], robot.legs):
            line(axis, time, vertical[inside, leg], colour, linewidth=0.9)
            line(axis, time, horizontal[inside, leg], TRUTH, linewidth=0.7)
            frame(axis, span, modes, names=leg == 0)
            label(
                axis,
                y=f"{words} [N]" if column == 0 else "",
                x=TIME if leg == 3 else "",
                title=PARTS[column] if leg == 0 else "",
            )
    vertical_entries = [(f"{name}, vertical", look) for name, look in leg_entries(robot.legs)]
    entries = [*vertical_entries, ("horizontal", {"color": TRUTH})]
    return finish(figure, entries, directory, "contact_forces")


def gait(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Which leg stands when: truly, felt by the controller, planned by the gait."""
    span = close_look(recording)
    states, contacts = recording.controller, recording.contacts
    figure, axes = make_figure(
        2,
        1,
        "Gait: which leg stands",
        size=(13.0, 6.0),
        sharex=True,
        gridspec_kw={"height_ratios": (4.0, 1.0)},
    )
    axis, phase = axes[:, 0]
    kinds = (
        ("touches the ground", contacts.time, contacts.contact, 1.0),
        ("carries load, felt", states.time, states.contact, 0.6),
        ("stands in the plan", states.time, states.stance, 0.3),
    )
    for leg, colour in enumerate(LEG_COLOURS):
        for row, (_, time, stands, opacity) in enumerate(kinds):
            bars = _runs(time, stands[:, leg], *span)
            axis.broken_barh(
                bars, (leg * 3.6 + row, 0.9), facecolor=colour, alpha=opacity, linewidth=0
            )
        axis.annotate(
            robot.legs[leg].replace("_", " "),
            (1.0, leg * 3.6 + 1.45),
            xycoords=("axes fraction", "data"),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            color=colour,
            fontweight="bold",
            annotation_clip=False,
        )
    axis.set_yticks(
        [leg * 3.6 + row + 0.45 for leg in range(4) for row in range(3)],
        [kind[0] for _ in range(4) for kind in kinds],
    )
    axis.set_ylim(4 * 3.6 - 0.5, -0.3)
    axis.grid(False, axis="y")
    line(phase, states.time, states.phase, TRUTH)
    phase.set_ylim(0.0, 1.0)
    label(axis, title=" ")
    label(phase, "phase [-]", TIME)
    for each in (axis, phase):
        frame(each, span, modes_of(recording), names=each is axis)
    return save(figure, directory, "gait")


def _runs(
    time: Array, on: NDArray[np.bool_], start: float, end: float
) -> list[tuple[float, float]]:
    """Return (start, length) of the times in which a flag is set."""
    inside = (time >= start) & (time <= end)
    times, flags = time[inside], on[inside].astype(np.int8)
    edges = np.diff(np.concatenate(([0], flags, [0])))
    stop = np.append(times, end)
    return [
        (float(times[first]), float(stop[behind] - times[first]))
        for first, behind in zip(
            np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True
        )
    ]
