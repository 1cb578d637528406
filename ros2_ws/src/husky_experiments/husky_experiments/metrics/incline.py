"""What a recording says of a climb, as numbers ready for JSON."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_experiments.incline_course import Course
from husky_experiments.metrics import measures
from husky_experiments.metrics.measures import by_group, peak, rms
from husky_experiments.metrics.walking import Summary, foot_placement_rms
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

_AT_CONE = 0.98
"""Share of the friction coefficient from which on a sample counts as at the cone's edge."""


def climb_summary(
    recording: Recording, robot: Robot, course: Course, start: float, end: float
) -> Summary:
    """Return the figures of a climb between two times [s], on the straight part of a course.

    Speeds are along the slope, loads and slip relative to it; attitude is the body's relative to
    the slope. `inside_cone` is the share of stance samples whose tangential over normal force is
    below 0.98 of the friction coefficient (T16, T33). `estimate_along_error_m` is the greatest
    error up the slope of the estimate by which the robot is led.
    """
    base = recording.base.between(start, end)
    if len(base) < 2:
        return {"duration_s": 0.0}
    duration = float(base.time[-1] - base.time[0])
    way = base.position[-1] - base.position[0]
    result: Summary = {
        "duration_s": duration,
        "mean_speed": float(way @ course.uphill) / duration,
        "lateral_drift_m": float(way[1]),
        **_attitude(base.orientation, course),
        **_feet(recording, course, start, end),
        "foot_placement_rms_mm": 1e3
        * foot_placement_rms(recording, robot, start, end, course.normal),
    }
    torque = recording.joints.between(start, end).torque
    for group, values in by_group(torque).items():
        result[f"torque_rms_{group}_Nm"] = rms(values)
        result[f"torque_peak_{group}_Nm"] = peak(values)
        result[f"torque_at_limit_{group}"] = measures.share_above(
            values, 0.98 * float(robot.joint_torque_limit.max())
        )
    if recording.has(graph.ODOMETRY):
        estimate = recording.estimate.between(start, end)
        error = measures.estimate_error(recording.base, estimate).position
        result["estimate_along_error_m"] = peak(error @ course.uphill)
    if recording.has(graph.FAN_STATE):
        result |= _thrust(recording, course, start, end)
    return result


def worst_tilt_deg(recording: Recording, course: Course, start: float, end: float) -> float:
    """Return how far the body was from upright between two times [s], on slope or flat [deg]."""
    base = recording.base.between(start, end)
    up = Rotation.from_quat(base.orientation).as_matrix()[:, :, 2]
    upright = np.maximum(up[:, 2], up @ course.normal)
    return float(np.degrees(np.arccos(np.clip(upright.min(), -1.0, 1.0))))


def _attitude(orientation: Array, course: Course) -> Summary:
    """Roll, pitch and yaw of the body relative to the slope."""
    slope = Rotation.from_euler("y", -course.slope)
    yaw, pitch, roll = (slope.inv() * Rotation.from_quat(orientation)).as_euler("ZYX").T
    return {
        "roll_rms_deg": rms(np.degrees(roll)),
        "pitch_rms_deg": rms(np.degrees(pitch)),
        "yaw_max_deg": peak(np.degrees(yaw)),
        "tilt_max_deg": peak(np.degrees(measures.tilt(orientation, course.normal))),
    }


def _feet(recording: Recording, course: Course, start: float, end: float) -> Summary:
    contacts = recording.contacts.between(start, end)
    used = measures.friction_use(contacts.force, course.normal)
    found = measures.steps(contacts, course.normal)
    slips = 1e3 * np.array([step.slip for step in found])
    nothing = float("nan")
    return {
        "inside_cone": float(np.mean(used < _AT_CONE * course.friction)) if len(used) else nothing,
        "load_ratio_p50": float(np.median(used)) if len(used) else nothing,
        "load_ratio_p95": float(np.percentile(used, 95)) if len(used) else nothing,
        "steps": len(found),
        "slip_mm_per_step": float(slips.mean()) if len(found) else nothing,
        "slip_max_mm": float(slips.max()) if len(found) else nothing,
    }


def _thrust(recording: Recording, course: Course, start: float, end: float) -> Summary:
    fans = recording.fans.between(start, end)
    size = np.linalg.norm(fans.force, axis=1)
    power = fans.battery_voltage * fans.battery_current
    return {
        "thrust_mean_n": float(size.mean()),
        "thrust_max_n": float(size.max()),
        "battery_power_mean_w": float(power.mean()),
        "battery_charge_end": float(fans.battery_charge[-1]),
    }
