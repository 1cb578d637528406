"""The process `recorder` beside publishers of the whole graph."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("husky_msgs")

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from mcap.reader import make_reader
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosbags.highlevel import AnyReader

from husky_bringup.definitions import message_class
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

CMD_VEL = graph.absolute(graph.CMD_VEL)
DIAGNOSTICS = graph.absolute(graph.DIAGNOSTICS)
JOINT_STATES = graph.absolute(graph.JOINT_STATES)
ROBOT_DESCRIPTION = graph.absolute(graph.ROBOT_DESCRIPTION)

pytestmark = pytest.mark.graph

TICKS = 500
MESSAGES = Path(__file__).resolve().parents[2] / "husky_msgs" / "msg"
OF_ROS = {"/rosout", "/parameter_events"}
RATED = [topic for topic in graph.TOPICS if topic.rate >= 50.0]


def make(name: str) -> Any:
    return message_class(name)()


def set_stamp(message: Any, time_ns: int) -> None:
    if hasattr(message, "header"):
        stamps.fill(message.header.stamp, time_ns)
    else:
        stamps.fill(message.stamp if hasattr(message, "stamp") else message.clock, time_ns)


DOMAIN = 1 + os.getpid() % 19
"""Of no graph: tests/ros_domain.py."""


def start_recorder(*parameters: str, limit: int | None = None) -> subprocess.Popen[str]:
    """Start a recorder, whose files may not get longer than a limit [bytes]."""
    settings = [word for parameter in parameters for word in ("-p", parameter)]
    command = [sys.executable, "-m", "husky_bringup.nodes.recorder", "--ros-args", *settings]
    if limit is not None:
        command = ["prlimit", f"--fsize={limit}", *command]
    return subprocess.Popen(
        command,
        env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


class Bench:
    """A recorder process and a node that publishes every topic, in a ROS domain of their own."""

    def __init__(self, output: Path, *parameters: str, limit: int | None = None):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = Node("everyone", context=self.context)
        self.publishers = {
            topic.name: self.node.create_publisher(
                type(make(topic.type)), topic.name, qos.PROFILES[topic.qos]
            )
            for topic in graph.TOPICS
        }
        self.process = start_recorder(f"output:={output}", *parameters, limit=limit)

    def until(self, predicate: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + 30.0
        while not predicate():
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < deadline, f"waited for {what}"
            time.sleep(0.02)

    def connect(self) -> None:
        self.until(
            lambda: all(p.get_subscription_count() for p in self.publishers.values()),
            "the recorder's subscriptions",
        )
        # The recorder may learn of a publisher a little later than the publisher of it.
        time.sleep(1.0)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "bag")
    yield bench
    bench.close()


def publish_run(bench: Bench, ticks: int = TICKS) -> dict[str, int]:
    """A second of simulated time at about full speed, or more, while there is a recorder; return
    messages by topic.
    """
    description = make("std_msgs/msg/String")
    description.data = "<robot/>"
    bench.publishers[ROBOT_DESCRIPTION].publish(description)
    counts = {ROBOT_DESCRIPTION: 1, CMD_VEL: 0}
    templates = {topic.name: make(topic.type) for topic in RATED}
    for tick in range(ticks):
        if bench.process.poll() is not None:
            break
        for topic in RATED:
            period = round(1e9 / topic.rate)
            count = counts.get(topic.name, 0)
            while count * period <= tick * graph.TICK_PERIOD_NS:
                message = templates[topic.name]
                set_stamp(message, count * period)
                bench.publishers[topic.name].publish(message)
                count += 1
            counts[topic.name] = count
        if tick % 25 == 24:
            bench.publishers[CMD_VEL].publish(make("geometry_msgs/msg/Twist"))
            counts[CMD_VEL] += 1
        time.sleep(0.001)
    return counts


def test_a_run_is_recorded_whole(bench: Bench, tmp_path: Path) -> None:
    bench.connect()
    counts = publish_run(bench)
    time.sleep(0.3)
    offered = {
        topic.name: str(bench.node.get_publishers_info_by_topic(topic.name)[0].topic_type_hash)
        for topic in graph.TOPICS
    }
    bench.process.send_signal(signal.SIGTERM)
    report, errors = bench.process.communicate(timeout=30.0)
    assert bench.process.returncode == 0, errors
    recording = Recording(tmp_path / "bag")
    found = {name: count for name, count in recording.counts.items() if count}
    assert found.pop(DIAGNOSTICS) >= 1 and found.pop("/rosout") >= 1, "its own"
    found.pop("/parameter_events", None)
    assert found == counts
    for name, count in counts.items():
        line = next(line.split() for line in report.splitlines() if line.startswith(f"{name} "))
        assert line == [name, str(count), "0"]

    assert recording.end == pytest.approx((TICKS - 1) * graph.TICK_PERIOD, abs=2e-3)
    for topic in RATED:
        times, columns = recording.columns(topic.name)
        prefix = next(key for key in columns if key.endswith("sec"))[: -len("sec")]
        stamp = columns[f"{prefix}sec"] + columns[f"{prefix}nanosec"] * 1e-9
        assert times == pytest.approx(stamp, abs=1e-9), topic.name
    with AnyReader([tmp_path / "bag"]) as reader:
        raw = [data for c, _, data in reader.messages() if c.topic == ROBOT_DESCRIPTION]
        assert reader.deserialize(raw[0], "std_msgs/msg/String").data == "<robot/>"  # type: ignore[attr-defined]

    info = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    for entry in info["rosbag2_bagfile_information"]["topics_with_message_count"]:
        row = entry["topic_metadata"]
        if row["name"] not in OF_ROS:
            assert row["type_description_hash"] == offered[row["name"]], "as ROS computes it"


def test_sigint_closes_the_bag_too_and_units_are_in_the_definitions(
    bench: Bench, tmp_path: Path
) -> None:
    """The comments of the installed files: as Foxglove shows them."""
    bench.connect()
    bench.process.send_signal(signal.SIGINT)
    bench.process.communicate(timeout=30.0)
    assert bench.process.returncode == 0
    counts = Recording(tmp_path / "bag").counts
    assert not {name for name, count in counts.items() if count} - {DIAGNOSTICS, *OF_ROS}
    with (tmp_path / "bag" / "bag.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    definitions = {s.name: s.data.decode() for s in summary.schemas.values()}
    assert "in m/s^2" in definitions["sensor_msgs/msg/Imu"]
    assert "A representation of pose" in definitions["nav_msgs/msg/Odometry"], "of a part"
    for file in sorted(MESSAGES.glob("*.msg")):
        text = definitions.get(f"husky_msgs/msg/{file.stem}", "")
        assert not text or text.startswith(file.read_text("utf-8")), file.stem
    assert sum(name.startswith("husky_msgs") for name in definitions) >= 10


def test_whatever_else_is_published_is_recorded(bench: Bench, tmp_path: Path) -> None:
    """Of any type, whenever it comes, latched or best effort; hidden topics are not."""
    bench.connect()
    best_effort = QoSProfile(depth=5, reliability=qos.CONTROL.reliability)
    create = bench.node.create_publisher
    mine = create(message_class("sensor_msgs/msg/Temperature"), "/mine/temperature", best_effort)
    hidden = create(message_class("std_msgs/msg/String"), "/mine/_hidden", 10)
    latched = create(message_class("std_msgs/msg/String"), "/mine/map", qos.LATCHED)
    latched.publish(latched.msg_type(data="said before anybody listened"))
    device = LifecycleNode("device", context=bench.context)
    device.trigger_configure()
    device.get_logger().warning("something is wrong")
    bench.until(lambda: mine.get_subscription_count() > 0, "the subscription of a new topic")
    events = "/device/transition_event"
    bench.until(lambda: bench.node.count_subscribers(events) > 0, "that of the transitions")
    time.sleep(1.0)  # as in `connect`
    for celsius in range(5):
        mine.publish(mine.msg_type(temperature=float(celsius)))
    hidden.publish(hidden.msg_type(data="not for you"))
    device.trigger_activate()
    time.sleep(0.3)
    bench.process.send_signal(signal.SIGTERM)
    _, errors = bench.process.communicate(timeout=30.0)
    assert bench.process.returncode == 0, errors
    device.destroy_node()
    with AnyReader([tmp_path / "bag"]) as reader:
        said: dict[str, list[Any]] = {}
        for connection, _, data in reader.messages():  # all of them can be read
            said.setdefault(connection.topic, []).append(
                reader.deserialize(data, connection.msgtype)  # type: ignore[attr-defined]
            )
    assert [message.temperature for message in said["/mine/temperature"]] == [0, 1, 2, 3, 4]
    assert [message.data for message in said["/mine/map"]] == ["said before anybody listened"]
    assert [event.goal_state.label for event in said[events]][-1] == "active"
    assert "something is wrong" in [line.msg for line in said["/rosout"]]
    assert not any("_hidden" in topic for topic in said)


@pytest.fixture
def full(tmp_path: Path) -> Iterator[Bench]:
    """With no room for the run. Fast DDS's own files in /dev/shm are half a megabyte long."""
    bench = Bench(tmp_path / "full", "compress:=false", limit=1_300_000)
    yield bench
    bench.close()


def test_a_full_disk_and_a_kill(full: Bench, tmp_path: Path) -> None:
    """One recorder after the other: there is no room for the run, and then it is killed."""
    heard: list[Any] = []
    ear = Node("ear", context=full.context)
    ear.create_subscription(
        type(make("diagnostic_msgs/msg/DiagnosticArray")),
        DIAGNOSTICS,
        lambda report: heard.extend(report.status),
        qos.PROFILES["STATUS"],
    )
    executor = SingleThreadedExecutor(context=full.context)
    executor.add_node(ear)
    full.connect()
    publish_run(full, 2 * TICKS)
    report, errors = full.process.communicate(timeout=30.0)
    assert full.process.returncode == 1
    problem = f"{tmp_path / 'full'}: File too large"
    assert errors.splitlines()[-1] == f"error: recording has ended: {problem}"
    assert "Traceback" not in errors + report
    recording = Recording(tmp_path / "full")
    assert recording.damage == problem
    assert contiguous(recording) > 100

    full.process = start_recorder(f"output:={tmp_path / 'bag'}")

    def told() -> bool:
        executor.spin_once(timeout_sec=0.0)
        return any(s.level == DiagnosticStatus.ERROR and problem in s.message for s in heard)

    full.until(told, "the report of the recorder that had no room")
    full.connect()
    publish_run(full)
    file = tmp_path / "bag" / "bag.mcap"
    full.until(lambda: file.stat().st_size > 10_000, "a chunk in the file")
    full.process.kill()
    full.process.communicate()
    recording = Recording(tmp_path / "bag")
    assert recording.damage.startswith(f"{tmp_path / 'bag'} is not whole")
    assert contiguous(recording) > 100
    executor.shutdown()
    ear.destroy_node()


def contiguous(recording: Recording) -> int:
    """Joint states of a recording, from the first one on without a gap."""
    stamps = recording.stamps([JOINT_STATES])[JOINT_STATES]
    assert stamps == pytest.approx(np.arange(len(stamps)) * graph.TICK_PERIOD)
    assert recording.counts[JOINT_STATES] == len(stamps)
    return len(stamps)


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        (["topics:=[nonsense]"], "topics has 'nonsense', a name begins with / or *"),
        (["period:=7.0"], "period"),
        (["output:={occupied}"], "exists"),
        (["output:={occupied}", "overwrite:=true"], "not a bag"),
    ],
)
def test_bad_parameters_are_named(tmp_path: Path, parameters: list[str], complaint: str) -> None:
    occupied = tmp_path / "occupied"
    occupied.mkdir()
    (occupied / "notes.txt").write_text("mine")
    if not any("output" in parameter for parameter in parameters):
        parameters = [*parameters, f"output:={tmp_path / 'other'}"]
    process = start_recorder(*(text.format(occupied=occupied) for text in parameters))
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 1
    assert complaint in errors
    assert "Traceback" not in errors
    assert (occupied / "notes.txt").exists()
