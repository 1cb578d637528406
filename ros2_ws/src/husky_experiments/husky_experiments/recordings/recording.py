"""A recorded run as a few numpy tables, read from its bag when they are first asked for."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from husky_bringup.bag_reader import BagReader
from husky_bringup.log_time import read_stamp
from husky_description.arrays import Array
from husky_experiments.recordings.message_columns import Columns, decode
from husky_experiments.recordings.tables import (
    Base,
    Contacts,
    ControllerStates,
    Fans,
    JointCommands,
    Joints,
    Propulsion,
    Table,
)
from husky_runtime import graph

TableT = TypeVar("TableT", bound=Table)


class MissingTopicError(LookupError):
    """A recording holds no message of a topic."""


class Recording(BagReader):
    """A bag, read when a topic is first asked for and decoded topic by topic."""

    def __init__(self, path: Path | str):
        """Open a bag.

        Raises:
            FileNotFoundError: there is none.
            rosbags.highlevel.AnyReaderError: it cannot be read, and nothing in it is whole.
        """
        super().__init__(path)
        self._columns: dict[str, tuple[Array, Columns]] = {}

    def columns(self, topic: str) -> tuple[Array, Columns]:
        """Return log times [s] (n,) and all fields of a topic, see `message_columns.decode`.

        Args:
            topic: its name in the graph, or its full name.

        Raises:
            MissingTopicError: there is no message of the topic.
        """
        if not self.has(topic):
            raise MissingTopicError(f"{self.path} has no messages of {self.full(topic)}")
        topic = self.full(topic)
        if topic not in self._columns:
            times, messages, message_type = self._messages.pop(topic)
            decoded = decode(messages, self._typestore, message_type)
            self._columns[topic] = np.array(times, np.float64) / 1e9, decoded
        return self._columns[topic]

    def stamps(self, topics: Collection[str]) -> dict[str, Array]:
        """Return the stamps that the messages of some topics begin with [s], in the bag's order.

        One pass over the bag, which is not kept: for recordings that are longer than the memory.
        """
        names = {self.full(topic): topic for topic in topics if self.has(topic)}

        def take(reader: Any) -> dict[str, list[int]]:
            found: dict[str, list[int]] = {name: [] for name in names}
            wanted = [c for c in reader.connections if c.topic in found]
            for connection, _, message in reader.messages(wanted) if wanted else ():
                found[connection.topic].append(read_stamp(message))
            return found

        found = self.read(take)
        return {names[name]: np.array(stamps, np.float64) / 1e9 for name, stamps in found.items()}

    @cached_property
    def _messages(self) -> dict[str, tuple[list[int], list[bytes], str]]:
        """Log times [ns], messages and their type, by topic: one pass over the whole bag."""

        def take(reader: Any) -> dict[str, tuple[list[int], list[bytes], str]]:
            found: dict[str, tuple[list[int], list[bytes], str]] = {}
            self._typestore = reader.typestore
            for connection in reader.connections:
                found.setdefault(connection.topic, ([], [], connection.msgtype))
            for connection, time, message in reader.messages():
                times, messages, _ = found[connection.topic]
                times.append(time)
                messages.append(message)
            return found

        return self.read(take)

    def _table(self, kind: type[TableT], topic: str, **renamed: str) -> TableT:
        """Return a topic's columns, those of another name in the message by that name."""
        time, column = self.columns(topic)
        names = [field.name for field in fields(kind) if field.name != "time"]
        return kind(time, **{name: column[renamed.get(name, name)] for name in names})

    @cached_property
    def joints(self) -> Joints:
        """Measured joint states, 500 Hz."""
        return self._table(Joints, graph.JOINT_STATES, torque="effort")

    @cached_property
    def commands(self) -> JointCommands:
        """Commands to the joints, 500 Hz."""
        return self._table(JointCommands, graph.JOINT_COMMAND, torque="effort")

    @cached_property
    def base(self) -> Base:
        """True motion of the base, 100 Hz."""
        return self._odometry(graph.GROUND_TRUTH)

    @cached_property
    def estimate(self) -> Base:
        """Estimated motion of the base, 50 Hz."""
        return self._odometry(graph.ODOMETRY)

    def _odometry(self, topic: str) -> Base:
        """Read an Odometry; its linear velocity is in base axes (REP-105) and turned to world."""
        time, column = self.columns(topic)
        orientation = column["pose.pose.orientation"]
        velocity = Rotation.from_quat(orientation).apply(column["twist.twist.linear"])
        return Base(
            time, column["pose.pose.position"], orientation, velocity, column["twist.twist.angular"]
        )

    @cached_property
    def contacts(self) -> Contacts:
        """True forces of the ground on the feet, 100 Hz."""
        time, column = self.columns(graph.FOOT_CONTACTS)
        contact = column["contact"]
        slid = column.get("slid", np.full(contact.shape, np.nan))
        return Contacts(time, contact, column["force"], column["position"], slid)

    @cached_property
    def controller(self) -> ControllerStates:
        """State of the controller, 50 Hz."""
        return self._table(ControllerStates, graph.CONTROLLER_STATE)

    # The propulsion unit ------------------------------------------------------------------------
    @cached_property
    def fans(self) -> Fans:
        """The truth about fans, battery and ropes, 100 Hz."""
        return self._table(Fans, graph.FAN_STATE, force="wrench.force", moment="wrench.torque")

    @cached_property
    def propulsion(self) -> Propulsion:
        """State of the propulsion unit as its autopilot reports it, 50 Hz."""
        return self._table(Propulsion, graph.PROPULSION_STATE)

    @cached_property
    def t265(self) -> Base:
        """Motion of the camera `t265_link` in its own world `t265_odom`, 200 Hz."""
        return self._odometry(graph.T265_ODOMETRY)
