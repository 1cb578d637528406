"""Dynamics of one ducted fan's rotor: J w' = (i - i0) / K - c w^2, never backwards.

The coefficients and the steady state are the fan's own (`husky_description.fan`).
"""

from __future__ import annotations

from numba import njit


@njit(cache=True)
def next_speed(
    speed: float,
    current: float,
    dt: float,
    torque_constant: float,
    no_load_current: float,
    drag: float,
    inertia: float,
) -> float:
    """Speed of the rotor after `dt` [rad/s]; friction stops it, nothing turns it backwards."""
    torque = (current - no_load_current) * torque_constant - drag * speed * speed
    return max(0.0, speed + torque / inertia * dt)
