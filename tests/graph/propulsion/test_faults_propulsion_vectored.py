"""What becomes of a force in any direction when something fails.

The unit is held in place; this test is its controller.
"""

import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_pu.autopilot.mixer import Mixer
from husky_runtime import graph

pytestmark = pytest.mark.graph

UP_THE_WALL = np.array((0.8, 0.0, -0.6))
"""Forward and down in base."""
FORCE = 32.0
MOMENT_PER_THRUST = Mixer(load_robot()).fan.moment_per_thrust
"""Drag of a rotor over its thrust [m]."""
NO_THRUST = 0.5
"""Of all fans, that counts as none [N]."""


@pytest.fixture
def companion(vectoring_of_module):
    vectoring_of_module.arm()
    return vectoring_of_module


def torque(session):
    """Return the moment of all fans about base's origin, in base [N m] (3,)."""
    t = session.fans.wrench.torque
    return np.array((t.x, t.y, t.z))


def falls(made):
    """The force only falls, along the direction that it had."""
    length = np.linalg.norm(made, axis=1)
    assert (length - np.minimum.accumulate(length)).max() < 0.3
    along = made @ (made[0] / length[0])
    assert np.linalg.norm(made - along[:, None] * made[0] / length[0], axis=1).max() < 0.5
    return length


def test_vectored_commands_stop(companion, record_property):
    companion.pushes(FORCE * UP_THE_WALL)
    times, made = companion.silence(2.5)
    length = falls(made)
    record_property("reaction_s", times[length > NO_THRUST][-1] - times[0])
    assert times[length > NO_THRUST][-1] - times[0] < 2.0
    assert not companion.session.propulsion.armed


@pytest.mark.slow  # in one process: `test_after_a_loss_thrust_only_falls_and_its_axis_stays[kill]`
def test_vectored_thrust_killed(companion, record_property):
    companion.pushes(FORCE * UP_THE_WALL)
    companion.robot.trigger(graph.PROPULSION_KILL)
    times, made = companion.silence(1.5)
    length = falls(made)
    record_property("reaction_s", times[length > NO_THRUST][-1] - times[0])
    assert times[length > NO_THRUST][-1] - times[0] < 1.0


@pytest.mark.slow  # in one process: `test_one_fan_lost_the_rest_keep_the_direction_...`
def test_vectored_fan_lost(companion, record_property):
    s = companion.session
    force = FORCE * UP_THE_WALL
    companion.pushes(force)
    assert s.propulsion.thrust_limit > 70.0
    before = torque(s)
    failed = s.time
    s.inject(graph.PLANT_INJECT_FAULT, "front_left_fan", "fail")
    while all(s.propulsion.fan_ok):
        assert s.time < failed + 0.5, "nobody says that a fan is lost"
        companion.ask(force, 0.02)
    record_property("reaction_s", s.time - failed)
    assert list(s.propulsion.fan_ok) == [False, True, True, True]
    assert s.propulsion.reason == "Fan front_left lost"
    # The three that are left make the force again, without a moment.
    companion.pushes(force, 1.5)
    assert 36.0 < s.propulsion.thrust_limit < 50.0  # of a full pack, which sags
    # Yaw is given up: what is left of the rotors' drag turns about the thrust's axis alone.
    change = torque(s) - before
    drag = MOMENT_PER_THRUST * FORCE
    np.testing.assert_allclose(change, -drag * np.sign(change[2]) * UP_THE_WALL, atol=0.1)
    companion.robot.reported(graph.PIXHAWK_BRIDGE, "fan lost: front_left")


@pytest.mark.slow
def test_vectored_flight_controller_dies(companion, record_property):
    s = companion.session
    companion.pushes(FORCE * UP_THE_WALL)
    s.kill(graph.FLIGHT_CONTROLLER)
    times, made = companion.silence(2.0)
    length = falls(made)
    record_property("reaction_s", times[length > NO_THRUST][-1] - times[0])
    assert times[length > NO_THRUST][-1] - times[0] < 1.5
    s.start(graph.FLIGHT_CONTROLLER)
    companion.arm()  # the new one, as usual
