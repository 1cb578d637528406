"""The T265's axes against SciPy's rotations, and which frames pass the gate."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.rotation import multiply, rotate
from husky_drivers.t265.frames import (
    PoseFrame,
    base_pose,
    covariance,
    odometry,
    rotation_from_ros,
    vector_from_ros,
)
from husky_drivers.t265.gate import JumpLimits, PoseGate

AXES = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Columns: right, up and backward in ROS axes."""
REST = PoseFrame(
    0, 0.0, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (0.0,) * 3, (0.0,) * 3, 3, 3
)
PERIOD_MS = 5.0

numbers = st.floats(-10.0, 10.0)
vectors = st.tuples(numbers, numbers, numbers)
rotations = st.integers(0, 2**31).map(
    lambda seed: tuple(Rotation.random(random_state=seed).as_quat().tolist())
)


def frame(number, **changes):
    return REST._replace(number=number, time_ms=PERIOD_MS * number, **changes)


# Axes -------------------------------------------------------------------------------------------
@given(rotations, vectors, vectors, vectors)
def test_pose_and_twist_are_the_wrappers(rotation, translation, velocity, angular_velocity):
    pose, twist = odometry(
        REST._replace(
            rotation=rotation,
            translation=translation,
            velocity=velocity,
            angular_velocity=angular_velocity,
        )
    )
    attitude = AXES @ Rotation.from_quat(rotation).as_matrix() @ AXES.T
    assert pose[:3] == pytest.approx(AXES @ translation, abs=1e-9)
    assert Rotation.from_quat(pose[3:]).as_matrix() == pytest.approx(attitude, abs=1e-9)
    assert twist[:3] == pytest.approx(attitude.T @ AXES @ velocity, abs=1e-9)
    assert twist[3:] == pytest.approx(attitude.T @ AXES @ angular_velocity, abs=1e-9)
    x, y, z = translation
    qx, qy, qz, qw = rotation
    assert pose == (-z, -x, y, -qz, -qx, qy, qw)


@pytest.mark.parametrize(
    ("camera", "ros"), [("right", (0, -1, 0)), ("up", (0, 0, 1)), ("backward", (-1, 0, 0))]
)
def test_axes_are_where_the_maker_says(camera, ros):
    axis = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "backward": (0.0, 0.0, 1.0)}[camera]
    assert vector_from_ros(ros) == axis
    # Turning about an axis of the camera is turning about the same axis under its ROS name.
    turned = rotation_from_ros(tuple(Rotation.from_rotvec(0.3 * np.array(ros)).as_quat()))
    assert Rotation.from_quat(turned).as_rotvec() == pytest.approx(0.3 * np.array(axis))


@given(rotations, vectors)
def test_from_ros_is_the_way_back(rotation, vector):
    assert tuple(AXES @ vector_from_ros(vector)) == vector
    attitude = Rotation.from_quat(rotation_from_ros(rotation)).as_matrix()
    expected = Rotation.from_quat(rotation).as_matrix()
    assert pytest.approx(expected, abs=1e-12) == AXES @ attitude @ AXES.T


@given(rotations, rotations, vectors)
def test_quaternions_are_scipys(a, b, vector):
    product = Rotation.from_quat(a) * Rotation.from_quat(b)
    assert Rotation.from_quat(multiply(a, b)).as_matrix() == pytest.approx(product.as_matrix())
    assert rotate(a, vector) == pytest.approx(Rotation.from_quat(a).apply(vector), abs=1e-9)


@given(rotations, vectors, rotations, vectors)
def test_base_is_where_its_camera_puts_it(attitude, position, mount_rotation, mount):
    """Independent check: homogeneous matrices."""

    def matrix(rotation, translation):
        result = np.eye(4)
        result[:3, :3], result[:3, 3] = Rotation.from_quat(rotation).as_matrix(), translation
        return result

    x = base_pose((*position, *attitude), mount, mount_rotation)
    camera = matrix(x[3:], x[:3]) @ matrix(mount_rotation, mount)
    assert camera == pytest.approx(matrix(attitude, position), abs=1e-8)


@pytest.mark.parametrize("confidence", [0, 1, 2, 3])
def test_covariance_grows_as_confidence_falls(confidence):
    matrix = np.reshape(covariance(confidence, 0.01, 0.02), (6, 6))
    expected = [0.01 * 10 ** (3 - confidence)] * 3 + [0.02 * 10 ** (1 - confidence)] * 3
    assert matrix == pytest.approx(np.diag(expected))


# Gate -------------------------------------------------------------------------------------------
def feed(gate, frames):
    return [gate.accept(item) for item in frames]


def test_motion_is_no_jump():
    """Half a metre to and fro at 3 Hz with 177 m/s^2 at its ends, and a turn of 10 rad/s."""
    gate = PoseGate()
    omega = 6.0 * math.pi
    for number in range(400):
        phase = omega * 0.005 * number
        assert gate.accept(
            frame(
                number,
                translation=(0.5 * math.sin(phase), 0.0, 0.0),
                velocity=(0.5 * omega * math.cos(phase), 0.0, 0.0),
                rotation=(0.0, math.sin(0.025 * number), 0.0, math.cos(0.025 * number)),
                angular_velocity=(0.0, 10.0, 0.0),
            )
        )
    assert gate.counters.jumps == 0
    assert gate.counters.good == 400


@pytest.mark.parametrize("offset", [0.049, 0.051, 2.0])
def test_a_jump_is_counted_once_with_its_size(offset):
    gate = PoseGate(JumpLimits(distance=0.05, acceleration=0.0))
    velocity = (1.0, 0.0, 0.0)
    for number in range(20):
        x = 0.005 * number + (offset if number >= 10 else 0.0)
        assert gate.accept(frame(number, translation=(x, 0.0, 0.0), velocity=velocity))
    assert gate.counters.jumps == (1 if offset > 0.05 else 0)
    assert gate.last_jump == pytest.approx(offset if offset > 0.05 else 0.0)


def test_a_turn_that_the_rate_does_not_explain_is_a_jump():
    gate = PoseGate()
    feed(gate, [frame(0), frame(1, rotation=(0.0, math.sin(0.1), 0.0, math.cos(0.1)))])
    assert gate.counters.jumps == 1
    assert gate.last_jump == pytest.approx(0.2)


def test_after_a_gap_motion_may_have_been_another_but_no_leap():
    for gap, distance, jumps in ((20, 0.14, 0), (20, 0.16, 1), (200, 1.04, 0), (200, 1.06, 1)):
        gate = PoseGate()
        feed(gate, [frame(0), frame(gap, translation=(distance, 0.0, 0.0))])
        assert (gate.counters.jumps, gate.counters.missed) == (jumps, gap - 1)


def test_repeats_and_restarts():
    gate = PoseGate()
    assert feed(gate, [frame(100), frame(100), frame(101)]) == [True, False, True]
    assert feed(gate, [frame(0, translation=(5.0, 0.0, 0.0)), frame(1)]) == [True, True]
    counters = gate.counters
    assert (counters.repeated, counters.clock_restarts, counters.good) == (1, 1, 4)
    assert (counters.missed, counters.jumps) == (0, 1)  # The way back from 5 m, not the restart.


def test_frames_that_come_once_more_are_no_restart():
    """Where the camera has been a while ago it is not now."""
    gate = PoseGate()
    frames = [frame(n, translation=(0.02 * n, 0.0, 0.0), velocity=(4.0, 0, 0)) for n in range(90)]
    assert all(feed(gate, frames[:60]))
    assert not any(feed(gate, frames[45:60]))
    assert feed(gate, [frames[60], frames[40], frames[61], frames[41]]) == [True, False] * 2
    counters = gate.counters
    assert (counters.repeated, counters.clock_restarts, counters.jumps) == (17, 0, 0)


def test_lost_tracking_is_counted_as_it_begins():
    gate = PoseGate()
    feed(gate, [frame(n, tracker_confidence=c) for n, c in enumerate((0, 0, 1, 3, 0, 0, 2))])
    assert gate.counters.lost == 2
    assert gate.confidence == 2


@pytest.mark.parametrize(
    "changes",
    [
        {"rotation": (0.0, 0.0, 0.0, 0.9)},
        {"rotation": (math.nan, 0.0, 0.0, 1.0)},
        {"translation": (math.inf, 0.0, 0.0)},
        {"velocity": (0.0, math.nan, 0.0)},
        {"velocity": (0.0, -150.0, 0.0)},
        {"angular_velocity": (0.0, 0.0, 1e9)},
        {"tracker_confidence": 4},
    ],
)
def test_nonsense_is_dropped_and_leaves_no_trace(changes):
    gate = PoseGate()
    assert feed(gate, [frame(0), frame(1, **changes), frame(2)]) == [True, False, True]
    assert (gate.counters.invalid, gate.counters.jumps) == (1, 0)


anything = st.floats(allow_nan=True, allow_infinity=True, width=32)


@given(
    st.lists(
        st.builds(
            PoseFrame,
            st.integers(0, 2**32 - 1),
            st.one_of(st.floats(), st.integers(0, 50).map(float)),
            st.tuples(anything, anything, anything),
            st.just((0.0, 0.0, 0.0)),
            st.just((0.0, 0.0, 0.0)),
            st.one_of(rotations, st.tuples(anything, anything, anything, anything)),
            st.tuples(anything, anything, anything),
            st.just((0.0, 0.0, 0.0)),
            st.integers(0, 5),
            st.integers(0, 5),
        ),
        max_size=20,
    )
)
def test_whatever_comes_is_counted_and_what_passes_can_be_published(frames):
    gate = PoseGate()
    passed = [item for item in frames if gate.accept(item)]
    counters = gate.counters
    assert counters.good == len(passed)
    assert counters.good + counters.repeated + counters.invalid == len(frames)
    assert all(a.time_ms != b.time_ms for a, b in itertools.pairwise(passed))
    for item in passed:
        assert item.time_ns >= 0
        assert np.all(np.isfinite(odometry(item)[0]))
        assert np.all(np.isfinite(odometry(item)[1]))
    assert all(value >= 0 for value in dataclasses.asdict(counters).values())
