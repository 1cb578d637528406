"""The localizer: accuracy, delay, odometry that starts anew, bad input, geometry."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localized_walk import LEGS_ONLY, LOOP, PARAMETERS, QUIET, SHORT, Walk, run, short
from scipy.spatial.transform import Rotation

from husky_description.rotation import about_z, from_roll_pitch_yaw, multiply
from husky_navigation.frame_filter import LevelTransform, heading_between
from husky_navigation.localizer_parameters import LocalizerParameters
from husky_navigation.map_frame import MapFrame


# Accuracy ---------------------------------------------------------------------------------------
def test_without_a_t265_map_is_odom_and_its_deviation_grows():
    walk = Walk()
    trial = run(walk, tracking=False)
    assert set(trial.states) == {LEGS_ONLY}
    assert not trial.odom.any()
    # Steps on a circle of the wrong radius do not close: the chord that is left, in closed form.
    turn = 2.0 * math.pi / LOOP + walk.heading
    own = (1.0 + walk.scale) * 2.0 * math.sin(0.5 * walk.heading * LOOP) / turn
    assert trial.distance[-1] == pytest.approx(own, abs=0.01)  # the noise of odometry
    assert trial.yaw_error[-1] == pytest.approx(walk.heading * LOOP)
    deviation = np.hypot(*trial.deviation[:2])
    assert 0.3 * own < deviation < 3.0 * own


def test_loop_of_50_m_ends_within_half_a_percent():
    """Legs alone end 0.79 m off. The T265 alone would end up to 0.4 m off, 0.1 m in the mean."""
    trial = run(Walk())
    assert trial.distance.max() <= 0.005 * LOOP
    assert abs(trial.yaw_error).max() < 0.02  # legs alone 0.1
    assert trial.distance[-1] < 3.0 * np.hypot(*trial.deviation[:2])
    assert 0.05 < np.hypot(*trial.deviation[:2]) < 0.01 * LOOP
    assert trial.counts == {}
    assert trial.map_frame.counters.fused == pytest.approx(20 * LOOP, rel=0.02)


def test_base_takes_the_share_of_the_less_drift():
    """A T265 without error; of what legs do wrong the filter leaves the share of its drift."""
    walk = Walk(distance=10.0, turn_rate=0.0, heading=0.0, tracking=0.0)
    trial = run(walk)
    p = PARAMETERS
    legs = p.leg_drift_length * p.leg_drift**2
    share = legs / (legs + p.tracking_drift_length * p.tracking_drift**2)
    start, end = trial.error[[125, -1], 0]  # from when the T265 is sure of itself, at 2 s
    own = walk.scale * (walk.distance - 2.5)
    assert end - start == pytest.approx((1.0 - share) * own, abs=3e-3)  # the noise


def test_covariance_on_a_line_is_that_of_two_random_walks():
    map_frame = MapFrame()
    for k in range(1001):
        map_frame.add_odometry(20_000_000 * k, (0.02 * k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    p, s = PARAMETERS, 20.0
    growth = 2.0 * p.leg_drift_length * p.leg_drift**2
    turn = p.leg_heading_drift**2 + p.leg_rest_drift**2  # at 1 m/s
    covariance = map_frame.covariance
    assert covariance[0, 0] == pytest.approx(growth * s, rel=1e-3)
    assert covariance[1, 1] == pytest.approx(growth * s + turn * s**3 / 3.0, rel=5e-3)
    assert covariance[1, 3] == pytest.approx(turn * s**2 / 2.0, rel=5e-3)
    assert covariance[3, 3] == pytest.approx(turn * s, rel=1e-3)


# Delay ------------------------------------------------------------------------------------------
TURNING = Walk(1.2, 0.3, 0.0, 1.0, rest=2.0, latency=0.0, jitter=0.03, scale=0.0, heading=0.0)


def test_delay_adds_no_error_at_turns_of_1_rad_per_s():
    prompt, late = run(TURNING), run(replace(TURNING, latency=0.1))
    assert late.counts == prompt.counts == {}
    assert late.map_frame.counters.tracking > 0.98 * 200 * 6  # the last 0.1 s have not come
    # 1.2 m by legs without error: noise, and the drift of the T265, 0.3 % of it.
    assert abs(late.yaw_error).max() < abs(prompt.yaw_error).max() + 1e-3 < 6e-3
    assert late.distance.max() < prompt.distance.max() + 1e-3 < 0.012


def test_delay_that_is_not_compensated_turns_the_base():
    """The same with the stamp of arrival, and a filter that believes the T265 of all turns.

    At 1 rad/s 0.1 s are 0.1 rad.
    """
    late = replace(TURNING, latency=0.1, jitter=0.0)
    open_gates = replace(
        PARAMETERS, jump_distance=1.0, jump_angle=1.0, gate=20.0, leg_turn_drift=0.1
    )
    compensated = run(late, parameters=open_gates)
    trial = run(late, stamped_late=0.1, parameters=open_gates)
    assert abs(compensated.yaw_error).max() < 6e-3
    assert abs(trial.yaw_error).max() == pytest.approx(0.1, abs=0.02)


# Odometry that starts anew ----------------------------------------------------------------------
def restart(frames, legs):
    """Let odom lie elsewhere from 5 s on."""
    position, rotation = legs
    odom = LevelTransform(1.0, -2.0, 0.3, 0.9)
    for k in range(250, len(position)):
        position[k] = odom.apply(position[k].tolist())
        rotation[k] = multiply(odom.rotation, rotation[k].tolist())


@pytest.mark.parametrize("tracking", [True, False])
def test_base_stays_in_map_where_odometry_starts_anew(tracking):
    trial = run(SHORT, restart, tracking=tracking)
    assert trial.counts == {"odometry_restarts": 1}
    assert "odometry starts anew: it stepped by" in trial.said[-1]
    # The way of one step, 2 cm, is not known; the T265 gives it back.
    assert trial.step(4.9, 6.0) < 0.02 + QUIET
    if tracking:
        assert np.linalg.norm(trial.error[-1] - short().error[-1]) < 3e-3
    else:
        other = run(SHORT, tracking=False)
        assert np.linalg.norm(trial.error[-1] - other.error[-1]) < 0.03


def test_t265_that_comes_late_is_compared_with_the_odometry_before_its_restart():
    trial = run(replace(SHORT, latency=0.3, jitter=0.0), restart)
    assert trial.counts == {"odometry_restarts": 1}
    assert np.linalg.norm(trial.error[-1] - short().error[-1]) < 0.01


def test_cleared_localizer_begins_anew():
    map_frame = run(replace(SHORT, distance=2.0)).map_frame
    assert any(map_frame.map_to_odom)
    map_frame.clear()
    assert map_frame.map_to_odom == LevelTransform()
    assert map_frame.state is LEGS_ONLY
    assert map_frame.base_in_map is None
    assert not map_frame.covariance.any()
    assert map_frame.counters.fused > 0
    assert map_frame.add_odometry(0, (3.0, 1.0, 0.5), (0.0, 0.0, 0.0, 1.0))
    assert map_frame.base_in_map == ((3.0, 1.0, 0.5), (0.0, 0.0, 0.0, 1.0))


# Bad input --------------------------------------------------------------------------------------
GOOD = (10**9, (0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("index", "value", "message"),
    [
        (0, 1.5, "stamp is 1.5, it must be whole nanoseconds"),
        (0, -1, "stamp is -1"),
        (1, (0.0, math.nan, 0.0), "position is 0.0, nan, 0.0, it must be finite"),
        (1, (0.0, 0.0, 1e7), "position is 0.0, 0.0, 10000000.0"),
        (1, (0.0, 0.0), "they must have 3 and 4"),
        (2, (0.0, 0.0, 0.0, 0.9), "rotation is 0.0, 0.0, 0.0, 0.9, it must be a unit quaternion"),
        (2, (0.0, 0.0, math.inf, 1.0), "rotation is 0.0, 0.0, inf"),
        (3, 4, "confidence is 4, it must be 0, 1, 2 or 3"),
    ],
)
def test_bad_numbers_are_named(index, value, message):
    map_frame = MapFrame()
    map_frame.add_odometry(*GOOD)
    pose = [*GOOD, 3]
    pose[index] = value
    with pytest.raises(ValueError, match=f"tracking: .*{message}"):
        map_frame.add_tracking(*pose)
    if index < 3:
        with pytest.raises(ValueError, match=f"odometry: .*{message}"):
            map_frame.add_odometry(*pose[:3])
    assert map_frame.add_tracking(*GOOD, 3)


def test_bad_stamps_are_refused_and_counted():
    map_frame, (stamp, *pose) = MapFrame(), GOOD
    period, counters = 20_000_000, map_frame.counters
    assert not map_frame.add_tracking(stamp, *pose, 3)  # before odometry
    for k in range(150):
        assert map_frame.add_odometry(stamp + k * period, *pose)
    newest = stamp + 149 * period
    assert not map_frame.add_odometry(newest, *pose)
    assert not map_frame.add_odometry(newest - 1, *pose)
    assert map_frame.add_tracking(newest - 2_100_000_000, *pose, 3)  # 100 poses are kept: 2 s
    assert not map_frame.add_tracking(newest - 2_100_000_000, *pose, 3)
    assert not map_frame.add_tracking(newest - 2_200_000_000, *pose, 3)
    assert not map_frame.add_tracking(newest + 1_000_000_001, *pose, 3)
    assert map_frame.add_tracking(newest + period, *pose, 3)  # waits
    assert counters.tracking == 0
    assert map_frame.add_odometry(newest + 15 * period, *pose)  # a gap of 0.3 s
    assert counters.tracking == 0
    assert vars(counters) == vars(type(counters)()) | {
        "odometry": 151,
        "odometry_refused": 2,
        "late": 1,
        "refused": 2,
        "ahead": 1,
        "unmatched": 2,
    }


def test_bad_parameter_is_named():
    with pytest.raises(ValueError, match="gate: nan"):
        LocalizerParameters(gate=math.nan)
    with pytest.raises(ValueError, match=r"loop_distance: 2\.0 is not above twice place_radius"):
        LocalizerParameters(loop_distance=2.0)


@given(st.integers(0, 2**32))
@settings(max_examples=6, deadline=None)
def test_whatever_comes_the_base_does_not_jump(seed):
    """Faults of all kinds at random while odometry is good: the base stays near it.

    The T265 may correct what legs can have done wrong, a relocalisation apart: it needs a place of
    5 m ago, and the robot walks 3 m.
    """
    random, map_frame = np.random.default_rng(seed), MapFrame()
    offset, before, stuck = np.zeros(3), np.zeros(3), None
    for k in range(150):
        place = np.array([0.02 * k, 0.0, 0.5])
        map_frame.add_odometry(20_000_000 * k, place, about_z(0.0))
        for i in range(4):
            fault = random.integers(60)
            if fault == 0:
                offset = random.normal(0.0, 1.0, 3)
            elif fault == 1:
                stuck = place + offset if stuck is None else None
            seen = place + offset if stuck is None else stuck
            stamp = 20_000_000 * k + 5_000_000 * i - int(random.integers(200_000_000))
            confidence = int(random.choice([0, 1, 3, 3, 3, 3]))
            map_frame.add_tracking(max(0, stamp), seen, about_z(0.1), confidence)
        base = np.array(map_frame.base_in_map[0]) - place
        assert np.linalg.norm(base - before) < 0.05
        before = base
        if k % 10 == 0:
            assert np.linalg.eigvalsh(map_frame.covariance).min() > -1e-12
    assert np.linalg.norm(before) < 0.3


# Geometry ---------------------------------------------------------------------------------------
def test_level_transform_is_a_turn_about_z_and_a_shift():
    frame = LevelTransform(1.0, 2.0, 3.0, 0.4)
    expected = Rotation.from_euler("z", 0.4).apply([0.5, -0.3, 0.2]) + [1.0, 2.0, 3.0]
    assert frame.apply((0.5, -0.3, 0.2)) == pytest.approx(expected)
    same = LevelTransform.through((0.5, -0.3, 0.2), tuple(expected), 0.4 + 4.0 * math.pi)
    assert same == pytest.approx(frame)


@given(st.tuples(*[st.floats(-3.1, 3.1)] * 4))
@settings(max_examples=30)
def test_heading_between_frames_does_not_depend_on_the_tilt(angles):
    """Of a body that lies at any roll and pitch in a frame that is turned by the fourth angle."""
    body = from_roll_pitch_yaw(*angles[:3])
    turned = multiply(about_z(angles[3]), body)
    assert heading_between(turned, body) == pytest.approx(angles[3], abs=1e-9)
