"""The controller as a whole: what is refused and counted, how modes follow each other."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from husky_control.controller import Controller
from husky_control.flight.hover import HoverPhase
from husky_control.modes.behaviour import Behaviour, Event
from husky_control.modes.table import ACTIVE, ON_LEGS, TRANSITIONS, Mode, Transition, modes_of
from husky_control.parameters import Parameters
from husky_control.rotation import matrix_from_quaternion
from husky_control.tick_data import CYCLIC_POSITION, CYCLIC_TORQUE, TICK, Measurements
from husky_description.robot import load_robot

ROBOT = load_robot()


class Bench:
    """A controller whose joints are where it wants them, with the torque that it asks for."""

    def __init__(self, robot=ROBOT, **arguments):
        soon = Parameters.of(robot, {"stand.duration": 0.82, "stand.joint_speed": 4.9})
        self.controller = Controller(robot, soon, warm_up=False, **arguments)
        self.m = Measurements(drives_operational=True)
        self.m.joint_position[:] = robot.sit_joint_position
        self.run(TICK)

    def run(self, seconds, velocity=None):
        """Go on for a while, a velocity command at every tenth of a second."""
        for index in range(round(seconds / TICK)):
            if velocity is not None and index % 50 == 0:
                assert self.controller.set_velocity_command(*velocity) == (True, "")
            self.m.time += TICK
            self.m.pose.stamp = self.m.time
            command = self.controller.tick(self.m)
            self.m.joint_torque[:] = command.effort
            self.m.joint_position[:] = command.position
        return self.controller

    def arm(self):
        self.m.fans_available, self.m.pose.variance = True, 0.01
        self.run(TICK)

    def ask(self, *modes):
        for mode in modes:
            accepted, message = self.controller.request_mode(mode)
            assert accepted, message
        return self


@pytest.fixture
def standing():
    robot = Bench().ask("stand_up")
    assert robot.run(2.0).mode is Mode.STAND, robot.controller.reason
    return robot


# ------------------------------------------------------------------- adding a mode


class Bow(Behaviour):
    """Kneels on the front legs and comes up again."""

    answers = frozenset({"sit"})

    def enter(self, event):
        self._start, self._elapsed = self.context.command.position.copy(), 0.0

    def tick(self, command):
        self._elapsed += TICK
        down = math.sin(math.pi * min(1.0, self._elapsed / 0.5)) ** 2
        command.position[:] = self._start
        command.position[[2, 5]] -= 0.2 * down
        command.velocity.fill(0.0)
        command.mode_of_operation = CYCLIC_POSITION
        return (Event.DONE, "bowed") if self.settled else None

    def answer(self, request):
        return (False, "sit refused: it bows") if request in self.answers else None

    @property
    def settled(self):
        return self._elapsed >= 0.5


@dataclass(frozen=True)
class Row:
    value: str
    behaviour: type
    meaning: str


def test_a_mode_is_its_class_and_its_rows_in_the_table():
    """One more row in the list of modes, and its transitions; nothing else knows of it."""
    bow = Row("bow", Bow, "kneels on the front legs and comes up again")
    rows = (
        *TRANSITIONS,
        Transition(frozenset({Mode.STAND}), Event.REQUEST, bow, ("bow",), ("at_rest",)),
        Transition(frozenset({bow}), Event.DONE, Mode.STAND, label="bowed"),
        Transition(frozenset({bow}), Event.FAULT, Mode.DAMPING, label="a safety check trips"),
    )
    robot = Bench(modes=(*modes_of(ROBOT), bow), transitions=rows)
    controller = robot.controller
    assert controller.request_mode("bow")[1].startswith("bow cannot follow passive; it allows ")
    robot.ask("stand_up").run(2.0)
    start = controller.command.position.copy()
    robot.m.angular_velocity_base_in_base[2] = 1.0
    robot.run(TICK)
    assert controller.request_mode("bow") == (False, "bow refused: the body is still moving")
    robot.m.angular_velocity_base_in_base[2] = 0.0
    robot.run(TICK)
    robot.ask("bow").run(0.25)
    assert controller.mode is bow and not controller.present.settled
    np.testing.assert_allclose((start - controller.command.position)[[2, 5]], 0.2, atol=1e-3)
    assert controller.allowed_requests()[bow] == ("sit",)
    assert controller.request_mode("sit") == (False, "sit refused: it bows")
    assert controller.set_velocity_command(0.1, 0.0, 0.0) == (False, "it is in mode bow")
    robot.run(0.3)
    assert (controller.mode, controller.reason) == (Mode.STAND, "bowed")
    robot.ask("bow")
    robot.m.drives_operational = False
    assert robot.run(TICK).mode is Mode.DAMPING
    assert (controller.counters.faults, controller.counters.refused_requests) == (1, 3)


@pytest.mark.parametrize(
    "mode", sorted(ACTIVE.intersection(modes_of(ROBOT)) - {Mode.SETTLE}, key=str)
)
def test_no_active_mode_is_without_a_way_out_by_a_fault(mode):
    """The drives stop following: on its legs the robot settles, else it sinks."""
    assert any(mode in row.sources and row.event is Event.FAULT for row in TRANSITIONS)
    robot = Bench()
    robot.controller._machine.mode = mode
    robot.controller.present = robot.controller._modes[mode]
    assert robot.controller.lose_drives("the drives are gone")
    assert robot.controller.mode is (Mode.SETTLE if mode in ON_LEGS else Mode.DAMPING)
    assert robot.controller.reason == "the drives are gone"
    assert robot.controller.counters.faults == 1
    assert not robot.controller.lose_drives("again") and robot.controller.counters.faults == 1


# ------------------------------------------------------------------- one mode after the other


def test_who_fell_while_the_gait_changed_does_not_walk_off_when_it_stands_again(standing):
    controller = standing.ask("walk").run(0.5)
    assert controller.request_gait("bound") == (True, "changing to bound through stand")
    standing.m.drives_operational = False
    assert standing.run(TICK).mode is Mode.SETTLE
    assert standing.run(0.7).mode is Mode.DAMPING
    standing.m.drives_operational = True
    standing.ask("passive").run(TICK)
    standing.ask("stand_up").run(2.5)
    assert (controller.mode, controller.context.gait) == (Mode.STAND, "trot")


def test_another_gait_is_walked_after_a_stand(standing):
    controller = standing.ask("walk").run(0.3)
    controller.request_gait("bound")
    modes = {standing.run(TICK).mode for _ in range(300)}
    assert modes == {Mode.WALK} and controller.context.gait == "bound"
    assert controller.reason == "walk requested"


def test_thrust_fades_whatever_mode_follows_a_flight_that_was_broken_off(standing):
    standing.arm()
    controller = standing.ask("fly").run(1.0)
    force = controller.hover.force
    assert controller.mode is Mode.FLY and force > 30.0
    controller.hover.phase = HoverPhase.HOLD  # in the air: on its legs it would settle first
    standing.ask("damping").run(TICK)
    standing.ask("passive").run(TICK)
    standing.ask("stand_up").run(TICK)
    assert controller.mode is Mode.STAND_UP and controller.hover.force > 0.9 * force
    standing.run(2.0)
    assert not controller.hover.active and controller.hover.force == 0.0


def test_an_emergency_stop_ends_thrust_at_once_in_flight_and_while_it_fades(standing):
    standing.arm()
    for way in (("emergency_stop",), ("damping", "emergency_stop")):
        standing.ask("fly").run(0.5)
        assert standing.controller.hover.force > 10.0
        standing.ask(*way).run(TICK)
        assert standing.controller.hover.force == 0.0
        standing.run(0.7)  # it settles, if its feet are on the ground yet
        assert standing.controller.command.mode_of_operation == CYCLIC_TORQUE
        standing.run(1.0)
        standing.ask("passive").run(TICK)
        standing.ask("stand_up").run(2.0)


def test_sitting_down_may_follow_half_of_standing_up_without_a_jump():
    robot = Bench().ask("stand_up")
    before = robot.run(0.8).command.position.copy()
    assert not robot.controller.present.settled
    robot.ask("sit").run(TICK)
    assert np.abs(robot.controller.command.position - before).max() < 0.01
    assert robot.run(2.5).present.settled and robot.controller.mode is Mode.SIT
    np.testing.assert_allclose(robot.controller.command.position, ROBOT.sit_joint_position)


# ------------------------------------------------------------------- righting


def lay(robot, roll):
    """Lay a bench's robot down, turned about its x axis by an angle [rad]."""
    m, half = robot.m, roll / 2.0
    m.orientation_base_in_world[:] = math.sin(half), 0.0, 0.0, math.cos(half)
    matrix_from_quaternion(m.orientation_base_in_world, m.rotation_base_in_world)
    robot.run(TICK)


def test_righting_is_refused_where_it_cannot_work_with_the_reason():
    robot = Bench()
    ask = robot.controller.request_mode
    lay(robot, math.pi / 2)
    assert ask("stand_up") == (False, "stand_up refused: the body is tilted too far")
    for name, bad, good, words in (
        ("drives_operational", False, True, "the drives are not operational"),
        ("imu_age", 1.0, 0.0, "measurements are missing or stale"),
        ("joint_age_ticks", 99, 1, "measurements are missing or stale"),
    ):
        setattr(robot.m, name, bad)
        robot.run(TICK)
        assert ask("righting") == (False, f"righting refused: {words}")
        setattr(robot.m, name, good)
    robot.m.angular_velocity_base_in_base[0] = 1.0
    robot.run(TICK)
    assert ask("righting") == (False, "righting refused: the body is still moving")
    robot.m.angular_velocity_base_in_base[0] = 0.0
    robot.run(TICK)
    robot.ask("righting")
    assert ask("stand_up")[1].startswith("stand_up cannot follow righting; it allows ")


def test_a_body_that_does_not_turn_is_given_up():
    robot = Bench()
    lay(robot, math.pi / 2)
    robot.ask("righting").run(40.0)
    assert robot.controller.mode is Mode.DAMPING
    assert robot.controller.reason == "not upright after 20 rounds"
    assert robot.controller.counters.faults == 0


def test_righting_ends_in_the_sitting_posture_from_which_it_stands_up():
    robot = Bench()
    lay(robot, -math.pi / 2)
    robot.ask("righting").run(3.0)
    lay(robot, -0.1)
    assert robot.run(6.0).mode is Mode.SIT
    assert robot.controller.reason == "on its perch"
    np.testing.assert_allclose(robot.controller.command.position, ROBOT.sit_joint_position)
    robot.ask("stand_up")


def test_righting_goes_on_being_judged_but_for_its_tilt():
    robot = Bench()
    lay(robot, math.pi)
    robot.ask("righting").run(1.0)
    robot.m.joint_age_ticks = 99
    assert robot.run(TICK).mode is Mode.DAMPING
    assert robot.controller.reason == "joint states are 99 ticks old"


# ------------------------------------------------------------------- refusals and limits


def test_a_mode_that_follows_no_velocity_command_reports_none(standing):
    controller = standing.ask("walk").controller
    assert controller.set_velocity_command(0.2, 0.0, 0.1) == (True, "")
    standing.run(0.3)
    np.testing.assert_allclose(controller.present.ramped_velocity, (0.2, 0.0, 0.1))
    standing.ask("damping").run(TICK)
    np.testing.assert_array_equal(controller.walking.reference.ramped, (0.2, 0.0, 0.1))
    np.testing.assert_array_equal(controller.present.ramped_velocity, 0.0)
    standing.run(0.7)  # it settles
    for mode in ("passive", "stand_up"):
        np.testing.assert_array_equal(controller.present.ramped_velocity, 0.0)
        standing.ask(mode).run(TICK)


def test_a_velocity_command_out_of_range_is_refused_whole_and_the_last_one_stays(standing):
    controller = standing.ask("walk").controller
    assert controller.set_velocity_command(0.2, 0.0, 0.1) == (True, "")
    for command, words in (
        ((9.0, 0.0, 0.0), "vx must be within +-1.6 m/s (gait.trot.max_speed), not 9.0"),
        (
            (0.0, math.nan, 0.0),
            "vy must be within +-0.3 m/s (gait.trot.max_lateral_speed), not nan",
        ),
        (
            (0.0, 0.0, -1.0),
            "yaw_rate must be within +-0.8 rad/s (gait.trot.max_yaw_rate), not -1.0",
        ),
    ):
        assert controller.set_velocity_command(*command) == (False, words)
    assert controller.counters.refused_velocity_commands == 3
    standing.run(0.3)
    np.testing.assert_allclose(controller.walking.reference.ramped, (0.2, 0.0, 0.1))


CREEPS = [(1e-9, 0.0, 0.0), (0.0, 0.0, -1e-9), (0.006, -0.007, 0.0), (0.0, 0.009, 0.009)]


@pytest.mark.parametrize("name", ["carbon", "beta"])
def test_a_command_in_the_band_of_zero_is_zero(name):
    """It does not set a standing robot in motion, and one in motion stands again."""
    robot = Bench(load_robot(name)).ask("stand_up")
    controller = robot.run(1.3)
    controller.watch.wakes = True
    for creep in CREEPS:
        assert robot.run(0.1, creep).mode is Mode.STAND
    for start in ((0.011, 0.0, 0.0), (0.0, 0.0, -0.011)):
        assert robot.run(0.3, start).mode is Mode.WALK
        assert controller.present.ramped_velocity == pytest.approx(start)
        assert robot.run(1.6, CREEPS[0]).mode is Mode.STAND
        assert controller.counters.command_timeouts == 0
    controller.parameters.set_all({"command.zero_speed": 0.0, "command.zero_yaw_rate": 0.0})
    assert robot.run(0.1, CREEPS[0]).mode is Mode.WALK


@pytest.mark.parametrize(
    ("name", "mode"), [("carbon", "walk"), ("carbon", "wair"), ("beta", "position_trot")]
)
def test_in_a_mode_that_was_asked_for_the_band_is_zero_too(name, mode):
    """To the bit: feet step in place where they do at zero, and stay where they stay at zero."""
    ways = []
    for command in ((0.0, 0.0, 0.0), CREEPS[2]):
        robot = Bench(load_robot(name)).ask("stand_up")
        robot.run(1.3)
        robot.ask(mode).run(0.2, (0.1, 0.0, 0.0))
        assert robot.run(0.8, command).mode.value == mode
        ways.append(robot.m.joint_position.tobytes())
    assert ways[0] == ways[1]


def test_commands_are_within_the_limits_of_the_joints_whatever_was_measured():
    robot = Bench()
    robot.m.joint_position[:] = 9.0
    command = robot.controller.tick(robot.m)
    np.testing.assert_array_equal(command.position, ROBOT.joint_upper)
    assert command.mode_of_operation == CYCLIC_TORQUE and not command.effort.any()


def test_nothing_is_begun_before_something_was_measured():
    controller = Controller(ROBOT, warm_up=False)
    assert "drives are not operational" in controller.request_mode("stand_up")[1]
    bad = Measurements(drives_operational=True, imu_age=math.nan)
    controller.tick(bad)
    assert (controller.counters.bad_measurements, controller.counters.faults) == (1, 0)
    assert controller.request_gait("gallop")[1].startswith("there is no gait 'gallop'; there are ")
    assert controller.counters.refused_requests == 2
