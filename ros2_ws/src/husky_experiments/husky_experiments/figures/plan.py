"""Figure of a planned gait cycle on a slope."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from husky_control.planning.plan import Plan
from husky_description.robot import LEG_NAMES
from husky_experiments.figures.style import (
    LEG_COLOURS,
    TIME,
    TRUTH,
    label,
    leg_entries,
    legend,
    make_figure,
)

AXES = {"along the slope": "#6a3d9a", "across": "#8c8c8c", "out of the slope": "#a0522d"}
"""Axes of the slope frame and their colours, none of which is a leg's."""


def draw_plan(plan: Plan, path: Path | str) -> Path:
    """Draw a plan over one cycle: body, ground forces and their cone, thrust, legs that stand.

    The image is PNG by its name; its path is returned.
    """
    title = (
        f"Plan: {plan.gait} at {plan.speed:.2f} m/s on {math.degrees(plan.slope):.0f} deg, "
        f"thrust {plan.thrust_mode}"
    )
    figure, axes = make_figure(2, 2, title, size=(12.0, 7.0))
    _body(plan, axes[0, 0])
    _forces(plan, axes[0, 1])
    _thrust(plan, axes[1, 0])
    _cone(plan, axes[1, 1])
    legend(figure, leg_entries(LEG_NAMES))
    figure.savefig(path)
    return Path(path)


def _body(plan: Plan, axis: Axes) -> None:
    """Place of the centre of mass beside the nominal one, in mm."""
    nominal = np.zeros_like(plan.position)
    nominal[:, 0] = plan.speed * plan.time
    nominal[:, 2] = plan.height
    _three(axis, plan.time, 1e3 * (plan.position - nominal))
    label(axis, "from nominal [mm]", TIME, "centre of mass")
    axis.legend(frameon=False)


def _forces(plan: Plan, axis: Axes) -> None:
    for leg, colour in enumerate(LEG_COLOURS):
        standing = plan.stance[:, leg]
        normal = np.where(standing, plan.foot_force[:, leg, 2], np.nan)
        tangential = np.where(standing, plan.foot_force[:, leg, 0], np.nan)
        axis.plot(plan.time, normal, color=colour)
        axis.plot(plan.time, tangential, color=colour, linestyle="--")
    label(axis, "force [N]", TIME, "ground on feet: normal, and along the slope (dashed)")


def _thrust(plan: Plan, axis: Axes) -> None:
    _three(axis, plan.time, plan.thrust)
    size = np.linalg.norm(plan.thrust, axis=1)
    axis.plot(plan.time, size, color=TRUTH, linewidth=1.5, label="size")
    axis.axhline(plan.thrust_limit, color=TRUTH, linewidth=0.8, linestyle=":", label="limit")
    label(axis, "thrust [N]", TIME, "thrust")
    axis.legend(frameon=False)


def _cone(plan: Plan, axis: Axes) -> None:
    """Tangential over normal force, the planned cone and that of the ground."""
    most = 1.1 * max(1.0, float(plan.foot_force[..., 2].max()))
    usable = (1.0 - plan.friction_margin) * plan.friction
    axis.plot([0.0, most], [0.0, plan.friction * most], color=TRUTH, linewidth=0.8)
    axis.plot([0.0, most], [0.0, usable * most], color=TRUTH, linewidth=0.8, linestyle=":")
    for leg, colour in enumerate(LEG_COLOURS):
        force = plan.foot_force[plan.stance[:, leg], leg]
        axis.plot(force[:, 2], np.hypot(force[:, 0], force[:, 1]), ".", color=colour)
    label(axis, "tangential [N]", "normal [N]", "friction: cone, and what may be used (dotted)")


def _three(axis: Axes, time: np.ndarray, values: np.ndarray) -> None:
    for column, (name, colour) in enumerate(AXES.items()):
        axis.plot(time, values[:, column], color=colour, label=name)
