"""Time for which the servos' line waits for an answer; no line is opened."""

import math
from types import SimpleNamespace

import pytest

from husky_drivers.dynamixel import port as port_module
from husky_drivers.dynamixel.port import DynamixelPort


@pytest.fixture
def clock(monkeypatch):
    """A wall clock that the test moves."""
    clock = SimpleNamespace(now=1000.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(port_module, "time", clock)
    return clock


def waits(clock, longest_look):
    """Return for how long an answer is awaited after a stop of 20 s, looked for every 10 ms [s]."""
    port = DynamixelPort("no line", 1_000_000, 0.6, longest_look=longest_look)
    port.setPacketTimeout(20)
    clock.now += 20.0
    begun = clock.now
    while not port.isPacketTimeout():
        clock.now += 0.01
    return clock.now - begun


def test_after_a_stop_of_the_master_an_answer_may_still_come(clock):
    assert waits(clock, 0.1) == pytest.approx(0.5, abs=0.011)


def test_on_the_robot_an_answer_is_late_however_it_came_about(clock):
    assert waits(clock, math.inf) == 0.0
