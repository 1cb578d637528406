"""Fans, battery and camera that fail while the robot trots with their help."""

import pytest
from nav_msgs.msg import Odometry

from husky_runtime import graph
from husky_runtime.nodes import stamps

pytestmark = pytest.mark.graph

SETTLED = 0.3
"""The voltage falls at once, and with it the thrust, which the autopilot then makes up for [s]."""


def test_fan_lost_while_trotting(assisted, record_property):
    """The autopilot finds it, tells it, and gives its share to the others: no moment is left."""
    s = assisted.session
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "front_left_fan", "fail")
    s.advance(1.6)
    times, thrusts = assisted.thrusts()
    record_property("reaction_s", times[thrusts[:, 0] > 0.2][-1] - failed)
    record_property("rise_n", assisted.rise(failed))
    record_property("others_n", (thrusts[0, 1:].sum(), thrusts[-1, 1:].sum()))
    record_property("others_max_n", thrusts[:, 1:].sum(axis=1).max())
    record_property("heights_m", assisted.trots_on())
    assert thrusts[-1, 0] < 0.05, assisted.seen
    assert list(s.propulsion.fan_ok) == [False, True, True, True], assisted.seen
    assert s.propulsion.reason == "Fan front_left lost" and s.propulsion.thrust_limit < 50.0
    assisted.robot.reported(graph.PIXHAWK_BRIDGE, "fan lost: front_left")
    # The share that was asked for, within what moments of the controller take from it.
    assert abs(thrusts[-1].sum() - thrusts[0].sum()) < 0.1 * thrusts[0].sum(), assisted.seen
    assert s.propulsion.armed and not s.propulsion.failsafe, assisted.seen
    assisted.recover()


# In one process: `test_critical_battery`, `test_every_check_by_itself` (arming is refused). Without
# its fans the robot trots on: `test_flight_controller_killed`.
@pytest.mark.slow
@pytest.mark.parametrize("charge", ["0.0", "0.05"])
def test_battery_empty(assisted, record_property, charge):
    s = assisted.session
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "battery", charge)
    record_property("reaction_s", assisted.thrust_ends(failed, SETTLED))
    record_property("heights_m", assisted.trots_on())
    assert not s.propulsion.armed, assisted.seen
    assert "attery" in s.propulsion.reason or "isarmed" in s.propulsion.reason, assisted.seen
    answer = assisted.arming_refused()
    assert "battery" in answer, answer
    assisted.recover()


def test_t265_freezes(assisted):
    """No foot and no fan follows the camera."""
    s = assisted.session
    poses = assisted.robot.tap(Odometry, graph.T265_ODOMETRY)
    s.advance(0.2)
    assert len(poses.drain()) > 20, assisted.seen
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "t265", "freeze")
    s.advance(0.5)
    late = [m for m in poses.drain() if stamps.to_ns(m.header.stamp) / 1e9 > failed + 0.01]
    assert not late, f"{len(late)} poses of a frozen camera"
    assisted.trots_on()
    assert assisted.helps(failed), assisted.seen
    s.inject(graph.PLANT_INJECT_FAULT, "t265", "")
    poses.clear()
    s.advance(0.2)
    assert len(poses.drain()) > 20, assisted.seen


def test_t265_jumps(assisted):
    """Its driver tells; nobody else needs to know."""
    s, robot = assisted.session, assisted.robot
    before = robot.told(graph.T265_DRIVER, "jumps")
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "t265", "jump")
    s.advance(0.5)
    assert robot.told(graph.T265_DRIVER, "jumps") - before == 1
    assisted.trots_on()
    assert assisted.helps(failed), assisted.seen
