"""The summary of a run that was made up, against the numbers that it was made of."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot
from husky_experiments.metrics import walking as metrics
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, Contacts, JointCommands
from husky_runtime import graph

CONTROLLER_STATE = graph.absolute(graph.CONTROLLER_STATE)
JOINT_STATES = graph.absolute(graph.JOINT_STATES)

ROBOT = load_robot()


@pytest.fixture(scope="module")
def recording(walk_bag: Path) -> Recording:
    return Recording(walk_bag)


@pytest.fixture(scope="module")
def summary(recording: Recording, walk: Any) -> metrics.Summary:
    return metrics.summary(recording, ROBOT, walk.walking_from, walk.duration)


def test_body(summary: metrics.Summary, walk: Any) -> None:
    assert summary["duration_s"] == pytest.approx(2.0)
    assert summary["mean_speed"] == pytest.approx(walk.speed)
    assert summary["mean_lateral_speed"] == pytest.approx(0.0, abs=1e-9)
    assert summary["mean_yaw_rate_dps"] == pytest.approx(0.0, abs=1e-9)
    assert summary["distance_m"] == pytest.approx(2.0 * walk.speed)
    assert summary["drift_m"] == pytest.approx(2.0 * walk.speed)
    # a sine over whole periods, sampled at both ends: 200 of 201 samples carry it
    roll = np.degrees(walk.roll_amplitude) / np.sqrt(2.0) * np.sqrt(200 / 201)
    assert summary["roll_rms_deg"] == pytest.approx(roll)
    assert summary["pitch_rms_deg"] == pytest.approx(np.degrees(walk.pitch))
    tilt = np.degrees(np.arccos(np.cos(walk.pitch) * np.cos(walk.roll_amplitude)))
    assert summary["tilt_max_deg"] == pytest.approx(tilt)
    assert summary["height_mean_m"] == pytest.approx(walk.height)
    assert summary["height_error_rms_m"] == pytest.approx(walk.height_offset)
    assert summary["height_error_max_m"] == pytest.approx(walk.height_offset)
    assert summary["fallen"] is False
    assert summary["fall_time_s"] is None


def test_torques_beside_the_ratings(summary: metrics.Summary, walk: Any) -> None:
    for group, torque in zip(("hip_frontal", "hip_sagittal", "knee"), walk.torque, strict=True):
        assert summary[f"torque_rms_{group}_Nm"] == pytest.approx(torque)
        assert summary[f"torque_peak_{group}_Nm"] == pytest.approx(torque)
        for rating, limit in (
            ("rated", ROBOT.gear_rated_torque),
            ("repeated", ROBOT.gear_repeated_peak_torque),
            ("momentary", ROBOT.gear_momentary_peak_torque),
        ):
            assert summary[f"gear_{rating}_Nm"] == limit
            assert summary[f"torque_share_above_{rating}_{group}"] == float(torque > limit)


def test_tracking(summary: metrics.Summary, walk: Any) -> None:
    for group in ("hip_frontal", "hip_sagittal", "knee"):
        assert summary[f"tracking_rms_{group}_deg"] == pytest.approx(
            np.degrees(walk.tracking_error)
        )


def test_contacts(summary: metrics.Summary, walk: Any) -> None:
    # the last of 201 samples begins a new half period, which adds one to one diagonal pair
    assert summary["contact_duty_front_left"] == pytest.approx(101 / 201)
    assert summary["contact_duty_front_right"] == pytest.approx(100 / 201)
    use = walk.tangential_force / walk.normal_force
    assert summary["friction_use_p95"] == pytest.approx(use)
    assert summary["friction_use_max"] == pytest.approx(use)
    assert summary["steps"] == 2 * (4 + 5), "those that begin and end in the window"


def test_foot_placement_is_the_way_along_the_ground_to_what_the_joints_are_told() -> None:
    """A body that has turned, whose feet come down 3 and 4 mm off and too high."""
    turn, count = Rotation.from_euler("xyz", (0.1, -0.2, 0.7)), 11
    time, place = 0.01 * np.arange(count), np.array((1.0, 2.0, 0.5))
    asked = np.tile(ROBOT.stand_joint_position, (count, 1))
    feet = place + turn.apply(Kinematics(ROBOT).foot_positions(asked[0])) + (0.003, 0.004, 0.02)
    touching = (time > 0.035) & (time < 0.075)
    recording = SimpleNamespace(
        base=Base(
            time, np.tile(place, (count, 1)), np.tile(turn.as_quat(), (count, 1)), asked, asked
        ),
        commands=JointCommands(time, np.full(count, 8, np.uint8), asked, asked, asked),
        contacts=Contacts(
            time,
            np.tile(touching[:, None], (1, 4)),
            np.tile((0.0, 0.0, 20.0), (count, 4, 1)),
            np.tile(feet, (count, 1, 1)),
            np.zeros((count, 4)),
        ),
    )
    placement = metrics.foot_placement_rms(cast(Recording, recording), ROBOT, 0.0, 1.0)
    assert placement == pytest.approx(0.005)
    recording.commands.mode_of_operation[:] = 10
    assert np.isnan(metrics.foot_placement_rms(cast(Recording, recording), ROBOT, 0.0, 1.0))


def test_estimate(summary: metrics.Summary, walk: Any) -> None:
    assert summary["estimate_drift_m"] == pytest.approx(0.0, abs=1e-9), "a constant offset"
    assert summary["estimate_height_rms_m"] == pytest.approx(walk.estimate_offset[2])
    assert summary["estimate_velocity_rms_mps"] == pytest.approx(0.0, abs=1e-9)
    assert summary["estimate_tilt_rms_deg"] == pytest.approx(0.0, abs=1e-6)


def test_margin_counts_while_walking(recording: Recording) -> None:
    assert metrics.summary(recording, ROBOT)["static_margin_min_m"] == pytest.approx(0.02)
    assert metrics.summary(recording, ROBOT, 0.0, 0.9)["static_margin_min_m"] is None


def test_it_is_json(summary: metrics.Summary) -> None:
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_an_empty_window_gives_no_numbers(recording: Recording) -> None:
    summary = metrics.summary(recording, ROBOT, 50.0, 60.0)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["duration_s"] == 0.0
    assert "mean_speed" not in summary


def test_topics_that_are_not_there_are_left_out(
    tmp_path: Path, write_bag: Any, messages: Any
) -> None:
    zeros = np.zeros(12)
    content = [
        (JOINT_STATES, messages.joint_states(i * 2_000_000, zeros, zeros, zeros + 2.0))
        for i in range(10)
    ]
    write_bag(tmp_path / "bag", content)
    summary = metrics.summary(Recording(tmp_path / "bag"), ROBOT)
    assert summary["torque_rms_knee_Nm"] == pytest.approx(2.0)
    assert not [name for name in summary if not name.startswith(("torque", "gear"))]


def test_single_figures(recording: Recording, walk: Any) -> None:
    walked = metrics.summary(recording, ROBOT, 1.0, 3.0)
    assert walked["distance_m"] == pytest.approx(1.0)
    stood = metrics.summary(recording, ROBOT, 0.0, 1.0)
    assert stood["drift_m"] == pytest.approx(0.0, abs=1e-9)
    assert metrics.height_error(recording, 0.0, 3.0) == pytest.approx(walk.height_offset)


def test_a_stop_is_reported_with_its_reason(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    modes = [("walk", "walk requested")] * 3 + [("damping", "tilt 0.9 rad")] * 2
    content = [
        (
            CONTROLLER_STATE,
            messages.controller_state(i * 20_000_000, mode, reason=reason),
        )
        for i, (mode, reason) in enumerate(modes)
    ]
    write_bag(tmp_path / "bag", content)
    summary = metrics.summary(Recording(tmp_path / "bag"), ROBOT)
    assert (summary["stopped"], summary["stop_reason"]) == (True, "tilt 0.9 rad")


@pytest.mark.parametrize(
    ("height", "roll", "expected"), [(0.5, 0.1, False), (0.2, 0.0, True), (0.5, 1.2, True)]
)
def test_has_fallen(height: float, roll: float, expected: bool) -> None:
    x, y, z, w = Rotation.from_euler("x", roll).as_quat()
    pose = SimpleNamespace(
        position=SimpleNamespace(x=1.0, y=2.0, z=height),
        orientation=SimpleNamespace(x=x, y=y, z=z, w=w),
    )
    assert metrics.has_fallen(SimpleNamespace(pose=SimpleNamespace(pose=pose))) is expected
    assert metrics.has_fallen(None) is False


def test_husky_beta_is_judged_by_its_servos_and_its_own_height(recording: Recording) -> None:
    beta = load_robot("beta", bus_servo__torque_limit=3.0)
    summary = metrics.summary(recording, beta, 1.0, 3.0)
    assert summary["servo_limit_Nm"] == beta.bus_servo.torque_limit
    # 1, 3 and 6 N m were made, the limit is 3
    assert summary["torque_share_above_servo_limit_knee"] == 1.0
    assert summary["torque_share_above_servo_limit_hip_frontal"] == 0.0
    assert not [name for name in summary if name.startswith("gear")]
    sitting = beta.sit_height + beta.foot_radius
    assert metrics.lowest_upright(beta) < 0.95 * sitting, "one that sits has not fallen"
    assert metrics.lowest_upright(ROBOT) == pytest.approx(0.27, abs=0.01), "the default"
