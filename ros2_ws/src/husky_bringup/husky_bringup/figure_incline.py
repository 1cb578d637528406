"""Figures of climbs, all slopes of a suite together: the thesis's T33 to T36."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from husky_bringup.figure_style import LEG_COLOURS, label, leg_entries, legend, make_figure, save
from husky_bringup.incline_course import Course
from husky_bringup.measures import JOINT_GROUPS
from husky_bringup.recording import Recording
from husky_bringup.tables import Array
from husky_description.robot import Robot

_CYCLES = 1.4
"""Time that joint angles and swing feet are shown for: four cycles of the gait [s]."""
_LOADED = 1.0
"""Normal force from which on a foot sample is drawn [N]."""


@dataclass(frozen=True)
class Climb:
    """One climb of a suite.

    Attributes:
        course: the ground.
        recording: of it.
        start, end: of the measured time [s].
        summary: its figures, from `incline_metrics.climb_summary`.
    """

    course: Course
    recording: Recording
    start: float
    end: float
    summary: dict[str, Any]

    @property
    def name(self) -> str:
        """The slope in words."""
        return f"{self.course.slope_deg:g} deg"


def draw_all(climbs: list[Climb], robot: Robot, directory: Path) -> list[Path]:
    """Draw every figure of a suite; return the files."""
    directory.mkdir(parents=True, exist_ok=True)
    drawings = (friction_cone, swing_feet, front_joint_angles, torques_and_thrust)
    return [draw(climbs, robot, directory) for draw in drawings]


def _panels(climbs: list[Climb], title: str, height: float, **grid: Any) -> tuple[Any, list[Axes]]:
    figure, axes = make_figure(1, len(climbs), title, size=(13.0, height), **grid)
    return figure, list(axes[0])


def friction_cone(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Tangential over normal force of the stance feet, and the cone (T33)."""
    figure, axes = _panels(climbs, "Ground forces of stance feet", 4.2, sharex=True, sharey=True)
    for axis, climb in zip(axes, climbs, strict=True):
        normal = climb.course.normal
        force = climb.recording.contacts.between(climb.start, climb.end).force
        pressing = force @ normal
        along = np.linalg.norm(force - pressing[..., None] * normal, axis=-1)
        for leg, colour in enumerate(LEG_COLOURS):
            on = pressing[:, leg] > _LOADED
            axis.plot(pressing[on, leg], along[on, leg], ".", color=colour, ms=1.5, alpha=0.4)
        edge = np.array([0.0, float(pressing.max())])
        axis.plot(edge, climb.course.friction * edge, color="black", linewidth=1.0)
        label(axis, x="normal force [N]", title=climb.name)
    label(axes[0], "tangential force [N]")
    legend(figure, [*leg_entries(robot.legs), ("cone", {"color": "black"})])
    return save(figure, directory, "friction_cone")


def swing_feet(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Paths of the front feet over the slope (T34)."""
    figure, axes = _panels(climbs, "Front feet over the slope", 3.6, sharey=True)
    for axis, climb in zip(axes, climbs, strict=True):
        course = climb.course
        foot = climb.recording.contacts.between(climb.start, climb.start + _CYCLES).position
        way = (foot - foot[0, 0]) @ course.uphill
        clear = (foot - course.foot) @ course.normal - robot.foot_radius
        for leg in (0, 1):
            axis.plot(way[:, leg], 100.0 * clear[:, leg], color=LEG_COLOURS[leg], linewidth=1.2)
        axis.axhline(0.0, color="black", linewidth=0.8)
        label(axis, x="along the slope [m]", title=climb.name)
    label(axes[0], "over the slope [cm]")
    legend(figure, leg_entries(robot.legs)[:2])
    return save(figure, directory, "swing_feet")


def front_joint_angles(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Angles of the front left leg's joints (T35)."""
    figure, axes = make_figure(
        3, len(climbs), "Joint angles, front left leg", sharex=True, sharey="row"
    )
    for column, climb in enumerate(climbs):
        joints = climb.recording.joints.between(climb.start, climb.start + _CYCLES)
        for row, group in enumerate(JOINT_GROUPS):
            axis = axes[row, column]
            axis.plot(
                joints.time - climb.start, np.degrees(joints.position[:, row]), LEG_COLOURS[0]
            )
            if column == 0:
                label(axis, f"{group.replace('_', ' ')} [deg]")
        label(axes[0, column], title=climb.name)
        label(axes[2, column], x="time [s]")
    return save(figure, directory, "front_joint_angles")


def friction_map(
    climbed: Mapping[tuple[float, float], int | None], seeds: int, directory: Path
) -> Path:
    """Draw how many seeds climb, by friction and slope.

    Args:
        climbed: seeds that do, by (friction, slope in deg); None where none was tried.
        seeds: tried in each cell.
        directory: for the figure, made if it is missing.
    """
    directory.mkdir(parents=True, exist_ok=True)
    frictions = sorted({friction for friction, _ in climbed})
    slopes = sorted({slope for _, slope in climbed})
    figure, axes = make_figure(1, 1, "Slopes that are climbed", size=(7.0, 5.0))
    axis = axes[0, 0]
    shares = np.array([[(climbed[f, s] or 0) / seeds for f in frictions] for s in slopes])
    axis.imshow(shares, origin="lower", aspect="auto", cmap="RdYlGn", vmin=-0.4, vmax=1.4)
    for row, slope in enumerate(slopes):
        for column, friction in enumerate(frictions):
            count = climbed[friction, slope]
            text = "not tried" if count is None else f"{count} of {seeds}"
            axis.text(column, row, text, ha="center", va="center")
    axis.set_xticks(range(len(frictions)), [f"{friction:g}" for friction in frictions])
    axis.set_yticks(range(len(slopes)), [f"{slope:g}" for slope in slopes])
    axis.grid(visible=False)
    label(axis, "slope [deg]", "coefficient of friction [-]")
    return save(figure, directory, "friction_map")


def torques_and_thrust(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Torques of the joints and thrust over the slope: legs less, fans more (T36)."""
    figure, axes = make_figure(1, 3, "Legs and fans over the slope", size=(13.0, 4.2))
    slopes = np.array([climb.course.slope_deg for climb in climbs])

    def column(key: str) -> Array:
        return np.array([climb.summary.get(key, np.nan) for climb in climbs], dtype=np.float64)

    for axis, kind in zip(axes[0, :2], ("rms", "peak"), strict=True):
        for group, colour in zip(JOINT_GROUPS, LEG_COLOURS, strict=False):
            axis.plot(slopes, column(f"torque_{kind}_{group}_Nm"), "o-", color=colour)
        label(axis, f"torque, {kind} [N m]", "slope [deg]")
        axis.set_ylim(bottom=0.0)
    thrust = axes[0, 2]
    thrust.plot(slopes, column("thrust_mean_n"), "o-", color="black")
    thrust.plot(slopes, column("thrust_max_n"), "--", color="black")
    label(thrust, "thrust, mean and greatest [N]", "slope [deg]")
    legend(
        figure,
        [
            (group.replace("_", " "), {"color": colour})
            for group, colour in zip(JOINT_GROUPS, LEG_COLOURS, strict=False)
        ],
    )
    return save(figure, directory, "torques_and_thrust")
