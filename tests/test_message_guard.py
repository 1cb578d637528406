"""The door of a node: what is let in, what is refused, and what is answered."""

import importlib

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import Quaternion
from hostile import mutations
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from husky_msgs.msg import DriveStatus, DriveStatusArray, FlightSensors, ServoCommand
from husky_runtime import graph
from husky_runtime.nodes.message_guard import MessageGuard, Refused, refusal
from husky_runtime.nodes.message_rules import RULES, SELF_CHECKED, kind_of, make_check

ALLOWED = ("empty", "greatest", "at 100000 s 0 ns", "5000", "one short", "none")
"""What may be genuine of some kinds: greatest of an integer, a late time, a list of any length."""
KINDS = sorted({topic.type for topic in graph.TOPICS})


def genuine(kind):
    """A message of a kind as a node of ours may send it."""
    package, _, name = kind.split("/")
    message = getattr(importlib.import_module(f"{package}.msg"), name)()
    if isinstance(message, JointState):
        message.position = message.velocity = message.effort = [0.1] * 12
    if isinstance(message, DriveStatusArray):
        message.drives = [DriveStatus()] * 12
    if hasattr(message, "orientation") and not isinstance(message.orientation, Quaternion):
        message.orientation[3] = 1.0
    return message


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_message_has_a_check_that_lets_genuine_ones_in(kind):
    message = genuine(kind)
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
    sensors.fan_speed[:] = float("nan")
    assert make_check(FlightSensors)(sensors) == ""
    sensors.pressure = float("nan")
    assert "pressure is nan" in make_check(FlightSensors)(sensors)


def test_a_reason_names_the_entry_and_what_is_allowed():
    command = ServoCommand()
    command.kind[8], command.kp[3] = 7, -1.0
    check = make_check(ServoCommand)
    assert check(command) == "kind[8] is 7, allowed is 0 to 3"
    command.kind[8] = 0
    assert check(command) == "kp[3] is -1.0, allowed is 0 to 10000"


def test_the_rules_name_fields_that_are_there():
    for kind, rules in RULES.items():
        package, name = kind.split("/")
        message = getattr(importlib.import_module(f"{package}.msg"), name)()
        for path in rules:
            value = message
            for step in path.split("."):
                value = getattr(value, step)


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
