"""The autopilot's parameters that somebody else has set: read and judged, never written."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink
from scripted_autopilot import PARAMETERS

from husky_description.robot import load_robot
from husky_pu.autopilot.airframe import airframe_parameters
from husky_pu.autopilot.flight_parameters import TABLE
from husky_pu.companion.flight_settings import ARDUPILOT, FlightSettings, rules_of
from husky_pu.companion.telemetry import PX4

RULES = rules_of(6)
NAMES = {rule.name for rule in RULES[PX4]}
WRONG = {
    "COM_OF_LOSS_T": (60.0, "COM_OF_LOSS_T is 60, allowed 0.1 to 1: ", True),
    "COM_OBL_RC_ACT": (0, "COM_OBL_RC_ACT is 0, allowed 4 or 6 or 7: ", True),
    "NAV_RCL_ACT": (2, "NAV_RCL_ACT is 2, allowed 3 or 5 or 6: ", True),
    "RC_MAP_KILL_SW": (0, "RC_MAP_KILL_SW is 0, allowed 1 to 16: the pilot has no kill", True),
    "MC_AIRMODE": (1, "MC_AIRMODE is 1, allowed 0: ", True),
    "COM_RC_IN_MODE": (4, "COM_RC_IN_MODE is 4, allowed 0 or 2 or 3: the radio", False),
    "COM_RC_LOSS_T": (35.0, "COM_RC_LOSS_T is 35, allowed 0 to 1: ", False),
    "COM_LOW_BAT_ACT": (0, "COM_LOW_BAT_ACT is 0, allowed 2 or 3: ", False),
    "BAT1_N_CELLS": (4, "BAT1_N_CELLS is 4, allowed 6: ", False),
    "MPC_THR_MAX": (0.5, "MPC_THR_MAX is 0.5, allowed 1: ", False),
    "FD_FAIL_R": (60, "FD_FAIL_R is 60, allowed 0: ", False),
    "FD_FAIL_P": (60, "FD_FAIL_P is 60, allowed 0: ", False),
    "PWM_MAIN_DISARM": (1050, "PWM_MAIN_DISARM is 1050, allowed 800 to 1000: ", False),
    "RC_MAP_ROLL": (4, "RC_MAP_ROLL is 4, allowed 1: ", False),
    "RC_MAP_PITCH": (3, "RC_MAP_PITCH is 3, allowed 2: ", False),
    "RC_MAP_THROTTLE": (1, "RC_MAP_THROTTLE is 1, allowed 3: ", False),
    "RC_MAP_YAW": (1, "RC_MAP_YAW is 1, allowed 4: ", False),
    "RC_MAP_OFFB_SW": (7, "RC_MAP_OFFB_SW is 7, allowed 5: ", False),
    "RC_MAP_ARM_SW": (5, "RC_MAP_ARM_SW is 5, allowed 6: ", False),
}


@pytest.fixture
def told(make_autopilot, make_pair):
    """Opinion of the client on an autopilot with some parameters."""

    def connect(changed=(), autopilot=PX4, system=0):
        pair = make_pair(make_autopilot(autopilot=autopilot), rules=RULES, target_system=system)
        pair.autopilot.parameters |= dict(changed)
        return pair.connect()

    return connect


def test_an_autopilot_as_it_should_be_is_read_and_never_written(told):
    pair = told()
    asked = pair.autopilot.of("PARAM_REQUEST_READ")
    assert {m.param_id for m in asked} == NAMES == set(PARAMETERS) == set(WRONG)
    assert {(m.target_system, m.target_component, m.param_index) for m in asked} == {(1, 1, -1)}
    settings = pair.client.settings
    assert settings.settled and not settings.unread
    assert settings.problems(unsafe=True) == settings.problems(unsafe=False) == []
    assert not pair.autopilot.of("PARAM_SET")


@pytest.mark.parametrize("name", WRONG)
def test_a_parameter_that_somebody_has_set_is_named_with_what_is_allowed(told, name):
    value, words, unsafe = WRONG[name]
    pair = told({name: value})
    (problem,) = pair.client.settings.problems(unsafe=unsafe)
    assert problem.startswith(words)
    assert pair.client.settings.problems(unsafe=not unsafe) == []
    assert not pair.autopilot.of("PARAM_SET")


def test_a_change_that_is_announced_later_counts(told):
    pair = told()
    pair.autopilot.parameters["COM_OF_LOSS_T"] = 30.0
    pair.autopilot.tell("COM_OF_LOSS_T")
    pair.carry()
    assert len(pair.client.settings.problems(unsafe=True)) == 1


def test_a_number_that_is_none_is_not_allowed(told):
    assert told({"COM_OF_LOSS_T": math.nan}).client.settings.problems(unsafe=True)


def test_answers_that_are_lost_are_asked_for_again_five_times(told):
    pair = told({"COM_OF_LOSS_T": None, "FD_FAIL_R": None})
    settings = pair.client.settings
    pair.wait(2.0)
    assert settings.settled and settings.unread == ["COM_OF_LOSS_T", "FD_FAIL_R"]
    asked = [m.param_id for m in pair.autopilot.of("PARAM_REQUEST_READ")]
    assert asked.count("COM_OF_LOSS_T") == 5 and asked.count("NAV_RCL_ACT") == 1
    (problem,) = settings.problems(unsafe=True)  # the other is one that some versions lack
    assert problem.startswith("COM_OF_LOSS_T is not told, allowed 0.1 to 1: ")
    assert settings.problems(unsafe=False) == []


def test_a_parameter_that_there_is_not_is_not_asked_for_again(told):
    pair = told({"FD_FAIL_R": None})
    pair.autopilot.send(
        mavlink.MAVLink_param_error_message(
            1, 191, b"FD_FAIL_R", -1, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
        )
    )
    pair.carry()
    assert pair.client.settings.settled
    assert pair.client.settings.problems(unsafe=False) == []


def test_a_restart_reads_everything_again(told):
    pair = told()
    pair.autopilot.telemetry(5000)
    pair.carry()
    pair.autopilot.parameters["COM_OBL_RC_ACT"] = 0
    for boot_ms in (20, 40, 60, 80, 100, 120, 140):
        pair.autopilot.telemetry(boot_ms)
        pair.carry()
    pair.wait(0.5)
    assert pair.client.telemetry.boots == 1
    assert len(pair.client.settings.problems(unsafe=True)) == 1


def test_an_autopilot_that_is_known_by_its_number_alone_is_read_when_it_says_what_it_is(
    make_autopilot, make_pair
):
    pair = make_pair(make_autopilot(), rules=RULES, target_system=1)
    pair.autopilot.telemetry(20)
    pair.carry()
    assert pair.client.connected and not pair.client.settings.settled
    pair.autopilot.heartbeat()
    pair.carry()
    pair.wait(0.1)
    assert pair.client.settings.settled and not pair.client.settings.unread


@pytest.mark.parametrize(
    ("options", "timeout", "problems"), [(8.0, 1.0, 0), (9.0, 0.5, 0), (0.0, 1.0, 1), (7.0, 3.0, 2)]
)
def test_of_ardupilot_it_needs_other_parameters(told, options, timeout, problems):
    """Its integers come as plain numbers."""
    pair = told({"GUID_OPTIONS": options, "GUID_TIMEOUT": timeout}, autopilot=ARDUPILOT)
    assert len(pair.client.settings.problems(unsafe=True)) == problems
    assert {m.param_id for m in pair.autopilot.of("PARAM_REQUEST_READ")} == {
        "GUID_OPTIONS",
        "GUID_TIMEOUT",
    }


@pytest.mark.parametrize("name", ["carbon", "beta"])
def test_the_simulated_autopilot_is_as_it_should_be(name):
    robot = load_robot(name)
    held = {key: row.default for key, row in TABLE.items()} | airframe_parameters(robot)
    for rule in rules_of(robot.battery.cells)[PX4]:
        assert rule.accepts(float(held[rule.name])), rule.name


def test_without_rules_nothing_is_asked():
    settings = FlightSettings({})
    settings.begin(PX4)
    assert settings.settled and settings.due(0.0) == []
