"""Figures of climbs, all slopes of a suite together: the thesis's T33 to T37."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_description.robot import Robot
from husky_experiments.figures.style import (
    LEG_COLOURS,
    TIME,
    TRUTH,
    finish,
    label,
    leg_entries,
    make_figure,
    save,
)
from husky_experiments.incline_course import Course
from husky_experiments.metrics.measures import JOINT_GROUPS, nearest
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Joints
from husky_runtime import graph

_CYCLES = 1.4
"""Time that joint angles and swing feet are shown for: four cycles of the gait [s]."""
_LOADED = 1.0
"""Normal force from which on a foot sample is drawn [N]."""


@dataclass(frozen=True)
class Climb:
    """One climb of a suite."""

    course: Course  # the ground
    recording: Recording  # of it
    start: float  # s, of the measured time
    end: float  # s
    summary: dict[str, Any]  # its figures, from `metrics.incline.climb_summary`

    @property
    def name(self) -> str:
        """The slope in words."""
        return f"{self.course.slope_deg:g} deg"


def draw_all(climbs: list[Climb], robot: Robot, directory: Path) -> list[Path]:
    """Draw every figure of a suite; return the files."""
    directory.mkdir(parents=True, exist_ok=True)
    drawings = (
        friction_cone,
        swing_feet,
        front_joint_angles,
        joint_torques,
        torques_and_thrust,
        inertial_forces,
        foot_placement,
        joint_motion,
    )
    return [draw(climbs, robot, directory) for draw in drawings]


def _panels(climbs: list[Climb], title: str, height: float, **grid: Any) -> tuple[Any, list[Axes]]:
    figure, axes = make_figure(1, len(climbs), title, size=(13.0, height), **grid)
    return figure, list(axes[0])


def _label_grid(axes: NDArray[Any], climbs: list[Climb], names: Sequence[str]) -> None:
    """Name slopes above the columns, rows (with unit) at the left, and the time below."""
    for axis, climb in zip(axes[0], climbs, strict=True):
        label(axis, title=climb.name)
    for axis, name in zip(axes[:, 0], names, strict=True):
        label(axis, name)
    for axis in axes[-1]:
        label(axis, x=TIME)


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
    entries = [*leg_entries(robot.legs), ("cone", {"color": "black"})]
    return finish(figure, entries, directory, "friction_cone")


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
    return finish(figure, leg_entries(robot.legs)[:2], directory, "swing_feet")


def front_joint_angles(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Angles of the front left leg's joints (T35)."""
    return _joints(climbs, directory, "front_joint_angles", "angles", "deg", _angles)


def joint_torques(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Torques of the front left leg's joints over time (T36)."""
    return _joints(climbs, directory, "joint_torques", "torques", "N m", lambda now: now.torque)


def joint_motion(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Speeds of the front left leg's joints over time (T37)."""
    return _joints(climbs, directory, "joint_motion", "speeds", "rad/s", lambda now: now.velocity)


def _angles(joints: Joints) -> Array:
    angles: Array = np.degrees(joints.position)
    return angles


def _joints(
    climbs: list[Climb],
    directory: Path,
    name: str,
    what: str,
    unit: str,
    values: Callable[[Joints], Array],
) -> Path:
    """Draw something of the front left leg's joints, kinds of joint in rows, slopes in columns."""
    title = f"Joint {what}, front left leg"
    figure, axes = make_figure(3, len(climbs), title, sharex=True, sharey="row")
    for column, climb in zip(axes.T, climbs, strict=True):
        joints = climb.recording.joints.between(climb.start, climb.start + _CYCLES)
        for axis, one in zip(column, values(joints).T, strict=False):
            axis.plot(joints.time - climb.start, one, color=LEG_COLOURS[0], linewidth=1.0)
    _label_grid(axes, climbs, [f"{group.replace('_', ' ')} [{unit}]" for group in JOINT_GROUPS])
    return save(figure, directory, name)


def inertial_forces(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Inertial force -m a of the whole robot, along and out of the slope (T37).

    By Newton's law it is what ground, fans and weight do not balance.
    """
    title = "Inertial force of the robot"
    figure, axes = make_figure(2, len(climbs), title, size=(13.0, 5.6), sharex=True, sharey="row")
    for column, climb in zip(axes.T, climbs, strict=True):
        course = climb.course
        time, force = inertial_force(climb, robot)
        for axis, direction in zip(column, (course.uphill, course.normal), strict=True):
            axis.plot(time - climb.start, force @ direction, color=TRUTH, linewidth=1.0)
    _label_grid(axes, climbs, ("along the slope [N]", "out of the slope [N]"))
    return save(figure, directory, "inertial_forces")


def inertial_force(climb: Climb, robot: Robot) -> tuple[Array, Array]:
    """Return times [s] (n,) and inertial force of the robot in world [N] (n, 3)."""
    recording, span = climb.recording, (climb.start, climb.start + _CYCLES)
    contacts, base = recording.contacts.between(*span), recording.base
    acting = contacts.force.sum(axis=1) - (0.0, 0.0, robot.mass * GRAVITY)
    if recording.has(graph.FAN_STATE):
        fans = recording.fans
        thrust = np.column_stack(
            [np.interp(contacts.time, fans.time, part) for part in fans.force.T]
        )
        turns = Rotation.from_quat(base.orientation[nearest(base.time, contacts.time)])
        acting = acting + turns.apply(thrust)
    return contacts.time, -acting


def foot_placement(climbs: list[Climb], robot: Robot, directory: Path) -> Path:
    """Where feet come down under the body, seen from above the slope (T37)."""
    figure, axes = _panels(climbs, "Footholds under the body", 4.2, sharex=True, sharey=True)
    for axis, climb in zip(axes, climbs, strict=True):
        contacts = climb.recording.contacts.between(climb.start, climb.end)
        base = climb.recording.base
        under = base.position[nearest(base.time, contacts.time)]
        for leg, colour in enumerate(LEG_COLOURS):
            landed = np.flatnonzero(np.diff(contacts.contact[:, leg].astype(np.int8)) == 1) + 1
            spots = contacts.position[landed, leg] - under[landed]
            axis.plot(spots @ climb.course.uphill, spots[:, 1], "o", color=colour, ms=2.5)
        axis.plot(0.0, 0.0, "+", color=TRUTH, ms=9.0)
        axis.set_aspect("equal", adjustable="box")
        label(axis, x="up the slope [m]", title=climb.name)
    label(axes[0], "left [m]")
    spot = {"linestyle": "", "marker": "o", "markersize": 5}
    body = {"linestyle": "", "marker": "+", "color": TRUTH, "markersize": 8}
    entries = [*leg_entries(robot.legs, **spot), ("body", body)]
    return finish(figure, entries, directory, "foot_placement")


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
    entries = [
        (group.replace("_", " "), {"color": colour})
        for group, colour in zip(JOINT_GROUPS, LEG_COLOURS, strict=False)
    ]
    return finish(figure, entries, directory, "torques_and_thrust")
