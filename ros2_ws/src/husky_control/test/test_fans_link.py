"""What a tick knows of the propulsion unit."""

import math

import pytest
from fake_node import FakeNode
from scipy.spatial.transform import Rotation

pytest.importorskip("rclpy")

from husky_control.nodes.fans_link import FansLink
from husky_control.tick_data import Measurements
from husky_msgs.msg import PropulsionState
from husky_runtime.nodes import stamps
from husky_runtime.nodes.message_guard import Refused

MS = 1_000_000


def state(milliseconds, **fields):
    message = PropulsionState(
        connected=True,
        armed=True,
        mode="OFFBOARD",
        fan_speed=[0.0] * 4,
        fan_ok=[True] * 4,
        thrust_limit=50.0,
    )
    stamps.fill(message.stamp, milliseconds * MS)
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def known(milliseconds, *states, lockstep=True):
    """What a tick of this time knows when these states have come."""
    node, measurements = FakeNode(), Measurements()
    link = FansLink(node, 4, 1.0, lockstep=lockstep)
    for each in states:
        node.say(each)
    link.await_tick(milliseconds * MS)
    link.fill(milliseconds * MS, measurements)
    return measurements


@pytest.mark.parametrize("states", [(), (state(0, connected=False, armed=False),)])
def test_a_unit_that_is_not_there_is_neither_used_nor_disarmed(states):
    m = known(100, *states)
    assert (m.fans_available, m.fans_disarmed, m.fans_limit) == (False, False, math.inf)
    assert math.isnan(m.fans_yaw)


def test_an_armed_unit_is_used_with_its_heading():
    sample = state(0)
    q = sample.attitude
    q.x, q.y, q.z, q.w = Rotation.from_euler("ZYX", [1.2, 0.1, -0.2]).as_quat().tolist()
    m = known(100, sample)
    assert (m.fans_available, m.fans_disarmed, m.fans_limit) == (True, False, math.inf)
    assert m.fans_yaw == pytest.approx(1.2)


@pytest.mark.parametrize("fields", [{"armed": False}, {"mode": "MANUAL"}, {"failsafe": True}])
def test_a_unit_that_does_not_follow_is_not_used(fields):
    m = known(100, state(0, **fields))
    assert not m.fans_available
    assert m.fans_disarmed == ("armed" in fields)


def test_a_lost_fan_limits_the_thrust():
    m = known(100, state(0, fan_ok=[True, False, True, True]))
    assert (m.fans_limit, m.fans_lost) == (50.0, 1)
    assert known(100, state(0)).fans_lost == -1


@pytest.mark.parametrize(("field", "value"), [("fan_ok", False), ("fan_speed", 0.0)])
@pytest.mark.parametrize("count", [0, 3, 8])
def test_a_unit_with_another_number_of_fans_is_refused(field, value, count):
    with pytest.raises(Refused, match=f"{field} holds {count} values, it must be 4"):
        known(100, state(0, **{field: [value] * count}))


def test_a_state_is_known_after_a_fixed_time_in_lockstep_and_too_old_after_another():
    assert not known(59, state(0)).fans_available
    assert known(60, state(0)).fans_available
    assert known(1, state(0), lockstep=False).fans_available
    assert known(299, state(0)).fans_available
    assert not known(300, state(0)).fans_available
