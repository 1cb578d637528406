"""What a bag holds of that which the page is drawn from."""

from __future__ import annotations

import math
import threading
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Any
from zlib import compress, decompress

from husky_bringup.bag_reader import BagReader
from husky_bringup.console.page import PLOTTED, SOURCES
from husky_bringup.console.plots import PERIOD, SPAN
from husky_bringup.definitions import Definitions
from husky_runtime import graph

_STANDS, _STANDS_OF_TF = 3.0, 1.0
"""For how long what is told again and again counts [s]: reports and plans once a second."""
_SLACK = 1e-3
"""By how much a message may come early to be kept [s]."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A message.

    Attributes:
        time: log time [s].
        topic: as in `SOURCES`.
        kept: its CDR; that of a map is compressed, since most of its cells are not known.
    """

    time: float
    topic: str
    kept: bytes

    @property
    def data(self) -> bytes:
        """Its CDR."""
        return decompress(self.kept) if self.topic == graph.ELEVATION_MAP else self.kept


@dataclass(slots=True)
class _Track:
    """The messages of one topic, by time."""

    topic: graph.Topic
    messages: list[Recorded] = field(default_factory=list)

    @property
    def stands(self) -> float:
        """For how long a message counts [s]."""
        if self.topic.qos == "LATCHED":
            return math.inf
        if self.topic.relative in PLOTTED:
            return SPAN
        return _STANDS_OF_TF if self.topic.relative == graph.TF else _STANDS

    @property
    def period(self) -> float:
        """Between two messages that are kept, at least [s]; 0 where all are."""
        return PERIOD - _SLACK if self.topic.rate * PERIOD > 1.0 else 0.0

    def between(self, after: float, until: float) -> list[Recorded]:
        """Return the messages after a time, up to another [s]."""
        time = attrgetter("time")
        first = bisect_right(self.messages, after, key=time)
        return self.messages[first : bisect_right(self.messages, until, key=time)]

    def standing(self, time: float) -> list[Recorded]:
        """Return the messages that still count at a time [s]; of maps the newest alone."""
        found = self.between(time - self.stands, time)
        return found[-1:] if self.topic.relative == graph.ELEVATION_MAP else found

    def add(self, time: float, data: bytes) -> None:
        """Keep a message [CDR] of a log time [s], unless it comes too early."""
        if not self.messages or time >= self.messages[-1].time + self.period:
            topic = self.topic.relative
            kept = compress(data, 1) if topic == graph.ELEVATION_MAP else data
            self.messages.append(Recorded(time, topic, kept))


class Record:
    """The messages of a bag, of one robot.

    A thread reads them, so that nobody waits for the end of a long bag. What comes faster than
    plots show it is thinned out.

    Attributes:
        path: of the bag.
        start, end: first and last log time [s].
        read_to: log time before which all has been read [s]; inf at the end.
        left_out: what of it is not shown, and why.
    """

    def __init__(self, path: Path, namespace: str | None = None):
        """Open a bag and begin to read it.

        Args:
            path: its directory, or an MCAP file.
            namespace: of the robot; by default of the one whose clock is recorded.

        Raises:
            FileNotFoundError: there is none.
            rosbags.highlevel.AnyReaderError: it cannot be read, and nothing in it is whole.
            ValueError: there is nothing in it that the page shows.
        """
        self._bag = BagReader(path)
        robot = self._bag.namespace if namespace is None else namespace
        shown = [row for row in graph.TOPICS if row.relative in SOURCES]
        self._tracks = {graph.absolute(row.relative, robot): _Track(row) for row in shown}
        if not any(self._bag.counts.get(name) for name in self._tracks):
            found = ", ".join(sorted(self._bag.counts)) or "no message"
            raise ValueError(f"{path} holds nothing of a robot in {robot or '/'}; it has {found}")
        self.path, self.start, self.end = path, self._bag.start, self._bag.end
        self.read_to = self.start
        self.left_out = [self._bag.damage] if self._bag.damage else []
        self._closed = False
        self._thread = threading.Thread(target=self._read, name="bag", daemon=True)
        self._thread.start()

    def between(self, after: float, until: float) -> list[Recorded]:
        """Return the messages after a time, up to another [s], in their order."""
        return _in_order(track.between(after, until) for track in self._tracks.values())

    def standing(self, time: float) -> list[Recorded]:
        """Return the messages that still count at a time [s], in their order."""
        return _in_order(track.standing(time) for track in self._tracks.values())

    def close(self) -> None:
        """Read no further."""
        self._closed = True
        self._thread.join()

    def _read(self) -> None:
        """Read it all."""
        try:
            self._bag.read(self._take)
        except Exception as error:  # of damaged bytes, or of a disk: whatever the reader trips over
            self.left_out.append(f"{self.path} cannot be read further: {error}")
        if self._bag.damage and self._bag.damage not in self.left_out:
            self.left_out.append(self._bag.damage)
        self.read_to = math.inf

    def _take(self, reader: Any) -> None:
        """Keep the messages of a reader as rosbags has it."""
        tracks, wanted, today = {}, [], Definitions()
        for connection in reader.connections:
            track = self._tracks.get(connection.topic)
            if track is not None and self._is_known(track.topic.type, connection, reader, today):
                tracks[connection.topic] = track
                wanted.append(connection)
        for track in tracks.values():
            track.messages.clear()
        for connection, time_ns, data in reader.messages(wanted) if wanted else ():
            if self._closed:
                return
            track, time = tracks[connection.topic], time_ns / 1e9
            self.read_to = time
            track.add(time, data)

    def _is_known(self, kind: str, connection: Any, reader: Any, today: Definitions) -> bool:
        """Return whether messages are of a type as it is today, and note where they are not."""
        today.text(kind)  # learns it
        known: bool = connection.msgtype == kind and (
            reader.typestore.hash_rihs01(kind) == today.typestore.hash_rihs01(kind)
        )
        note = f"{connection.topic}: {connection.msgtype} is not what it is today"
        if not known and note not in self.left_out:
            self.left_out.append(note)
        return known


def _in_order(parts: Iterable[list[Recorded]]) -> list[Recorded]:
    """Return messages by time; those of one time in the order of their topics."""
    return sorted(chain.from_iterable(parts), key=attrgetter("time"))
