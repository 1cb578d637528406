"""Measures of a run: pure functions, arrays over time in, numbers out.

SI units and radians. The ground is horizontal unless a normal is given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from husky_description.arrays import Array
from husky_experiments.recordings.tables import Base, Contacts, EstimateErrors, Mask
from husky_runtime import graph

JOINT_GROUPS = ("hip_frontal", "hip_sagittal", "knee")
"""The three kinds of joint; joint index = 3 * leg + group."""
UP: Array = np.array((0.0, 0.0, 1.0))
"""Normal of horizontal ground, in world."""
MAXIMUM_TILT = np.pi / 4.0
"""A robot that leans more than this has fallen [rad]."""

_CONTACT_FORCE = 5.0
"""A foot carries load from this normal force on [N]: 7 % of the robot's weight."""


def rms(values: Array) -> float:
    """Return the root mean square of all values, NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else float("nan")


# Motion of the base ---------------------------------------------------------------------------
def mean_velocity_in_heading(time: Array, position: Array, yaw: Array) -> tuple[float, float]:
    """Return the mean forward and leftward speed of the base [m/s].

    The way covered in each interval is split along the heading in it, so a robot that slowly turns
    keeps its forward speed, and swaying to and fro adds nothing.

    Args:
        time: [s] (n,).
        position: base in world [m] (n, 3).
        yaw: [rad], unwrapped (n,).
    """
    if len(time) < 2:
        return float("nan"), float("nan")
    step = np.diff(position[:, :2], axis=0)
    heading = (yaw[1:] + yaw[:-1]) / 2.0
    forward = step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading)
    left = step[:, 1] * np.cos(heading) - step[:, 0] * np.sin(heading)
    duration = time[-1] - time[0]
    return float(forward.sum() / duration), float(left.sum() / duration)


def in_heading(velocity: Array, yaw: Array) -> Array:
    """Turn velocities from world to forward, left, up of the heading.

    Args:
        velocity: in world [m/s] (n, 3).
        yaw: [rad] (n,).
    """
    forward = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
    left = velocity[:, 1] * np.cos(yaw) - velocity[:, 0] * np.sin(yaw)
    return np.column_stack((forward, left, velocity[:, 2]))


def mean_yaw_rate(time: Array, yaw: Array) -> float:
    """Return the mean yaw rate [rad/s] from unwrapped yaw [rad] (n,)."""
    return float((yaw[-1] - yaw[0]) / (time[-1] - time[0])) if len(time) > 1 else float("nan")


def drift(position: Array) -> float:
    """Return the greatest horizontal distance from the first position [m]; position (n, 3)."""
    if not len(position):
        return float("nan")
    return float(np.linalg.norm(position[:, :2] - position[0, :2], axis=1).max())


def distance(position: Array) -> float:
    """Return the horizontal distance from the first to the last position [m]; position (n, 3)."""
    if not len(position):
        return float("nan")
    return float(np.linalg.norm(position[-1, :2] - position[0, :2]))


def height_error(height: Array, reference: Array | float) -> tuple[float, float]:
    """Return rms and greatest absolute difference of the height to its reference [m]."""
    error = np.asarray(height) - reference
    return rms(error), peak(error)


def tilt(orientation: Array, normal: Array = UP) -> Array:
    """Return the angle between the base's z axis and a normal in world [rad] (n,)."""
    up = Rotation.from_quat(orientation).apply(UP)
    angle: Array = np.arccos(np.clip(up @ normal, -1.0, 1.0))
    return angle


def first_fall(
    time: Array,
    height: Array,
    tilt_angle: Array,
    upright: Mask,
    minimum_height: float,
    maximum_tilt: float = MAXIMUM_TILT,
) -> float | None:
    """Return when the robot fell [s], None if it did not.

    A fall is a tilt above the maximum at any time, or a base below the minimum height while the
    robot should be on its legs.

    Args:
        time: [s] (n,).
        height: of the base above the ground [m] (n,).
        tilt_angle: [rad] (n,).
        upright: the robot should be on its legs (n,).
        minimum_height: [m].
        maximum_tilt: [rad].
    """
    fallen = (tilt_angle > maximum_tilt) | (upright & (height < minimum_height))
    return float(time[np.argmax(fallen)]) if fallen.any() else None


def estimate_error(base: Base, estimate: Base) -> EstimateErrors:
    """Return estimate minus truth, the truth interpolated to the times of the estimate.

    Estimates before the first and after the last true sample are left out.
    """
    inside = (estimate.time >= base.time[0]) & (estimate.time <= base.time[-1])
    time = estimate.time[inside]

    def at(values: Array) -> Array:
        return np.column_stack([np.interp(time, base.time, column) for column in values.T])

    truly = Slerp(base.time, Rotation.from_quat(base.orientation))(time)
    turn = truly.inv() * Rotation.from_quat(estimate.orientation[inside])
    return EstimateErrors(
        time,
        estimate.position[inside] - at(base.position),
        estimate.velocity[inside] - at(base.velocity),
        turn.as_rotvec(),
    )


# Joints ---------------------------------------------------------------------------------------
def by_group(values: Array) -> dict[str, Array]:
    """Split columns in joint order (n, 12) by kind of joint: four columns each (n, 4)."""
    return {name: values[:, index::3] for index, name in enumerate(JOINT_GROUPS)}


def peak(values: Array) -> float:
    """Return the greatest magnitude, NaN of none."""
    return float(np.abs(values).max()) if np.size(values) else float("nan")


def share_above(values: Array, limit: float) -> float:
    """Return the share of samples whose magnitude is above a limit, 0 to 1."""
    return float(np.mean(np.abs(values) > limit)) if np.size(values) else float("nan")


def tracking_error(
    command_time: Array, target: Array, joint_time: Array, position: Array
) -> tuple[Array, Array]:
    """Return target minus measured joint position [rad] and when [s].

    A target commanded for a tick is to be reached at the end of that tick (the drive interpolates
    towards it), so it is compared with the joint states one tick later.

    Args:
        command_time: [s] (n,).
        target: [rad] (n, 12).
        joint_time: [s] (m,).
        position: measured [rad] (m, 12).

    Returns:
        Time (k,) and error (k, 12), of the commands that have a measurement.
    """
    due = command_time + graph.TICK_PERIOD
    index = np.searchsorted(joint_time, due - graph.TICK_PERIOD / 4.0)
    found = index < len(joint_time)
    found[found] = np.abs(joint_time[index[found]] - due[found]) < graph.TICK_PERIOD / 2.0
    return due[found], target[found] - position[index[found]]


# Feet -----------------------------------------------------------------------------------------
def friction_use(force: Array, normal: Array = UP) -> Array:
    """Return tangential over normal force of each loaded foot sample (k,), T/N.

    Args:
        force: of the ground on the feet, in world [N] (n, 4, 3).
        normal: of the ground, in world (3,).
    """
    pressing = force @ normal
    loaded = pressing > _CONTACT_FORCE
    sideways = np.linalg.norm(force - pressing[..., None] * normal, axis=-1)
    used: Array = sideways[loaded] / pressing[loaded]
    return used


@dataclass(frozen=True)
class Step:
    """One stance of one foot."""

    leg: int  # 0 to 3
    start: float  # first sample in contact [s]
    end: float  # last sample in contact [s]
    slip: float  # how far the contact point slid over the ground [m]


def steps(contacts: Contacts, normal: Array = UP) -> list[Step]:
    """Return the stances of all feet and how far each slipped.

    A stance counts from the sample before the foot touches to the one after it has left, so that
    all it has slid is in it, landing and leaving included. A touch that never carries load is no
    step; stances cut by the recording's ends are not counted.

    Args:
        contacts: of the feet.
        normal: of the ground, in world (3,).
    """
    loaded = contacts.contact & (contacts.force @ normal > _CONTACT_FORCE)
    found = []
    for leg in range(4):
        edges = np.diff(contacts.contact[:, leg].astype(np.int8))
        for before in np.flatnonzero(edges == 1):
            ends = np.flatnonzero(edges[before:] == -1)
            if not len(ends):
                continue
            last = before + ends[0]
            if loaded[before + 1 : last + 1, leg].any():
                slip = contacts.slid[last + 1, leg] - contacts.slid[before, leg]
                start, end = contacts.time[[before + 1, last]].tolist()
                found.append(Step(leg, start, end, float(slip)))
    return sorted(found, key=lambda step: step.start)


def nearest(time: Array, wanted: Array) -> NDArray[np.intp]:
    """Return the index of the sample nearest to each wanted time."""
    right = np.clip(np.searchsorted(time, wanted), 1, max(1, len(time) - 1))
    left = right - 1
    nearer_left = wanted - time[left] <= time[np.minimum(right, len(time) - 1)] - wanted
    return np.where(nearer_left, left, np.minimum(right, len(time) - 1))
