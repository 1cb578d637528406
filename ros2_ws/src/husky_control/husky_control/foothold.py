"""Where a swing foot comes down: event-based (T13), with a velocity term against pushes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.kinematics import LEGS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def nominal_footholds(
    hip_position: Array, lateral_offset: Array, forward_spread: float, lateral_spread: float
) -> Array:
    """Foot positions under the legs of a standing robot, (4, 2) m, x and y in base.

    Args:
        hip_position: (4, 3) m in base.
        lateral_offset: (4,) m, signed.
        forward_spread: m, front feet forward and hind feet backward by this much.
        lateral_spread: m, feet outward by this much.
    """
    foothold = np.empty((LEGS, 2))
    foothold[:, 0] = hip_position[:, 0] + np.sign(hip_position[:, 0]) * forward_spread
    foothold[:, 1] = (
        hip_position[:, 1] + lateral_offset + np.sign(lateral_offset) * lateral_spread
    )
    return foothold


@njit(cache=True)
def place_footholds(
    nominal: Array,
    cos_yaw: float,
    sin_yaw: float,
    x: float,
    y: float,
    vx: float,
    vy: float,
    velocity_desired: Array,
    yaw_rate_desired: float,
    remaining_time: Array,
    stance_time: float,
    velocity_gain: float,
    reach: float,
    update: Mask,
    foothold: Array,
) -> None:
    """Footholds in world: under the hip at touchdown, half a stance ahead, and a velocity term.

    foothold = hip at touchdown + v_d T_stance / 2 + velocity_gain (v - v_d), no further than reach
    from the nominal place.

    Args:
        nominal: (4, 2) m in base.
        cos_yaw: of the base's heading.
        sin_yaw: of the base's heading.
        x: m, base in world, without sway.
        y: m.
        vx: m/s, of the base in world, without sway.
        vy: m/s.
        velocity_desired: (2,) m/s in world.
        yaw_rate_desired: rad/s.
        remaining_time: (4,) s until each leg's touchdown.
        stance_time: s.
        velocity_gain: s.
        reach: m.
        update: (4,) bool, the legs whose foothold is placed anew; the others keep theirs.
        foothold: (4, 2) m in world, updated.
    """
    for leg in range(LEGS):
        if not update[leg]:
            continue
        # Under a turning base the hip will have moved on by half the stance, too.
        turn = yaw_rate_desired * (remaining_time[leg] + 0.5 * stance_time)
        nx = nominal[leg, 0] - turn * nominal[leg, 1]
        ny = nominal[leg, 1] + turn * nominal[leg, 0]
        dx = 0.5 * stance_time * velocity_desired[0] + velocity_gain * (
            vx - velocity_desired[0]
        )
        dy = 0.5 * stance_time * velocity_desired[1] + velocity_gain * (
            vy - velocity_desired[1]
        )
        distance = (dx * dx + dy * dy) ** 0.5
        if distance > reach:
            dx *= reach / distance
            dy *= reach / distance
        foothold[leg, 0] = (
            x + vx * remaining_time[leg] + cos_yaw * nx - sin_yaw * ny + dx
        )
        foothold[leg, 1] = (
            y + vy * remaining_time[leg] + sin_yaw * nx + cos_yaw * ny + dy
        )
