"""States of a walking robot at a Poincare section, and how stable its return map is (T14)."""

from __future__ import annotations

import contextlib

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from husky_control.gait.stability import fit_return_map
from husky_description.arrays import Array
from husky_experiments.metrics.measures import nearest
from husky_experiments.recordings.recording import Recording

MOTION = (
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
"""Motion of the body at a section: m/s, m, rad, rad/s, in the heading frame. Place and heading in
the world are left out: the gait does not care where it is."""
HELD = ("forward_of_feet", "left_of_feet", "forward_integral", "left_integral", "heading")
"""What the controller holds from step to step: where the body is over the feet that it has put
down [m], what the integral of its velocity error adds to the command [m/s], and the heading that
it keeps to [rad]."""
STATE = MOTION + HELD
"""Components of a section state."""
PHASE = 0.25
"""Phase of the gait at the section: the middle of a trot's stance, away from the impacts."""
SAMPLES, CONFIDENCE = 200, 0.95
"""Of the bootstrap: maps that are fitted, and share of them that lie below its upper end."""


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


def section_states(recording: Recording, times: Array, follow: float, slope: float = 0.0) -> Array:
    """Return the states at some times, (len(times), len(STATE)), columns as `STATE`.

    The motion is the true one, what is held is the controller's. Its integral is read from the
    velocities that it reports: the reference body moves at v - (1 - follow) (v - v_d), where v is
    the estimate and v_d the command and a share of the integral.

    Args:
        recording: with ground truth.
        times: [s].
        follow: the gait's share of the measured velocity (`Gait.velocity_follow`), below 1.
        slope: of the ground, rising along x [rad]; states are relative to it, height is its normal
            coordinate.
    """
    base, contacts, states = recording.base, recording.contacts, recording.controller
    ground = Rotation.from_euler("y", slope)
    yaw, pitch, roll = (ground * Rotation.from_quat(base.orientation)).as_euler("ZYX").T
    heading = Rotation.from_euler("z", np.interp(times, base.time, np.unwrap(yaw))[:, None])

    def at(time: Array, values: Array) -> Array:
        return np.column_stack([np.interp(times, time, column) for column in values.T])

    def along_heading(time: Array, values: Array) -> Array:
        turned: Array = heading.inv().apply(ground.apply(at(time, values)))
        return turned

    height = ground.apply(base.position)[:, 2]
    columns = at(base.time, np.column_stack((height, roll, pitch, base.angular_velocity)))
    standing = contacts.contact[nearest(contacts.time, times)]
    feet = at(contacts.time, contacts.position.reshape(-1, 12)).reshape(-1, 4, 3)
    middle = np.average(feet, axis=1, weights=np.repeat(standing[..., None], 3, axis=2))
    over_feet = heading.inv().apply(ground.apply(at(base.time, base.position) - middle))
    lag = (states.velocity - states.desired_velocity) / (1.0 - follow)
    wanted = along_heading(states.time, states.velocity - lag)
    return np.column_stack(
        (
            along_heading(base.time, base.velocity),
            columns,
            over_feet[:, :2],
            wanted[:, :2] - at(states.time, states.commanded_velocity[:, :2]),
            np.interp(times, states.time, states.rpy[:, 2]),
        )
    )


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


def upper_modulus(states: Array, successors: Array, seed: int = 0) -> float:
    """Return the upper end of a bootstrap interval of the largest eigenvalue's modulus.

    The return map is fitted to pairs drawn with replacement, again and again; a draw that cannot
    be fitted counts as infinite.

    Args:
        states: at a section (m, n).
        successors: at the next one (m, n).
        seed: of the draws.
    """
    random = np.random.default_rng(seed)
    moduli = np.full(SAMPLES, np.inf)
    for sample in range(SAMPLES):
        drawn = random.integers(0, len(states), len(states))
        with contextlib.suppress(ValueError):
            moduli[sample] = fit_return_map(states[drawn], successors[drawn]).spectral_radius
    return float(np.quantile(moduli, CONFIDENCE, method="higher"))
