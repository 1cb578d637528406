"""When a climbing controller asks for another plan, and for which one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from husky_control.modes.table import Mode

if TYPE_CHECKING:
    from husky_control.controller import Controller

SLOPE_STEP = math.radians(2.5)
"""Between the slopes that are planned for [rad]: a plan fades over 10 deg."""
SPEED_STEP = 0.05
"""Between the speeds that are planned for [m/s]."""
LEAST_SLOPE = math.radians(5.0)
"""Below it the robot walks as on the flat [rad]."""
FACING = math.cos(math.radians(45.0))
"""Plans are for walking straight up and backwards down: cosine of the greatest deviation."""
_KEEP = 0.7
"""Steps that the slope or the speed may be off the planned one before another one is asked for."""


@dataclass(frozen=True)
class PlanQuery:
    """What the planner is asked for."""

    slope: float  # [rad]
    speed: float  # [m/s], negative backwards
    load_slope: float  # tangential over normal force that the feet may bear [-]
    thrust_mode: str  # "vector" or "body_z"
    thrust_limit: float  # [N]


def next_query(controller: Controller, last: PlanQuery | None) -> PlanQuery | None:
    """Return what to ask for now, or None while the last query still holds.

    A robot that stands keeps the plan that it came with.
    """
    climbing, p = controller.climbing, controller.parameters
    if controller.mode is not Mode.WAIR or p["wair.thrust_share"] == 0.0:
        return None
    slope, speed = climbing.slope, float(controller.walking.reference.ramped[0])
    ahead = controller.body.rotation[:, 0]
    if slope < LEAST_SLOPE or float(ahead @ climbing.uphill) < FACING or speed == 0.0:
        return None
    wanted = PlanQuery(
        _nearest(slope, SLOPE_STEP, last.slope if last is not None else None),
        _nearest(speed, SPEED_STEP, last.speed if last is not None else None),
        p["wair.load_slope"],
        "vector" if climbing.vectoring else "body_z",
        p["wair.thrust_limit"],
    )
    return None if wanted == last else wanted


def _nearest(value: float, step: float, last: float | None) -> float:
    """Round to a grid, and stay where the last one was until it is clearly left."""
    if last is not None and abs(value - last) < _KEEP * step:
        return last
    return step * round(value / step)
