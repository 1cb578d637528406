"""What tests of a bag on the page share: a bag of a walk, and what is in it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Duration, Time
from console_bench import grid_map
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from husky_bringup.console.record import Record
from husky_msgs.msg import ControllerState
from husky_runtime import graph

URDF = """<robot name="recorded_robot"><link name="base_link"><visual><geometry>
<box size="1 1 1"/></geometry></visual></link></robot>"""
LENGTH = 20
"""Of the bag [s]."""
MODES = ("passive", "stand", "walk", "sit")
"""Of the robot in it, five seconds each."""
MAPPING = 6
"""Of the bag, after which the robot has a map; it tells one every three seconds [s]."""
BEGIN = 100.0
"""Of the robot's time in it [s]; below it is counted from there."""


def stamp(seconds: float) -> Time:
    return Time(sec=int(BEGIN + seconds), nanosec=round(seconds % 1.0 * 1e9))


def pose(seconds: float) -> TFMessage:
    """A robot that moves by 1 m/s."""
    moved = TransformStamped(child_frame_id=graph.FRAME_BASE)
    moved.header.frame_id, moved.header.stamp = graph.FRAME_ODOM, stamp(seconds)
    moved.transform.translation.x = seconds
    return TFMessage(transforms=[moved])


def drawing(seconds: float) -> MarkerArray:
    """What is drawn of each second for three seconds."""
    marker = Marker(type=Marker.CUBE, ns=f"of_{seconds:.0f}", lifetime=Duration(sec=3))
    marker.header.frame_id, marker.header.stamp = graph.FRAME_ODOM, stamp(seconds)
    marker.color.a = 1.0
    return MarkerArray(markers=[marker])


def told(seconds: float) -> Iterator[tuple[str, Any]]:
    """What the robot tells at a time, fifty times a second."""
    odometry = Odometry()
    odometry.header.stamp = stamp(seconds)
    odometry.twist.twist.linear.x = seconds
    yield graph.ODOM, odometry
    mode = MODES[int(seconds * len(MODES) / LENGTH)]
    yield graph.CONTROLLER_STATE, ControllerState(stamp=stamp(seconds), mode=mode)
    yield graph.TF, pose(seconds)
    if seconds == 0.0:
        yield graph.ROBOT_DESCRIPTION, String(data=URDF)
        fixed = TransformStamped(child_frame_id="imu")
        fixed.header.frame_id = graph.FRAME_BASE
        yield graph.TF_STATIC, TFMessage(transforms=[fixed])
    if seconds == int(seconds):
        yield graph.MARKERS, drawing(seconds)
        status = DiagnosticStatus(name="node", message=f"second {seconds:.0f}")
        report = DiagnosticArray(status=[status])
        report.header.stamp = stamp(seconds)
        yield graph.DIAGNOSTICS, report
    if seconds >= MAPPING and seconds % 3.0 == 0.0:
        known = grid_map((3, 3), elevation=lambda x, y: seconds)
        known.header.stamp = stamp(seconds)
        yield graph.ELEVATION_MAP, known


def content() -> Iterator[tuple[str, bytes]]:
    for tick in range(50 * LENGTH):
        for topic, message in told(tick / 50):
            yield topic, serialize_message(message)


@pytest.fixture(scope="session")
def walk_bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Any) -> Path:
    path = tmp_path_factory.mktemp("walk") / "bag"
    write_bag(path, content())
    return path


def read(path: Path, namespace: str | None = None) -> Record:
    """A record that has been read to its end."""
    record = Record(path, namespace)
    record._thread.join()
    return record


@pytest.fixture(scope="session")
def record(walk_bag: Path) -> Record:
    return read(walk_bag)
