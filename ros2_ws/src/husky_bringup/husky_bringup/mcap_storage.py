"""An MCAP file that is whole up to its last chunk at any time, also on a disk that gets full."""

from __future__ import annotations

import contextlib
import os
import pickle
import struct
from array import array
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from zlib import compress, crc32, decompress

from rosbags.rosbag2.enums import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter

_CRC_PLACE = 9 + 24
"""Of the checksum in a chunk record: behind opcode, length, two times and a size."""
_MAGIC = b"\x89MCAP0\r\n"
_CHECKSUM_AND_MAGIC = 12
_FOOTER = struct.Struct("<BQQQI8s")
"""Opcode, length, start of the summary, of its offsets, checksum, magic."""
_INDEX = struct.Struct("<QQQ")
"""Least and greatest log time [ns] of a chunk, and where it begins [bytes]: its index's first."""
_BLOCK = 64
"""Records that are packed together."""


class WholeWrites:
    """A file that gets whatever is committed to it whole or not at all."""

    def __init__(self, path: Path):
        """Go on at the end of a file.

        Raises:
            OSError: it cannot be opened.
        """
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
        self._length = os.lseek(self._descriptor, 0, os.SEEK_END)
        self._pending = bytearray()

    def tell(self) -> int:
        """Return the length with what is pending [bytes]."""
        return self._length + len(self._pending)

    def write(self, data: bytes | memoryview) -> int:
        """Add to what is pending; return how much."""
        self._pending += data
        return len(data)

    def patch(self, place: int, data: bytes) -> None:
        """Change what is pending at a place of the file."""
        start = place - self._length
        self._pending[start : start + len(data)] = data

    def pending_from(self, place: int) -> bytes:
        """Return what is pending from a place of the file on."""
        return bytes(self._pending[place - self._length :])

    def commit(self) -> None:
        """Write what is pending.

        Raises:
            OSError: it cannot be written, and is given up; the file is as it was before.
        """
        data, self._pending = memoryview(self._pending), bytearray()
        written = 0
        try:
            while written < len(data):
                written += os.write(self._descriptor, data[written:])
        except OSError:
            self.cut(self._length)
            raise
        self._length += written

    def cut(self, length: int) -> None:
        """Take away the end of the file, and what is pending."""
        self._pending = bytearray()
        self._length = length
        with contextlib.suppress(OSError):
            os.ftruncate(self._descriptor, length)
            os.lseek(self._descriptor, length, os.SEEK_SET)

    def close(self) -> None:
        """Nothing: `commit` and `release` say what is meant."""

    def release(self) -> None:
        """Give the file back."""
        os.close(self._descriptor)


class PackedRecords:
    """A list of records that gets long and is hardly looked at: all but the newest are packed.

    What the index at the end of a file tells of each chunk has to be kept until then.
    """

    def __init__(self) -> None:
        """No record."""
        self._packed: list[bytes] = []
        self._newest: list[bytes] = []

    def __len__(self) -> int:
        """Return how many there are."""
        return _BLOCK * len(self._packed) + len(self._newest)

    def __iter__(self) -> Iterator[bytes]:
        """Yield them from the first to the last."""
        for block in self._packed:
            yield from _unpack(block)
        yield from self._newest

    def append(self, record: bytes) -> None:
        """Add one at the end."""
        self._newest.append(record)
        if len(self._newest) == _BLOCK:
            self._packed.append(compress(pickle.dumps(self._newest)))
            self._newest = []

    def pop(self) -> bytes:
        """Take the last one away; return it."""
        if not self._newest:
            self._newest = _unpack(self._packed.pop())
        return self._newest.pop()


def _unpack(block: bytes) -> list[bytes]:
    records: list[bytes] = pickle.loads(decompress(block))
    return records


class _Streams:
    """Records as the list of streams, each at its end, that rosbags keeps."""

    def __init__(self, records: PackedRecords):
        self._records = records

    def __len__(self) -> int:
        return len(self._records)

    def __iter__(self) -> Iterator[BytesIO]:
        for record in self._records:
            stream = BytesIO()
            stream.write(record)
            yield stream

    def append(self, stream: BytesIO) -> None:
        self._records.append(stream.getvalue())


class WholeMcapWriter(McapWriter):
    """Writes chunk by chunk, each with its checksum; `close` may fail, and be tried again."""

    def __init__(self, path: Path, compression: CompressionMode):
        """Make the file `path`/NAME.mcap.

        Raises:
            OSError: it cannot be made.
        """
        super().__init__(path, compression)
        self.bio.close()
        self._file = WholeWrites(self.path)
        self.bio = self._file  # type: ignore[assignment]
        self._indexes, self._counts = PackedRecords(), PackedRecords()  # of each chunk
        self.chunks = _Streams(self._indexes)  # type: ignore[assignment]

    def close_chunk(self) -> None:
        """Write the pending chunk.

        Raises:
            OSError: it cannot be written; it is given up, the file ends with the chunk before it.
        """
        chunk, start = self.chunk, self._file.tell()
        checksum = crc32(chunk.bio.getbuffer())
        super().close_chunk()
        self._file.patch(start + _CRC_PLACE, checksum.to_bytes(4, "little"))
        try:
            self._file.commit()
        except OSError:
            self._indexes.pop()
            raise
        counts = array("I", (len(chunk.msgs.get(channel, ())) for channel in self.channel_stats))
        self._counts.append(counts.tobytes())

    def close(self, version: int, metadata: str) -> None:
        """Write index and footer; the file stays open until `release`: it may have to be cut yet.

        Raises:
            OSError: they cannot be written; the file ends with the last chunk.
        """
        super().close(version, metadata)
        place = self._file.tell() - _FOOTER.size
        _, _, start, _, _, _ = _FOOTER.unpack(self._file.pending_from(place))
        checksum = crc32(self._file.pending_from(start)[:-_CHECKSUM_AND_MAGIC])
        self._file.patch(place + _FOOTER.size - _CHECKSUM_AND_MAGIC, checksum.to_bytes(4, "little"))
        self._file.commit()

    @property
    def has_pending(self) -> bool:
        """Whether there are messages that are not in the file yet."""
        return bool(self.chunk.msgs)

    @property
    def counts(self) -> dict[int, int]:
        """Messages in the file, by channel."""
        total = dict.fromkeys(self.channel_stats, 0)
        for counts in self._counts:
            # Channels that were made later are missing at the end.
            for channel, count in zip(total, array("I", counts), strict=False):
                total[channel] += count
        return total

    @property
    def times(self) -> tuple[int, int]:
        """Least and greatest log time in the file [ns], as rosbags has them for none at all."""
        first, last = 2**63 - 1, 0
        for index in self._indexes:
            start, end, _ = _INDEX.unpack_from(index)  # of a chunk without messages as above
            first, last = min(first, start), max(last, end)
        return first, last

    def settle(self) -> None:
        """Make the statistics those of what is in the file."""
        self.channel_stats = self.counts
        self.message_start_time, self.message_end_time = self.times

    def give_back(self) -> bool:
        """Cut the last chunk and all behind it, to make room; return whether there was one."""
        if not self._indexes:
            return False
        self._counts.pop()
        _, _, place = _INDEX.unpack_from(self._indexes.pop())
        self._file.cut(place)
        return True

    def release(self) -> None:
        """Close the file for good."""
        self._file.release()


def check_index(path: Path) -> None:
    """Check the index at the end of a file against its checksum, if it has one.

    Raises:
        OSError: the file cannot be read.
        ValueError: there is no index, or it is damaged.
    """
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _FOOTER.size))
        end = file.read()
        if len(end) < _FOOTER.size or not end.endswith(_MAGIC):
            raise ValueError("it has no index: it was not closed, or is cut short")
        _, _, start, _, checksum, _ = _FOOTER.unpack(end)
        if not checksum:
            return
        file.seek(min(start, size))
        if crc32(file.read()[:-_CHECKSUM_AND_MAGIC]) != checksum:
            raise ValueError("its index does not match its checksum")
