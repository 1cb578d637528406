"""Integration of the reduced-order model that stays on SO(3): Runge-Kutta-Munthe-Kaas, order 4."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from husky_control.planning.array_namespace import checked_vector
from husky_control.planning.reduced_order import ANGULAR_VELOCITY, ROTATION, STATES
from husky_control.rotation import rotation_from_vector, vector_rate
from husky_description.arrays import Array

Rate = Callable[[float, Array], Array]


def rom_step(rate: Rate, time: float, x: Array, dt: float) -> Array:
    """Return the state after dt: the classical Runge-Kutta step, the rotation as R exp([theta]_x).

    The rotation stays one but for rounding, whatever dt; in exact arithmetic the nine entries alone
    would drift off SO(3) by the order of the method.

    Args:
        rate: f(t, x) -> x' (42), as `reduced_order.f_rom` gives; inputs are its own.
        time: s.
        x: state (42,).
        dt: s.

    Raises:
        ValueError: the motion left the finite numbers.
    """
    start = x[ROTATION].reshape(3, 3).T

    def moved(at: float, change: Array, turn: Array) -> Array:
        state = x + change
        if not (np.isfinite(state).all() and np.isfinite(turn).all()):
            raise ValueError(f"the motion diverges at {at:.4g} s: steps of {dt:.4g} s are too long")
        state[ROTATION] = (start @ rotation_from_vector(turn)).T.reshape(-1)
        return state

    def slopes(at: float, change: Array, turn: Array) -> tuple[Array, Array]:
        state = moved(at, change, turn)
        return rate(at, state), vector_rate(turn, state[ANGULAR_VELOCITY])

    zero = np.zeros(3)
    k1, w1 = slopes(time, np.zeros(STATES), zero)
    k2, w2 = slopes(time + dt / 2, dt / 2 * k1, dt / 2 * w1)
    k3, w3 = slopes(time + dt / 2, dt / 2 * k2, dt / 2 * w2)
    k4, w4 = slopes(time + dt, dt * k3, dt * w3)
    change = dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return moved(time + dt, change, dt / 6 * (w1 + 2 * w2 + 2 * w3 + w4))


def integrate_rom(rate: Rate, x: Array, duration: float, steps: int) -> tuple[Array, Array]:
    """Return the motion from a state in equal steps.

    Args:
        rate: f(t, x) -> x' (42).
        x: state at time zero (42,).
        duration: s.
        steps: number of them.

    Returns:
        Times (steps + 1,) s, and states (steps + 1, 42).

    Raises:
        ValueError: the duration or the number of steps is not above zero; the shape of x is wrong;
            the motion left the finite numbers.
    """
    if not duration > 0.0 or steps < 1:
        raise ValueError(f"duration must be > 0 s and steps >= 1, not {duration} and {steps}")
    times = np.linspace(0.0, duration, steps + 1)
    states = np.empty((steps + 1, STATES))
    states[0] = checked_vector("x", x, STATES)
    for k in range(steps):
        states[k + 1] = rom_step(rate, float(times[k]), states[k], duration / steps)
    return times, states
