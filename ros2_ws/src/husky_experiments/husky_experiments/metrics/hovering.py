"""What a recording says of a robot that hovers: how still it is, how it turns, what a gust does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_experiments.metrics.measures import nearest, rms, tilt
from husky_experiments.metrics.propulsion import Span, attitude_summary
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base

SETTLED = 0.05
"""Share of a step within which the heading has settled."""


@dataclass(frozen=True, eq=False)
class Stray:
    """How far a body is from its place over time (n rows)."""

    time: Array  # [s] (n,)
    offset: Array  # from the place, in world [m] (n, 3)
    tilt: Array  # [rad] (n,)

    @property
    def distance(self) -> Array:
        """Distance from the place [m] (n,)."""
        distance: Array = np.linalg.norm(self.offset, axis=1)
        return distance


def stray_from(base: Base, place: Array, span: Span) -> Stray:
    """Return how far a motion, true or estimated, is from a place in its world [m] (3,)."""
    inside = base.between(*span)
    return Stray(inside.time, inside.position - place, tilt(inside.orientation))


def place_above(base: Base, time: float, height: float) -> Array:
    """Return the place a height [m] above where a body was at a time [s], (3,)."""
    at = [np.interp(time, base.time, column) for column in base.position.T]
    return np.array(at) + (0.0, 0.0, height)


def hold_summary(
    recording: Recording, take_off: float, height: float, hold: Span
) -> dict[str, float]:
    """Return how still a robot is in the air, by its estimate and in truth.

    Places count from where each had the body when it took off; attitudes from what was desired.

    Args:
        recording: the run.
        take_off: when the body still rested on its perch [s].
        height: of the hold above that place [m].
        hold: first and last time [s].
    """
    result = {}
    for name, base in (("estimated", recording.estimate), ("true", recording.base)):
        stray = stray_from(base, place_above(base, take_off, height), hold)
        result[f"{name}_position_error_max_m"] = float(stray.distance.max())
        result[f"{name}_position_error_rms_m"] = rms(stray.distance)
        result[f"{name}_tilt_max_deg"] = math.degrees(stray.tilt.max())
        result[f"{name}_tilt_rms_deg"] = math.degrees(rms(stray.tilt))
    attitude = attitude_summary(recording, *hold)
    for name in ("attitude_rms_deg", "roll_rms_deg", "pitch_rms_deg", "yaw_rms_deg"):
        result[name] = float(attitude[name] or 0.0)
    heading = recording.base.between(*hold).rpy[:, 2]
    result["heading_drift_deg"] = math.degrees(float(np.ptp(heading)))
    return result


def sweep_summary(stray: Stray) -> dict[str, float]:
    """Return how far a robot in the air goes astray and tilts while its arms move."""
    return {
        "sweep_position_error_max_m": float(stray.distance.max()),
        "sweep_position_error_rms_m": rms(stray.distance),
        "sweep_tilt_max_deg": math.degrees(float(stray.tilt.max())),
    }


@dataclass(frozen=True, eq=False)
class HeadingStep:
    """A step of the heading: response, and what it took (n rows).

    What did not happen is NaN.
    """

    time: Array  # since the step began [s] (n,)
    heading: Array  # true, since then [rad] (n,)
    motors: Array  # commanded, share of full throttle (n, 4)
    hips: Array  # measured frontal angles from where they were at the beginning [rad] (n, 4)
    step: float  # that was asked for [rad]

    @property
    def rise(self) -> float:
        """Time from 10 to 90 % of the step [s]."""
        return self._first(0.9) - self._first(0.1)

    @property
    def settling(self) -> float:
        """Time after which the heading stays within `SETTLED` of the step [s]."""
        off = np.flatnonzero(np.abs(self.heading - self.step) > SETTLED * abs(self.step))
        if not len(off):
            return 0.0
        return float(self.time[off[-1] + 1]) if off[-1] + 1 < len(self.time) else math.nan

    @property
    def overshoot(self) -> float:
        """Of the step, a share of it."""
        return max(0.0, float((self.heading / self.step).max()) - 1.0)

    def _first(self, share: float) -> float:
        beyond = np.flatnonzero(self.heading / self.step >= share)
        return float(self.time[beyond[0]]) if len(beyond) else math.nan

    def as_metrics(self, name: str) -> dict[str, float]:
        """Return what the step came to, ready for JSON."""
        return {
            f"{name}_rise_s": self.rise,
            f"{name}_settling_s": self.settling,
            f"{name}_overshoot_percent": 100.0 * self.overshoot,
            f"{name}_motor_command_max": float(self.motors.max()),
            f"{name}_motor_spread_max": float(np.ptp(self.motors, axis=1).max()),
            f"{name}_hip_tilt_max_deg": math.degrees(float(np.abs(self.hips).max())),
        }


def turn_of(recording: Recording, robot: Robot, step: float, span: Span) -> HeadingStep:
    """Return the response to a step of the heading [rad] that begins and is looked at in a span."""
    base, state = recording.base.between(*span), recording.propulsion
    joints = recording.joints
    yaw = base.rpy[:, 2]
    low, high = robot.esc.pulse_low, robot.esc.pulse_high
    pulses = state.pwm[nearest(state.time, base.time)].astype(float)
    hips = joints.position[nearest(joints.time, base.time), 0::3]
    return HeadingStep(
        base.time - span[0], yaw - yaw[0], (pulses - low) / (high - low), hips - hips[0], step
    )


def gust_summary(stray: Stray, gust: Span, near: float) -> dict[str, float]:
    """Return how far a gust carries a body, and how long after its end it is near its place again.

    Args:
        stray: from the gust's beginning on.
        gust: when it blew [s].
        near: distance that is near [m].
    """
    level = np.linalg.norm(stray.offset[:, :2], axis=1)
    away = stray.time[(level > near) & (stray.time > gust[1])]
    return {
        "gust_displacement_max_m": float(level.max()),
        "gust_height_change_max_m": float(np.abs(stray.offset[:, 2]).max()),
        "gust_tilt_max_deg": math.degrees(float(stray.tilt.max())),
        "gust_recovery_s": float(away[-1]) - gust[1] if len(away) else 0.0,
    }
