"""The process `foxglove_gateway` between a client that knows no ROS and a node of the test's."""

from __future__ import annotations

import base64
from typing import Any

import pytest

pytest.importorskip("rclpy")

from gateway_bench import (
    CMD_VEL,
    DESCRIPTION,
    JOINTS,
    NOW_NS,
    SPEED,
    AloneBench,
    joint_state,
)
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from husky_runtime.nodes.one_clock import ROSOUT

pytestmark = pytest.mark.graph


# Topics ---------------------------------------------------------------------------------------
def test_a_client_reads_by_the_schema_that_it_is_given(gateway: AloneBench) -> None:
    client = gateway.client()
    channel = client.channels[JOINTS]
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
    assert "# This is a message that holds data to describe the state" in channel["schema"]
    heard = gateway.hear(client, JOINTS, gateway.joints)
    gateway.tell_time(NOW_NS)
    stamp = NOW_NS + 2_000_000
    gateway.wait(
        lambda: heard, "a message", lambda: gateway.joints.publish(joint_state(stamp, 0.25))
    )
    first = heard[0]
    assert (first.message.name, list(first.message.position)) == (["knee"], [0.25])
    assert deserialize_message(first.data, JointState) == joint_state(stamp, 0.25)
    assert first.log_time == stamp


def test_a_stamp_of_another_clock_is_no_log_time(gateway: AloneBench) -> None:
    client = gateway.client()
    heard = gateway.hear(client, JOINTS, gateway.joints)
    gateway.tell_time(NOW_NS)
    odd = joint_state(1_700_000_000_000_000_000, 0.0)
    gateway.wait(lambda: heard, "a message", lambda: gateway.joints.publish(odd))
    assert heard[0].log_time == NOW_NS


def test_a_fast_topic_is_thinned_out_and_a_slow_one_is_whole(gateway: AloneBench) -> None:
    """The newest message always comes; of those on demand none is lost."""
    client = gateway.client()
    joints = gateway.hear(client, JOINTS, gateway.joints)
    words = gateway.hear(client, "/words", gateway.words)
    for number in range(90):
        gateway.joints.publish(joint_state(0, float(number)))
        gateway.words.publish(String(data=str(number)))
    gateway.wait(lambda: len(words) == 90, "every word")
    gateway.wait(lambda: joints and joints[-1].message.position[0] == 89.0, "the last state")
    assert [each.message.data for each in words] == [str(number) for number in range(90)]
    assert len(joints) < 45


def test_a_topic_is_subscribed_to_while_somebody_listens(gateway: AloneBench) -> None:
    one, other = gateway.client(), gateway.client()
    assert gateway.words.get_subscription_count() == 0
    gateway.hear(one, "/words", gateway.words)
    heard = other.subscribe("/words")
    gateway.wait(lambda: heard, "a word", lambda: gateway.words.publish(String(data="here")))
    assert gateway.words.get_subscription_count() == 1
    one.unsubscribe("/words")
    count = len(heard)
    gateway.wait(
        lambda: len(heard) > count + 5, "more", lambda: gateway.words.publish(String(data="more"))
    )
    other.break_off()
    gateway.wait(lambda: gateway.words.get_subscription_count() == 0, "nobody to listen")


def test_a_newcomer_is_told_what_was_said_before(gateway: AloneBench) -> None:
    gateway.description.publish(String(data="<robot/>"))
    for _ in range(2):
        heard = gateway.client().subscribe(DESCRIPTION)
        gateway.wait(lambda heard=heard: heard, "the description")
        assert heard[0].message.data == "<robot/>"


def test_no_line_of_the_log_comes_twice(gateway: AloneBench) -> None:
    log = gateway.node.create_publisher(Log, "/rosout", ROSOUT)
    one, other = gateway.client(), gateway.client()
    gateway.wait(lambda: "/rosout" in one.channels and "/rosout" in other.channels, "the log")
    first = one.subscribe("/rosout")
    log.publish(Log(msg="a line"))
    gateway.wait(lambda: [r for r in first if r.message.msg == "a line"], "the line")
    second = other.subscribe("/rosout")
    gateway.wait(lambda: second, "a line for the newcomer", lambda: log.publish(Log(msg="more")))
    assert sum(r.message.msg == "a line" for r in first) == 1


# Services and parameters ----------------------------------------------------------------------
def test_a_service_is_called_with_raw_messages(gateway: AloneBench) -> None:
    client = gateway.client()
    service = client.services["/enable"]
    assert service["type"] == "std_srvs/srv/SetBool"
    assert service["request"]["schemaName"] == "std_srvs/srv/SetBool_Request"
    assert "bool data" in service["request"]["schema"]
    assert "string message" in service["response"]["schema"]
    call = client.call("/enable", serialize_message(SetBool.Request(data=True)))
    gateway.wait(lambda: call in client.answers, "the answer")
    answer = deserialize_message(client.answers[call], SetBool.Response)
    assert (gateway.enabled, answer.message) == ([True], "it is done")


def test_what_is_no_request_is_a_failure_with_its_reason(gateway: AloneBench) -> None:
    client = gateway.client()
    call = client.call("/enable", b"")
    gateway.wait(lambda: call in client.answers, "the failure")
    assert client.answers[call] == "ValueError: 0 bytes are no SetBool_Request"
    assert gateway.enabled == []


def test_a_service_that_leaves_is_no_longer_offered(gateway: AloneBench) -> None:
    service = gateway.node.create_service(Trigger, "visitor", lambda request, response: response)
    client = gateway.client()
    gateway.wait(lambda: "/visitor" in client.services, "the visitor")
    gateway.node.destroy_service(service)
    gateway.wait(lambda: "/visitor" not in client.services, "its end")
    names = gateway.node.get_service_names_and_types
    gateway.wait(lambda: "/visitor" not in dict(names()), "the end of the gateway's own ear for it")


def test_parameters_are_read_set_and_watched(gateway: AloneBench) -> None:
    client, other = gateway.client(), gateway.client()
    everything = client.get_parameters()
    gateway.wait(lambda: everything in client.answered, "all parameters")
    assert (client.parameters[SPEED], client.parameters["/bench.names"]) == (0.5, ["a", "b"])
    assert client.parameters["/bench.sizes"] == [1.0, 2.5]
    assert base64.b64decode(client.parameters["/bench.bytes"]) == b"\1\2"
    other.say(op="subscribeParameterUpdates", parameterNames=[SPEED])
    done = client.set_parameter(SPEED, 1)  # which JSON knows no better
    gateway.wait(lambda: done in client.answered, "the answer")
    assert (client.parameters[SPEED], gateway.node.get_parameter("speed").value) == (1.0, 1.0)
    gateway.wait(lambda: other.parameters.get(SPEED) == 1.0, "the change, by who watches it")
    gateway.node.set_parameters([Parameter("speed", value=0.25)])
    gateway.wait(lambda: other.parameters[SPEED] == 0.25, "a change by the node itself")


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        (SPEED, 7.0, "out of range"),
        (SPEED, "fast", "'fast' is no double"),
        (SPEED, True, "True is no number"),
        ("/bench.names", [1], "[1] is no string_array"),
        ("/bench.names", "a", "'a' is no string_array"),
        ("/bench.sizes", 2, "2.0 is no double_array"),
        ("/bench.bytes", "AQI=", "'AQI=' is no byte_array"),
        ("/elsewhere/bench.speed", 0.1, "there is no parameter /elsewhere/bench.speed"),
        ("/bench.nothing", 1, "there is no parameter /bench.nothing"),
        ("nonsense", 1, "there is no parameter nonsense"),
    ],
)
def test_a_parameter_that_is_refused(
    gateway: AloneBench, name: str, value: Any, reason: str
) -> None:
    client = gateway.client()
    done = client.set_parameter(name, value)
    gateway.wait(lambda: done in client.answered, "the answer")
    assert any(reason in text for text in client.statuses), client.statuses
    assert gateway.node.get_parameter("speed").value == 0.5
    assert gateway.node.get_parameter("names").value == ["a", "b"]


# What clients publish -------------------------------------------------------------------------
def test_a_client_publishes_velocities(gateway: AloneBench) -> None:
    client = gateway.client()
    client.advertise(CMD_VEL, "geometry_msgs/Twist")
    twist = Twist()
    twist.linear.x = 0.3
    gateway.wait(
        lambda: gateway.velocities,
        "a velocity",
        lambda: client.publish(serialize_message(twist)),
    )
    assert gateway.velocities[0] == twist
    count = gateway.value("refused_from_clients")
    client.publish(b"\0\1\0\0short")
    gateway.wait(lambda: gateway.value("refused_from_clients") == count + 1, "a refusal")
    gateway.wait(lambda: client.statuses, "its reason")
    assert client.statuses[-1] == f"{CMD_VEL}: 9 bytes are no Twist"


@pytest.mark.parametrize(
    ("topic", "schema", "encoding", "reason"),
    [
        (JOINTS, "sensor_msgs/msg/JointState", "cdr", f"may publish {CMD_VEL}, not {JOINTS}"),
        (CMD_VEL, "geometry_msgs/msg/Twist", "json", "encoding is 'json', it must be cdr"),
        (CMD_VEL, "geometry_msgs/TwistStamped", "cdr", "it must be geometry_msgs/msg/Twist"),
    ],
)
def test_a_client_may_not_publish(
    gateway: AloneBench, topic: str, schema: str, encoding: str, reason: str
) -> None:
    client = gateway.client()
    client.advertise(topic, schema, encoding=encoding)
    gateway.wait(lambda: client.statuses, "a refusal")
    assert reason in client.statuses[0]
    client.publish(serialize_message(joint_state(0, 0.0)))
    call = client.call("/enable", serialize_message(SetBool.Request(data=True)))
    gateway.wait(lambda: call in client.answers, "an answer after it")
    assert (gateway.velocities, gateway.enabled) == ([], [True])
