"""A recorded run as a few numpy tables, read from its bag when they are first asked for."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from rosbags.highlevel import AnyReader, AnyReaderError
from scipy.spatial.transform import Rotation

from husky_bringup.bag import INCOMPLETE_KEY
from husky_bringup.log_time import read_stamp
from husky_bringup.mcap_storage import check_index
from husky_bringup.salvage import SalvagedBag
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

T = TypeVar("T")
TableT = TypeVar("TableT", bound=Table)

_log = logging.getLogger(__name__)


class MissingTopicError(LookupError):
    """A recording holds no message of a topic."""


class Recording:
    """A bag, read when a topic is first asked for and decoded topic by topic.

    Of a bag that was not closed, or is damaged, what is whole is read.

    Attributes:
        path: the bag.
        counts: messages by topic.
        start, end: first and last log time [s].
        damage: in one line, why this is not all that should have been recorded; "" when it is.
    """

    def __init__(self, path: Path | str):
        """Open a bag.

        Raises:
            FileNotFoundError: there is none.
            rosbags.highlevel.AnyReaderError: it cannot be read, and nothing in it is whole.
        """
        self.path = Path(path)
        self.damage = ""
        self._salvaged: SalvagedBag | None = None
        try:
            self._file = self._find_file()
            with AnyReader([self._file]) as reader:
                self.counts = {name: info.msgcount for name, info in reader.topics.items()}
                empty = reader.message_count == 0
                self.start = 0.0 if empty else reader.start_time / 1e9
                self.end = 0.0 if empty else (reader.end_time - 1) / 1e9  # it ends after the last
            self.damage = self._noted()
        except Exception as error:  # of damaged bytes: whatever the reader trips over
            self._salvage(error)
        self._columns: dict[str, tuple[Array, Columns]] = {}

    def _find_file(self) -> Path:
        """Return what is to be read: the bag's one MCAP file, which has checksums, or the bag.

        Raises:
            ValueError: the file has no index, or a damaged one.
        """
        files = sorted(self.path.glob("*.mcap")) if self.path.is_dir() else [self.path]
        if len(files) != 1 or files[0].suffix != ".mcap":
            return self.path
        check_index(files[0])
        return files[0]

    def _noted(self) -> str:
        """Return what the recorder has noted of why this is not all."""
        if not self.path.is_dir():
            return ""
        try:
            text = (self.path / "metadata.yaml").read_text("utf-8")
            custom = yaml.safe_load(text)["rosbag2_bagfile_information"].get("custom_data") or {}
            return str(custom.get(INCOMPLETE_KEY, ""))
        except (OSError, ValueError, LookupError, TypeError, AttributeError, yaml.YAMLError):
            return f"{self.path / 'metadata.yaml'} is missing or damaged"

    def _salvage(self, error: Exception) -> SalvagedBag:
        """Read what is whole.

        Raises:
            FileNotFoundError: there is no bag.
            AnyReaderError: there is none that could be salvaged.
        """
        reason = " ".join(str(error).split())
        try:
            bag = SalvagedBag(self.path)
        except OSError:
            if isinstance(error, OSError | AnyReaderError):
                raise error from None
            raise AnyReaderError(f"{self.path} cannot be read: {reason}") from error
        self.counts = dict(bag.counts)
        self.start, self.end = bag.start / 1e9, bag.end / 1e9
        damaged = f", {bag.lost_chunks} damaged chunks are left out" if bag.lost_chunks else ""
        self.damage = f"{self.path} is not whole ({reason}): {bag.counts.total()} messages{damaged}"
        self._salvaged = bag
        _log.warning("%s", self.damage)
        return bag

    def _read(self, take: Callable[[Any], T]) -> T:
        """Return what a function makes of the open bag; it may be called twice."""
        if self._salvaged is None:
            try:
                with AnyReader([self._file]) as reader:
                    return take(reader)
            except Exception as error:
                self._salvage(error)
        return take(self._salvaged)

    def has(self, topic: str) -> bool:
        """Return whether there is any message of a topic."""
        return self.counts.get(self._full(topic), 0) > 0

    def _full(self, topic: str) -> str:
        """Return the full name of a topic of the graph, of the robot whose clock is recorded."""
        clock = graph.absolute(graph.CLOCK)
        robots = [name.removesuffix(clock) for name in self.counts if name.endswith(clock)]
        return graph.absolute(topic, min(robots, key=len, default=""))

    def columns(self, topic: str) -> tuple[Array, Columns]:
        """Return log times [s] (n,) and all fields of a topic, see `message_columns.decode`.

        Args:
            topic: its name in the graph, or its full name.

        Raises:
            MissingTopicError: there is no message of the topic.
        """
        if not self.has(topic):
            raise MissingTopicError(f"{self.path} has no messages of {self._full(topic)}")
        topic = self._full(topic)
        if topic not in self._columns:
            times, messages, message_type = self._messages.pop(topic)
            decoded = decode(messages, self._typestore, message_type)
            self._columns[topic] = np.array(times, np.float64) / 1e9, decoded
        return self._columns[topic]

    def stamps(self, topics: Collection[str]) -> dict[str, Array]:
        """Return the stamps that the messages of some topics begin with [s], in the bag's order.

        One pass over the bag, which is not kept: for recordings that are longer than the memory.
        """
        names = {self._full(topic): topic for topic in topics if self.has(topic)}

        def take(reader: Any) -> dict[str, list[int]]:
            found: dict[str, list[int]] = {name: [] for name in names}
            wanted = [c for c in reader.connections if c.topic in found]
            for connection, _, message in reader.messages(wanted) if wanted else ():
                found[connection.topic].append(read_stamp(message))
            return found

        found = self._read(take)
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

        return self._read(take)

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
