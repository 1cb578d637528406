"""The process `foxglove_gateway` between a client that knows no ROS and a node of the test's."""

from __future__ import annotations

import base64
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from foxglove_client import FoxgloveClient, Received
from geometry_msgs.msg import Twist
from node_bench import NodeBench, assert_refused, values_of
from rcl_interfaces.msg import FloatingPointRange, Log, ParameterDescriptor
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from websockets.exceptions import InvalidStatus

from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.diagnostics import PERIOD
from husky_runtime.nodes.one_clock import ROSOUT

pytestmark = pytest.mark.graph

MODULE = "husky_bringup.nodes.foxglove_gateway"
JOINTS = graph.absolute(graph.JOINT_STATES)
DESCRIPTION = graph.absolute(graph.ROBOT_DESCRIPTION)
CMD_VEL = graph.absolute(graph.CMD_VEL)
SPEED = "/bench.speed"
NOW_NS = 7_000_000_000


class Bench(NodeBench):
    """The process, clients of it, and a node that is the robot."""

    def __init__(self, domain: int, directory: Path):
        super().__init__(domain, directory, MODULE)
        self.clients: list[FoxgloveClient] = []
        self.parameters: dict[str, Any] | None = None
        self.address = ""
        self.velocities: list[Twist] = []
        make = self.node.create_publisher
        self.clock = make(Clock, graph.CLOCK, qos.CLOCK)
        self.joints = make(JointState, graph.JOINT_STATES, qos.CONTROL)
        self.description = make(String, graph.ROBOT_DESCRIPTION, qos.LATCHED)
        self.words = make(String, "words", 100)
        self.node.create_subscription(Twist, graph.CMD_VEL, self.velocities.append, qos.COMMAND)
        self.enabled: list[bool] = []
        self.node.create_service(SetBool, "enable", self._on_enable)
        within = FloatingPointRange(from_value=0.0, to_value=1.0)
        self.node.declare_parameter(
            "speed", 0.5, ParameterDescriptor(floating_point_range=[within])
        )
        self.node.declare_parameter("names", ["a", "b"])
        self.node.declare_parameter("bytes", [b"\1", b"\2"])
        self.node.declare_parameter("sizes", [1.0, 2.5])
        self.node.declare_parameter("none", [])

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.enabled.append(request.data)
        response.success, response.message = True, "it is done"
        return response

    def serve(self, **parameters: Any) -> None:
        """Let the process run with these parameters; wait until it serves."""
        if parameters == self.parameters and self.process and self.process.poll() is None:
            return
        self.end()
        self.parameters = parameters
        self.start(**{PERIOD: 0.05, "port": 0, **parameters})
        self.address = self.wait_for_report(lambda report: True, "a report")["address"]

    def client(self, **options: Any) -> FoxgloveClient:
        """Connect a client, which has seen what there is."""
        client = FoxgloveClient(self.address, **options)
        self.clients.append(client)
        self.wait(
            lambda: {JOINTS, "/words"} <= set(client.channels) and "/enable" in client.services,
            "topics and services",
        )
        return client

    def hear(self, client: FoxgloveClient, topic: str, publisher: Any) -> list[Received]:
        """Let a client listen to a topic, until its publisher knows."""
        count = publisher.get_subscription_count()
        heard = client.subscribe(topic)
        self.wait(lambda: publisher.get_subscription_count() > count, f"the ear for {topic}")
        return heard

    def tell_time(self, time_ns: int) -> None:
        """Tell the gateway what time it is on the robot."""
        message = Clock()
        stamps.fill(message.clock, time_ns)
        client = self.clients[0]
        self.wait(lambda: client.time == time_ns, "the time", lambda: self.clock.publish(message))

    def value(self, name: str) -> int:
        """Return a number of the newest report."""
        return int(values_of(self.reports[-1])[name]) if self.reports else 0

    def leave(self) -> None:
        """Let the clients go; the process serves on, as if none had been there."""
        for client in self.clients:
            client.close()
        self.clients.clear()
        self.velocities.clear()
        self.enabled.clear()
        self.node.set_parameters([Parameter("speed", value=0.5)])
        if self.process is not None and self.process.poll() is None:
            self.wait_for_report(lambda each: values_of(each)["connections"] == "0", "their end")


@pytest.fixture(scope="module")
def bench_of_all(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """A process takes longer to start than a test."""
    bench = Bench(domain, tmp_path_factory.mktemp("gateway"))
    yield bench
    bench.close()


@pytest.fixture
def bench(bench_of_all: Bench) -> Iterator[Bench]:
    bench_of_all.serve(connections=20)
    yield bench_of_all
    bench_of_all.leave()


def joint_state(time_ns: int, position: float) -> JointState:
    message = JointState(name=["knee"], position=[position])
    stamps.fill(message.header.stamp, time_ns)
    return message


# Topics ---------------------------------------------------------------------------------------
def test_a_client_reads_by_the_schema_that_it_is_given(bench: Bench) -> None:
    client = bench.client()
    channel = client.channels[JOINTS]
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
    assert "# This is a message that holds data to describe the state" in channel["schema"]
    heard = bench.hear(client, JOINTS, bench.joints)
    bench.tell_time(NOW_NS)
    stamp = NOW_NS + 2_000_000
    bench.wait(lambda: heard, "a message", lambda: bench.joints.publish(joint_state(stamp, 0.25)))
    first = heard[0]
    assert (first.message.name, list(first.message.position)) == (["knee"], [0.25])
    assert deserialize_message(first.data, JointState) == joint_state(stamp, 0.25)
    assert first.log_time == stamp


def test_a_stamp_of_another_clock_is_no_log_time(bench: Bench) -> None:
    client = bench.client()
    heard = bench.hear(client, JOINTS, bench.joints)
    bench.tell_time(NOW_NS)
    odd = joint_state(1_700_000_000_000_000_000, 0.0)
    bench.wait(lambda: heard, "a message", lambda: bench.joints.publish(odd))
    assert heard[0].log_time == NOW_NS


def test_a_fast_topic_is_thinned_out_and_a_slow_one_is_whole(bench: Bench) -> None:
    """The newest message always comes; of those on demand none is lost."""
    client = bench.client()
    joints = bench.hear(client, JOINTS, bench.joints)
    words = bench.hear(client, "/words", bench.words)
    for number in range(90):
        bench.joints.publish(joint_state(0, float(number)))
        bench.words.publish(String(data=str(number)))
    bench.wait(lambda: len(words) == 90, "every word")
    bench.wait(lambda: joints and joints[-1].message.position[0] == 89.0, "the last state")
    assert [each.message.data for each in words] == [str(number) for number in range(90)]
    assert len(joints) < 45


def test_a_topic_is_subscribed_to_while_somebody_listens(bench: Bench) -> None:
    one, other = bench.client(), bench.client()
    assert bench.words.get_subscription_count() == 0
    bench.hear(one, "/words", bench.words)
    heard = other.subscribe("/words")
    bench.wait(lambda: heard, "a word", lambda: bench.words.publish(String(data="here")))
    assert bench.words.get_subscription_count() == 1
    one.unsubscribe("/words")
    count = len(heard)
    bench.wait(
        lambda: len(heard) > count + 5, "more", lambda: bench.words.publish(String(data="more"))
    )
    other.break_off()
    bench.wait(lambda: bench.words.get_subscription_count() == 0, "nobody to listen")


def test_a_newcomer_is_told_what_was_said_before(bench: Bench) -> None:
    bench.description.publish(String(data="<robot/>"))
    for _ in range(2):
        heard = bench.client().subscribe(DESCRIPTION)
        bench.wait(lambda heard=heard: heard, "the description")
        assert heard[0].message.data == "<robot/>"


def test_no_line_of_the_log_comes_twice(bench: Bench) -> None:
    log = bench.node.create_publisher(Log, "/rosout", ROSOUT)
    one, other = bench.client(), bench.client()
    bench.wait(lambda: "/rosout" in one.channels and "/rosout" in other.channels, "the log")
    first = one.subscribe("/rosout")
    log.publish(Log(msg="a line"))
    bench.wait(lambda: [r for r in first if r.message.msg == "a line"], "the line")
    second = other.subscribe("/rosout")
    bench.wait(lambda: second, "a line for the newcomer", lambda: log.publish(Log(msg="more")))
    assert sum(r.message.msg == "a line" for r in first) == 1


# Services and parameters ----------------------------------------------------------------------
def test_a_service_is_called_with_raw_messages(bench: Bench) -> None:
    client = bench.client()
    service = client.services["/enable"]
    assert service["type"] == "std_srvs/srv/SetBool"
    assert service["request"]["schemaName"] == "std_srvs/srv/SetBool_Request"
    assert "bool data" in service["request"]["schema"]
    assert "string message" in service["response"]["schema"]
    call = client.call("/enable", serialize_message(SetBool.Request(data=True)))
    bench.wait(lambda: call in client.answers, "the answer")
    answer = deserialize_message(client.answers[call], SetBool.Response)
    assert (bench.enabled, answer.message) == ([True], "it is done")


def test_what_is_no_request_is_a_failure_with_its_reason(bench: Bench) -> None:
    client = bench.client()
    call = client.call("/enable", b"")
    bench.wait(lambda: call in client.answers, "the failure")
    assert client.answers[call] == "ValueError: 0 bytes are no SetBool_Request"
    assert bench.enabled == []


def test_a_service_that_leaves_is_no_longer_offered(bench: Bench) -> None:
    service = bench.node.create_service(Trigger, "visitor", lambda request, response: response)
    client = bench.client()
    bench.wait(lambda: "/visitor" in client.services, "the visitor")
    bench.node.destroy_service(service)
    bench.wait(lambda: "/visitor" not in client.services, "its end")
    names = bench.node.get_service_names_and_types
    bench.wait(lambda: "/visitor" not in dict(names()), "the end of the gateway's own ear for it")


def test_parameters_are_read_set_and_watched(bench: Bench) -> None:
    client, other = bench.client(), bench.client()
    everything = client.get_parameters()
    bench.wait(lambda: everything in client.answered, "all parameters")
    assert (client.parameters[SPEED], client.parameters["/bench.names"]) == (0.5, ["a", "b"])
    assert client.parameters["/bench.sizes"] == [1.0, 2.5]
    assert base64.b64decode(client.parameters["/bench.bytes"]) == b"\1\2"
    other.say(op="subscribeParameterUpdates", parameterNames=[SPEED])
    done = client.set_parameter(SPEED, 1)  # which JSON knows no better
    bench.wait(lambda: done in client.answered, "the answer")
    assert (client.parameters[SPEED], bench.node.get_parameter("speed").value) == (1.0, 1.0)
    bench.wait(lambda: other.parameters.get(SPEED) == 1.0, "the change, by who watches it")
    bench.node.set_parameters([Parameter("speed", value=0.25)])
    bench.wait(lambda: other.parameters[SPEED] == 0.25, "a change by the node itself")


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        (SPEED, 7.0, "out of range"),
        (SPEED, "fast", "'fast' is no float"),
        ("/bench.names", [1], "1 is no str"),
        ("/bench.names", "a", "'a' is not a list of str"),
        ("/bench.bytes", "AQI=", "'AQI=' is not what can be set"),
        ("/bench.nothing", 1, "there is no parameter /bench.nothing"),
        ("nonsense", 1, "there is no parameter nonsense"),
    ],
)
def test_a_parameter_that_is_refused(bench: Bench, name: str, value: Any, reason: str) -> None:
    client = bench.client()
    done = client.set_parameter(name, value)
    bench.wait(lambda: done in client.answered, "the answer")
    assert any(reason in text for text in client.statuses), client.statuses
    assert bench.node.get_parameter("speed").value == 0.5
    assert bench.node.get_parameter("names").value == ["a", "b"]


# What clients publish -------------------------------------------------------------------------
def test_a_client_publishes_velocities(bench: Bench) -> None:
    client = bench.client()
    client.advertise(CMD_VEL, "geometry_msgs/Twist")
    twist = Twist()
    twist.linear.x = 0.3
    bench.wait(
        lambda: bench.velocities,
        "a velocity",
        lambda: client.publish(serialize_message(twist)),
    )
    assert bench.velocities[0] == twist
    count = bench.value("refused_from_clients")
    client.publish(b"\0\1\0\0short")
    bench.wait(lambda: bench.value("refused_from_clients") == count + 1, "a refusal")
    bench.wait(lambda: client.statuses, "its reason")
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
    bench: Bench, topic: str, schema: str, encoding: str, reason: str
) -> None:
    client = bench.client()
    client.advertise(topic, schema, encoding=encoding)
    bench.wait(lambda: client.statuses, "a refusal")
    assert reason in client.statuses[0]
    client.publish(serialize_message(joint_state(0, 0.0)))
    call = client.call("/enable", serialize_message(SetBool.Request(data=True)))
    bench.wait(lambda: call in client.answers, "an answer after it")
    assert (bench.velocities, bench.enabled) == ([], [True])


# Nobody brings it down ------------------------------------------------------------------------
def is_served(bench: Bench) -> None:
    """Who comes now is served."""
    client = bench.client()
    call = client.call("/enable", serialize_message(SetBool.Request(data=True)))
    bench.wait(lambda: call in client.answers, "an answer")
    assert isinstance(client.answers[call], bytes)


@pytest.mark.parametrize(
    "nonsense",
    [
        "{",
        "[]",
        '{"op": "nothing"}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99999}]}',
        '{"op": "setParameters", "parameters": [{"name": "", "value": {"a": []}}]}',
        b"",
        b"\xff" * 100,
        b"\x02" + b"\xff" * 20,
        b"\x01\0\0\0\0",
        b"\x01" * 20_000_000,
    ],
    ids=lambda nonsense: repr(nonsense[:20]),
)
def test_nonsense_over_the_websocket(bench: Bench, nonsense: str | bytes) -> None:
    client = bench.client()
    client.send_raw(nonsense)
    is_served(bench)


def test_fifty_clients_are_served_or_refused(bench: Bench) -> None:
    served = refused = 0
    for _ in range(50):
        try:
            bench.clients.append(FoxgloveClient(bench.address))
            served += 1
        except InvalidStatus as error:
            assert error.response.status_code == 503
            refused += 1
    assert (served, refused) == (20, 30)
    bench.leave()
    is_served(bench)


def test_who_does_not_read_holds_up_nobody(bench: Bench) -> None:
    bench.serve(backlog=16)
    stalled, client = bench.client(), bench.client()
    bench.hear(stalled, "/words", bench.words)
    heard, big = client.subscribe("/words"), String(data="x" * 1_000_000)
    with stalled.held():
        before = resident_mb(bench)
        bench.wait(lambda: len(heard) >= 100, "100 MB", lambda: bench.words.publish(big))
        is_served(bench)
        assert resident_mb(bench) - before < 60.0


def resident_mb(bench: Bench) -> float:
    """The process's resident memory [MB]."""
    assert bench.process is not None
    status = Path(f"/proc/{bench.process.pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1e3


def test_all_is_well_in_its_report(bench: Bench) -> None:
    client = bench.client()
    client.subscribe("/words")
    report: Callable[[DiagnosticStatus], bool] = lambda each: (  # noqa: E731
        values_of(each)["topics_listened"] == "1"
    )
    values = bench.wait_for_report(report, "one topic that is listened to")
    assert (values["connections"], values["skipped"]) == ("1", "")


def test_a_token_is_asked_for_where_others_get_to(bench: Bench) -> None:
    bench.serve(host="0.0.0.0", token="a-good-token")
    here = bench.address.replace("0.0.0.0", "127.0.0.1")
    for address in (here, f"{here}?token=another-token"):
        with pytest.raises(InvalidStatus) as caught:
            FoxgloveClient(address)
        assert caught.value.response.status_code == 401
    bench.address = f"{here}?token=a-good-token"
    is_served(bench)
    bench.wait(lambda: bench.value("refused_connections") == 2, "the count of it")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_with_clients_and_calls_under_way(bench: Bench, number: int) -> None:
    asked: list[object] = []

    def never(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        asked.append(request)
        return response

    bench.node.create_service(Trigger, "slow", never)
    client = bench.client()
    bench.wait(lambda: "/slow" in client.services, "the slow service")
    client.subscribe("/words")
    client.call("/slow")
    client.get_parameters()
    bench.end(number)
    client._thread.join(60.0)
    assert client.closed


def test_an_address_that_is_not_here_is_named() -> None:
    assert_refused(MODULE, "192.0.2.1", host="192.0.2.1", port=0)
