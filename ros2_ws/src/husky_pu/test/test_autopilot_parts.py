"""Parts of the autopilot, each against something independent."""

import itertools
import math
import socket
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_description.rotation import from_roll_pitch_yaw, multiply, tilt_of, to_roll_pitch_yaw
from husky_pu.autopilot.arming import refusals
from husky_pu.autopilot.attitude_control import ControlGains, RateControl, rate_demand
from husky_pu.autopilot.attitude_estimator import (
    AttitudeEstimator,
    EstimatorWeights,
)
from husky_pu.autopilot.autopilot import Autopilot, SensorSample
from husky_pu.autopilot.battery import BatteryLevel, BatteryMonitor
from husky_pu.autopilot.failsafes import Cause, FlightMode, FlightSituation, Reaction, judge
from husky_pu.autopilot.flight_parameters import (
    TABLE,
    FlightParameters,
    ParameterError,
    read_overrides,
)
from husky_pu.autopilot.imu import AutopilotImu, ImuErrors
from husky_pu.autopilot.mavlink_ports import UdpPort, parse_address
from husky_pu.autopilot.mixer import Mixer
from husky_pu.autopilot.pace import FramePace
from husky_pu.autopilot.rc import Source, StickInput
from husky_pu.autopilot.setpoints import AttitudeSetpoint, SetpointStream
from husky_pu.autopilot.state import Motion

MIXER = Mixer(load_robot())
NED_FIELD = np.array([0.21, 0.03, 0.43])
angle = st.floats(-1.4, 1.4)
heading = st.floats(-3.1, 3.1)


# Attitude ---------------------------------------------------------------------------------------
@given(angle, angle, heading)
def test_euler_angles_are_those_of_scipy(roll, pitch, yaw):
    mine = np.array(from_roll_pitch_yaw(roll, pitch, yaw))
    theirs = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()
    assert abs(mine @ theirs) == pytest.approx(1.0, abs=1e-12)
    assert to_roll_pitch_yaw(tuple(mine)) == pytest.approx((roll, pitch, yaw), abs=1e-9)
    down = Rotation.from_quat(mine).apply([0, 0, 1])
    assert math.cos(tilt_of(tuple(mine))) == pytest.approx(down[2], abs=1e-9)


def measured(rotation, field=NED_FIELD):
    """Accelerometer and magnetometer of a unit at rest."""
    turn = rotation.inv()
    return tuple(turn.apply([0.0, 0.0, -9.81])), tuple(turn.apply(field))


@settings(max_examples=40)
@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), heading)
def test_first_attitude(roll, pitch, yaw):
    rotation = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    accel, mag = measured(rotation, np.array([0.21, 0.0, 0.43]))
    estimator = AttitudeEstimator()
    for _ in range(51):
        estimator.update((0.0, 0.0, 0.0), accel, mag, 0.002)
    assert estimator.aligned
    error = Rotation.from_quat(estimator.attitude).inv() * rotation
    assert error.magnitude() < 1e-6


@pytest.mark.parametrize(
    "euler",
    [
        (0.2, 0.3, 1.0),
        *(pytest.param(alone, marks=pytest.mark.slow) for alone in ((0.5, 0, 0), (0, -0.4, 0))),
    ],
)
def test_a_wrong_attitude_converges(euler):
    """The time constants are the weights: 5 s for the tilt, 10 s for the heading."""
    truth = Rotation.from_euler("ZYX", [0.7, 0.1, -0.2])
    accel, mag = measured(truth)
    weights = EstimatorWeights(gyro_bias=0.0, declination=math.atan2(0.03, 0.21))
    estimator = AttitudeEstimator(weights)
    estimator.aligned = True
    estimator.attitude = tuple((truth * Rotation.from_euler("xyz", euler)).as_quat())
    start = (Rotation.from_quat(estimator.attitude).inv() * truth).magnitude()
    for _ in range(20000):
        estimator.update((0.0, 0.0, 0.0), accel, mag, 0.002)
    left = (Rotation.from_quat(estimator.attitude).inv() * truth).magnitude()
    assert left < start * 2.0 * math.exp(-40.0 * 0.1)


def test_rotation_is_integrated():
    """A coning motion against SciPy's product of rotations; no accelerometer, no compass."""
    estimator = AttitudeEstimator(EstimatorWeights(accel=0.0, mag=0.0, gyro_bias=0.0))
    estimator.aligned = True
    truth = Rotation.identity()
    for tick in range(2500):
        rates = np.array([math.sin(0.01 * tick), math.cos(0.013 * tick), 0.5])
        truth = truth * Rotation.from_rotvec(0.002 * rates)
        estimator.update(tuple(rates), (0.0, 0.0, -9.81), (0.0, 0.0, 0.0), 0.002)
    error = Rotation.from_quat(estimator.attitude).inv() * truth
    assert error.magnitude() < 1e-3  # of first order in the step


@pytest.mark.parametrize(("at_rest", "seconds"), [(True, 3), (False, 120)])
def test_the_gyros_bias_is_learnt(at_rest, seconds):
    bias = (0.01, -0.02, 0.015)
    accel, mag = measured(Rotation.identity(), np.array([0.21, 0.0, 0.43]))
    estimator = AttitudeEstimator()
    for _ in range(seconds * 500):
        estimator.update(bias, accel, mag, 0.002, at_rest=at_rest)
    assert estimator.gyro_bias == pytest.approx(bias, abs=2e-3)
    assert estimator.rates == pytest.approx((0.0, 0.0, 0.0), abs=2e-3)


def test_at_rest_level_is_found_within_two_seconds():
    truth = Rotation.from_euler("ZYX", [0.7, 0.1, -0.2])
    accel, mag = measured(truth)
    estimator = AttitudeEstimator()
    estimator.aligned = True
    estimator.attitude = tuple((truth * Rotation.from_euler("xyz", (0.05, -0.03, 0.0))).as_quat())
    for _ in range(1000):
        estimator.update((0.0, 0.0, 0.0), accel, mag, 0.002, at_rest=True)
    down = Rotation.from_quat(estimator.attitude).inv().apply([0.0, 0.0, 1.0])
    assert np.linalg.norm(np.cross(down, truth.inv().apply([0.0, 0.0, 1.0]))) < 2e-3


def test_strides_do_not_tilt_what_is_level():
    """Each step pushes ahead while it carries more, and brakes while it carries less.

    Judged sample by sample only the longer, lighter phase would count, and level be 3.2 deg off.
    """
    estimator = AttitudeEstimator(EstimatorWeights(gyro_bias=0.0))
    for tick in range(30000):
        heavy = tick > 100 and tick % 90 < 30
        ahead, up = (1.0, 11.41) if heavy else (-0.5, 9.01)
        accel = (ahead, 0.0, -up) if tick > 100 else (0.0, 0.0, -9.81)
        estimator.update((0.0, 0.0, 0.0), accel, (0.0, 0.0, 0.0), 0.002)
    assert tilt_of(estimator.attitude) < math.radians(0.3)


def test_imu_errors_have_their_size_and_seed():
    errors = ImuErrors()
    still = SensorSample(0, (0, 0, 0), (0, 0, -9.81), (0.2, 0, 0.4), 1e5, 25.0, 0.0)

    def record(seed, count=5000):
        imu = AutopilotImu(errors, seed)
        return np.array([imu.measure(still).angular_velocity for _ in range(count)])

    one = record(1)
    assert np.array_equal(one, record(1))
    assert not np.array_equal(one, record(2))
    assert one.std(axis=0) == pytest.approx(errors.gyro_density * math.sqrt(250.0), rel=0.05)
    biases = np.array([record(seed, 50).mean(axis=0) for seed in range(60)])
    assert biases.std() == pytest.approx(errors.gyro_bias, rel=0.2)


# Control ----------------------------------------------------------------------------------------
GAINS = ControlGains(
    attitude=(4.0, 4.0, 1.5),
    yaw_weight=0.4,
    rate_limit=(9.0, 9.0, 9.0),
    proportional=(0.1, 0.1, 0.1),
    integral=(0.1, 0.1, 0.1),
    derivative=(0.0, 0.0, 0.0),
    integral_limit=(0.3, 0.3, 0.3),
    cutoff=30.0,
)


@given(
    angle, angle, heading, st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)
)
def test_small_errors_ask_for_gain_times_error(roll, pitch, yaw, ex, ey, ez):
    attitude = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    desired = attitude * Rotation.from_rotvec([ex, ey, ez])
    demand = rate_demand(tuple(attitude.as_quat()), tuple(desired.as_quat()), GAINS)
    assert demand == pytest.approx((4.0 * ex, 4.0 * ey, 1.5 * ez), abs=0.02)


@settings(max_examples=60)
@given(angle, angle, heading, angle, angle, heading)
def test_attitude_law_converges_from_anywhere(a, b, c, d, e, f):
    """The rates themselves carry every attitude to the desired one, tilt first."""
    q, goal = from_roll_pitch_yaw(a, b, c), from_roll_pitch_yaw(d, e, f)
    for _ in range(1500):
        x, y, z = (0.0025 * rate for rate in rate_demand(q, goal, GAINS))
        w = math.sqrt(1.0 - x * x - y * y - z * z)  # SciPy's rotations took most of the time
        q = multiply(q, (x, y, z, w))
    assert (Rotation.from_quat(q).inv() * Rotation.from_quat(goal)).magnitude() < 0.02


def test_integral_stops_at_saturation_and_at_its_limit():
    control = RateControl()
    for _ in range(5000):
        control.update((0, 0, 0), (100.0, 1.0, 0.0), GAINS, 0.002, integrate=True)
    assert control.integral[0] == 0.0  # the moment is full without it
    assert control.integral[1] == pytest.approx(0.3)
    moments = control.update((0, 0, 0), (100.0, 1.0, 0.0), GAINS, 0.002, integrate=False)
    assert moments == pytest.approx((1.0, 0.4, 0.0))


def test_the_short_way_through_the_mixer_is_the_mixers(monkeypatch):
    """Where nothing has to give way the matrix alone must say what the allocation says."""
    autopilot = Autopilot(MIXER)
    logic = autopilot.vehicle.logic
    logic.armed = True
    generator = np.random.default_rng(0)
    short = 0
    for _ in range(300):
        logic.thrust = generator.uniform(0.0, 1.0)
        logic.moments = tuple(generator.uniform(-0.3, 0.3, 3))
        autopilot._voltage = generator.uniform(19.0, 25.0)
        x, y, z = np.array(logic.moments) * MIXER.moment_scale * [1, -1, -1]
        thrusts = MIXER.allocate(80.0 * logic.thrust, (x, y, z), autopilot._voltage, rise=0.0)
        collective, moment = MIXER.wrench(thrusts)
        short += np.allclose([collective, *moment], [80.0 * logic.thrust, x, y, z])
        expected = MIXER.pulses(thrusts, autopilot._voltage)
        assert np.abs(np.array(autopilot._mix()) - expected).max() <= 1  # of rounding
    assert 50 < short < 300


# Setpoints, sticks, battery -----------------------------------------------------------------------
def test_stream_needs_two_hertz():
    stream = SetpointStream()
    setpoint = AttitudeSetpoint(0, 0.1, attitude=(0, 0, 0, 1))
    assert not stream.alive(0.0)
    stream.accept(setpoint, "a", 0.0)
    assert not stream.alive(0.0)
    stream.accept(setpoint, "a", 0.5)
    assert stream.alive(0.5) and stream.alive(1.0) and not stream.alive(1.01)
    stream.accept(setpoint, "a", 1.2)
    assert not stream.alive(1.2)


CENTRED = [1500.0] * 16


def pulses(**channels):
    values = list(CENTRED)
    values[2] = 1000.0
    for name, pulse in channels.items():
        values[int(name[1:]) - 1] = pulse
    return values


def test_stick_map_and_switches():
    input_ = StickInput(FlightParameters())
    input_.radio(pulses(c1=2000, c2=1000, c3=1250, c4=1750, c5=1000, c6=1000, c7=1000), 0.0)
    sticks = input_.sticks
    assert (sticks.roll, sticks.pitch, sticks.throttle) == (1.0, -1.0, 0.25)
    assert sticks.yaw == pytest.approx((0.5 - 0.02) / 0.98)
    assert (sticks.offboard, sticks.arm, sticks.kill) == (False, False, False)
    input_.radio(pulses(c5=1900, c6=1800, c7=2000), 0.014)
    assert (input_.sticks.offboard, input_.sticks.arm, input_.sticks.kill) == (True, True, True)
    input_.radio(pulses(c5=1500, c6=1500, c7=1500), 0.028)  # between: as it was
    assert (input_.sticks.offboard, input_.sticks.arm, input_.sticks.kill) == (True, True, True)


def test_stick_loss():
    input_ = StickInput(FlightParameters())
    assert input_.silent(0.0) and not input_.seen
    input_.radio(pulses(), 1.0)
    assert not input_.silent(1.5) and input_.silent(1.51)
    input_.radio(pulses(), 1.4, lost=True)
    assert input_.silent(1.51)  # a frame that was missed is no sign of life
    input_.radio(pulses(), 2.0)
    input_.radio(pulses(), 2.01, failsafe=True)
    assert input_.silent(2.02)
    input_.radio(pulses(), 2.03)
    assert not input_.silent(2.04)


@pytest.mark.parametrize("bad", [math.nan, 0.0, 5000.0, math.inf])
def test_absurd_pulses_are_refused_whole(bad):
    input_ = StickInput(FlightParameters())
    input_.radio(pulses(), 0.0)
    before = input_.sticks
    input_.radio(pulses(c9=bad, c1=2000), 0.1)
    assert input_.sticks is before and input_.bad_frames == 1


@pytest.mark.parametrize(
    ("mode", "source"),
    [(0, Source.RADIO), (1, Source.MAVLINK), (2, Source.MAVLINK), (3, Source.RADIO), (4, 0)],
)
def test_who_holds_the_sticks(mode, source):
    """The radio speaks first and falls silent, MAVLink speaks all the time."""
    input_ = StickInput(FlightParameters({"COM_RC_IN_MODE": mode}))
    for tenth in range(20):
        if tenth < 5:
            input_.radio(pulses(), 0.1 * tenth)
        input_.override([1500, 1500, 1000, 1500, *[0] * 14], 0.1 * tenth)
    assert input_.source == source


def test_battery_under_load_is_not_empty():
    p = FlightParameters({"BAT1_CAPACITY": -1, "BAT1_R_INTERNAL": 0.002})
    rest, load = BatteryMonitor(p), BatteryMonitor(p)
    for _ in range(1000):
        rest.update(6 * 3.8, 0.0, 0.01)
        load.update(6 * (3.8 - 200.0 * 0.002), 200.0, 0.01)
    assert rest.remaining == pytest.approx((3.8 - 3.6) / (4.05 - 3.6), abs=1e-3)
    assert load.remaining == pytest.approx(rest.remaining, abs=1e-3)
    assert load.level is BatteryLevel.NORMAL


def test_charge_is_counted():
    monitor = BatteryMonitor(FlightParameters({"BAT1_CAPACITY": 1000}))
    for _ in range(3600):
        monitor.update(25.0, 0.9, 1.0)  # 900 mAh of 1000
    assert monitor.consumed == pytest.approx(3240.0)
    assert monitor.remaining == pytest.approx(0.1, abs=1e-6)
    assert monitor.level is BatteryLevel.LOW


@pytest.mark.parametrize(("cell", "level"), [(3.7, 0), (3.66, 1), (3.63, 2), (3.61, 3), (3.0, 3)])
def test_battery_levels(cell, level):
    monitor = BatteryMonitor(FlightParameters({"BAT1_CAPACITY": -1}))
    monitor.update(6 * cell, 0.0, 0.01)
    assert monitor.level == level


# Arming and fail-safes --------------------------------------------------------------------------
def situation(**changes):
    """Of a unit that may arm and fly on; changes go to its motion where that has them."""
    still = Motion(aligned=True, sensors_ok=True, compass_ok=True, still_for=1.0, tilt=0.1)
    moved = {name: value for name, value in changes.items() if hasattr(still, name)}
    values = {
        "mode": FlightMode.OFFBOARD,
        "motion": replace(still, **moved),
        "tilted_for": 0.0,
        "battery_connected": True,
        "battery": BatteryLevel.NORMAL,
        "battery_warned": BatteryLevel.NORMAL,
        "kill": False,
        "terminated": False,
        "sticks_seen": True,
        "sticks_alive": True,
        "throttle": 0.0,
        "stream_alive": True,
        "setpoint_age": 0.0,
        "setpoint_thrust": 0.0,
        "fans_lost": 0,
    }
    others = {name: value for name, value in changes.items() if name not in moved}
    return FlightSituation(**{**values, **others})


BAD = {
    "sensors_ok": (False, "gyro or accelerometer missing"),
    "compass_ok": (False, "compass missing"),
    "aligned": (False, "attitude not ready"),
    "still_for": (0.1, "unit is moving"),
    "tilt": (1.5, "tilted too far"),
    "battery_connected": (False, "battery not connected"),
    "battery": (BatteryLevel.LOW, "low battery"),
    "kill": (True, "kill switch engaged"),
    "terminated": (True, "flight termination active"),
    "throttle": (0.3, "throttle not low"),
    "sticks_alive": (False, "no manual control input"),
}


@pytest.mark.parametrize("mode", list(FlightMode))
def test_every_check_by_itself(mode):
    parameters = FlightParameters()
    assert refusals(situation(mode=mode), parameters) == []
    stick_checks = ("throttle", "sticks_alive")
    for name, (value, reason) in BAD.items():
        expected = [] if mode is FlightMode.OFFBOARD and name in stick_checks else [reason]
        assert refusals(situation(mode=mode, **{name: value}), parameters) == expected
    if mode is FlightMode.OFFBOARD:
        found = refusals(situation(stream_alive=False), parameters)
        assert found == ["no offboard signal"]
        found = refusals(situation(setpoint_thrust=0.2), parameters)
        assert found == ["thrust setpoint not low"]


def test_fail_safes_and_their_reactions():
    p = FlightParameters()
    assert judge(situation(), p) is None
    cases = [
        ({"sensors_lost": True}, Cause.SENSORS, Reaction.DESCEND),
        ({"battery_warned": BatteryLevel.CRITICAL}, Cause.BATTERY, Reaction.DESCEND),
        ({"setpoint_age": 1.01}, Cause.OFFBOARD_LOSS, Reaction.DESCEND),
        ({"sticks_alive": False}, Cause.RC_LOSS, Reaction.DESCEND),
        ({"tilted_for": 0.31}, Cause.TILT, Reaction.TERMINATE),
    ]
    for case, cause, reaction in cases:
        assert judge(situation(**case), p) == (cause, reaction)
    for one, two in itertools.combinations(cases, 2):
        assert judge(situation(**one[0], **two[0]), p)[0] in (one[1], two[1])
    stabilized = FlightMode.STABILIZED
    assert judge(situation(mode=stabilized, setpoint_age=math.inf), p) is None
    assert judge(situation(sticks_seen=False, sticks_alive=False), p) is None
    assert judge(situation(battery_warned=BatteryLevel.LOW), p) is None


def test_parameters_choose_the_reaction():
    p = FlightParameters(
        {"COM_OBL_RC_ACT": 7, "NAV_RCL_ACT": 5, "COM_LOW_BAT_ACT": 0, "COM_RCL_EXCEPT": 4}
    )
    assert judge(situation(setpoint_age=2.0), p) == (Cause.OFFBOARD_LOSS, Reaction.DISARM)
    assert judge(situation(battery_warned=BatteryLevel.EMERGENCY), p) is None
    assert judge(situation(sticks_alive=False), p) is None
    lost = situation(mode=FlightMode.STABILIZED, sticks_alive=False)
    assert judge(lost, p) == (Cause.RC_LOSS, Reaction.TERMINATE)
    assert judge(situation(fans_lost=1), p) is None
    p = FlightParameters({"COM_ACT_FAIL_ACT": 2})
    assert judge(situation(fans_lost=1), p) == (Cause.FANS, Reaction.DESCEND)


# Parameters, pace, ports ------------------------------------------------------------------------
def test_parameter_table_fits_the_wire():
    for name, row in TABLE.items():
        assert len(name) <= 16 and name.isascii()
        assert row.lower <= row.default <= row.upper
        # Integers in these ranges are no signalling NaN when their bytes pass for a float.
        assert isinstance(row.default, float) or (row.lower >= -1 and row.upper < 2**31 / 2)


@pytest.mark.parametrize(
    ("name", "value"),
    [("NO", 1.0), ("COM_OF_LOSS_T", math.nan), ("COM_OF_LOSS_T", -1.0), ("NAV_RCL_ACT", 3.5)],
)
def test_bad_parameters(name, value):
    with pytest.raises(ParameterError):
        FlightParameters({name: value})


def test_overrides():
    assert read_overrides("") == {}
    assert read_overrides(" FD_FAIL_R=60, COM_OF_LOSS_T = 0.5,") == {
        "FD_FAIL_R": 60.0,
        "COM_OF_LOSS_T": 0.5,
    }
    for bad in ("FD_FAIL_R", "FD_FAIL_R=", "=", "FD_FAIL_R=high"):
        with pytest.raises(ParameterError):
            read_overrides(bad)
    with pytest.raises(ParameterError):
        FlightParameters(read_overrides("FD_FAIL_R=nan"))


def test_pace_takes_one_frame_a_period():
    pace = FramePace(14_000_000)
    acted = []
    for tick in range(200):
        now = 2_000_000 * tick
        # The writer sees time in steps of 10 ms.
        if now % 10_000_000 == 0:
            due = {n for n in range(1000) if now - 10_000_000 < 14_000_000 * n <= now}
            for number in sorted(due):
                pace.push(number, now)
        assert pace.ready(now)
        frame = pace.next_due(now)
        if frame is not None:
            acted.append((now, frame))
    assert [frame for _, frame in acted] == list(range(len(acted)))
    assert {b[0] - a[0] for a, b in itertools.pairwise(acted)} == {14_000_000}
    pace.restart()
    assert not pace.due(22_000_000)
    assert not pace.ready(24_000_000)
    pace.lost()
    assert pace.ready(24_000_000)


def test_udp_port_has_a_link_for_each_peer():
    port = UdpPort(0)
    peers = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    try:
        for number, peer in enumerate(peers):
            peer.settimeout(5.0)
            peer.sendto(bytes([number]), ("127.0.0.1", port.port))
        received = []
        while len(received) < 2:
            received += port.read()
        links = {data: link for link, data in received}
        assert len(set(links.values())) == 2
        port.write(links[b"\1"], b"x" * 3000)
        assert [len(peers[1].recv(4096)) for _ in range(3)] == [1400, 1400, 200]
    finally:
        for peer in peers:
            peer.close()
        port.close()


@pytest.mark.parametrize("text", ["", "host", "host:", ":1", "127.0.0.1:0", "127.0.0.1:x"])
def test_bad_addresses(text):
    with pytest.raises(ValueError):
        parse_address(text)
