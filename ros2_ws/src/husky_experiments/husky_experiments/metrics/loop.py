"""Judgement of a localisation: where the robot believes to be beside where it is, along a walk."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base
from husky_runtime import graph

LEGS, MAP = graph.FRAME_ODOM, graph.FRAME_MAP
"""Frames in which the robot tells where it is: by its legs alone, and with the T265."""


@dataclass(frozen=True, eq=False)
class Track:
    """A walk as the robot believes it, beside the truth.

    Both begin at the origin with heading 0: the frames are where the walk begins.

    Attributes:
        time: of the poses [s] (n,).
        believed: base in the frame [m] (n, 3).
        true: base at the same times [m] (n, 3).
        heading_error: believed less true heading [rad] (n,).
    """

    time: Array
    believed: Array
    true: Array
    heading_error: Array

    @property
    def distance(self) -> float:
        """Length of the true way, seen from above, without the sway of the trot [m]."""
        steps = np.diff(_smoothed(self.true[:, :2], self.time), axis=0)
        return float(np.hypot(*steps.T).sum())

    @property
    def error(self) -> Array:
        """Distance of the believed base from the true one [m] (n,)."""
        distance: Array = np.linalg.norm(self.believed - self.true, axis=1)
        return distance


_SWAY = 1.0
"""Time over which the way is averaged: two periods of the trot and more [s]."""


def _smoothed(way: Array, time: Array) -> Array:
    """Return a moving average over `_SWAY`, shorter at both ends (n, 2)."""
    count = max(1, round(_SWAY / float(np.median(np.diff(time)))))
    total = np.vstack([np.zeros(2), np.cumsum(way, axis=0)])
    index = np.arange(len(way))
    half = np.minimum(np.minimum(index, len(way) - 1 - index), count // 2)
    mean: Array = (total[index + half + 1] - total[index - half]) / (2 * half + 1)[:, None]
    return mean


def track(recording: Recording, frame: str, start: float, end: float) -> Track:
    """Return a walk between two simulated times [s], as the robot believes it in a frame.

    Args:
        recording: of the walk.
        frame: `LEGS` or `MAP`.
        start: of the walk.
        end: of the walk.
    """
    told = recording.estimate if frame == LEGS else _in_map(recording)
    told, truth = told.between(start, end), recording.base
    inside = (told.time >= truth.time[0]) & (told.time <= truth.time[-1])
    time = told.time[inside]
    true = np.stack(
        [np.interp(time, truth.time, truth.position[:, axis]) for axis in range(3)], axis=1
    )
    true_heading = np.interp(time, truth.time, truth.rpy[:, 2])
    heading = told.rpy[inside, 2]
    error = heading - true_heading
    return Track(
        time,
        _from_start(told.position[inside], float(heading[0])),
        _from_start(true, float(true_heading[0])),
        error - error[0],
    )


def _from_start(position: Array, heading: float) -> Array:
    """Return positions seen from the first, along and across a heading [rad] (n, 3)."""
    seen: Array = Rotation.from_euler("z", -heading).apply(position - position[0])
    return seen


def _in_map(recording: Recording) -> Base:
    """Return the base in `map`; velocities are not told there."""
    _, column = recording.columns(graph.MAP_POSE)
    time = column["header.stamp.sec"] + 1e-9 * column["header.stamp.nanosec"]
    unknown = np.full((len(time), 3), math.nan)
    return Base(
        time, column["pose.pose.position"], column["pose.pose.orientation"], unknown, unknown
    )


def summary(name: str, told: Track) -> dict[str, float]:
    """Return errors at the end and the greatest [m], as a share of the way [-], of heading [deg].

    Args:
        name: that the figures begin with.
        told: the walk.
    """
    return {
        f"{name}_end_error_m": float(told.error[-1]),
        f"{name}_end_error_share": float(told.error[-1]) / told.distance,
        f"{name}_greatest_error_m": float(told.error.max()),
        f"{name}_heading_error_deg": math.degrees(float(told.heading_error[-1])),
    }
