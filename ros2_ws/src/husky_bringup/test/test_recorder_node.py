"""The process `recorder` beside publishers of the whole graph."""

from __future__ import annotations

import importlib
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

import rclpy
import yaml
from rclpy.context import Context
from rclpy.node import Node
from rosbags.highlevel import AnyReader

from husky_bringup.recording import Recording
from husky_description import graph
from husky_description.nodes import qos, stamps

pytestmark = pytest.mark.graph

TICKS = 1000
RATED = [topic for topic in graph.TOPICS if topic.rate >= 50.0]


def make(name: str) -> Any:
    package, _, message = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), message)()


def set_stamp(message: Any, time_ns: int) -> None:
    if hasattr(message, "header"):
        stamps.fill(message.header.stamp, time_ns)
    else:
        stamps.fill(message.stamp if hasattr(message, "stamp") else message.clock, time_ns)


class Bench:
    """A recorder process and a node that publishes every topic, in a ROS domain of their own."""

    def __init__(self, output: Path):
        domain = 1 + os.getpid() % 100
        self.environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("everyone", context=self.context)
        self.publishers = {
            topic.name: self.node.create_publisher(
                type(make(topic.type)), topic.name, qos.PROFILES[topic.qos]
            )
            for topic in graph.TOPICS
        }
        self.process = self.start(f"output:={output}")

    def start(self, *parameters: str) -> subprocess.Popen[str]:
        settings = [word for parameter in parameters for word in ("-p", parameter)]
        return subprocess.Popen(
            [sys.executable, "-m", "husky_bringup.nodes.recorder", "--ros-args", *settings],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

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


def publish_run(bench: Bench) -> dict[str, int]:
    """Two seconds of simulated time at about full speed; return messages by topic."""
    description = make("std_msgs/msg/String")
    description.data = "<robot/>"
    bench.publishers[graph.ROBOT_DESCRIPTION].publish(description)
    counts = {graph.ROBOT_DESCRIPTION: 1, graph.CMD_VEL: 0}
    templates = {topic.name: make(topic.type) for topic in RATED}
    for tick in range(TICKS):
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
            bench.publishers[graph.CMD_VEL].publish(make("geometry_msgs/msg/Twist"))
            counts[graph.CMD_VEL] += 1
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
        raw = [data for c, _, data in reader.messages() if c.topic == graph.ROBOT_DESCRIPTION]
        assert reader.deserialize(raw[0], "std_msgs/msg/String").data == "<robot/>"  # type: ignore[attr-defined]

    info = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    for entry in info["rosbag2_bagfile_information"]["topics_with_message_count"]:
        row = entry["topic_metadata"]
        assert row["type_description_hash"] == offered[row["name"]], "as ROS computes it"


def test_sigint_closes_the_bag_too(bench: Bench, tmp_path: Path) -> None:
    bench.connect()
    bench.process.send_signal(signal.SIGINT)
    bench.process.communicate(timeout=30.0)
    assert bench.process.returncode == 0
    assert sum(Recording(tmp_path / "bag").counts.values()) == 0


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        (["topics:=['/nonsense']"], "/nonsense"),
        (["period:=7.0"], "period"),
        (["output:={occupied}"], "exists"),
        (["output:={occupied}", "overwrite:=true"], "not a bag"),
    ],
)
def test_bad_parameters_are_named(
    bench: Bench, tmp_path: Path, parameters: list[str], complaint: str
) -> None:
    occupied = tmp_path / "occupied"
    occupied.mkdir()
    (occupied / "notes.txt").write_text("mine")
    if not any("output" in parameter for parameter in parameters):
        parameters = [*parameters, f"output:={tmp_path / 'other'}"]
    process = bench.start(*(text.format(occupied=occupied) for text in parameters))
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 1
    assert complaint in errors
    assert "Traceback" not in errors
    assert (occupied / "notes.txt").exists()
