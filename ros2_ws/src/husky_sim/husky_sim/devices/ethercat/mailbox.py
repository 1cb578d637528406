"""CAN application protocol over EtherCAT (CoE) at the mailbox of one simulated drive (ETG.1000.6).

Messages go in and out as bytes; which memory they stand in is the slave controller's business.
SDO transfers up and down, expedited, normal and in segments, SDO information, emergency messages.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.bus import NO_OBJECT, NO_SUBINDEX, SdoAbort
from husky_drivers.ethercat.pdo import MAPPINGS
from husky_sim.devices.drives.drive import OBJECT_NAMES, SimulatedDrive, error_register

HEADER = struct.Struct("<HHBB")
"""Length of what follows, station address, channel and priority, type and counter."""
_ERROR, _COE = 0x00, 0x03
UNSUPPORTED_PROTOCOL, SERVICE_NOT_SUPPORTED, TOO_SHORT, INVALID_SIZE = (
    0x0002,
    0x0004,
    0x0006,
    0x0008,
)
"""Details of a mailbox error."""
_EMERGENCY, _SDO_REQUEST, _SDO_RESPONSE, _SDO_INFORMATION = 0x1, 0x2, 0x3, 0x8
TOGGLE_NOT_ALTERNATED, UNKNOWN_COMMAND, OUT_OF_MEMORY = 0x05030000, 0x05040001, 0x05040005
UNSUPPORTED_ACCESS, LENGTH_DIFFERS = 0x06010000, 0x06070010
LONGEST_DOWNLOAD = 4096
"""Bytes that a master may download into one object (assumed)."""
_MOST_REPLIES = 4
"""Waiting replies from which on an emergency message waits in the drive."""
_SDO_BYTES = 8
_SEGMENT_BYTES = 7
_BEFORE_DATA = HEADER.size + 2 + _SDO_BYTES
"""Mailbox bytes before the data of a normal transfer."""
_DATA_TYPES = {
    "<b": (0x0002, 8),
    "<h": (0x0003, 16),
    "<i": (0x0004, 32),
    "<B": (0x0005, 8),
    "<H": (0x0006, 16),
    "<I": (0x0007, 32),
    "<f": (0x0008, 32),
}
"""Data type and bits of a number; text is a visible string."""
_VISIBLE_STRING = 0x0009
_VARIABLE, _RECORD = 0x07, 0x09
_IDENTITY_TYPE, _MAPPING_TYPE = 0x0023, 0x0021
_NO_TYPE = 0x0000
_READABLE, _WRITABLE = 0x0007, 0x0038


@dataclass
class _Transfer:
    """A transfer in segments: the object, its bytes, how many are through, the next toggle bit."""

    index: int
    subindex: int
    data: bytearray
    done: int
    size: int
    toggle: int = 0


class CoeServer:
    """Answers the mailbox of one drive.

    Attributes:
        replies: messages that wait to be fetched, without padding.
    """

    def __init__(self, drive: SimulatedDrive):
        """Stand before a drive."""
        self._drive = drive
        self.replies: deque[bytes] = deque()
        self.reset()

    def reset(self) -> None:
        """Forget messages, transfers and counters, as the drive does in INIT."""
        self.replies.clear()
        self._heard = self._counter = 0
        self._upload: _Transfer | None = None
        self._download: _Transfer | None = None

    def take_emergency(self) -> None:
        """Queue the emergency message that waits in the drive's record, if one does."""
        record = self._drive.record
        if record["emergency"] and len(self.replies) < _MOST_REPLIES:
            record["emergency"] = 0
            code = int(record["error_code"])
            self._reply_coe(_EMERGENCY, struct.pack("<HB5x", code, error_register(code)))

    def request(self, message: bytes, room: int) -> None:
        """Process a message of the master; replies are queued.

        Args:
            message: the whole mailbox.
            room: bytes of the mailbox for replies.
        """
        length, _, _, kind = HEADER.unpack_from(message)
        counter, protocol = kind >> 4 & 0x7, kind & 0x0F
        if counter and counter == self._heard:
            return  # repeated, as its answer seemed lost
        self._heard = counter
        body = message[HEADER.size : HEADER.size + length]
        if len(body) < length:
            self._reply_error(INVALID_SIZE)
        elif protocol != _COE:
            self._reply_error(UNSUPPORTED_PROTOCOL)
        elif length < 2 + 1:
            self._reply_error(TOO_SHORT)
        else:
            service = struct.unpack_from("<H", body)[0] >> 12
            content = body[2:].ljust(_SDO_BYTES, b"\0")
            if service == _SDO_REQUEST:
                self._sdo(content, length - 2, room)
            elif service == _SDO_INFORMATION:
                self._information(content, room)
            else:
                self._reply_error(SERVICE_NOT_SUPPORTED)

    def _reply(self, protocol: int, body: bytes) -> None:
        self._counter = self._counter % 7 + 1
        self.replies.append(HEADER.pack(len(body), 0, 0, protocol | self._counter << 4) + body)

    def _reply_coe(self, service: int, content: bytes) -> None:
        self._reply(_COE, struct.pack("<H", service << 12) + content)

    def _reply_error(self, detail: int) -> None:
        self._reply(_ERROR, struct.pack("<HH", 1, detail))

    # -- SDO

    def _sdo(self, content: bytes, length: int, room: int) -> None:
        command, index, subindex = struct.unpack_from("<BHB", content)
        service = command >> 5
        if service in (0, 3):  # segments name no object
            transfer = self._download if service == 0 else self._upload
            index, subindex = (transfer.index, transfer.subindex) if transfer else (0, 0)
        try:
            if service == 0:
                self._download_segment(command, content[1:length])
            elif service == 1:
                self._start_download(command, index, subindex, content[4:length])
            elif service == 2:
                self._start_upload(command, index, subindex, room)
            elif service == 3:
                self._upload_segment(command, room)
            elif command == 0x80:
                self._upload = self._download = None
            else:
                raise SdoAbort(UNKNOWN_COMMAND, 0, index, subindex)
        except SdoAbort as abort:
            self._upload = self._download = None
            abortion = struct.pack("<BHBI", 0x80, index, subindex, abort.code)
            self._reply_coe(_SDO_REQUEST, abortion)

    def _start_upload(self, command: int, index: int, subindex: int, room: int) -> None:
        self._refuse_complete_access(command, index, subindex)
        data = self._drive.sdo_read(index, subindex)
        self._upload = self._download = None
        if 0 < len(data) <= 4:
            answer = 0x43 | 4 - len(data) << 2
            head = struct.pack("<BHB", answer, index, subindex)
            self._reply_coe(_SDO_RESPONSE, head + data.ljust(4, b"\0"))
            return
        first = data[: room - _BEFORE_DATA]
        if len(first) < len(data):
            self._upload = _Transfer(index, subindex, bytearray(data), len(first), len(data))
        head = struct.pack("<BHBI", 0x41, index, subindex, len(data))
        self._reply_coe(_SDO_RESPONSE, head + first)

    def _upload_segment(self, command: int, room: int) -> None:
        transfer = self._continue(self._upload, command)
        end = transfer.done + room - HEADER.size - 3
        segment = bytes(transfer.data[transfer.done : end])
        transfer.done += len(segment)
        answer = command & 0x10
        if transfer.done == transfer.size:
            answer |= 0x01
            self._upload = None
        answer |= max(_SEGMENT_BYTES - len(segment), 0) << 1
        self._reply_coe(_SDO_RESPONSE, bytes((answer,)) + segment.ljust(_SEGMENT_BYTES, b"\0"))

    def _start_download(self, command: int, index: int, subindex: int, content: bytes) -> None:
        self._refuse_complete_access(command, index, subindex)
        self._upload = self._download = None
        if command & 0x02:
            unused = command >> 2 & 0x3 if command & 0x01 else 0
            self._drive.sdo_write(index, subindex, content[: 4 - unused])
        else:
            size = struct.unpack_from("<I", content.ljust(4, b"\0"))[0]
            data = content[4:]
            if size > LONGEST_DOWNLOAD:
                raise SdoAbort(OUT_OF_MEMORY, 0, index, subindex)
            if len(data) < size:
                self._download = _Transfer(index, subindex, bytearray(data), len(data), size)
            else:
                self._drive.sdo_write(index, subindex, data[:size])
        self._reply_coe(_SDO_RESPONSE, struct.pack("<BHB4x", 0x60, index, subindex))

    def _download_segment(self, command: int, content: bytes) -> None:
        transfer = self._continue(self._download, command)
        unused = command >> 1 & 0x7 if len(content) <= _SEGMENT_BYTES else 0
        transfer.data += content[: len(content) - unused]
        last = command & 0x01
        if len(transfer.data) > transfer.size or (last and len(transfer.data) < transfer.size):
            raise SdoAbort(LENGTH_DIFFERS, 0, transfer.index, transfer.subindex)
        if last:
            self._download = None
            self._drive.sdo_write(transfer.index, transfer.subindex, bytes(transfer.data))
        self._reply_coe(_SDO_RESPONSE, struct.pack("<B7x", 0x20 | command & 0x10))

    def _continue(self, transfer: _Transfer | None, command: int) -> _Transfer:
        """Return the transfer that a segment belongs to; raises SdoAbort."""
        if transfer is None:
            raise SdoAbort(UNKNOWN_COMMAND, 0, 0, 0)
        if command & 0x10 != transfer.toggle:
            raise SdoAbort(TOGGLE_NOT_ALTERNATED, 0, transfer.index, transfer.subindex)
        transfer.toggle ^= 0x10
        return transfer

    def _refuse_complete_access(self, command: int, index: int, subindex: int) -> None:
        if command & 0x10:
            raise SdoAbort(UNSUPPORTED_ACCESS, 0, index, subindex)

    # -- SDO information

    def _information(self, content: bytes, room: int) -> None:
        opcode = content[0] & 0x7F
        try:
            if opcode == 1:
                data = self._object_list(struct.unpack_from("<H", content, 4)[0])
            elif opcode == 3:
                data = self._describe_object(struct.unpack_from("<H", content, 4)[0])
            elif opcode == 5:
                data = self._describe_entry(*struct.unpack_from("<HBB", content, 4))
            else:
                raise SdoAbort(UNKNOWN_COMMAND, 0, 0, 0)
        except SdoAbort as abort:
            self._reply_information(7, 0, struct.pack("<I", abort.code))
            return
        step = room - HEADER.size - 2 - 4 & ~1
        pieces = [data[start : start + step] for start in range(0, len(data), step)]
        for left, piece in zip(reversed(range(len(pieces))), pieces, strict=True):
            self._reply_information(opcode + 1, left, piece)

    def _reply_information(self, opcode: int, left: int, data: bytes) -> None:
        head = struct.pack("<BxH", opcode | (0x80 if left else 0), left)
        self._reply_coe(_SDO_INFORMATION, head + data)

    def _object_list(self, kind: int) -> bytes:
        """Return a list of objects; 0 asks for the lengths of the lists 1 to 5.

        1 are all objects, 2 and 3 those that mapping objects map to outputs and inputs; 4 and 5,
        what to save and to load, are empty.
        """
        everything = list(self._drive.dictionary)
        mapped = [
            sorted(
                {entry.index for m in MAPPINGS if m >> 8 == group for entry in MAPPINGS[m]}
                & self._drive.dictionary.keys()
            )
            for group in (0x16, 0x1A)
        ]
        lists: list[Sequence[int]] = [everything, *mapped, (), ()]
        if kind == 0:
            found: Sequence[int] = [len(each) for each in lists]
        elif kind <= len(lists):
            found = lists[kind - 1]
        else:
            raise SdoAbort(UNKNOWN_COMMAND, 0, 0, 0)
        return struct.pack(f"<H{len(found)}H", kind, *found)

    def _describe_object(self, index: int) -> bytes:
        entries = self._entries(index)
        last = max(entries)
        first = entries[min(entries)]
        name = first.name
        if last:
            name = OBJECT_NAMES.get(index, f"mapping 0x{index:04X}")
        kind = _type_of(first)
        if last:
            kind = _MAPPING_TYPE if index >> 8 in (0x16, 0x1A) else _NO_TYPE
            kind = _IDENTITY_TYPE if index == 0x1018 else kind
        code = _RECORD if last else _VARIABLE
        return struct.pack("<HHBB", index, kind, last, code) + name.encode("ascii")

    def _describe_entry(self, index: int, subindex: int, wanted: int) -> bytes:
        entry = self._entries(index).get(subindex)
        if entry is None:
            raise SdoAbort(NO_SUBINDEX, 0, index, subindex)
        if entry.format in _DATA_TYPES:
            bits = _DATA_TYPES[entry.format][1]
        else:
            bits = 8 * len(self._drive.sdo_read(index, subindex))
        access = _READABLE | (_WRITABLE if entry.writable else 0)
        head = struct.pack("<HBBHHH", index, subindex, wanted & 0x07, _type_of(entry), bits, access)
        return head + entry.name.encode("ascii")

    def _entries(self, index: int) -> dict[int, od.ObjectEntry]:
        entries = self._drive.dictionary.get(index)
        if entries is None:
            raise SdoAbort(NO_OBJECT, 0, index, 0)
        return entries


def _type_of(entry: od.ObjectEntry) -> int:
    return _DATA_TYPES.get(entry.format, (_VISIBLE_STRING, 0))[0]
