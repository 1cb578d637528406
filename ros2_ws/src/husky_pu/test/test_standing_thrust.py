"""Arming asks for no thrust: what was asked for before counts only when it is asked for anew."""

import numpy as np
import pytest
from test_autopilot_flight import DT, LEVEL, Rig, dialect, pulses

from husky_pu.autopilot.failsafes import FlightMode

SHARE = 0.37
FORCE = 21196


def attitude(rig, share):
    rig.setpoint = lambda: rig.attitude_message(LEVEL, share)


def wrench(rig, share):
    controls = [0.0, 0.0, 0.0, share, 0.0, 0.0, 0.0, 0.0]
    rig.setpoint = lambda: dialect.MAVLink_set_actuator_control_target_message(
        rig.time_ns // 1000, 0, 1, 1, controls
    )


def sticks(rig, share):
    rig.rc = lambda: pulses(throttle=1000 + 1000 * share)


@pytest.mark.parametrize("ask", [attitude, wrench, sticks])
def test_thrust_that_stands_at_arming_is_asked_for_anew(ask):
    rig = Rig(grounded=True)
    ask(rig, SHARE)
    rig.run(2.5)
    if ask is not sticks:
        rig.command(176, 1, 6)
    rig.command(400, 1, FORCE)
    log = rig.run(2.0)
    assert rig.logic.armed, rig.texts()
    assert not log[:, 4].any() and log[-1, 5] < 0.2  # N: the fans idle
    assert "No thrust until it is asked for anew from low" in rig.texts()
    ask(rig, 0.0)
    rig.run(0.1)
    ask(rig, SHARE)
    log = rig.run(1.5)
    assert np.diff(log[:, 4]).max() <= DT * 1.0 + 1e-12
    assert log[-1, 4] == pytest.approx(SHARE, abs=0.01)


def test_nor_does_a_change_of_mode_let_it_loose():
    rig = Rig(grounded=True)
    attitude(rig, SHARE)
    rig.run(2.5)
    rig.command(400, 1, FORCE)
    rig.run(0.5)
    rig.command(176, 1, 6)
    log = rig.run(2.0)
    assert rig.logic.armed and rig.logic.mode is FlightMode.OFFBOARD
    assert not log[:, 4].any()


def test_a_stream_that_begins_after_arming_counts():
    rig = Rig(grounded=True)
    rig.run(2.5)
    rig.command(400, 1, FORCE)
    attitude(rig, SHARE)
    rig.run(0.5)
    rig.command(176, 1, 6)
    assert rig.run(2.0)[-1, 4] == pytest.approx(SHARE, abs=1e-6)


def test_in_flight_a_companion_may_take_over_with_what_it_asked_for_all_along():
    rig = Rig(grounded=True)
    attitude(rig, SHARE)
    sticks(rig, 0.0)
    rig.run(2.5)
    rig.command(400, 1)
    rig.run(0.1)
    assert rig.logic.armed
    sticks(rig, 0.5)
    rig.run(1.0)
    rig.command(176, 1, 6)
    assert rig.run(1.0)[:, 4].min() >= SHARE - 1e-6
