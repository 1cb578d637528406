"""Figures of the joints: desired and measured angles, tracking, torques and ratings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from husky_description.actuation import BUS_SERVOS
from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_experiments.figures.style import (
    LEG_COLOURS,
    PARTS,
    TIME,
    close_look,
    each_leg,
    finish,
    frame,
    label,
    leg_entries,
    line,
    make_figure,
    modes_of,
    span_of,
)
from husky_experiments.metrics import measures
from husky_experiments.metrics.walking import torque_ratings
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

_GROUPS = ("hip frontal", "hip sagittal", "knee")
_DASHED = (0, (4, 2))
_LIMIT = "#8b1a1a"
_LIMIT_STYLES = ((0, (1, 2)), (0, (5, 2)), "-")
_RATINGS = {
    "gear_rated": "rated",
    "gear_repeated": "repeated\npeak",
    "gear_momentary": "momentary\npeak",
    "servo_limit": "limit",
}
"""Names in the figure of `torque_ratings`."""
_POSITION_MODE = 8
"""CiA 402 cyclic synchronous position."""


def joint_angles(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Desired and measured angles of all twelve joints, whole recording."""
    return _joint_angles(recording, robot, directory, close=False)


def joint_angles_close(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Desired and measured angles of all twelve joints, a few steps."""
    return _joint_angles(recording, robot, directory, close=True)


def _joint_angles(recording: Recording, robot: Robot, directory: Path, *, close: bool) -> Path:
    span = close_look(recording) if close else span_of(recording)
    joints, commands = recording.joints.between(*span), recording.commands.between(*span)
    target = np.where(
        (commands.mode_of_operation == _POSITION_MODE)[:, None], commands.position, np.nan
    )
    # Dashes over a few steps; behind the measured line where steps are packed too densely for them.
    desired = (
        {"linewidth": 0.8, "linestyle": _DASHED}
        if close
        else {"linewidth": 1.5, "alpha": 0.6, "zorder": 1}
    )
    title = "Joint angles, a closer look" if close else "Joint angles"
    figure, axes = make_figure(3, 4, title, sharex=True, sharey="row")
    modes = modes_of(recording)
    for group in range(3):
        for leg, axis, words, colour in each_leg(axes[group], robot.legs):
            index = 3 * leg + group
            line(axis, joints.time, np.degrees(joints.position[:, index]), colour)
            line(
                axis,
                commands.time + graph.TICK_PERIOD,
                np.degrees(target[:, index]),
                "black",
                **desired,
            )
            frame(axis, span, modes, names=group == 0)
            label(
                axis,
                y=f"{_GROUPS[group]} [deg]" if leg == 0 else "",
                x=TIME if group == 2 else "",
                title=words if group == 0 else "",
            )
    look = {"color": "black", "linestyle": _DASHED if close else "-"}
    entries = [*leg_entries(robot.legs), ("desired", look)]
    return finish(figure, entries, directory, "joint_angles_close" if close else "joint_angles")


def tracking(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Desired minus measured joint angles."""
    commands = recording.commands
    chosen = commands.mode_of_operation == _POSITION_MODE
    time, error = measures.tracking_error(
        commands.time[chosen],
        commands.position[chosen],
        recording.joints.time,
        recording.joints.position,
    )
    title = "Joint tracking: desired minus measured"
    path = directory / "tracking.png"
    return _by_group(recording, robot, path, title, "deg", time, np.degrees(error), {})


def torques(recording: Recording, robot: Robot, directory: Path) -> Path:
    """Joint torques from the motors' currents beside the ratings of gear or servo."""
    limits = {_RATINGS[name]: value for name, value in torque_ratings(robot).items()}
    joints = recording.joints
    what = "limit of the servos" if robot.actuation == BUS_SERVOS else "ratings of the gear"
    title = f"Joint torques (from motor currents) and {what}"
    path = directory / "torques.png"
    return _by_group(recording, robot, path, title, "N m", joints.time, joints.torque, limits)


def _by_group(
    recording: Recording,
    robot: Robot,
    path: Path,
    title: str,
    unit: str,
    time: Array,
    values: Array,
    limits: dict[str, float],
) -> Path:
    """Draw the kinds of joint in rows; whole recording and closer look; one colour per leg."""
    figure, axes = make_figure(
        3, 2, title, sharex="col", sharey="row", gridspec_kw={"width_ratios": (1.4, 1.0)}
    )
    modes = modes_of(recording)
    for row, of_group in enumerate(measures.by_group(values).values()):
        for column, span in enumerate((span_of(recording), close_look(recording))):
            axis = axes[row, column]
            inside = (time >= span[0]) & (time <= span[1])
            for leg, colour in enumerate(LEG_COLOURS):
                line(axis, time[inside], of_group[inside, leg], colour, linewidth=0.8, alpha=0.9)
            _limits(axis, limits, named=column == 1)
            frame(axis, span, modes, names=row == 0)
            label(
                axis,
                y=f"{_GROUPS[row]} [{unit}]" if column == 0 else "",
                x=TIME if row == 2 else "",
                title=PARTS[column] if row == 0 else "",
            )
        axes[row, 0].annotate(
            f"rms {measures.rms(of_group):.2g}, peak {measures.peak(of_group):.2g} {unit}",
            (0.008, 0.965),
            xycoords="axes fraction",
            va="top",
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
        )
    return finish(figure, leg_entries(robot.legs), path.parent, path.stem)


def _limits(axis: Axes, limits: dict[str, float], named: bool) -> None:
    """Draw ratings as lines on both sides of zero, named at the right."""
    for (name, value), style in zip(limits.items(), _LIMIT_STYLES, strict=False):
        for sign in (-1.0, 1.0):
            axis.axhline(sign * value, color=_LIMIT, linewidth=0.9, linestyle=style)
        if named:
            axis.annotate(
                f"{name} {value:g}",
                (1.0, value),
                xycoords=("axes fraction", "data"),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize=7,
                color=_LIMIT,
                annotation_clip=False,
            )
