"""States of a walking robot at a Poincare section: once a gait cycle, from a recording (T14)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from husky_bringup.recording import Recording

Array = NDArray[np.float64]

STATE = (
    "forward_velocity",
    "lateral_velocity",
    "vertical_velocity",
    "height",
    "roll",
    "pitch",
    "roll_rate",
    "pitch_rate",
    "yaw_rate",
)
"""Components of a section state: m/s, m, rad, rad/s, in the heading frame. Place and heading are
left out: the gait does not care where it is."""


PHASE = 0.25
"""Phase of the gait at the section: the middle of a trot's stance, away from the impacts."""


def crossings(recording: Recording, start: float, end: float, phase: float = PHASE) -> Array:
    """Return the times at which the gait passes a phase [s], between the controller's reports.

    The phase is unwrapped and interpolated; a clock that waits for a late touchdown just delays it.
    """
    states = recording.controller.between(start, end)
    unwrapped = np.unwrap(2.0 * np.pi * states.phase) / (2.0 * np.pi) - phase
    cycles = np.arange(np.ceil(unwrapped[0]), np.floor(unwrapped[-1]) + 1.0)
    rising = np.maximum.accumulate(unwrapped + 1e-9 * np.arange(len(unwrapped)))
    times: Array = np.interp(cycles, rising, states.time)
    return times


def section_states(recording: Recording, times: Array, slope: float = 0.0) -> Array:
    """Return the true states at some times, (len(times), len(STATE)), columns as `STATE`.

    Args:
        recording: with ground truth.
        times: [s].
        slope: of the ground, rising along x [rad]; states are relative to it, height is its normal
            coordinate.
    """
    base = recording.base
    ground = Rotation.from_euler("y", slope)
    yaw, pitch, roll = (ground * Rotation.from_quat(base.orientation)).as_euler("ZYX").T
    heading = Rotation.from_euler("z", yaw[:, None])
    velocity = heading.inv().apply(ground.apply(base.velocity))
    height = ground.apply(base.position)[:, 2]
    columns = np.column_stack((velocity, height, roll, pitch, base.angular_velocity))
    return np.column_stack([np.interp(times, base.time, column) for column in columns.T])


def undisturbed_pairs(times: Array, disturbances: Array, duration: float) -> NDArray[np.intp]:
    """Return the indices of sections from which to the next one nothing pushed the robot.

    Args:
        times: of the sections [s], ascending.
        disturbances: when pushes began [s].
        duration: of a push [s].
    """
    pushed = np.zeros(len(times) - 1, dtype=bool)
    for begin in disturbances:
        pushed |= (times[:-1] < begin + duration) & (times[1:] > begin)
    return np.flatnonzero(~pushed)
