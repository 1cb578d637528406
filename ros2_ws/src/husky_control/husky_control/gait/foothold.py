"""Where a swing foot comes down: event-based (T13), with a velocity term against pushes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_description.kinematics import LegGeometry

Point = tuple[float, float]


class Approach(NamedTuple):
    """How the body comes to its footholds, in the frame of the ground."""

    position: Point  # m, that feet are placed about: of the base, without sway
    velocity: Point  # m/s, of the base, without sway
    yaw: float  # rad
    velocity_desired: Point  # m/s
    yaw_rate_desired: float  # rad/s


class FootholdLaw(NamedTuple):
    """The numbers of the law."""

    stance_time: float  # s
    velocity_gain: float  # s
    reach: float  # m


def nominal_footholds(
    geometry: LegGeometry, forward_spread: float, lateral_spread: float
) -> Array:
    """Return foot positions under the legs of a standing robot, (4, 2) m, x and y in base.

    Args:
        geometry: of the legs.
        forward_spread: m, front feet forward and hind feet backward by this much.
        lateral_spread: m, feet outward by this much.
    """
    hip, side = geometry.hip_position, geometry.lateral_offset
    return np.column_stack(
        (
            hip[:, 0] + np.sign(hip[:, 0]) * forward_spread,
            hip[:, 1] + side + np.sign(side) * lateral_spread,
        )
    )


def foothold_of(nominal: Point, remaining: float, approach: Approach, law: FootholdLaw) -> Point:
    """Return a foothold: under the hip at touchdown, half a stance ahead, and a velocity term.

    foothold = hip at touchdown + v_d T_stance / 2 + velocity_gain (v - v_d), no further than reach
    from the nominal place (m in base), so long before touchdown (s).

    Returns:
        m along x and y of the ground.
    """
    (x, y), (vx, vy), yaw, (wish_x, wish_y), yaw_rate = approach
    half = 0.5 * law.stance_time
    # Under a turning base the hip will have moved on by half the stance, too.
    turn = yaw_rate * (remaining + half)
    nx, ny = nominal[0] - turn * nominal[1], nominal[1] + turn * nominal[0]
    dx = half * wish_x + law.velocity_gain * (vx - wish_x)
    dy = half * wish_y + law.velocity_gain * (vy - wish_y)
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > law.reach:
        dx, dy = dx * (law.reach / distance), dy * (law.reach / distance)
    c, s = math.cos(yaw), math.sin(yaw)
    return x + vx * remaining + c * nx - s * ny + dx, y + vy * remaining + s * nx + c * ny + dy
