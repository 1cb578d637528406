"""The tables of the documents, and `husky_runtime.graph`, against the running graph."""

import importlib
import re
import time
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from husky_bringup import document
from husky_bringup.interfaces import all_nodes, running
from husky_msgs.srv import StepWorld
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.one_clock import ROSOUT

pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[2]
UPDATE = "bring them up to date with: . scripts/env.sh; python -m husky_bringup.document"
MEASURED = 500
"""Ticks over which rates are counted: one second."""
PORTION = 10
"""Ticks of these after which this process catches up: they make a hundred messages. 512 may wait in
shared memory (Fast DDS, `port_queue_capacity`); of more some are lost."""
LATE = 10.0
"""Wall time that messages may be on their way [s]."""


@pytest.fixture(scope="module")
def reader(domain):
    """Every node with its defaults, seen from outside."""
    with running(all_nodes()) as reader:
        yield reader


@pytest.fixture(scope="module")
def nodes(reader):
    return reader.read(all_nodes())


def test_documents_say_what_the_graph_has(nodes):
    changed = document.changes(ROOT, nodes)
    told = [document.difference(*texts, path.name) for path, texts in changed.items()]
    assert not told, "\n".join([*told, UPDATE])


def test_every_node_is_documented(nodes):
    for node in nodes.values():
        readme = (ROOT / "ros2_ws/src" / node.package / "README.md").read_text()
        wanted = {f"interface {node.name}", f"parameters {node.name}"}
        assert wanted <= set(document.block_names(readme)), f"{node.package}/README.md"
    overview = document.block_names((ROOT / "docs/graph.md").read_text())
    assert {"graph", "nodes", "topics", "services"} <= set(overview)
    assert "graph" in document.block_names((ROOT / "README.md").read_text())


def test_nothing_in_the_tables_is_left_unexplained():
    for path in document.documents(ROOT):
        for line in path.read_text().splitlines():
            assert not re.fullmatch(r"\|.*`/.*\|\s*\|", line), f"{path.name}: {line}"


def test_every_parameter_has_a_description_and_every_quantity_a_unit(nodes):
    for node in nodes.values():
        for parameter in node.parameters:
            told = f"{parameter.name} of {node.name}: {parameter.description!r}"
            assert parameter.description, told
            if isinstance(parameter.value, float):
                assert document.unit(parameter), f"no unit [...]: {told}"
                assert parameter.lower is not None, f"no range: {told}"


def test_the_parameter_file_to_copy_says_what_the_nodes_say(nodes):
    """Each value is the default, and the words beside it are the ones allowed."""
    text = (ROOT / "ros2_ws/src/husky_bringup/config/husky.yaml").read_text()
    told = yaml.safe_load(text)
    assert told and set(told) <= set(nodes)
    for name, node in told.items():
        parameters = {p.name: p for p in nodes[name].parameters}
        for key, value in node["ros__parameters"].items():
            parameter = parameters[key]
            assert parameter.value == value, key
            (comment,) = re.findall(rf"^    {key}: \S+ +# (.*)$", text, re.MULTILINE)
            assert not parameter.allowed or comment == parameter.allowed, key


def test_topics_and_services_have_the_names_of_the_table(nodes):
    found = {t for node in nodes.values() for t in (*node.publishes, *node.subscribes)}
    assert found == {(topic.name, topic.type) for topic in graph.TOPICS}
    services = {name for node in nodes.values() for name, _ in node.offers}
    constants = {name: value for name, value in vars(graph).items() if name.isupper()}
    tools = (graph.RECORDER, graph.TELEOP, graph.FOXGLOVE_GATEWAY, graph.CONSOLE)
    nodes_and_frames = {*graph.NODES, *tools}
    named = {
        graph.absolute(value)
        for name, value in constants.items()
        if isinstance(value, str) and value not in nodes_and_frames and not name.startswith("FRAME")
    }
    framed = {graph.absolute(graph.CYCLE_END)}  # of another bus than this graph's
    assert named == {name for name, _ in found} | services | framed


def test_topics_have_the_publishers_and_the_quality_of_the_table(reader, nodes):
    for topic in graph.TOPICS:
        publishers = {n.name for n in nodes.values() if (topic.name, topic.type) in n.publishes}
        # This graph has drives in the process of the bridge; another robot's is in test_beta.
        others = {graph.SERVO_BRIDGE, graph.DRIVE_SEGMENT}
        assert publishers == set(topic.publishers) - others, topic.name
        wanted = qos.OFFERED[topic.qos]
        for offered in reader.publisher_qos(topic.name):
            assert offered.reliability == wanted.reliability, topic.name
            assert offered.durability == wanted.durability, topic.name


class Counter:
    """Counts the different stamps on a topic, and how often one came again; no message wakes it.

    It subscribes with the default settings but for the depth: what users do must hear everything.
    """

    def __init__(self, node: Node, topic: graph.Topic):
        package, _, message = topic.type.split("/")
        kind = getattr(importlib.import_module(f"{package}.msg"), message)
        profile = QoSProfile(depth=4000)
        self._subscription = node.create_subscription(kind, topic.name, print, profile)
        self._stamps: set[int] = set()
        self.again = 0

    def count(self, since: int) -> int:
        """Return how many stamps after `since` [ns] have come."""
        handle, kind = self._subscription.handle, self._subscription.msg_type
        with handle:
            while (taken := handle.take_message(kind, False)) is not None:
                message = taken[0]
                header = getattr(message, "header", message)
                stamp = stamps.to_ns(getattr(header, "stamp", None) or message.clock)
                self.again += stamp in self._stamps
                self._stamps.add(stamp)
        return sum(stamp > since for stamp in self._stamps)


def test_topics_come_at_the_rates_of_the_table(reader):
    """In simulated time, which does not depend on the machine."""
    topics = [t for t in graph.TOPICS if t.rate > 0.0 and t.relative != graph.DIAGNOSTICS]
    ear = Node("ear", context=reader.node.context)  # in no executor
    counters = {topic.name: Counter(ear, topic) for topic in topics}
    reader.wait_until(
        lambda: all(ear.count_publishers(topic.name) for topic in topics), "publishers"
    )
    reader.wait_until(
        lambda: all(counter.count(0) for counter in counters.values()),
        "a message of each, which then knows this subscriber",
    )
    reader.call(SetBool, graph.PLANT_PAUSE, SetBool.Request(data=True))
    start = reader.call(StepWorld, graph.PLANT_STEP, StepWorld.Request(ticks=1))
    assert start.success, start.message
    since = stamps.to_ns(start.stamp)
    ticks = counters[graph.absolute(graph.SERVO_STATE)]
    again = ticks.again
    # A window that does not begin with a period of the topic may hold one more or less; where a
    # process waits for a processor longer than the plant waits for it, a few messages are left out.
    wanted = {topic.name: pytest.approx(topic.rate, abs=2.0, rel=0.02) for topic in topics}
    for _ in range(MEASURED // PORTION):
        end = reader.call(StepWorld, graph.PLANT_STEP, StepWorld.Request(ticks=PORTION))
        assert end.success, end.message
        period = (stamps.to_ns(end.stamp) - since) / 1e9
        least = {topic.name: 0.98 * topic.rate * period - 2.0 for topic in topics}
        deadline = time.monotonic() + LATE
        while True:
            heard = {name: counter.count(since) for name, counter in counters.items()}
            late = any(heard[name] < least[name] for name in heard)
            if not late or time.monotonic() > deadline:
                break
            time.sleep(0.01)
    # With a tick that is told again, as its answer is late, the bridge tells its state again too.
    status = graph.topic(graph.DRIVES_STATUS)
    more = max(0, heard[status.name] - round(status.rate * period))
    heard[status.name] -= min(ticks.again - again, more)
    counts = {name: count / period for name, count in heard.items()}
    ear.destroy_node()
    assert counts == wanted


def test_every_node_goes_by_the_time_of_the_simulation(reader):
    """Reports and log lines of all nodes, in a world that stands still: one stamp."""
    names = {spec.name for spec in all_nodes()}
    for name in names:
        client = AsyncParameterClient(reader.node, name)
        reader.wait_until(client.services_are_ready, f"parameters of {name}")
        told = reader.result(client.get_parameters(["use_sim_time"]), name)
        assert told.values[0].bool_value, name
    reader.call(SetBool, graph.PLANT_PAUSE, SetBool.Request(data=True))
    world = reader.call(StepWorld, graph.PLANT_STEP, StepWorld.Request(ticks=1))
    reader.wait(0.5)  # the time is told again every 0.1 s
    said, logged = {}, {}

    def hear(report):
        said[report.status[0].name] = stamps.to_ns(report.header.stamp)

    def read(line):
        if line.msg.startswith("refused on /clock"):
            logged[line.name] = stamps.to_ns(line.stamp)

    reader.node.create_subscription(DiagnosticArray, graph.DIAGNOSTICS, hear, qos.STATUS)
    reader.node.create_subscription(Log, "/rosout", read, ROSOUT)
    clock = reader.node.create_publisher(Clock, graph.CLOCK, qos.CLOCK)
    bad = Clock()
    bad.clock.sec = -1
    telling = names - {graph.TELEOP}  # which has no report

    def all_have_told():
        clock.publish(bad)
        return said.keys() == telling and logged.keys() == names

    reader.wait_until(all_have_told, "a report and a log line of each node")
    (told,) = set(said.values()) | set(logged.values())
    assert 0 <= stamps.to_ns(world.stamp) - told < 1e9 / graph.topic(graph.CLOCK).rate
