"""Measures against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_experiments.metrics import measures
from husky_experiments.recordings.tables import Base, Contacts

TIME = np.linspace(0.0, 10.0, 1001)
ROBOT = load_robot()


def about_z(angle: np.ndarray) -> Rotation:
    return Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0]))


# Body -----------------------------------------------------------------------------------------
def test_rms_of_a_sine() -> None:
    whole_turns = np.sin(np.linspace(0.0, 8.0 * np.pi, 8000, endpoint=False))
    assert measures.rms(3.0 * whole_turns) == pytest.approx(3.0 / np.sqrt(2.0))
    assert np.isnan(measures.rms(np.zeros(0)))
    assert np.isnan(measures.peak(np.zeros(0)))


def test_speed_along_a_circle_is_forward() -> None:
    """On a circle of radius r the robot walks 2 pi r per turn and never sideways."""
    yaw = TIME * 0.4
    place = np.column_stack((2.0 * np.sin(yaw), 2.0 * (1.0 - np.cos(yaw)), 0.0 * yaw))
    forward, left = measures.mean_velocity_in_heading(TIME, place, yaw)
    assert forward == pytest.approx(0.8, rel=1e-5)
    assert left == pytest.approx(0.0, abs=1e-9)
    assert measures.mean_yaw_rate(TIME, yaw) == pytest.approx(0.4)


def test_sway_adds_nothing_to_speed() -> None:
    place = np.column_stack((0.5 * TIME, 0.05 * np.sin(2 * np.pi * TIME), 0 * TIME))
    forward, left = measures.mean_velocity_in_heading(TIME, place, np.zeros_like(TIME))
    assert (forward, left) == (pytest.approx(0.5), pytest.approx(0.0, abs=1e-12))


@given(st.floats(-np.pi, np.pi), st.floats(-2, 2), st.floats(-2, 2))
def test_heading_frame_turns_back(yaw: float, forward: float, left: float) -> None:
    turn = Rotation.from_euler("z", yaw)
    world = turn.apply([[forward, left, 0.3]])
    back = measures.in_heading(world, np.array([yaw]))
    assert np.allclose(back, [[forward, left, 0.3]], atol=1e-12)


def test_drift_is_the_farthest_and_distance_the_last() -> None:
    place = np.array([[1.0, 1, 0.5], [1.3, 1.4, 0.1], [1.0, 1.1, 9.0]])
    assert measures.drift(place) == pytest.approx(0.5)
    assert measures.distance(place) == pytest.approx(0.1)
    assert np.isnan(measures.drift(place[:0]))
    assert np.isnan(measures.distance(place[:0]))


def test_height_error() -> None:
    height = np.array([0.51, 0.49, 0.53])
    wanted = np.array([0.50, 0.50, 0.50])
    rms, peak = measures.height_error(height, wanted)
    assert rms == pytest.approx(np.sqrt((0.01**2 + 0.01**2 + 0.03**2) / 3))
    assert peak == pytest.approx(0.03)
    assert measures.height_error(height, 0.5) == (rms, peak)


@given(st.floats(0.0, np.pi), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi))
def test_tilt_does_not_depend_on_direction(angle: float, direction: float, yaw: float) -> None:
    lean = Rotation.from_rotvec(angle * np.array([np.cos(direction), np.sin(direction), 0.0]))
    orientation = (lean * Rotation.from_euler("z", yaw)).as_quat()
    # arccos loses half of the digits near its ends
    assert measures.tilt(orientation[None])[0] == pytest.approx(angle, abs=1e-7)


def test_tilt_to_a_slope() -> None:
    slope = Rotation.from_euler("y", -0.4)
    normal = slope.apply([0.0, 0.0, 1.0])
    assert measures.tilt(slope.as_quat()[None], normal)[0] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("height", "tilt", "upright", "expected"),
    [
        (0.5, 0.1, True, None),
        (0.2, 0.1, True, 3.0),
        (0.2, 0.1, False, None),  # it sits
        (0.5, 1.0, False, 3.0),  # on its side, whatever the mode
    ],
)
def test_fall(height: float, tilt: float, upright: bool, expected: float | None) -> None:
    late = TIME >= 3.0
    fall = measures.first_fall(
        TIME,
        np.where(late, height, 0.5),
        np.where(late, tilt, 0.0),
        np.full(len(TIME), upright),
        minimum_height=0.27,
    )
    assert fall == (None if expected is None else pytest.approx(expected))


def test_estimate_error_takes_the_truth_of_its_time() -> None:
    """Truth moves at 2 m/s and yaws at 0.5 rad/s; the estimate is off by known amounts."""
    yaw = 0.5 * TIME
    truth = Base(
        TIME,
        np.column_stack((2.0 * TIME, 0 * TIME, 0 * TIME)),
        about_z(yaw).as_quat(),
        np.tile([2.0, 0.0, 0.0], (len(TIME), 1)),
        np.zeros((len(TIME), 3)),
    )
    when = np.array([-0.1, 0.503, 4.0077, 10.1])  # between the samples of the truth
    lean = about_z(0.5 * when) * Rotation.from_rotvec([0.0, 0.02, 0.0])
    estimate = Base(
        when,
        np.column_stack((2.0 * when, 0 * when, 0.03 + 0 * when)),
        lean.as_quat(),
        np.tile([2.0, 0.1, 0.0], (4, 1)),
        np.zeros((4, 3)),
    )
    error = measures.estimate_error(truth, estimate)
    assert error.time.tolist() == [0.503, 4.0077]
    assert np.allclose(error.position, [[0, 0, 0.03]] * 2)
    assert np.allclose(error.velocity, [[0, 0.1, 0]] * 2)
    assert np.allclose(error.attitude, [[0, 0.02, 0]] * 2)


# Joints ---------------------------------------------------------------------------------------
def test_groups_are_every_third_joint() -> None:
    groups = measures.by_group(np.arange(24.0).reshape(2, 12))
    assert groups["hip_frontal"][0].tolist() == [0, 3, 6, 9]
    assert groups["hip_sagittal"][0].tolist() == [1, 4, 7, 10]
    assert groups["knee"][1].tolist() == [14, 17, 20, 23]


def test_share_above_counts_both_signs() -> None:
    ramp = np.linspace(-10.0, 10.0, 100_001)
    assert measures.share_above(ramp, 2.5) == pytest.approx(0.75, abs=1e-4)


def test_tracking_compares_with_the_end_of_the_tick() -> None:
    """A joint that is exactly where it was to be one tick after each command has no error."""
    ticks = np.arange(1000) * 0.002

    def course(time: np.ndarray) -> np.ndarray:
        return np.sin(5.0 * time)[:, None] * np.ones(12)

    time, error = measures.tracking_error(ticks, course(ticks + 0.002), ticks, course(ticks))
    assert len(time) == 999, "the last command has no measurement"
    assert np.allclose(error, 0.0, atol=1e-12)


def test_tracking_leaves_out_what_was_not_measured() -> None:
    ticks = np.arange(10) * 0.002
    seen = np.delete(ticks, [4, 5])
    time, error = measures.tracking_error(ticks, np.ones((10, 12)), seen, np.zeros((8, 12)))
    assert np.allclose(time, [0.002, 0.004, 0.006, 0.012, 0.014, 0.016, 0.018])
    assert np.allclose(error, 1.0)


# Feet -----------------------------------------------------------------------------------------
def test_friction_use_on_a_slope() -> None:
    """Weight on a slope of angle a uses tan(a), whatever the load."""
    angle = 0.35
    force = np.zeros((3, 4, 3))
    force[0, :, 2] = (20.0, 40.0, 2.0, 0.0)  # two loaded feet, two hardly or not
    normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    assert np.allclose(measures.friction_use(force, normal), [np.tan(angle)] * 2)
    assert np.allclose(measures.friction_use(force), [0.0, 0.0])


def stance(slid: np.ndarray, load: float = 40.0) -> Contacts:
    """One stance of leg 2 from 0.2 s to 0.6 s, and how far it has slid."""
    time = np.arange(len(slid)) * 0.01
    contact = np.zeros((len(time), 4), np.bool_)
    contact[20:61, 2] = True
    force = np.zeros((len(time), 4, 3))
    force[..., 2] = load * contact
    ways = np.zeros((len(time), 4))
    ways[:, 2] = slid
    return Contacts(time, contact, force, np.zeros((len(time), 4, 3)), ways)


def test_a_stance_slips_from_before_it_touches_until_it_has_left() -> None:
    """It slides as it lands, between two samples, all the time, and as it leaves."""
    slid = 0.05 * np.clip(np.arange(100) - 20, 0, 40) * 0.01
    slid[20:] += 0.003
    slid[61:] += 0.002
    (step,) = measures.steps(stance(1.0 + slid))
    assert step.slip == pytest.approx(0.05 * 0.4 + 0.003 + 0.002)
    assert (step.leg, step.start, step.end) == (2, pytest.approx(0.2), pytest.approx(0.6))


def test_a_touch_without_load_is_no_step() -> None:
    assert measures.steps(stance(np.zeros(100), load=2.0)) == []
    tilted = np.array([0.0, -1.0, 0.0])
    assert measures.steps(stance(np.zeros(100)), tilted) == []


def test_stances_cut_by_the_ends_are_not_counted() -> None:
    contacts = stance(np.zeros(100))
    assert len(measures.steps(contacts.between(0.0, 0.5))) == 0
    assert len(measures.steps(contacts.between(0.3, 0.99))) == 0
    assert len(measures.steps(contacts.between(0.19, 0.61))) == 1


@given(
    st.lists(st.floats(0, 10), min_size=2, max_size=30, unique=True).map(sorted),
    st.floats(-1, 11),
)
def test_nearest(times: list[float], wanted: float) -> None:
    time = np.array(times)
    found = measures.nearest(time, np.array([wanted]))[0]
    assert abs(time[found] - wanted) == pytest.approx(np.abs(time - wanted).min(), abs=1e-12)
