"""Master, simulated drives, servos and twelve pendulums in one closed loop, tick by tick."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_description.robot import load_robot
from husky_drivers.cia402 import DriveState
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.bus import Bus
from husky_drivers.ethercat.master import Master
from husky_drivers.joint_master.phase import Phase
from husky_sim.devices.drives.motor import Servos
from husky_sim.devices.drives.segment import SimulatedSegment

TICK, STEP = 0.002, 0.0005
ROBOT = load_robot()
NAMES = ROBOT.joint_names
STAND = ROBOT.stand_joint_position
ZERO = np.zeros(12)
INERTIA = 0.015 + 0.06  # armature and a leg [kg m2]
GRAVITY = 2.0  # torque of a pendulum held level [N m]
LONGEST = 0.65  # from the last command until torque is gone [s]


class Joints:
    """Twelve pendulums on the servos; `gravity` is the torque at angle 0 [N m]."""

    def __init__(self, gravity=GRAVITY, seed=0, **overrides):
        self.gravity = gravity
        self.position, self.velocity = STAND.copy(), np.zeros(12)
        self.servos = Servos(ROBOT, seed=seed)
        self.segment = SimulatedSegment(ROBOT, tick=TICK)
        self.bus: Bus = self.segment
        self.master = Master(self.bus, settings_of(ROBOT, **overrides), ROBOT)
        self.master.configure()
        self.servos.update_state(self.position)
        self.held = np.zeros(12, bool)  # cannot move
        self.bridge = True
        for _ in range(12):
            self.pass_time()
        self.master.start()
        self.command = (8, STAND.copy(), ZERO, ZERO)

    def pass_time(self):
        s = self.servos
        self.segment.set_servo_state(s.encoder_count, s.velocity_count, s.current, s.bus_voltage)

    def tick(self, ticks=1, command=True):
        """Run ticks of the bridge and the plant; returns the peak torque of the last one."""
        for _ in range(ticks):
            if self.bridge:
                self.pass_time()
                if command:
                    refusal = self.master.set_command(*self.command)
                    assert refusal == "", refusal
                self.master.exchange()
                c = self.segment.servo_command()
                self.servos.set_command(*(c[name] for name in c.dtype.names))
            peak = np.zeros(12)
            for _ in range(round(TICK / STEP)):
                torque = self.servos.step(self.position, self.velocity)
                peak = np.maximum(peak, np.abs(torque))
                pull = self.gravity * np.cos(self.position - STAND)
                self.velocity += (torque - pull) / INERTIA * STEP
                self.velocity[self.held] = 0.0
                self.position += self.velocity * STEP
            self.servos.update_state(self.position)
        return peak

    def enable(self):
        self.tick(2)
        assert self.master.enable() == ""
        self.until(Phase.ENABLED)

    def until(self, phase, limit=300, command=True):
        for ticks in range(limit):
            if self.master.phase is phase:
                return ticks
            self.tick(command=command)
        raise AssertionError(f"{phase} not within {limit} ticks, {self.master.phase}")


@pytest.fixture
def joints():
    # hanging straight down: no torque is needed until the drives are enabled
    made = Joints(gravity=0.0)
    made.enable()
    made.gravity = GRAVITY
    made.tick(300)
    return made


def test_a_load_is_held_with_the_droop_of_the_position_gain(joints):
    droop = STAND - joints.position
    # gravity over kp, to the encoders' error at the joint
    error = ROBOT.encoder.accuracy / ROBOT.gear.ratio + 3e-5
    assert droop == pytest.approx(np.full(12, GRAVITY / ROBOT.servo.kp), abs=error)
    assert np.abs(joints.velocity).max() < 0.01
    efforts = []
    for _ in range(200):
        joints.tick()
        efforts.append(joints.master.effort.copy())
    assert np.mean(efforts, axis=0) == pytest.approx(np.full(12, GRAVITY), rel=0.02)


def test_gains_can_be_changed_while_standing(joints):
    joints.master.set_gains(150.0, 4.0).result()
    joints.tick(400)
    droop = STAND - joints.position
    assert droop == pytest.approx(np.full(12, GRAVITY / 150.0), abs=4e-4)


def test_torque_offset_takes_the_load(joints):
    joints.command = (8, STAND.copy(), ZERO, np.full(12, GRAVITY))
    joints.tick(300)
    assert STAND - joints.position == pytest.approx(ZERO, abs=4e-4)


def test_a_swing_is_tracked_with_feed_forward(joints):
    joints.gravity = 0.0
    amplitude, omega = 0.2, 2 * math.pi * 2.0
    errors = []
    for k in range(1000):
        t = k * TICK
        ahead = t + TICK  # the target is reached at the end of the tick
        swing = amplitude * (1 - math.cos(omega * ahead)) / 2
        speed = amplitude * omega * math.sin(omega * ahead) / 2
        pull = INERTIA * amplitude * omega**2 * math.cos(omega * ahead) / 2
        joints.command = (8, STAND + swing, np.full(12, speed), np.full(12, pull))
        joints.tick()
        if k > 300:
            errors.append(joints.position - STAND - swing)
    assert np.abs(errors).max() < 0.004


def test_damping_lets_the_load_sink_at_a_bounded_speed(joints):
    joints.command = (9, STAND.copy(), ZERO, ZERO)
    joints.tick(100)
    # kd times speed carries the load
    assert -joints.velocity == pytest.approx(np.full(12, GRAVITY / ROBOT.servo.kd), rel=0.05)


def test_wire_and_joint_agree(joints):
    error = ROBOT.encoder.accuracy / ROBOT.gear.ratio + 3e-5
    joints.pass_time()
    joints.master.exchange()
    assert joints.master.position == pytest.approx(joints.position, abs=error)


# nobody gives torque later than 100 ms after its source died


def silent_time(joints, **how):
    """Ticks until there is no torque any more, and none comes back."""
    last = 0
    for k in range(400):
        if joints.tick(**how).any():
            last = k + 1
    return last


@pytest.mark.parametrize("speed", [0.0, -12.0, 25.0])
def test_controller_dies(joints, speed):
    joints.velocity[:] = speed
    joints.tick()
    ticks = silent_time(joints, command=False)
    assert ticks * TICK < LONGEST
    assert joints.master.reason == "no joint command"


def test_controller_dies_while_a_drive_brakes_under_load(joints):
    joints.gravity = 9.0  # close to what the drives can hold
    joints.tick(3)
    assert silent_time(joints, command=False) * TICK < LONGEST


def test_bridge_dies(joints):
    joints.bridge = False
    assert silent_time(joints) == 49  # after the tick of the last command


def test_master_stalls(joints):
    for _ in range(25):
        joints.pass_time()
    assert joints.segment.states() == [DriveState.FAULT] * 12
    assert not joints.segment.servo_command()["kind"].any()
    assert joints.segment.al_states()[0].code == 0x001B


@pytest.mark.parametrize(
    ("fault", "sto_state"),
    [
        ("fault:8611", DriveState.SWITCH_ON_DISABLED),
        ("fault:2340", DriveState.SWITCH_ON_DISABLED),
        ("silent", DriveState.SWITCH_ON_DISABLED),
        ("unpowered", DriveState.SWITCH_ON_DISABLED),
        ("al_error:001a", DriveState.SWITCH_ON_DISABLED),
        ("disturbed_timing", DriveState.SWITCH_ON_DISABLED),
        ("sto", DriveState.SWITCH_ON_DISABLED),
        ("sto", DriveState.SWITCHED_ON),
        ("sto", DriveState.FAULT),
    ],
)
def test_every_fault_stops_the_robot_and_it_stands_again(joints, fault, sto_state):
    for drive in joints.segment.drives:
        drive.record["sto_state"] = sto_state
    joints.segment.inject("front_right_knee", fault)
    joints.tick(2)
    joints.until(Phase.OFF, 400)
    assert "front_right_knee" in joints.master.reason
    assert not joints.tick(10).any()
    joints.segment.clear()
    assert not joints.tick(100).any()  # nothing starts by itself
    joints.position[:], joints.velocity[:] = STAND, 0.0
    joints.gravity = 0.0
    assert joints.master.reset_faults() == ""
    joints.until(Phase.OFF)
    joints.enable()
    joints.gravity = GRAVITY
    joints.tick(200)
    assert STAND - joints.position == pytest.approx(np.full(12, GRAVITY / 300), abs=4e-4)


def test_sto_of_all_drives(joints):
    for name in NAMES:
        joints.segment.inject(name, "sto")
    assert not joints.tick().any()
    joints.tick(3)
    assert joints.master.phase is Phase.OFF
    assert "safe torque off" in joints.master.reason
    assert all(row.safe_torque_off for row in joints.master.status())
    assert "safe torque off" in joints.master.enable()


def test_a_joint_that_is_stuck_trips_on_following_error(joints):
    joints.held[4] = True
    target = STAND.copy()
    for _ in range(400):
        target[4] += 0.002
        joints.command = (8, target.copy(), ZERO, ZERO)
        joints.tick()
        if joints.master.phase is not Phase.ENABLED:
            break
    assert joints.master.reason.startswith("front_right_hip_sagittal: fault")
    assert "(position tracking)" in joints.master.reason
    moved = target[4] - STAND[4]
    # window, then its time at 1 rad/s
    expected = ROBOT.drive.following_error_window + ROBOT.drive.following_error_time * 1.0
    assert moved == pytest.approx(expected, abs=0.02)


def test_the_other_drives_settle_when_one_is_lost(joints):
    joints.segment.inject("hind_left_knee", "fault:2340")
    joints.tick(60)
    others = np.arange(12) != NAMES.index("hind_left_knee")
    assert joints.master.phase is Phase.SETTLING
    # The knees fold, and the joints are where they are told to be, but for the droop.
    assert (joints.position[[2, 5, 11]] < STAND[[2, 5, 11]] - 0.1).all()
    assert np.abs(joints.position - joints.master.settling.joint_position)[others].max() < 0.1
    assert not joints.tick()[~others].any()


def test_no_jump_at_enabling(joints):
    joints.master.disable()
    joints.until(Phase.OFF, 400)
    joints.gravity = 0.0
    joints.position[:], joints.velocity[:] = STAND - 0.15, 0.0
    joints.tick(5)
    assert joints.master.enable() == ""
    peak = 0.0
    for _ in range(400):
        peak = max(peak, joints.tick().max())
        assert np.abs(joints.velocity).max() < 1.3
    assert joints.master.phase is Phase.ENABLED
    assert peak < 5.0  # 0.15 rad at once would be 10 N m, the limit
    assert joints.position == pytest.approx(STAND, abs=4e-4)


@pytest.mark.parametrize("volts", [9.0, 0.0])
def test_a_dead_battery_ends_in_off(joints, volts):
    joints.servos.bus_voltage = volts
    joints.tick(5)
    assert joints.master.phase is Phase.OFF
    assert "undervoltage" in joints.master.reason


def test_same_seed_same_bits():
    def run():
        joints = Joints(seed=5)
        joints.enable()
        joints.tick(50)
        joints.segment.inject("front_left_knee", "sto")
        joints.tick(50)
        return joints.position.tobytes() + joints.master.effort.tobytes()

    assert run() == run()


EVENTS = st.one_of(
    st.tuples(st.just("run"), st.integers(1, 30)),
    st.tuples(st.just("silence"), st.integers(1, 30)),
    st.tuples(st.just("mode"), st.sampled_from([8, 9, 10])),
    st.tuples(
        st.sampled_from(
            [
                "sto",
                "silent",
                "cut",
                "unpowered",
                "disturbed_timing",
                "al_error:001b",
                "fault:8611",
                "fault:4310",
            ]
        ),
        st.sampled_from(NAMES),
    ),
    st.tuples(st.sampled_from(["clear", "enable", "reset", "stop", "disable"]), st.none()),
)


@given(st.lists(EVENTS, max_size=25))
@settings(max_examples=20)  # each takes 50 ms
def test_whatever_happens_torque_ends_soon_after_the_last_command(events):
    joints = Joints(gravity=0.5)
    joints.enable()
    for what, argument in events:
        if what in ("run", "silence"):
            joints.tick(argument, command=what == "run")
        elif what == "mode":
            joints.command = (argument, STAND, ZERO, ZERO)
        elif what == "clear":
            joints.segment.clear()
        elif what == "enable":
            joints.position[:], joints.velocity[:] = STAND, 0.0
            joints.master.enable()
        elif what == "reset":
            joints.master.reset_faults()
        elif what == "stop":
            joints.master.emergency_stop()
        elif what == "disable":
            joints.master.disable()
        else:
            joints.segment.inject(argument, what)
    joints.tick()
    assert silent_time(joints, command=False) * TICK <= LONGEST
    joints.tick(50)  # commands alone bring nothing back
    assert not joints.tick().any()
