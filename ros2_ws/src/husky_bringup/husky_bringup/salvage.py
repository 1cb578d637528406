"""Reads what is whole in an MCAP file that was not closed, or was damaged later.

The recorder was killed, the power went, a disk lost bytes: records are read from the start for as
long as they are whole; a chunk that does not match its checksum is left out. The format:
https://mcap.dev/spec.
"""

from __future__ import annotations

import contextlib
import heapq
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

from backports import zstd
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 3, 4, 5, 6
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_LONGEST = 1 << 31
"""Length of a chunk that is not believed [bytes]: its record is damaged."""


@dataclass(frozen=True)
class SalvagedTopic:
    """A topic of a salvaged file: what stands for a connection of rosbags."""

    topic: str  # its name
    msgtype: str  # its type


class _Damaged(Exception):
    """A record does not hold what it should."""


_DAMAGES = (_Damaged, struct.error, zstd.ZstdError, UnicodeDecodeError, LookupError)
"""What reading of damaged bytes ends in."""


class SalvagedBag:
    """What is whole in a bag's MCAP file.

    Attributes:
        connections: one for each channel.
        counts: messages by topic.
        start, end: least and greatest log time [ns], 0 without messages.
        lost_chunks: that are there but damaged.
    """

    def __init__(self, path: Path):
        """Look through a bag's directory, or an MCAP file, once.

        Raises:
            FileNotFoundError: there is none.
            OSError: it cannot be read.
        """
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if not files or not is_mcap(files[0]):
            raise FileNotFoundError(f"{path} has no MCAP file")
        self._path = files[0]
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, SalvagedTopic] = {}
        self._chunks: list[tuple[int, int]] = []
        self.lost_chunks = 0
        self.counts: Counter[str] = Counter()
        times: list[int] = []
        with self._path.open("rb") as file:
            records = list(_top_records(file))
            # The index at the end of a closed file repeats the definitions: a first chunk that is
            # damaged does not take all others along.
            for kind, place, length in records:
                if kind in (_SCHEMA, _CHANNEL):
                    file.seek(place)
                    with contextlib.suppress(*_DAMAGES):
                        self._define(kind, file.read(length))
            for kind, place, length in records:
                if kind != _CHUNK:
                    continue
                messages = self._whole(file, place, length)
                if messages is None:
                    self.lost_chunks += 1
                    continue
                self._chunks.append((place, length))
                self.counts.update(topic.topic for topic, _, _ in messages)
                times += (message[1] for message in (messages[:1] + messages[-1:]))
        self.start, self.end = (min(times), max(times)) if times else (0, 0)
        self.connections = list(dict.fromkeys(self._channels.values()))

    def messages(
        self, connections: Collection[SalvagedTopic] = ()
    ) -> Iterator[tuple[SalvagedTopic, int, bytes]]:
        """Yield topic, log time [ns] and message, by time; of all topics or of some."""
        wanted = set(connections) or set(self.connections)
        with self._path.open("rb") as file:
            parts = [self._whole(file, *place) or [] for place in self._chunks]
        for message in heapq.merge(*parts, key=itemgetter(1)):
            if message[0] in wanted:
                yield message

    def _whole(
        self, file: BinaryIO, place: int, length: int
    ) -> list[tuple[SalvagedTopic, int, bytes]] | None:
        """Return the messages of a chunk by time, and note its definitions; None if damaged."""
        file.seek(place)
        try:
            return sorted(self._read(_unpack(file.read(length))), key=itemgetter(1))
        except _DAMAGES:
            return None

    def _read(self, content: bytes) -> Iterator[tuple[SalvagedTopic, int, bytes]]:
        place = 0
        while place < len(content):
            kind, length = _RECORD.unpack_from(content, place)
            place += _RECORD.size
            body = content[place : place + length]
            place += length
            if len(body) != length:
                raise _Damaged
            if kind in (_SCHEMA, _CHANNEL):
                self._define(kind, body)
            elif kind == _MESSAGE:
                number, _, time, _ = _MESSAGE_HEAD.unpack_from(body)
                # The chunk that has told what it is may be damaged: the others are read.
                if number in self._channels:
                    yield self._channels[number], time, body[_MESSAGE_HEAD.size :]

    def _define(self, kind: int, body: bytes) -> None:
        """Note a schema or a channel."""
        number, schema = struct.unpack_from("<HH", body)
        if kind == _CHANNEL:
            self._channels[number] = SalvagedTopic(_text(body, 4)[0], self._schemas[schema][0])
            return
        name, end = _text(body, 2)
        _, end = _text(body, end)
        self._schemas[number] = (name, _text(body, end)[0])

    @cached_property
    def typestore(self) -> Any:
        """Definitions of the types."""
        store = get_typestore(Stores.EMPTY)
        found: dict[str, Any] = {}
        for name, definition in self._schemas.values():
            found.update(get_types_from_msg(definition, name))
        store.register(found)
        return store


def _top_records(file: BinaryIO) -> Iterator[tuple[int, int, int]]:
    """Yield kind, place and length [bytes] of each record that is whole by its length."""
    size = file.seek(0, 2)
    file.seek(0)
    place = len(_MAGIC)
    if file.read(place) != _MAGIC:
        return
    while place + _RECORD.size <= size:
        file.seek(place)
        kind, length = _RECORD.unpack(file.read(_RECORD.size))
        place += _RECORD.size
        if kind == 0 or length > min(_LONGEST, size - place):
            return
        yield kind, place, length
        place += length


def is_mcap(path: Path) -> bool:
    """Return whether a file begins like an MCAP file, as far as it goes."""
    with path.open("rb") as file:
        return _MAGIC.startswith(file.read(len(_MAGIC)))


def _unpack(body: bytes) -> bytes:
    """Return the records of a chunk."""
    _, _, size, checksum = _CHUNK_HEAD.unpack_from(body)
    compression, place = _text(body, _CHUNK_HEAD.size)
    (length,) = struct.unpack_from("<Q", body, place)
    packed = body[place + 8 :]
    if len(packed) != length or compression not in ("", "zstd") or size > _LONGEST:
        raise _Damaged
    content = zstd.decompress(packed) if compression else packed
    if len(content) != size or (checksum and crc32(content) != checksum):
        raise _Damaged
    return content


def _text(body: bytes, place: int) -> tuple[str, int]:
    """Return a text and where it ends."""
    (length,) = struct.unpack_from("<I", body, place)
    end = place + 4 + length
    if end > len(body):
        raise _Damaged
    return body[place + 4 : end].decode(), end
