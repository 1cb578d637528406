"""What the climbing controller takes from a plan: body reference, footholds and thrust (T28-T31).

A plan is one cycle on one slope at one speed; the ground under the feet bends, and the operator
changes the speed. So the controller walks event by event (T13) and keeps of the plan what holds for
every cycle on that slope: where the feet stand relative to the body, and what lies beyond the
statics of the thrust (vectored) or of the body's pitch (fixed fans). Away from the plan's slope it
fades into the statics of `statics`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from husky_control.incline.statics import least_thrust, load_slope
from husky_control.planning.plan import Plan
from husky_description.arrays import Array
from husky_description.gravity import GRAVITY

REACH = math.radians(10.0)
"""Difference from the plan's slope at which nothing of the plan is left [rad]."""
MASS_TOLERANCE = 0.1
"""Share by which the plan's mass may differ from the robot's [-]."""


@dataclass(frozen=True)
class PlanReference:
    """Means of a plan over its cycle."""

    slope: float  # [rad]
    thrust_extra: Array  # (2,) N up the slope and out of it, beyond the least thrust of the statics
    # how much further uphill the feet stand under the centre of mass than by statics [m]
    shift_extra: float
    pitch: float  # of the body relative to the slope, nose down positive [rad]

    def weight(self, slope: float) -> float:
        """Return how much of the plan holds on a slope [rad]: 1 on its own, 0 from `REACH` on."""
        return max(0.0, 1.0 - abs(slope - self.slope) / REACH)


def reference_of(plan: Plan, mass: float, thrust_mode: str, ratio: float) -> PlanReference:
    """Return what the controller takes from a plan.

    Args:
        plan: of the gait that is climbed with.
        mass: of the robot [kg].
        thrust_mode: what the robot's fans can do, "vector" or "body_z".
        ratio: tangential over normal load that the statics keep.

    Raises:
        ValueError: the plan is of another robot, thrust mode or gait; says which.
    """
    if plan.thrust_mode != thrust_mode:
        raise ValueError(
            f"the plan's thrust_mode is {plan.thrust_mode!r}, the fans' is {thrust_mode!r}"
        )
    if plan.gait != "climb":
        raise ValueError(f"the plan's gait is {plan.gait!r}, it must be climb")
    if abs(plan.mass - mass) > MASS_TOLERANCE * mass:
        raise ValueError(f"the plan's mass is {plan.mass:g} kg, the robot's {mass:g} kg")
    thrust = plan.thrust.mean(axis=0)
    gravity = GRAVITY * np.array([-math.sin(plan.slope), 0.0, -math.cos(plan.slope)])
    support = -plan.mass * gravity - thrust
    height = float(plan.position[:, 2].mean())
    shift = _feet_ahead(plan) + height * load_slope(support, 1.0)[0]
    extra = np.zeros(2)
    if thrust_mode == "vector":
        extra = (thrust - least_thrust(gravity, plan.mass, ratio))[[0, 2]]
    pitch = float(np.mean(np.arctan2(plan.rotation[:, 0, 2], plan.rotation[:, 2, 2])))
    return PlanReference(plan.slope, extra, shift, pitch)


def _feet_ahead(plan: Plan) -> float:
    """How far uphill of the centre of mass the standing feet are, mean over the cycle [m]."""
    center = plan.position
    way = time = 0.0
    for k in range(len(plan.time) - 1):
        # Between two points; at a switch of the stance they have the same time.
        step = float(plan.time[k + 1] - plan.time[k])
        feet = plan.foothold_at(float(plan.time[k]) + 0.5 * step)[plan.stance[k], 0]
        if step > 0.0 and len(feet):
            way += step * (float(feet.mean()) - 0.5 * float(center[k, 0] + center[k + 1, 0]))
            time += step
    return way / time if time > 0.0 else 0.0
