"""Writes a rosbag2 bag (MCAP storage) from messages as they come off the wire, undecoded."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rosbags.interfaces import Connection, Nodetype, Qos
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from husky_bringup.log_time import LogTime, read_stamp
from husky_description import graph

METADATA_VERSION: Literal[9] = 9
"""Version of metadata.yaml that rosbag2 of ROS 2 Jazzy writes."""
MISSING_KEY = "husky.missing_messages"
"""Key in the bag's custom data: JSON of the messages that never came, by topic."""

_PACING_RATE = 50.0
"""Topics of at least this nominal rate may set the present, and their gaps are counted [Hz]."""


def make_typestore(messages: Path) -> Any:
    """Return the messages of ROS 2 Jazzy and those of husky_msgs.

    Args:
        messages: directory with the `.msg` files of husky_msgs.

    Raises:
        FileNotFoundError: there are none.
    """
    files = sorted(messages.glob("*.msg"))
    if not files:
        raise FileNotFoundError(f"no .msg files in {messages}")
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in files:
        store.register(get_types_from_msg(file.read_text("utf-8"), f"husky_msgs/msg/{file.stem}"))
    return store


def begins_with_stamp(typestore: Any, message_type: str) -> bool:
    """Return whether messages of a type begin with a stamp (a Time or a Header)."""
    _, fields = typestore.fielddefs[message_type]
    if not fields:
        return False
    kind, name = fields[0][1]
    return kind == Nodetype.NAME and name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header")


@dataclass(slots=True)
class Channel:
    """One topic of a bag that is being written.

    Attributes:
        topic: row of the graph's table.
        connection: the writer's handle.
        stamped: its messages begin with a stamp.
        rank: place among the topics that may set the present, None for one that may not.
        period: nominal [ns], 0 for a topic whose gaps are not counted.
        count: messages written.
        missing: messages that never came, by the gaps between stamps.
        last: newest stamp [ns], negative before the first.
    """

    topic: graph.Topic
    connection: Connection
    stamped: bool
    rank: int | None
    period: int
    count: int = 0
    missing: int = 0
    last: int = -1


class BagWriter:
    """A bag that is being written.

    The bag is a directory with `metadata.yaml` and one `.mcap` file, which `ros2 bag`, Foxglove
    and PlotJuggler open; the definitions of all message types are inside.

    Attributes:
        path: the bag's directory.
        channels: one for each topic, in the order given.
    """

    def __init__(
        self,
        path: Path,
        topics: Iterable[graph.Topic],
        profiles: Mapping[str, Qos],
        typestore: Any,
        *,
        overwrite: bool = False,
        compress: bool = True,
    ):
        """Open a new bag.

        Args:
            path: directory to make.
            topics: what will be written, in the graph's order.
            profiles: the quality of service that publishers offer, by the name of the profile.
            typestore: definitions of all types, see `make_typestore`.
            overwrite: replace a bag of that name.
            compress: chunks with Zstandard, as rosbag2's preset `zstd_fast` does.

        Raises:
            FileExistsError: there is something of that name, and it may not or cannot be replaced.
        """
        _make_room(path, overwrite)
        self.path = path
        self._writer = Writer(path, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
        if compress:
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self.channels: list[Channel] = []
        for rank, topic in enumerate(topics):
            stamped = begins_with_stamp(typestore, topic.type)
            connection = self._writer.add_connection(
                topic.name,
                topic.type,
                typestore=typestore,
                offered_qos_profiles=[profiles[topic.qos]],
            )
            pacing = stamped and topic.rate >= _PACING_RATE
            period = round(1e9 / topic.rate) if pacing else 0
            self.channels.append(
                Channel(topic, connection, stamped, rank if pacing else None, period)
            )
        self._paced = any(channel.rank is not None for channel in self.channels)
        self._log_time = LogTime()
        self._early: list[tuple[Channel, bytes]] = []

    def write(self, channel: Channel, message: bytes) -> None:
        """Add a message.

        Args:
            channel: one of `channels`.
            message: CDR with its encapsulation header.
        """
        log_time = self._log_time
        if channel.rank is not None:
            stamp = read_stamp(message)
            logged = log_time.pace(channel.rank, stamp)
            if self._early:
                self._write_early()
        elif not self._paced:
            stamp = logged = time.time_ns()
        elif log_time.present is None:
            self._early.append((channel, message))
            return
        elif channel.stamped:
            stamp = read_stamp(message)
            logged = log_time.place(stamp)
        else:
            stamp = logged = log_time.present
        if channel.period:
            gap = stamp - channel.last
            if gap > 1.5 * channel.period and channel.last >= 0:
                channel.missing += round(gap / channel.period) - 1
            channel.last = stamp
        channel.count += 1
        self._writer.write(channel.connection, logged, message)

    def _write_early(self) -> None:
        """Add what came before anything had said what time it is."""
        early, self._early = self._early, []
        for channel, message in early:
            self.write(channel, message)

    @property
    def resets(self) -> int:
        """How often simulated time jumped back."""
        return self._log_time.resets

    @property
    def missing(self) -> dict[str, int]:
        """Messages that never came, by topic; topics that are complete are left out."""
        return {c.topic.name: c.missing for c in self.channels if c.missing}

    def close(self) -> None:
        """Write what is left, the index and metadata.yaml."""
        for channel, message in self._early:
            channel.count += 1
            self._writer.write(channel.connection, 0, message)
        self._early = []
        self._writer.set_custom_data(MISSING_KEY, json.dumps(self.missing))
        self._writer.close()

    def report(self) -> str:
        """Return a table of topics, their messages and the missing ones."""
        lines = [f"{'topic':<28}{'messages':>9}{'missing':>9}"]
        lines += [f"{c.topic.name:<28}{c.count:>9}{c.missing:>9}" for c in self.channels]
        return "\n".join(lines)


def _make_room(path: Path, overwrite: bool) -> None:
    """See to it that there is nothing at `path`; only a bag is ever removed."""
    if not path.exists() and not path.is_symlink():
        return
    if not overwrite:
        raise FileExistsError(f"{path} exists; choose another output or set overwrite")
    contents = list(path.iterdir()) if path.is_dir() and not path.is_symlink() else None
    if contents is None or any(_is_foreign(entry) for entry in contents):
        raise FileExistsError(f"{path} is not a bag, it will not be overwritten")
    shutil.rmtree(path)


def _is_foreign(entry: Path) -> bool:
    """Return whether an entry of a directory cannot be part of an MCAP bag."""
    return not entry.is_file() or not (entry.name == "metadata.yaml" or entry.suffix == ".mcap")


def select_topics(names: Sequence[str]) -> list[graph.Topic]:
    """Return the rows of the graph's table for these names, in the table's order.

    Raises:
        ValueError: a name that the graph does not have.
    """
    unknown = sorted(set(names) - {topic.name for topic in graph.TOPICS})
    if unknown:
        known = ", ".join(topic.name for topic in graph.TOPICS)
        raise ValueError(f"topics has {', '.join(unknown)}, it must be some of {known}")
    return [topic for topic in graph.TOPICS if topic.name in names]
