"""Writes a rosbag2 bag (MCAP storage) from messages as they come off the wire, undecoded."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rosbags.interfaces import Connection, Nodetype, Qos
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from husky_bringup.log_time import LogTime, read_stamp
from husky_bringup.mcap_storage import WholeMcapWriter
from husky_runtime import graph

METADATA_VERSION: Literal[9] = 9
"""Version of metadata.yaml that rosbag2 of ROS 2 Jazzy writes."""
MISSING_KEY = "husky.missing_messages"
"""Key in the bag's custom data: JSON of the messages that never came, by topic."""
INCOMPLETE_KEY = "husky.incomplete"
"""Key in the bag's custom data: why it ends early, in one line."""

_EARLY = 1 << 24
"""What is held back until the robot's time is known [bytes]."""
_PACING_RATE = 50.0
"""Topics of at least this nominal rate may set the present, and their gaps are counted [Hz]."""


def begins_with_stamp(typestore: Any, message_type: str) -> bool:
    """Return whether messages of a type begin with a stamp (a Time or a Header)."""
    _, fields = typestore.fielddefs[message_type]
    if not fields:
        return False
    kind, name = fields[0][1]
    return kind == Nodetype.NAME and name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header")


@dataclass(slots=True)
class BagChannel:
    """One topic of a bag that is being written."""

    topic: graph.Topic  # row of the graph's table, or what was found of another topic
    connection: Connection  # the writer's handle
    stamped: bool  # its messages begin with a stamp
    rank: int | None  # place among the topics that may set the present, None for one that may not
    period: int  # nominal [ns], 0 for a topic whose gaps are not counted
    count: int = 0  # messages written
    missing: int = 0  # messages that never came, by the gaps between stamps
    last: int = -1  # newest stamp [ns], negative before the first


class BagWriter:
    """A bag that is being written.

    The bag is a directory with `metadata.yaml` and one `.mcap` file, which `ros2 bag`, Foxglove
    and PlotJuggler open; the definitions of all message types are inside.

    When nothing more can be written, the disk being full, say, the bag is closed with what it has;
    where there is no room for index and metadata, its last chunks are given up for them.

    Attributes:
        path: the bag's directory.
        channels: one for each topic, in the order given, then those that were added.
        problem: why nothing more is written, in one line; "" while all is well.
        dropped: messages that came too late for it.
    """

    def __init__(
        self,
        path: Path,
        topics: Iterable[graph.Topic],
        profiles: Mapping[str, Qos],
        typestore: Any,
        *,
        text_of: Callable[[str], str] | None = None,
        overwrite: bool = False,
        compress: bool = True,
    ):
        """Open a new bag.

        Args:
            path: directory to make.
            topics: what will be written, in the graph's order.
            profiles: the quality of service that publishers offer, by the name of the profile.
            typestore: knows the types, or does after `text_of` has been asked.
            text_of: returns the whole definition of a type with its comments; without it they are
                written from the typestore.
            overwrite: replace a bag of that name.
            compress: chunks with Zstandard, as rosbag2's preset `zstd_fast` does.

        Raises:
            FileExistsError: there is something of that name, and it may not or cannot be replaced.
        """
        _make_room(path, overwrite)
        self.path = path
        self.problem = ""
        self.dropped = 0
        self._writer, self._storage = _open_writer(path, compress)
        self._open = True
        self.channels: list[BagChannel] = []
        self._typestore, self._text_of = typestore, text_of
        self._log_time = LogTime()
        self._early: list[tuple[BagChannel, bytes, int]] = []
        self._early_bytes = 0
        for topic in topics:
            self.add(topic, profiles[topic.qos])
        self._paced = any(channel.rank is not None for channel in self.channels)

    def add(self, topic: graph.Topic, offered: Qos) -> BagChannel:
        """Make a channel for one more topic; it may be written from now on.

        Args:
            topic: with its full name; one of at least 50 Hz may set the present.
            offered: quality of service of its publishers.

        Raises:
            LookupError: its type is not known.
        """
        text = self._text_of(topic.type) if self._text_of is not None else None
        stamped = begins_with_stamp(self._typestore, topic.type)
        connection = self._writer.add_connection(
            topic.name,
            topic.type,
            typestore=self._typestore,
            msgdef=text,
            rihs01=self._typestore.hash_rihs01(topic.type) if text is not None else None,
            offered_qos_profiles=[offered],
        )
        pacing = stamped and topic.rate >= _PACING_RATE
        period = round(1e9 / topic.rate) if pacing else 0
        rank = len(self.channels) if pacing else None
        self.channels.append(BagChannel(topic, connection, stamped, rank, period))
        return self.channels[-1]

    def write(self, channel: BagChannel, message: bytes) -> None:
        """Add a message, CDR with its encapsulation header, to one of `channels`."""
        if not self._open:
            self.dropped += 1
            return
        log_time = self._log_time
        stamp = read_stamp(message) if channel.stamped else -1
        if channel.rank is not None and stamp >= 0:
            logged = log_time.pace(channel.rank, stamp)
            if self._early:
                self._write_early()
        elif not self._paced:
            logged = time.time_ns()
        elif log_time.present is None or not log_time.is_paced:
            self._hold_back(channel, message)
            return
        elif stamp >= 0:
            logged = log_time.place(stamp)
        else:
            logged = log_time.present
        if channel.period and stamp >= 0:
            gap = stamp - channel.last
            if gap > 1.5 * channel.period and channel.last >= 0:
                channel.missing += round(gap / channel.period) - 1
            channel.last = stamp
        self._add(channel, logged, message)

    def _add(self, channel: BagChannel, logged: int, message: bytes) -> None:
        """Write a message, or close the bag if that cannot be done."""
        channel.count += 1
        try:
            self._writer.write(channel.connection, logged, message)
        except OSError as error:
            self._give_up(error)

    def flush(self) -> None:
        """Write what has come so far: whatever happens to this process, it is in the file."""
        if not self._open or not self._storage.has_pending:
            return
        try:
            self._storage.close_chunk()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.problem = f"{self.path}: {error.strerror or error}"
        self._finish()

    def _hold_back(self, channel: BagChannel, message: bytes) -> None:
        """Keep a message until something says what time it is, as long as there is room."""
        self._early.append((channel, message, time.time_ns()))
        self._early_bytes += len(message)
        if self._early_bytes > _EARLY:
            self._log_early()

    def _write_early(self) -> None:
        """Add what came before anything had said what time it is."""
        early, self._early, self._early_bytes = self._early, [], 0
        for channel, message, _ in early:
            self.write(channel, message)

    def _log_early(self) -> None:
        """Add what came before, at the wall time of its coming."""
        early, self._early, self._early_bytes = self._early, [], 0
        for channel, message, arrival in early:
            if self._open:
                self._add(channel, self._log_time.go_by(arrival), message)

    @property
    def resets(self) -> int:
        """How often simulated time jumped back."""
        return self._log_time.resets

    @property
    def missing(self) -> dict[str, int]:
        """Messages that never came, by topic; topics that are complete are left out."""
        return {c.topic.name: c.missing for c in self.channels if c.missing}

    def close(self) -> None:
        """Write what is left, the index and metadata.yaml; `problem` says if that failed."""
        self._log_early()
        self.flush()
        if self._open:
            self._finish()

    def _finish(self) -> None:
        """Write index and metadata, at the cost of the last chunks if need be."""
        self._open = False
        writer, storage = self._writer, self._storage
        while True:
            storage.settle()
            written = storage.counts
            writer.counts = dict(written)
            writer.min_timestamp, writer.max_timestamp = storage.times
            writer.set_custom_data(MISSING_KEY, json.dumps(self.missing))
            if self.problem:
                writer.set_custom_data(INCOMPLETE_KEY, self.problem)
            try:
                writer.close()
                break
            except OSError as error:
                self.problem = self.problem or f"{self.path}: {error.strerror or error}"
                writer.storage = storage
                writer.metapath.with_suffix(".yaml.tmp").unlink(missing_ok=True)
                if not storage.give_back():
                    break
        storage.release()
        for channel in self.channels:
            lost = channel.count - written[channel.connection.id]
            channel.count -= lost
            self.dropped += lost

    def report(self) -> str:
        """Return a table of topics, their messages and the missing ones."""
        width = max([28, *(len(channel.topic.name) + 1 for channel in self.channels)])
        lines = [f"{'topic':<{width}}{'messages':>9}{'missing':>9}"]
        lines += [f"{c.topic.name:<{width}}{c.count:>9}{c.missing:>9}" for c in self.channels]
        return "\n".join(lines)


def _open_writer(path: Path, compress: bool) -> tuple[Writer, WholeMcapWriter]:
    """Return a new bag's writer and the file behind it."""
    writer = Writer(path, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.STORAGE_PLUGINS = {StoragePlugin.MCAP: WholeMcapWriter}
    if compress:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    writer.open()
    assert isinstance(writer.storage, WholeMcapWriter)
    return writer, writer.storage


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
