"""Figures of the body: position, velocity, attitude, and its path seen from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from husky_description.robot import Robot
from husky_experiments.figures.style import (
    DESIRED,
    ESTIMATE,
    LEG_COLOURS,
    TRUTH,
    finish,
    frame_rows,
    label,
    label_rows,
    leg_entries,
    line,
    make_figure,
)
from husky_experiments.metrics import measures
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph


def body(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Position and velocity of the base: truth, estimate, desired."""
    base = recording.base
    figure, axes = make_figure(3, 2, "Body: position and velocity", sharex=True)
    velocity = measures.in_heading(base.velocity, base.rpy[:, 2])
    for row in range(3):
        line(axes[row, 0], base.time, base.position[:, row], TRUTH, linewidth=1.6)
        line(axes[row, 1], base.time, velocity[:, row], TRUTH, linewidth=1.2)
    if recording.has(graph.ODOMETRY):
        estimate = recording.estimate
        velocity = measures.in_heading(estimate.velocity, estimate.rpy[:, 2])
        for row in range(3):
            line(axes[row, 0], estimate.time, estimate.position[:, row], ESTIMATE)
            line(axes[row, 1], estimate.time, velocity[:, row], ESTIMATE, linewidth=0.7)
    if recording.has(graph.CONTROLLER_STATE):
        states = recording.controller
        standing = np.isin(states.mode, ("stand", "walk"))[:, None]
        ordered = np.isin(states.mode, ("walk", "position_trot"))[:, None]
        desired = np.where(standing, states.desired_position, np.nan)
        commanded = np.where(ordered, states.commanded_velocity, np.nan)
        for row in range(3):
            line(axes[row, 0], states.time, desired[:, row], DESIRED, linestyle="--")
        for row in range(2):
            line(axes[row, 1], states.time, commanded[:, row], DESIRED, linestyle="--")
    for column in axes.T:
        frame_rows(recording, column)
    label_rows(axes[:, 0], ("x [m]", "y [m]", "z [m]"), "base in world")
    speeds = ("forward [m/s]", "left [m/s]", "up [m/s]")
    label_rows(axes[:, 1], speeds, "velocity along the heading")
    entries = [
        ("truth", {"color": TRUTH}),
        ("estimate", {"color": ESTIMATE}),
        ("desired", {"color": DESIRED, "linestyle": "--"}),
    ]
    return finish(figure, entries, directory, "body")


def attitude(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Roll, pitch and yaw: truth and estimate."""
    base = recording.base
    figure, axes = make_figure(3, 1, "Attitude of the base", sharex=True)
    for row, axis in enumerate(axes[:, 0]):
        line(axis, base.time, np.degrees(base.rpy[:, row]), TRUTH, linewidth=1.3)
        if recording.has(graph.ODOMETRY):
            estimate = recording.estimate
            line(axis, estimate.time, np.degrees(estimate.rpy[:, row]), ESTIMATE, linewidth=0.9)
    frame_rows(recording, axes[:, 0])
    label_rows(axes[:, 0], ("roll [deg]", "pitch [deg]", "yaw [deg]"))
    entries = [("truth", {"color": TRUTH}), ("estimate", {"color": ESTIMATE})]
    return finish(figure, entries, directory, "attitude")


def path(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Seen from above: the way of the base and where the feet came down."""
    base, contacts = recording.base, recording.contacts
    extent = np.ptp(np.concatenate((base.position[:, :2], contacts.position[..., 1, :2])), axis=0)
    height = float(np.clip(12.0 * (extent[1] + 0.5) / (extent[0] + 0.5) + 1.2, 3.2, 9.0))
    figure, axes = make_figure(1, 1, "Path seen from above", size=(13.0, height))
    axis = axes[0, 0]
    for leg, colour in enumerate(LEG_COLOURS):
        landed = np.flatnonzero(np.diff(contacts.contact[:, leg].astype(np.int8)) == 1) + 1
        spots = contacts.position[landed, leg]
        axis.plot(spots[:, 0], spots[:, 1], "o", markersize=3.5, color=colour, markeredgewidth=0)
    axis.plot(base.position[:, 0], base.position[:, 1], color=TRUTH, linewidth=1.4)
    axis.set_aspect("equal", adjustable="datalim")
    label(axis, "y [m]", "x [m]")
    spot = {"linestyle": "", "marker": "o", "markersize": 5}
    landings = [(f"{name} lands", look) for name, look in leg_entries(robot.legs, **spot)]
    return finish(figure, [*landings, ("base", {"color": TRUTH})], directory, "path")
