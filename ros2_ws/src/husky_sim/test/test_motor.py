"""Servo law, motor and encoder against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_description.robot import load_robot
from husky_sim.devices.drives.motor import Servos, ServoTiming
from husky_sim.devices.drives.servo_law import OFF, POSITION, TORQUE, VELOCITY

ROBOT = load_robot()
EXACT = load_robot(encoder__accuracy=0.0)  # no turn error
STRONG = load_robot(encoder__accuracy=0.0, drive__peak_current=200.0)  # the supply limits it
PEAK_CURRENT = 22.0  # A
COUNTS = ROBOT.encoder_counts_per_joint_turn / (2 * math.pi)  # per joint radian
QUANTUM = 1 / COUNTS
KP, KD = 300.0, 4.0
TORQUE_PER_AMPERE = 0.0218 * 30 * 0.7


def make(robot=EXACT, **timing):
    return Servos(robot, ServoTiming(**timing) if timing else None)


def command(servos, kind, position=0.0, velocity=0.0, torque=0.0, kp=KP, kd=KD, limit=10.0):
    def full(value):
        return np.full(12, float(value))

    return servos.set_command(
        np.full(12, kind, np.uint8),
        full(position),
        full(velocity),
        full(torque),
        full(kp),
        full(kd),
        full(limit),
    )


SHARED = make()


def still(servos, position, steps=1):
    for _ in range(steps):
        torque = servos.step(np.full(12, float(position)), np.zeros(12))
    return torque


@given(
    st.floats(-1.5, 1.5, allow_nan=False),
    st.floats(-0.03, 0.03),
    st.floats(0.0, 400.0),
)
@settings(max_examples=50)
def test_static_torque_is_kp_times_error(position, error, kp):
    servos = make(STRONG)
    command(servos, POSITION, position + error, kp=kp, limit=1e3)
    torque = still(servos, position, 4)
    assert torque == pytest.approx(np.full(12, kp * error), abs=kp * QUANTUM / 2 + 1e-9)


def test_velocity_law_is_kd_times_error():
    servos = make()
    command(servos, VELOCITY, velocity=1.5, torque=0.25)
    assert still(servos, 0.3, 4) == pytest.approx(np.full(12, KD * 1.5 + 0.25), abs=1e-9)


def test_torque_law_ignores_gains_and_position():
    servos = make()
    command(servos, TORQUE, position=1.0, velocity=3.0, torque=-2.5)
    assert still(servos, 0.0) == pytest.approx(np.full(12, -2.5))


def test_torque_limit_and_current():
    servos = make()
    command(servos, POSITION, 1.0, limit=4.0)
    assert still(servos, 0.0) == pytest.approx(np.full(12, 4.0))
    servos.update_state(np.zeros(12))
    assert servos.current == pytest.approx(np.full(12, 4.0 / TORQUE_PER_AMPERE))
    command(servos, POSITION, -1.0, limit=4.0)
    assert still(servos, 0.0, 5) == pytest.approx(np.full(12, -4.0))


def test_off_is_off_and_never_commanded_is_off():
    servos = make()
    assert not still(servos, 0.3).any()
    command(servos, OFF, 1.0, torque=5.0)
    assert not still(servos, 0.3).any()


def test_targets_are_reached_linearly_in_the_interpolation_period():
    # one drive cycle a step, so that every cycle of the 2 ms is seen
    servos = make(step=0.0001)
    command(servos, TORQUE, torque=1.0)
    still(servos, 0.0, 20)
    command(servos, TORQUE, torque=3.0)
    seen = [still(servos, 0.0)[0] for _ in range(25)]
    assert seen == pytest.approx([*(1.0 + 2.0 * np.arange(1, 21) / 20), *[3.0] * 5])


def test_position_and_velocity_targets_are_interpolated():
    servos = make(step=0.0001)
    p0, p1 = 0.2, 0.2 + 40 * QUANTUM
    command(servos, POSITION, p0, kd=0.0)
    base = still(servos, 0.2, 20)[0]
    command(servos, POSITION, p1, kd=0.0)
    seen = np.array([still(servos, 0.2)[0] for _ in range(20)]) - base
    assert seen == pytest.approx(KP * (p1 - p0) * np.arange(1, 21) / 20)
    command(servos, VELOCITY, velocity=0.0)
    still(servos, 0.2, 20)
    command(servos, VELOCITY, velocity=1.0)
    seen = np.array([still(servos, 0.2)[0] for _ in range(20)])
    assert seen == pytest.approx(KD * np.arange(1, 21) / 20)


def test_a_late_command_starts_where_the_targets_stand():
    servos = make(step=0.0001)
    command(servos, TORQUE, torque=0.0)
    still(servos, 0.0, 20)
    command(servos, TORQUE, torque=2.0)
    still(servos, 0.0, 10)  # half way
    command(servos, TORQUE, torque=-1.0)
    assert still(servos, 0.0)[0] == pytest.approx(1.0 - 2.0 / 20)


def test_a_new_kind_starts_at_its_target():
    servos = make(step=0.0001)
    command(servos, TORQUE, torque=2.0)
    still(servos, 0.0, 20)
    command(servos, POSITION, 0.01, kd=0.0)
    assert still(servos, 0.0)[0] == pytest.approx(KP * 0.01, abs=KP * QUANTUM)


def test_mean_torque_of_a_physics_step():
    fine, coarse = make(step=0.0001), make(step=0.0005)
    for servos in (fine, coarse):
        command(servos, TORQUE, torque=0.0)
        command(servos, TORQUE, torque=2.0)
    cycles = [still(fine, 0.0)[0] for _ in range(5)]
    assert still(coarse, 0.0)[0] == pytest.approx(np.mean(cycles))


@pytest.mark.parametrize("volts", [22.2, 16.0])
def test_torque_falls_linearly_with_speed(volts):
    servos = make(STRONG)
    servos.bus_voltage = volts
    motor = EXACT.motor
    no_load = motor.speed_constant * volts / 30  # rad/s at the joint
    stall = volts / math.sqrt(3) / motor.phase_resistance * TORQUE_PER_AMPERE
    for part in (0.0, 0.5, 0.9, 0.99, 1.0):
        command(servos, TORQUE, torque=1e3, limit=1e3)
        torque = servos.step(np.zeros(12), np.full(12, part * no_load))
        assert torque == pytest.approx(np.full(12, stall * (1 - part)), abs=1e-9)
    command(servos, TORQUE, torque=1e3, limit=10.0)
    assert servos.step(np.zeros(12), np.full(12, 0.5 * no_load))[0] == pytest.approx(10.0)
    # beyond no-load speed the supply brakes; against the speed it has more, not less
    command(servos, TORQUE, torque=1e3, limit=1e3)
    assert servos.step(np.zeros(12), np.full(12, 1.01 * no_load))[0] < 0.0
    servos.reset()
    command(servos, TORQUE, torque=-1e3, limit=1e3)
    assert servos.step(np.zeros(12), np.full(12, 0.5 * no_load))[0] == pytest.approx(-1.5 * stall)


def test_speed_constant_and_torque_constant_belong_to_one_motor():
    # power: 3/2 of phase amplitude voltage times current is torque times speed
    volts = 22.2
    no_load = ROBOT.motor.speed_constant * volts
    back_emf = volts / math.sqrt(3)  # phase amplitude at no-load speed
    assert 1.5 * back_emf / no_load == pytest.approx(ROBOT.motor.torque_constant, rel=0.01)


def test_encoder_quantisation():
    servos = make()
    positions = np.linspace(-2.0, 2.0, 12)
    servos.update_state(positions)
    error = servos.encoder_count / COUNTS - positions
    assert np.all(error <= 1e-12)
    assert np.all(error > -QUANTUM)


def test_encoder_error_has_one_period_a_motor_turn_within_the_accuracy():
    servos = make(ROBOT)
    turn = 2 * math.pi / ROBOT.gear.ratio
    angles = np.arange(720) * turn / 720
    errors = np.zeros((720, 12))
    for k, angle in enumerate(angles):
        servos.update_state(np.full(12, angle + 5 * turn))
        errors[k] = (servos.encoder_count + 0.5) / COUNTS - angle - 5 * turn
    at_motor = errors * ROBOT.gear.ratio
    quantum = 2 * math.pi / 8192
    peak = np.abs(at_motor).max(axis=0)
    assert np.all(peak <= ROBOT.encoder.accuracy + quantum)
    assert np.all(peak >= 0.5 * ROBOT.encoder.accuracy - quantum)
    spectrum = np.abs(np.fft.rfft(at_motor, axis=0)) / 360
    assert spectrum[1] == pytest.approx(servos.records["error_amplitude"], abs=quantum)
    assert np.all(spectrum[2:10] < quantum)


def test_encoder_errors_come_from_the_seed():
    one, same, other = (Servos(ROBOT, seed=s).records for s in (3, 3, 4))
    assert np.array_equal(one["error_phase"], same["error_phase"])
    assert not np.array_equal(one["error_phase"], other["error_phase"])


def test_speed_estimate_is_a_first_order_low_pass():
    # speed step 0 -> v with 200 Hz: after t the estimate is v (1 - exp(-2 pi 200 t))
    servos = make(step=0.0001)
    v = 8.0
    still(servos, 0.0, 2)
    q = np.zeros(12)
    times, seen = [], []
    for k in range(40):
        servos.step(q, np.full(12, v))
        q = q + v * 1e-4
        times.append(k * 1e-4)
        seen.append(servos.records["velocity"][0] / COUNTS)
    expected = v * -np.expm1(-2 * math.pi * 200 * np.array(times))
    ripple = QUANTUM / 1e-4 * -np.expm1(-2 * math.pi * 200 * 1e-4)
    assert np.abs(np.array(seen) - expected).max() < 2 * ripple
    servos.update_state(q)
    assert servos.velocity_count[0] == pytest.approx(seen[-1] * COUNTS, abs=0.5)


def test_watchdog_of_100_ms():
    servos = make()
    command(servos, TORQUE, torque=3.0)
    for step in range(210):
        torque = still(servos, 0.0)
        assert (torque[0] != 0.0) == (step < 200)
    command(servos, TORQUE, torque=3.0)
    assert still(servos, 0.0).all()


ANYTHING = st.floats() | st.sampled_from((1e308, -1e308, 1e9, -1e9, 200.0, -200.0))
NUMBERS = st.tuples(st.integers(0, 255), *[ANYTHING] * 6)
NO_LOAD = 39.79 * 22.2 / 30  # rad/s at the joint; beyond it the motor is a generator


@given(st.lists(NUMBERS, min_size=1, max_size=4), st.floats(-NO_LOAD, NO_LOAD))
@settings(max_examples=200)
def test_no_command_makes_more_than_the_drives_peak_current(commands, joint_velocity):
    """Nor does what came before spoil a good command."""
    servos = SHARED
    servos.reset()
    for numbers in commands:
        kind, *values = numbers
        taken = command(servos, kind, *values)
        assert taken == (kind <= TORQUE and all(map(math.isfinite, values)))
        for _ in range(5):
            servos.step(np.full(12, 0.3), np.full(12, joint_velocity))
            servos.update_state(np.full(12, 0.3))
            assert np.abs(servos.current).max() <= PEAK_CURRENT * (1 + 1e-12)
    for _ in range(2):
        assert command(servos, TORQUE, torque=-1.0)
        still(servos, 0.3, 4)
    assert still(servos, 0.3) == pytest.approx(np.full(12, -1.0))


def test_limits_are_the_drives_own_whatever_a_command_says():
    servos = make()
    command(servos, TORQUE, torque=200.0, limit=200.0)
    assert still(servos, 0.0) == pytest.approx(np.full(12, PEAK_CURRENT * TORQUE_PER_AMPERE))
    command(servos, POSITION, 1e9, velocity=1e9, kp=1e9, kd=1e9, limit=-1.0)
    records = servos.records
    assert not still(servos, 0.0).any()
    assert records["end_position"] == pytest.approx(np.full(12, 2.0**31 * QUANTUM))
    assert (records["end_velocity"] == ROBOT.joint_velocity_limit).all()
    assert (records["kp"] == 1000.0).all() and (records["kd"] == 50.0).all()


IN_RANGE = st.tuples(
    st.sampled_from((OFF, POSITION, VELOCITY, TORQUE)),
    st.floats(-10.0, 10.0),  # rad
    st.floats(-29.7, 29.7),  # rad/s
    st.floats(-10.0, 10.0),  # N m
    st.floats(0.0, 1000.0),
    st.floats(0.0, 50.0),
    st.floats(0.0, 10.0),  # N m
)


@given(IN_RANGE)
def test_a_command_within_the_limits_is_followed_to_the_bit(numbers):
    servos = SHARED
    servos.reset()
    assert command(servos, *numbers)
    record = servos.records[0]
    names = ("kind", "end_position", "end_velocity", "end_torque", "kp", "kd", "torque_limit")
    assert tuple(record[name] for name in names) == numbers


def test_a_command_that_is_none_changes_nothing():
    servos = make()
    command(servos, TORQUE, torque=3.0)
    still(servos, 0.0, 4)
    before = servos.records.copy()
    good = (POSITION, 0.1, 0.0, 0.0, KP, KD, 10.0)
    for index in range(1, 7):
        for bad in (math.nan, math.inf, -math.inf):
            numbers = [np.full(12, value) for value in good]
            numbers[index][7] = bad  # one joint of twelve
            assert not servos.set_command(numbers[0].astype(np.uint8), *numbers[1:])
    assert not command(servos, TORQUE + 1)
    assert (servos.records == before).all()


def test_reset_forgets():
    servos = make()
    command(servos, TORQUE, torque=3.0)
    servos.step(np.zeros(12), np.ones(12))
    servos.reset()
    servos.update_state(np.zeros(12))
    assert not servos.velocity_count.any()
    assert not servos.current.any()
    assert not still(servos, 1.0).any()
    assert servos.records["velocity"][0] == 0.0


@pytest.mark.parametrize("name", ["step", "interpolation", "watchdog"])
def test_times_are_whole_drive_cycles(name):
    with pytest.raises(ValueError, match=name):
        make(**{name: 0.00025})


def test_same_input_same_bits():
    def run():
        servos = Servos(ROBOT, seed=1)
        random = np.random.default_rng(0)
        out = []
        for _ in range(50):
            command(servos, POSITION, random.normal())
            for _ in range(4):
                q, dq = random.normal(size=12), random.normal(size=12)
                out.append(servos.step(q, dq).copy())
        return np.array(out)

    assert run().tobytes() == run().tobytes()


@pytest.mark.parametrize("inertia", [0.015, 0.05, 0.3])
def test_position_law_is_stable_on_the_rotor_alone_and_with_a_leg(inertia):
    """kp 300, kd 4 on the armature alone: poles of the continuous law within a tenth."""
    servos = Servos(ROBOT)
    q, dq = np.full(12, 0.02), np.zeros(12)
    command(servos, POSITION, 0.0)
    h, track = 0.0005, []
    for k in range(3000):
        if k % 4 == 0:
            command(servos, POSITION, 0.0)
        dq = dq + servos.step(q, dq) / inertia * h
        q = q + dq * h
        track.append(q[0])
    track = np.array(track)
    rest = track[-200:]
    # settles, to a limit cycle of a few quanta and the encoder's error at most
    assert np.abs(rest).max() < ROBOT.encoder.accuracy / 30 + 3 * QUANTUM
    assert rest.max() - rest.min() < 4 * QUANTUM
    damping = KD / (2 * math.sqrt(KP * inertia))
    if damping < 1.0:
        overshoot = 0.02 * math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
        assert -track.min() == pytest.approx(overshoot, abs=0.1 * 0.02)
