"""Nodes of the propulsion unit that die while the robot trots with its help."""

import pytest

from husky_runtime import graph

pytestmark = pytest.mark.graph

RISE_RATE = 80.0
"""The bridge's `thrust_rate` [N/s]."""


def test_pixhawk_bridge_killed(assisted, record_property):
    robot, s = assisted.robot, assisted.session
    died = assisted.watch()
    s.kill(graph.PIXHAWK_BRIDGE)
    record_property("reaction_s", assisted.thrust_ends(died))
    record_property("heights_m", assisted.trots_on())
    robot.reported(graph.FLIGHT_CONTROLLER, "pixhawk_bridge lost")
    s.start(graph.PIXHAWK_BRIDGE)
    back = assisted.watch()
    s.advance(0.5)
    assert assisted.rise(back) == 0.0, "fans turn though nobody has armed them"
    assert not s.propulsion.armed, assisted.seen
    assisted.recover()


@pytest.mark.slow
def test_pixhawk_bridge_started_again_at_once(assisted, record_property):
    """Before the flight controller misses it: its thrust begins at zero and comes back slowly."""
    s = assisted.session
    died = assisted.watch()
    s.kill(graph.PIXHAWK_BRIDGE)
    s.start(graph.PIXHAWK_BRIDGE)
    s.advance(2.2)
    times, thrusts = assisted.thrusts()
    total = thrusts.sum(axis=1)
    record_property("lowest_n", total.min())
    record_property("highest_n", total.max())
    record_property("rise_in_100_ms_n", (total[10:] - total[:-10]).max())
    record_property("at_the_end", (died, times[-1], total[-1], s.propulsion.armed))
    assert total.max() < 1.1 * total[0], assisted.seen
    assert (total[10:] - total[:-10]).max() < RISE_RATE * 0.1, assisted.seen
    record_property("heights_m", assisted.trots_on())
    assisted.recover()


def test_flight_controller_killed(assisted, record_property):
    robot, s = assisted.robot, assisted.session
    died = assisted.watch()
    s.kill(graph.FLIGHT_CONTROLLER)
    record_property("reaction_s", assisted.thrust_ends(died))
    record_property("heights_m", assisted.trots_on())
    assert not s.propulsion.connected, assisted.seen
    robot.reported(graph.PLANT, "flight_controller is lost")
    robot.reported(graph.PIXHAWK_BRIDGE, "no port")
    s.start(graph.FLIGHT_CONTROLLER)
    robot.reported(graph.FLIGHT_CONTROLLER, "no sensors", "disarmed")
    back = assisted.watch()
    s.advance(0.5)
    assert assisted.rise(back) == 0.0, "fans turn though nobody has armed them"
    assisted.recover()


@pytest.mark.slow
def test_controller_killed_while_assisting(assisted, record_property):
    """The drives put the robot down, and the fans let it."""
    robot, s = assisted.robot, assisted.session
    died = assisted.watch()
    s.kill(graph.LOW_LEVEL_CONTROLLER)
    record_property("reaction_s", assisted.thrust_ends(died))
    record_property("torque_s", robot.put_down(died))
    robot.reported(graph.DRIVE_BRIDGE, "low_level_controller is lost")
    s.start(graph.LOW_LEVEL_CONTROLLER)
    back = assisted.watch()
    s.advance(0.5)
    assert assisted.rise(back) == 0.0, "fans turn though nobody has armed them"
    assert not s.propulsion.armed, assisted.seen
    assisted.recover()


# In one process: `test_on_an_incline_it_is_put_down_along_the_slope` (a stop, the fans fade),
# `test_other_modes_ask_for_nothing_within_a_second_however_slow_the_slew`.
@pytest.mark.slow
def test_emergency_stop_while_assisting(assisted, record_property):
    """The robot is put down, and the fans end."""
    robot = assisted.robot
    stopped = assisted.watch()
    assert not robot.trigger(graph.DRIVES_EMERGENCY_STOP)
    record_property("reaction_s", assisted.thrust_ends(stopped))
    record_property("torque_s", robot.put_down(stopped))
    assert robot.mode == "damping", assisted.seen
    assisted.recover()
