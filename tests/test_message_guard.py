"""The door of a node: what is let in, what is refused, and what is answered."""

import importlib
import math
import re
import time

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import Twist, TwistStamped
from hostile import genuine, mutations
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from husky_msgs.msg import (
    DriveStatusArray,
    FanCommand,
    FlightSensors,
    InclinePlan,
    InclinePlanPoint,
    ServoCommand,
)
from husky_runtime import graph
from husky_runtime.nodes.message_guard import MessageGuard, Refused, refusal
from husky_runtime.nodes.message_rules import (
    RULES,
    SELF_CHECKED,
    Numbers,
    kind_of,
    make_check,
    most_bytes,
)

ALLOWED = ("empty", "greatest", "at 100000 s 0 ns", "5000", " 8", "one short", "none")
"""What may be genuine of some kinds: greatest of an integer, a late time, a list of any length."""
KINDS = sorted({topic.type for topic in graph.TOPICS})


def message_class(kind):
    """The class of a type as the table of topics names it."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_message_has_a_check_that_lets_genuine_ones_in(kind):
    message = genuine(message_class(kind))
    check = make_check(type(message))
    assert check(message) == ""
    if kind_of(type(message)) in SELF_CHECKED:
        return  # numbers of commands are their owners' affair
    for label, wrong in mutations(message):
        rule = RULES.get(kind_of(type(message)), {}).get(label.split(" ")[0])
        unknown = getattr(rule, "unknown", False) and label.endswith("nan")
        if not unknown and not label.endswith(ALLOWED):
            assert check(wrong), f"{kind}: {label} is let in"


def test_unknown_speeds_are_told_as_nan():
    sensors = FlightSensors()
    sensors.fan_speed = [float("nan")] * 4
    assert make_check(FlightSensors)(sensors) == ""
    sensors.pressure = float("nan")
    assert "pressure is nan" in make_check(FlightSensors)(sensors)


def test_a_reason_names_the_entry_and_what_is_allowed():
    command = FanCommand()
    command.pwm, command.tilt[1] = [1500] * 4, 2501
    assert make_check(FanCommand)(command) == "tilt[1] is 2501, allowed is 0 to 2500"


@pytest.mark.parametrize("lower", [None, 0.0])
@pytest.mark.parametrize("place", range(12))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 11.0, -11.0])
def test_one_wrong_number_is_found_wherever_it_stands(monkeypatch, lower, place, bad):
    monkeypatch.setitem(RULES, "sensor_msgs/JointState", {"velocity": Numbers(10.0, lower)})
    check, joints = make_check(JointState), genuine(JointState)
    assert check(joints) == ""
    joints.velocity[place] = bad
    assert check(joints).startswith(f"velocity[{place}] is {bad}, allowed is ")


def test_the_rules_name_fields_that_are_there():
    for kind, rules in RULES.items():
        package, _, name = kind.partition("/")
        service, _, request = name.partition("_")
        module = importlib.import_module(f"{package}.{'srv' if request else 'msg'}")
        found = getattr(module, service)
        message = (getattr(found, request) if request else found)()
        for path in rules:
            value = message
            *through, last = path.split(".")
            for step in through:
                part = getattr(value, step)
                value = entry_of(value, step) if isinstance(part, list) else part
            getattr(value, last)


def entry_of(message, field):
    """Return an empty entry of a message's list of messages."""
    slots = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
    kind = slots[field].value_type
    return getattr(importlib.import_module(".".join(kind.namespaces)), kind.name)()


LONG = {
    "a million names": JointState(name=["x"] * 1_000_000),
    "a frame of a megabyte": JointState(header=Header(frame_id="x" * 1_000_000)),
    "a plan of 4096 points": InclinePlan(points=[InclinePlanPoint()] * 4096),
}


def until(look):
    """Look until there is something; return it. The test's timeout is the only limit."""
    while not (seen := look()):
        time.sleep(0.01)
    return seen


@pytest.mark.parametrize("what", LONG)
def test_a_message_that_is_too_long_is_refused_before_it_is_made(node, what):
    """It would be for longer than a tick."""
    wrong, guard, heard = LONG[what], MessageGuard(node), []
    kind = type(wrong)
    subscription = node.create_subscription(kind, "topic", heard.append, 10)
    publisher = node.create_publisher(kind, "topic", 10)
    take = guard.taker(subscription.handle, "/topic", kind, raw=False)
    until(lambda: publisher.get_subscription_count())
    publisher.publish(wrong)
    publisher.publish(kind())
    assert until(take)[0] == kind() and guard.refused == {"/topic": 1}
    assert re.fullmatch(r"/topic: \d+ bytes, \d+ are allowed", guard.last)


def test_bytes_that_are_no_message_are_refused(node):
    guard = MessageGuard(node)
    publisher = node.create_publisher(JointState, "topic", 10)
    subscription = node.create_subscription(JointState, "topic", print, 10)
    take = guard.taker(subscription.handle, "/topic", JointState, raw=False)
    until(lambda: publisher.get_subscription_count())
    publisher.publish(serialize_message(JointState(name=["left"]))[:24])
    until(lambda: take() or guard.refused)
    assert guard.last == "/topic: 24 bytes are no JointState"


def test_kinds_of_a_fixed_length_are_not_counted():
    assert most_bytes(ServoCommand) is None and most_bytes(Twist) is None
    for kind in (JointState, DriveStatusArray, Odometry, TwistStamped):
        assert most_bytes(kind) == 65_536


def test_the_longest_plan_of_ours_is_let_in():
    """Of 100 intervals, the most that the planner's parameter allows, and 8 switches of stance."""
    plan = InclinePlan(points=[InclinePlanPoint()] * (100 + 1 + 8))
    assert len(serialize_message(plan)) < 0.6 * most_bytes(InclinePlan)


def test_what_is_refused_or_fails_is_counted_and_the_node_goes_on(node):
    guard, heard = MessageGuard(node), []

    def act(message):
        heard.append(message.data)
        if message.data == "refuse":
            raise Refused("not now")
        if message.data == "fail":
            raise KeyError("a defect")

    enter = guard.guarded(act, "/topic", String, raw=False)
    for text in ("a", "refuse", "fail", "x" * 5000, "b"):
        enter(String(data=text))
    assert heard == ["a", "refuse", "fail", "b"]
    assert guard.refused == {"/topic": 2} and guard.failures == 1
    assert guard.last == "/topic: data has 5000 characters, 4096 are allowed"


def test_a_no_is_in_the_words_of_the_request():
    assert refusal(Trigger.Request(), Trigger.Response(), "why").message == "why"
    assert not refusal(ChangeState.Request(), ChangeState.Response(), "why").success
    many = SetParameters.Request(parameters=[Parameter()] * 3)
    results = refusal(many, SetParameters.Response(), "why").results
    assert [(each.successful, each.reason) for each in results] == [(False, "why")] * 3
    request = SetParametersAtomically.Request()
    result = refusal(request, SetParametersAtomically.Response(), "why").result
    assert (result.successful, result.reason) == (False, "why")
    assert refusal(GetParameters.Request(), GetParameters.Response(), "why").values == []
