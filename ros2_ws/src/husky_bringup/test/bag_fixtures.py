"""Fixtures of tests that read or write bags: messages of the graph, and a writer of bags."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import (
    Nodetype,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from husky_bringup.bag import BagWriter
from husky_description.robot import JOINT_NAMES
from husky_runtime import graph

_WORKSPACE = Path(__file__).resolve().parents[3]
MESSAGES = (_WORKSPACE / "src/husky_msgs/msg", _WORKSPACE / "underlay/grid_map_msgs/msg")
"""Definitions of the graph's types that rosbags has none of."""
FOREVER = QosTime(9223372036, 854775807)
WRENCH = 2
"""A kind of PropulsionCommand."""


def profile(reliability: QosReliability, depth: int) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        reliability,
        QosDurability.VOLATILE,
        FOREVER,
        FOREVER,
        QosLiveliness.AUTOMATIC,
        FOREVER,
        False,
    )


def types_of_the_graph(more: dict[str, str] | None = None) -> Any:
    """The types of the graph as rosbags has them, with more fields in those that are named."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for directory in MESSAGES:
        for file in sorted(directory.glob("*.msg")):
            text = f"{file.read_text('utf-8')}\n{(more or {}).get(file.stem, '')}"
            store.register(get_types_from_msg(text, f"{directory.parent.name}/msg/{file.stem}"))
    return store


@pytest.fixture(scope="session")
def typestore() -> Any:
    return types_of_the_graph()


@pytest.fixture(scope="session")
def profiles() -> dict[str, Qos]:
    reliable = profile(QosReliability.RELIABLE, 10)
    return {
        "CONTROL": profile(QosReliability.BEST_EFFORT, 16),
        "STATUS": reliable,
        "COMMAND": reliable,
        "LATCHED": reliable._replace(durability=QosDurability.TRANSIENT_LOCAL, depth=1),
        "CLOCK": profile(QosReliability.BEST_EFFORT, 1),
        "TF": profile(QosReliability.RELIABLE, 100),
    }


class Messages:
    """Makes serialized messages."""

    def __init__(self, typestore: Any):
        self._store = typestore
        self._types = typestore.types

    def pack(self, kind: str, /, **fields: Any) -> bytes:
        """Serialize a message; fields that are not given are zero or empty."""
        data: bytes = bytes(self._store.serialize_cdr(self._fill(kind, fields), kind))
        return data

    def _fill(self, kind: str, fields: dict[str, Any]) -> Any:
        known = self._store.fielddefs[kind][1]
        return self._types[kind](
            **{name: self._zero(description) for name, description in known} | fields
        )

    def _zero(self, description: Any) -> Any:
        node, inner = description
        if node == Nodetype.NAME:
            return self._fill(inner, {})
        if node == Nodetype.BASE:
            return "" if inner[0] == "string" else np.zeros(1, inner[0])[0].item()
        (element_node, element), count = inner
        count = count if node == Nodetype.ARRAY else 0
        if element_node == Nodetype.BASE and element[0] != "string":
            return np.zeros(count, element[0])
        return [self._zero((element_node, element)) for _ in range(count)]

    def stamp(self, time_ns: int) -> Any:
        return self._types["builtin_interfaces/msg/Time"](*divmod(time_ns, 1_000_000_000))

    def header(self, time_ns: int, frame: str = "") -> Any:
        return self._types["std_msgs/msg/Header"](self.stamp(time_ns), frame)

    def _make(self, kind: str, values: Iterable[float]) -> Any:
        return self._types[f"geometry_msgs/msg/{kind}"](*map(float, values))

    def quaternion(self, turn: Rotation) -> Any:
        return self._make("Quaternion", turn.as_quat())

    def vector(self, values: Iterable[float]) -> Any:
        return self._make("Vector3", values)

    def wrench(self, force: Iterable[float], torque: Iterable[float]) -> Any:
        return self._types["geometry_msgs/msg/Wrench"](self.vector(force), self.vector(torque))

    def joint_states(self, time_ns: int, position: Any, velocity: Any, effort: Any) -> bytes:
        return self.pack(
            "sensor_msgs/msg/JointState",
            header=self.header(time_ns),
            name=list(JOINT_NAMES),
            position=np.asarray(position, float),
            velocity=np.asarray(velocity, float),
            effort=np.asarray(effort, float),
        )

    def joint_command(self, time_ns: int, mode: int, position: Any) -> bytes:
        return self.pack(
            "husky_msgs/msg/JointCommand",
            stamp=self.stamp(time_ns),
            mode_of_operation=mode,
            position=np.asarray(position, float),
        )

    def odometry(
        self, time_ns: int, position: Any, orientation: Any, velocity: Any, rate: Any
    ) -> bytes:
        make = self._types
        pose = make["geometry_msgs/msg/PoseWithCovariance"](
            make["geometry_msgs/msg/Pose"](
                self._make("Point", position), self._make("Quaternion", orientation)
            ),
            np.zeros(36),
        )
        twist = make["geometry_msgs/msg/TwistWithCovariance"](
            make["geometry_msgs/msg/Twist"](self.vector(velocity), self.vector(rate)),
            np.zeros(36),
        )
        return self.pack(
            "nav_msgs/msg/Odometry",
            header=self.header(time_ns, graph.FRAME_WORLD),
            child_frame_id=graph.FRAME_BASE,
            pose=pose,
            twist=twist,
        )

    def foot_contacts(
        self, time_ns: int, contact: Any, force: Any, position: Any, slid: Any = (0.0,) * 4
    ) -> bytes:
        return self.pack(
            "husky_msgs/msg/FootContacts",
            stamp=self.stamp(time_ns),
            contact=np.asarray(contact, np.bool_),
            force=[self.vector(row) for row in force],
            position=[self._make("Point", row) for row in position],
            slid=np.asarray(slid, float),
        )

    def controller_state(self, time_ns: int, mode: str, **fields: Any) -> bytes:
        upright = {"orientation": np.array([0.0, 0.0, 0.0, 1.0])}
        return self.pack(
            "husky_msgs/msg/ControllerState",
            **({"stamp": self.stamp(time_ns), "mode": mode, "gait": "trot"} | upright | fields),
        )


@pytest.fixture(scope="session")
def messages(typestore: Any) -> Messages:
    return Messages(typestore)


WriteBag = Callable[[Path, Iterable[tuple[str, bytes]]], BagWriter]


@pytest.fixture(scope="session")
def write_bag(typestore: Any, profiles: dict[str, Qos]) -> WriteBag:
    """Write (topic, message) pairs to a bag and close it."""

    def write(path: Path, content: Iterable[tuple[str, bytes]]) -> BagWriter:
        writer = BagWriter(path, graph.TOPICS, profiles, typestore)
        channels = {channel.topic.name: channel for channel in writer.channels}
        for topic, message in content:
            writer.write(channels[graph.absolute(topic)], message)
        writer.close()
        return writer

    return write
