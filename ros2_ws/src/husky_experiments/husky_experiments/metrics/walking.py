"""What a recording says of how well the robot did, as numbers ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from husky_control.gait import stability
from husky_description.actuation import BUS_SERVOS
from husky_description.arrays import Array
from husky_description.kinematics import Kinematics
from husky_description.robot import Robot
from husky_experiments.metrics import measures
from husky_experiments.metrics.measures import UP, by_group, nearest, peak, rms
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, ControllerStates, Joints
from husky_runtime import graph

Summary = dict[str, float | int | bool | str | None]
"""Name (with its unit, m/s where there is none) to value; None for what cannot be said."""

_POSITION_MODE = 8
"""CiA 402 cyclic synchronous position."""
_UPRIGHT_MODES = ("stand", "walk", "position_trot")
"""Modes in which a low base means a fall; in others the robot may sit."""
_STOPPED_MODES = ("damping", "emergency_stop")
_FALLEN_HEIGHT = 0.5
"""Base height below which a robot on its legs has fallen, as a share of the stand height."""
_FALLEN_SHARE = 0.9
"""Of the height on the perch, below which one that flies from it has fallen."""


# Single figures -------------------------------------------------------------------------------
def height_error(recording: Recording, start: float, end: float) -> float:
    """Return the greatest difference of the true height to the one the controller wants [m]."""
    base = recording.base.between(start, end)
    wanted = _wanted_height(base, recording.controller, UP)
    return measures.height_error(base.position[:, 2], wanted)[1]


def lowest_upright(robot: Robot) -> float:
    """Return the height of the base below which a robot on its legs has fallen [m]."""
    half = _FALLEN_HEIGHT * (robot.stand_height + robot.foot_radius)
    if not robot.legs_carry_propellers:
        return half
    # On its perch it sits nearly as high, and soft ground gives way.
    return min(half, _FALLEN_SHARE * (robot.sit_height + robot.foot_radius))


def has_fallen(truth: Any, minimum_height: float = 0.27) -> bool:
    """Return whether a robot that should be on its legs has fallen.

    Args:
        truth: `nav_msgs/Odometry` of the ground truth, or None when there is none yet.
        minimum_height: of the base [m]; half of Carbon's stand height, see `lowest_upright`.
    """
    if truth is None:
        return False
    pose = truth.pose.pose
    q = pose.orientation
    tilt = measures.tilt(np.array([[q.x, q.y, q.z, q.w]]))[0]
    return bool(tilt > measures.MAXIMUM_TILT or pose.position.z < minimum_height)


def _wanted_height(base: Base, states: ControllerStates, normal: Array) -> Array:
    """Return the height that the controller wants, at the times of `base` [m]."""
    wanted: Array = np.interp(base.time, states.time, states.desired_position @ normal)
    return wanted


# All figures ----------------------------------------------------------------------------------
def summary(
    recording: Recording,
    robot: Robot,
    start: float = -np.inf,
    end: float = np.inf,
    normal: Array = UP,
) -> Summary:
    """Return the figures of a recording between two simulated times [s].

    Topics that it lacks leave their figures out. The normal of the ground is in world (3,).
    """
    result: Summary = {}
    states = (
        recording.controller.between(start, end) if recording.has(graph.CONTROLLER_STATE) else None
    )
    if recording.has(graph.GROUND_TRUTH):
        result |= _base_summary(recording.base.between(start, end), states, robot, normal)
    if states is not None and len(states):
        result |= _controller_summary(states)
    if recording.has(graph.JOINT_STATES):
        result |= _torque_summary(recording.joints.between(start, end), robot)
        if recording.has(graph.JOINT_COMMAND):
            result |= _tracking_summary(recording, start, end)
    if recording.has(graph.FOOT_CONTACTS):
        result |= _contact_summary(recording, robot, start, end, normal)
    if recording.has(graph.GROUND_TRUTH) and recording.has(graph.ODOMETRY):
        result |= _estimate_summary(recording.base, recording.estimate.between(start, end))
    return {name: _finite(value) for name, value in result.items()}


def static_margin(recording: Recording, start: float, end: float) -> float:
    """Return the least true static margin [m] (T15): centre of mass in the polygon of contacts."""
    time, column = recording.columns(graph.FOOT_CONTACTS)
    margins = [
        stability.static_margin(center, position[contact.astype(bool)])
        for stamp, center, position, contact in zip(
            time, column["center_of_mass"], column["position"], column["contact"], strict=True
        )
        if start <= stamp <= end
    ]
    return min(margins, default=float("nan"))


def foot_placement_rms(
    recording: Recording, robot: Robot, start: float, end: float, normal: Array = UP
) -> float:
    """Return how far feet come down from where the controller puts them [m], rms over all steps.

    The distance along the ground, at the first touch of a step, from the foot to the place that the
    joints' commands give it under the true body: what drives and frame give way. NaN of no steps.
    """
    base, contacts, commands = recording.base, recording.contacts, recording.commands
    steps = measures.steps(contacts.between(start, end), normal)
    touches = np.array([step.start for step in steps])
    rows = (nearest(table.time, touches) for table in (base, contacts, commands))
    kinematics, misses = Kinematics(robot), []
    for step, body, touch, row in zip(steps, *rows, strict=True):
        if commands.mode_of_operation[row] == _POSITION_MODE:
            asked = kinematics.foot_positions(commands.position[row])[step.leg]
            asked = base.position[body] + Rotation.from_quat(base.orientation[body]).apply(asked)
            miss = contacts.position[touch, step.leg] - asked
            misses.append(np.linalg.norm(miss - (miss @ normal) * normal))
    return rms(np.array(misses))


def _finite(value: float | int | bool | str | None) -> float | int | bool | str | None:
    """Return None for a number that JSON does not have."""
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _base_summary(
    base: Base, states: ControllerStates | None, robot: Robot, normal: Array
) -> Summary:
    if len(base) < 2:
        return {"duration_s": 0.0}
    roll, pitch, yaw = base.rpy.T
    height = base.position @ normal
    standing = robot.stand_height + robot.foot_radius
    wanted: Array | float = standing
    upright = np.ones(len(base), np.bool_)
    if states is not None and len(states):
        wanted = _wanted_height(base, states, normal)
        upright = np.isin(states.mode, _UPRIGHT_MODES)[nearest(states.time, base.time)]
    forward, left = measures.mean_velocity_in_heading(base.time, base.position, yaw)
    height_rms, height_max = measures.height_error(height, wanted)
    tilt = measures.tilt(base.orientation, normal)
    fall = measures.first_fall(base.time, height, tilt, upright, lowest_upright(robot))
    return {
        "duration_s": float(base.time[-1] - base.time[0]),
        "mean_speed": forward,
        "mean_lateral_speed": left,
        "mean_yaw_rate_dps": float(np.degrees(measures.mean_yaw_rate(base.time, yaw))),
        "distance_m": measures.distance(base.position),
        "drift_m": measures.drift(base.position),
        "roll_rms_deg": rms(np.degrees(roll)),
        "pitch_rms_deg": rms(np.degrees(pitch)),
        "tilt_max_deg": float(np.degrees(tilt.max())),
        "height_mean_m": float(height.mean()),
        "height_error_rms_m": height_rms,
        "height_error_max_m": height_max,
        "fallen": fall is not None,
        "fall_time_s": fall,
    }


def _estimate_summary(base: Base, estimate: Base) -> Summary:
    """Errors of the estimate; its position may start anywhere, so the first is taken off."""
    if not len(estimate) or len(base) < 2:
        return {}
    error = measures.estimate_error(base, estimate)
    drift = error.position - error.position[:1]
    return {
        "estimate_drift_m": peak(np.linalg.norm(drift[:, :2], axis=1)),
        "estimate_height_rms_m": rms(error.position[:, 2]),
        "estimate_velocity_rms_mps": rms(np.linalg.norm(error.velocity, axis=1)),
        "estimate_tilt_rms_deg": rms(np.degrees(np.linalg.norm(error.attitude[:, :2], axis=1))),
        "estimate_yaw_rms_deg": rms(np.degrees(error.attitude[:, 2])),
    }


def _controller_summary(states: ControllerStates) -> Summary:
    stopped = np.isin(states.mode, _STOPPED_MODES)
    walking = states.mode == "walk"
    margin = states.static_margin[walking]
    return {
        "stopped": bool(stopped.any()),
        "stop_reason": str(states.reason[np.argmax(stopped)]) if stopped.any() else "",
        "static_margin_min_m": float(margin.min()) if len(margin) else float("nan"),
    }


def _torque_summary(joints: Joints, robot: Robot) -> Summary:
    """Torques of each joint group beside the ratings of gear or servo."""
    ratings = torque_ratings(robot)
    result: Summary = {f"{name}_Nm": value for name, value in ratings.items()}
    for group, torque in by_group(joints.torque).items():
        result[f"torque_rms_{group}_Nm"] = rms(torque)
        result[f"torque_peak_{group}_Nm"] = peak(torque)
        for name, value in ratings.items():
            share = f"torque_share_above_{name.removeprefix('gear_')}_{group}"
            result[share] = measures.share_above(torque, value)
    return result


def torque_ratings(robot: Robot) -> dict[str, float]:
    """Return the torques beside which those of the joints are judged [N m], by name."""
    if robot.actuation == BUS_SERVOS:
        return {"servo_limit": robot.bus_servo.torque_limit}
    return {
        "gear_rated": robot.gear_rated_torque,
        "gear_repeated": robot.gear_repeated_peak_torque,
        "gear_momentary": robot.gear_momentary_peak_torque,
    }


def _tracking_summary(recording: Recording, start: float, end: float) -> Summary:
    commands = recording.commands.between(start, end)
    positions = commands.mode_of_operation == _POSITION_MODE
    _, error = measures.tracking_error(
        commands.time[positions],
        commands.position[positions],
        recording.joints.time,
        recording.joints.position,
    )
    return {
        f"tracking_rms_{group}_deg": rms(np.degrees(values))
        for group, values in by_group(error).items()
    }


def _contact_summary(
    recording: Recording, robot: Robot, start: float, end: float, normal: Array
) -> Summary:
    contacts = recording.contacts.between(start, end)
    if len(contacts) < 2:
        return {}
    result: Summary = {
        f"contact_duty_{leg}": float(contacts.contact[:, i].mean())
        for i, leg in enumerate(robot.legs)
    }
    used = measures.friction_use(contacts.force, normal)
    if len(used):
        result["friction_use_p95"] = float(np.percentile(used, 95))
        result["friction_use_max"] = float(used.max())
    found = measures.steps(contacts, normal)
    result["steps"] = len(found)
    if found:
        slips = np.array([step.slip for step in found]) * 1e3
        result["slip_mean_mm"] = float(slips.mean())
        result["slip_max_mm"] = float(slips.max())
    if recording.has(graph.JOINT_COMMAND) and recording.has(graph.GROUND_TRUTH):
        placement = foot_placement_rms(recording, robot, start, end, normal)
        result["foot_placement_rms_mm"] = 1e3 * placement
    return result
