"""Velocity commands and parameters that are wrong, or do not come."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Twist

from husky_experiments.session import SessionError
from husky_runtime import graph

pytestmark = pytest.mark.graph


def twist(vx: float = 0.0, vy: float = 0.0, yaw_rate: float = 0.0) -> Twist:
    """A velocity command."""
    message = Twist()
    message.linear.x, message.linear.y, message.angular.z = vx, vy, yaw_rate
    return message


BAD_VELOCITIES = [
    {"vx": math.nan},
    {"vy": math.nan},
    {"yaw_rate": math.nan},
    {"vx": math.inf},
    {"vx": -math.inf},
    {"vx": 9.0},
    {"vy": -9.0},
    {"vx": 0.1, "yaw_rate": 99.0},
]


def test_bad_velocity_commands_among_good_ones(trotting):
    """Each is refused whole and counted; the last good one stays."""
    s = trotting.session
    refused, command = s.state.refused_commands, list(s.state.commanded_velocity)
    for bad in BAD_VELOCITIES:
        s.publish_twist(twist(**bad))
    s.advance(0.4)
    assert s.state.refused_commands == refused + len(BAD_VELOCITIES), trotting.seen
    assert trotting.mode == "walk" and np.isfinite(s.state.position).all(), trotting.seen
    assert list(s.state.commanded_velocity) == pytest.approx(command), trotting.seen


def test_parameters_that_do_not_fit(trotting):
    """One that does not fit what is set is refused with the reason; the robot trots on."""
    s, node = trotting.session, graph.LOW_LEVEL_CONTROLLER
    reason = r"liftoff_force \(8 N\) must not be above contact\.touchdown_force \(6 N\)"
    s.set_parameter(node, "contact.touchdown_force", 6.0)
    try:
        with pytest.raises(SessionError, match=reason):
            s.set_parameter(node, "contact.liftoff_force", 8.0)
    finally:
        s.set_parameter(node, "contact.touchdown_force", 10.0)
    s.set_parameter(node, "contact.liftoff_force", 8.0)  # The first was not taken, this one is.
    s.set_parameter(node, "contact.liftoff_force", 5.0)
    s.advance(0.4)
    assert trotting.mode == "walk", trotting.seen


def test_only_bad_velocity_commands(trotting, record_property):
    """They count as silence: a program gone mad does not keep a robot going."""
    s = trotting.session
    s.release_velocity()
    start = s.time

    def stands() -> bool:
        s.publish_twist(twist(math.nan))
        return trotting.mode == "stand"

    trotting.until(stands, "stand", within=2.0, step=0.05)
    record_property("reaction_s", s.time - start)
    assert s.drives.operational and trotting.height > 0.5, trotting.seen


def test_velocity_command_silent(trotting, record_property):
    s = trotting.session
    s.release_velocity()
    took = trotting.until(lambda: trotting.mode == "stand", "stand", within=2.0)
    record_property("reaction_s", took)
    assert took > 0.3, "0.5 s of silence, 0.2 s of which may have gone by"
    assert trotting.told(graph.LOW_LEVEL_CONTROLLER, "command_timeouts") >= 1
    s.advance(0.5)
    assert s.drives.operational and trotting.height > 0.5, trotting.seen
    x = s.truth.pose.pose.position.x
    s.advance(0.5)
    way = abs(s.truth.pose.pose.position.x - x)
    assert way < 0.03, f"a robot that stands makes no way, not {way:.3f} m in 0.5 s"
