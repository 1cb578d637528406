"""The servos' master on emulated servos, tick by tick; joints that nothing turns."""

import dataclasses
import re
import select

import numpy as np
import pytest
from servo_line import ROBOT, SERVO, Line

from husky_drivers.dynamixel.chain import ServoChain
from husky_drivers.dynamixel.port import DynamixelPort
from husky_drivers.dynamixel.servo_master import ServoMaster
from husky_drivers.dynamixel.settings import servo_settings
from husky_drivers.joint_master.phase import Phase
from husky_runtime import graph

STAND, ZERO = np.array(ROBOT.stand_joint_position), np.zeros(12)
LOST = 4
JOINT = ROBOT.joint_names[LOST]


class Loop(Line):
    """A master, and a controller that commands the joints to be where they are.

    When they are not enabled any more it damps, as it does on the ground.

    Attributes:
        lands: it goes on with positions instead.
        target: joint positions that it commands [rad] (12,).
    """

    def __init__(self, directory):
        super().__init__(directory)
        self.motors.update_state(STAND)
        settings = servo_settings(ROBOT, SERVO, 0.01)
        # A tick takes 0.7 ms here: the longest hold is 3 s, not 13 s.
        settings = dataclasses.replace(settings, landing_ticks=1000, yield_ticks=500)
        self.master = ServoMaster(ServoChain(self.port), settings)
        self.port.close()
        self.master.connect()
        self.ticks, self.lands, self.target = 0, False, STAND

    def tick(self, ticks=1, command=True):
        for _ in range(ticks):
            if command:
                damps = self.master.phase in (Phase.DAMPING, Phase.QUICK_STOP)
                mode = 9 if damps and not self.lands else 8
                assert self.master.set_command(mode, self.target, ZERO, ZERO) == ""
            cycle = self.ticks % self.master.settings.ticks_per_cycle == 0
            self.ticks += 1
            self.master.measure(cycle)
            self.master.act(cycle)
            if not cycle:  # what it has asked for is on the line at the next tick
                select.select([self.port._descriptor()], [], [], 0.05)
            with self.held:
                self.motors.step(STAND, ZERO)
                self.bus.advance(graph.TICK_PERIOD)

    def until(self, phase, limit, command=True):
        for ticks in range(limit):
            if self.master.phase is phase:
                return ticks
            self.tick(command=command)
        raise AssertionError(f"{phase} not within {limit} ticks: {self.master.phase}")

    def inject(self, fault):
        self.impatient()
        with self.held:
            self.bus.inject(JOINT, fault)


@pytest.fixture
def enabled(tmp_path):
    loop = Loop(tmp_path)
    loop.tick(26)  # each servo's health is known after twelve cycles
    while loop.master.enable() and loop.ticks < 200:
        loop.tick()
    loop.until(Phase.ENABLED, 200)
    yield loop
    loop.close()


def test_joints_and_status_are_what_the_servos_tell(enabled):
    master = enabled.master
    half_a_count = np.pi / SERVO.resolution
    assert np.abs(master.position - STAND).max() <= half_a_count * 1.001
    assert master.working_counter == master.expected_working_counter == 12
    assert {row.state.title for row in master.status()} == {"operation enabled"}
    assert master.reason == ""


def test_a_lost_servo_is_held_by_the_others_then_all_lose_torque(enabled):
    master, settings = enabled.master, enabled.master.settings
    enabled.inject("unplug")
    enabled.until(Phase.DAMPING, 2 * settings.miss_limit + 2)
    assert f"{JOINT} (servo {LOST + 1}): no answer" in master.reason
    records, others = enabled.motors.records, np.arange(12) != LOST
    assert enabled.until(Phase.QUICK_STOP, 400) == settings.hold_ticks
    assert records["torque_on"][others].all()
    assert enabled.until(Phase.OFF, 100) == settings.stop_ticks
    enabled.tick(4)
    assert not records["torque_on"][others].any()
    assert master.status()[LOST].state.title == "fault"
    assert JOINT in master.enable()


def test_silence_of_a_controller_that_damps_stops_all_servos_well_within_100_ms(enabled):
    assert enabled.master.set_command(9, STAND, ZERO, ZERO) == ""
    ticks = enabled.until(Phase.OFF, 100, command=False)
    enabled.tick(4, command=False)
    assert not enabled.motors.records["torque_on"].any()
    assert (ticks + 4) * graph.TICK_PERIOD <= 0.08
    assert enabled.master.reason == "no joint command"


def test_silence_of_one_that_may_fly_holds_the_arms_then_gives_way(enabled):
    """Nobody else's commands end the hold: a new controller knows nothing of a flight."""
    master, settings, records = enabled.master, enabled.master.settings, enabled.motors.records
    enabled.until(Phase.DAMPING, 20, command=False)
    assert master.reason == "no joint command"
    goal = records["goal"].copy()
    enabled.tick(2 * settings.hold_ticks)  # it damps
    assert master.phase is Phase.DAMPING and records["torque_on"].all()
    np.testing.assert_array_equal(records["goal"], goal)
    whole = settings.landing_ticks + settings.yield_ticks
    held = enabled.until(Phase.QUICK_STOP, whole)
    assert held + 2 * settings.hold_ticks == pytest.approx(whole, abs=1)
    enabled.until(Phase.OFF, 100)
    enabled.tick(4)
    assert not records["torque_on"].any() and "not off" not in master.enable()


def test_an_emergency_stop_pressed_again_and_again_still_ends(enabled):
    """While it lands: 1 s of following, counted from the first."""
    master, settings = enabled.master, enabled.master.settings
    enabled.lands = True
    master.emergency_stop()
    enabled.tick(settings.settle_ticks)
    goal = enabled.motors.records["goal"].copy()
    enabled.target = STAND + 0.1
    for _ in range(3):
        master.emergency_stop()
        enabled.tick(50)
        np.testing.assert_array_equal(enabled.motors.records["goal"], goal)
    enabled.lands = False
    enabled.until(Phase.OFF, 100)


def test_emergency_stop_is_latched_until_a_reset(enabled):
    master = enabled.master
    master.emergency_stop()
    assert "servos are not off" in master.reset_faults()
    enabled.until(Phase.OFF, 100)
    assert "emergency stop is latched" in master.enable()
    assert master.reset_faults() == ""
    enabled.until(Phase.OFF, 100)
    assert master.enable() == ""


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ((7, STAND, ZERO, ZERO), "mode of operation 7"),
        ((8, STAND + 5.0, ZERO, ZERO), "front_left_hip_frontal: position"),
        ((9, STAND, ZERO + np.nan, ZERO), "velocity .* is not finite"),
        ((10, STAND, ZERO, ZERO[1:]), "11 numbers of effort"),
    ],
)
def test_bad_commands_are_refused_whole(tmp_path, command, words):
    port = DynamixelPort(str(tmp_path / "nobody"), SERVO.baud_rate, 0.0)
    master = ServoMaster(ServoChain(port), servo_settings(ROBOT, SERVO, 0.01))
    assert re.search(words, master.set_command(*command))
    assert master.refused_commands == 1
