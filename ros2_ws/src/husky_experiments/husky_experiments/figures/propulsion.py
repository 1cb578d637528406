"""Figures of the propulsion unit: battery, attitude, fans, and its place by the tracking camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.robot import Robot
from husky_experiments.figures.style import (
    DESIRED,
    ESTIMATE,
    FAN_COLOURS,
    TRUTH,
    finish,
    frame_rows,
    label_rows,
    leg_entries,
    line,
    make_figure,
)
from husky_experiments.metrics.propulsion import (
    Span,
    base_by_t265,
    flying,
    open_circuit_voltage,
    pack_resistance,
    taut_spans,
)
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

TAUT = "#f7c6c0"
"""Background while a rope of the gantry is taut."""
_TAUT_ENTRY = ("rope taut", {"color": TAUT, "linewidth": 7.0})


def battery(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Voltage and current of the battery: truth, as measured, and what its resistance says."""
    fans = recording.fans
    figure, axes = make_figure(2, 1, "Battery", size=(13.0, 6.5), sharex=True)
    voltage, current = axes[:, 0]
    line(voltage, fans.time, fans.battery_voltage, TRUTH, linewidth=1.4)
    line(current, fans.time, fans.battery_current, TRUTH, linewidth=1.4)
    entries = [("truth", {"color": TRUTH})]
    if recording.has(graph.PROPULSION_STATE):
        state = recording.propulsion
        line(voltage, state.time, state.voltage, ESTIMATE)
        line(current, state.time, state.current, ESTIMATE)
        charge = np.interp(state.time, fans.time, fans.battery_charge)
        said = open_circuit_voltage(robot, charge) - pack_resistance(robot) * state.current
        line(voltage, state.time, said, DESIRED, linestyle="--")
        name = "open circuit - R x measured current"
        entries += [
            ("measured", {"color": ESTIMATE}),
            (name, {"color": DESIRED, "linestyle": "--"}),
        ]
    _frame(recording, axes[:, 0])
    label_rows(axes[:, 0], ("voltage [V]", "current [A]"))
    return finish(figure, entries, directory, "battery")


def unit_attitude(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Roll, pitch and yaw: desired, measured, true; shaded where a rope is taut."""
    state, base = recording.propulsion, recording.base
    figure, axes = make_figure(3, 1, "Attitude: desired and measured", sharex=True)
    ropes = _ropes(recording)
    held = flying(state)[:, None]
    desired = np.degrees(np.where(held, state.rpy_desired, np.nan))
    measured, true = np.degrees(state.rpy), np.degrees(base.rpy)
    for row, axis in enumerate(axes[:, 0]):
        line(axis, base.time, true[:, row], TRUTH, linewidth=1.5)
        line(axis, state.time, measured[:, row], ESTIMATE)
        axis.plot(state.time, desired[:, row], color=DESIRED, linewidth=1.1, linestyle="--")
        _frame_y(axis, base.time, true[:, row], state.time[held[:, 0]])
    label_rows(axes[:, 0], ("roll [deg]", "pitch [deg]", "yaw [deg]"))
    _frame(recording, axes[:, 0], ropes)
    entries: list[tuple[str, dict[str, Any]]] = [
        ("desired", {"color": DESIRED, "linestyle": "--"}),
        ("measured", {"color": ESTIMATE}),
        ("truth", {"color": TRUTH}),
        *([_TAUT_ENTRY] if ropes else []),
    ]
    return finish(figure, entries, directory, "unit_attitude")


def fans(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Thrust, all together (whichever way it points) and each, speed of the rotors and pulses."""
    truth = recording.fans
    figure, axes = make_figure(4, 1, "Fans", size=(13.0, 9.5), sharex=True)
    total, each, speed, pulses = axes[:, 0]
    line(total, truth.time, np.linalg.norm(truth.force, axis=1), TRUTH, linewidth=1.4)
    colours = FAN_COLOURS[: len(robot.rotor_names)]
    entries = [*leg_entries(robot.rotor_names), ("all", {"color": TRUTH})]
    for index, colour in enumerate(colours):
        line(each, truth.time, truth.thrust[:, index], colour)
        line(speed, truth.time, truth.speed[:, index], colour)
    if recording.has(graph.PROPULSION_STATE):
        state = recording.propulsion
        # Of whoever commands, controller or sticks: what the autopilot follows.
        wanted = state.collective_desired * len(colours) * FanModel.of(robot).max_thrust
        line(total, state.time, wanted, DESIRED, linestyle="--")
        entries.append(("commanded", {"color": DESIRED, "linestyle": "--"}))
        for index, colour in enumerate(colours):
            line(pulses, state.time, state.pwm[:, index].astype(np.float64), colour)
    ropes = _ropes(recording)
    _frame(recording, axes[:, 0], ropes)
    names = ("total thrust [N]", "thrust [N]", "speed [rad/s]", "pulse [us]")
    label_rows(axes[:, 0], names)
    return finish(figure, [*entries, *([_TAUT_ENTRY] if ropes else [])], directory, "fans")


def t265(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Position of the base: truth, and by the tracking camera from where it began."""
    base, seen = recording.base, base_by_t265(recording, robot)
    figure, axes = make_figure(3, 1, "Position by the tracking camera", sharex=True)
    for row, axis in enumerate(axes[:, 0]):
        line(axis, base.time, base.position[:, row], TRUTH, linewidth=1.6)
        line(axis, seen.time, seen.position[:, row], ESTIMATE)
    label_rows(axes[:, 0], ("x [m]", "y [m]", "z [m]"))
    ropes = _ropes(recording)
    _frame(recording, axes[:, 0], ropes)
    entries = [("truth", {"color": TRUTH}), ("T265", {"color": ESTIMATE})]
    return finish(figure, [*entries, *([_TAUT_ENTRY] if ropes else [])], directory, "t265")


def _ropes(recording: Recording) -> list[Span]:
    """Return the times in which a rope is taut [s]."""
    return taut_spans(recording.fans) if recording.has(graph.FAN_STATE) else []


def _frame(recording: Recording, axes: NDArray[Any], ropes: Sequence[Span] = ()) -> None:
    """Set the time range; draw modes, and where a rope is taut, behind axes above each other."""
    frame_rows(recording, axes)
    for axis in axes:
        for start, end in ropes:
            axis.axvspan(start, end, color=TAUT, zorder=-4, linewidth=0)


def _frame_y(axis: Axes, time: Array, values: Array, held: Array) -> None:
    """Fit the height of an axis to the time in which an attitude is held."""
    if not len(held):
        return
    inside = values[(time >= held[0] - 1.0) & (time <= held[-1] + 1.0)]
    low, high = float(inside.min()), float(inside.max())
    margin = 0.15 * (high - low) + 1.0
    axis.set_ylim(low - margin, high + margin)
