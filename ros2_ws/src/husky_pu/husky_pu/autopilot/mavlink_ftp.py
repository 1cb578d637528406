"""MAVLink's file transfer protocol, the server's side, read-only: requests in, replies out.

FILE_TRANSFER_PROTOCOL carries 251 bytes: sequence number, session, opcode, size, the request that
is answered, "burst complete", offset, then up to 239 bytes of data. Each request is answered, by
ACK or by NAK with a reason; the reply's sequence number is one higher. A request that comes again
(its reply was lost) gets the same reply again. What would write is refused with "file protected".

Source: mavlink.io/en/services/ftp.html.
"""

from __future__ import annotations

import posixpath
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from pymavlink.dialects.v20 import common as mavlink

Client: TypeAlias = tuple[int, int]
"""System and component of a client."""
DATA_SIZE = 239
"""Most bytes of data in one message."""
PAYLOAD_SIZE = 251
_HEADER = struct.Struct("<HBBBBBxI")
_MOST_CLIENTS = 16
_MOST_SESSIONS = 4
"""Files that one client may have open."""


_ACK, _NAK = int(mavlink.MAV_FTP_OPCODE_ACK), int(mavlink.MAV_FTP_OPCODE_NAK)
_BURST = int(mavlink.MAV_FTP_OPCODE_BURSTREADFILE)
_WRITING = (
    mavlink.MAV_FTP_OPCODE_CREATEFILE,
    mavlink.MAV_FTP_OPCODE_REMOVEFILE,
    mavlink.MAV_FTP_OPCODE_CREATEDIRECTORY,
    mavlink.MAV_FTP_OPCODE_REMOVEDIRECTORY,
    mavlink.MAV_FTP_OPCODE_OPENFILEWO,
    mavlink.MAV_FTP_OPCODE_TRUNCATEFILE,
    mavlink.MAV_FTP_OPCODE_RENAME,
)


class FtpFrame(NamedTuple):
    """The payload of one FILE_TRANSFER_PROTOCOL.

    Attributes:
        sequence: number, 16 bits.
        session: of the file that is meant.
        opcode: MAV_FTP_OPCODE.
        size: bytes of data that are there, or that are wanted of a file.
        answered: opcode of the request, in replies.
        burst_complete: this packet is the last of a burst.
        offset: in the file [bytes], or in the list of a directory [entries].
        data: names, or what stands in the file.
    """

    sequence: int
    session: int
    opcode: int
    size: int = 0
    answered: int = 0
    burst_complete: int = 0
    offset: int = 0
    data: bytes = b""

    @classmethod
    def of_payload(cls, payload: bytes) -> FtpFrame:
        """Return the frame in a payload, which may lack zeros at its end."""
        whole = payload.ljust(PAYLOAD_SIZE, b"\0")
        fields: tuple[int, int, int, int, int, int, int] = _HEADER.unpack_from(whole)
        return cls(*fields, whole[_HEADER.size :])

    def to_payload(self) -> bytes:
        """Return the payload, with zeros behind the data."""
        return (_HEADER.pack(*self[:7]) + self.data).ljust(PAYLOAD_SIZE, b"\0")


class _RefusedError(Exception):
    """A request is answered NAK, with a MAV_FTP_ERR."""

    def __init__(self, problem: int):
        super().__init__(problem)
        self.problem = problem


@dataclass
class _Burst:
    """A file on its way, packet by packet."""

    session: int
    offset: int
    size: int
    sequence: int


@dataclass
class _Client:
    sessions: dict[int, bytes] = field(default_factory=dict)
    burst: _Burst | None = None
    request: bytes | None = None
    reply: bytes = b""


class FtpServer:
    """Serves files that do not change; while it is `bursting` call `stream`."""

    def __init__(self, files: Mapping[str, bytes]):
        """Serve these files: content by absolute path, all in the root directory."""
        self._files = files
        self._clients: dict[Client, _Client] = {}
        self.bursting = False

    def answer(self, payload: bytes, name: Client) -> bytes | None:
        """Return the payload that answers a client's request, None for what is a reply itself."""
        request = FtpFrame.of_payload(payload)
        if request.opcode in (_ACK, _NAK):
            return None
        client = self._client(name)
        if payload == client.request and request.opcode != _BURST:
            return client.reply
        try:
            reply = self._carry_out(request, client)
        except _RefusedError as refused:
            reply = FtpFrame(0, request.session, _NAK, 1, data=bytes((refused.problem,)))
        client.request = payload
        client.reply = reply._replace(
            sequence=(request.sequence + 1) & 0xFFFF, answered=request.opcode
        ).to_payload()
        self._look()
        return client.reply

    def stream(self) -> list[tuple[Client, bytes]]:
        """Return the next packet of each burst that is under way, with its client."""
        packets = [
            (name, self._next_packet(client, client.burst).to_payload())
            for name, client in self._clients.items()
            if client.burst is not None
        ]
        self._look()
        return packets

    # Requests -----------------------------------------------------------------------------------
    def _client(self, name: Client) -> _Client:
        """Return the state of a client, who is now the one heard last."""
        client = self._clients.pop(name, None) or _Client()
        if len(self._clients) >= _MOST_CLIENTS:
            del self._clients[next(iter(self._clients))]
        self._clients[name] = client
        return client

    def _look(self) -> None:
        self.bursting = any(client.burst is not None for client in self._clients.values())

    def _carry_out(self, request: FtpFrame, client: _Client) -> FtpFrame:
        """Return the reply, but for its sequence number and the request that it answers."""
        if request.size > DATA_SIZE:
            raise _RefusedError(mavlink.MAV_FTP_ERR_INVALIDDATASIZE)
        if request.opcode in _WRITING:
            raise _RefusedError(mavlink.MAV_FTP_ERR_FILEPROTECTED)
        handler = _HANDLERS.get(request.opcode)
        if handler is None:
            raise _RefusedError(mavlink.MAV_FTP_ERR_UNKNOWNCOMMAND)
        return handler(self, request, client)

    def _nothing(self, request: FtpFrame, client: _Client) -> FtpFrame:
        return _ack(request.session)

    def _terminate(self, request: FtpFrame, client: _Client) -> FtpFrame:
        _content(request, client)
        del client.sessions[request.session]
        if client.burst is not None and client.burst.session == request.session:
            client.burst = None
        return _ack(request.session)

    def _reset(self, request: FtpFrame, client: _Client) -> FtpFrame:
        client.sessions.clear()
        client.burst = None
        return _ack(request.session)

    def _list(self, request: FtpFrame, client: _Client) -> FtpFrame:
        if _path(request) != "/":
            raise _RefusedError(mavlink.MAV_FTP_ERR_FILENOTFOUND)
        entries = [
            f"F{path[1:]}\t{len(content)}\0".encode() for path, content in self._files.items()
        ]
        listed = b""
        for entry in entries[request.offset :]:
            if len(listed) + len(entry) > DATA_SIZE:
                break
            listed += entry
        if not listed:
            raise _RefusedError(mavlink.MAV_FTP_ERR_EOF)
        return _ack(request.session, listed, request.offset)

    def _open(self, request: FtpFrame, client: _Client) -> FtpFrame:
        content = self._file(request)
        if len(client.sessions) >= _MOST_SESSIONS:
            raise _RefusedError(mavlink.MAV_FTP_ERR_NOSESSIONSAVAILABLE)
        # The server chooses. Some clients (MAVProxy) hear of no other than they have named.
        session = request.session
        if session in client.sessions:
            session = min(set(range(_MOST_SESSIONS)) - set(client.sessions))
        client.sessions[session] = content
        return _ack(session, struct.pack("<I", len(content)))

    def _read(self, request: FtpFrame, client: _Client) -> FtpFrame:
        content = _content(request, client)
        data = content[request.offset : request.offset + request.size]
        if request.offset >= len(content):
            raise _RefusedError(mavlink.MAV_FTP_ERR_EOF)
        return _ack(request.session, data, request.offset)

    def _write(self, request: FtpFrame, client: _Client) -> FtpFrame:
        _content(request, client)
        raise _RefusedError(mavlink.MAV_FTP_ERR_FILEPROTECTED)

    def _checksum(self, request: FtpFrame, client: _Client) -> FtpFrame:
        return _ack(request.session, struct.pack("<I", crc32(self._file(request))))

    def _burst(self, request: FtpFrame, client: _Client) -> FtpFrame:
        if request.offset >= len(_content(request, client)):
            raise _RefusedError(mavlink.MAV_FTP_ERR_EOF)
        size = request.size or DATA_SIZE
        client.burst = _Burst(request.session, request.offset, size, request.sequence)
        return self._next_packet(client, client.burst)

    def _next_packet(self, client: _Client, burst: _Burst) -> FtpFrame:
        """Return the next packet of a burst; with the last the burst ends."""
        content = client.sessions[burst.session]
        data, at = content[burst.offset : burst.offset + burst.size], burst.offset
        burst.offset += len(data)
        burst.sequence = (burst.sequence + 1) & 0xFFFF
        complete = burst.offset >= len(content)
        if complete:
            client.burst = None
        packet = _ack(burst.session, data, at)
        return packet._replace(
            sequence=burst.sequence, answered=_BURST, burst_complete=int(complete)
        )

    def _file(self, request: FtpFrame) -> bytes:
        """Return the content of the file that a request names."""
        path = _path(request)
        if path == "/":
            raise _RefusedError(mavlink.MAV_FTP_ERR_FAIL)  # a directory
        content = self._files.get(path)
        if content is None:
            raise _RefusedError(mavlink.MAV_FTP_ERR_FILENOTFOUND)
        return content


def _ack(session: int, data: bytes = b"", offset: int = 0) -> FtpFrame:
    return FtpFrame(0, session, _ACK, len(data), offset=offset, data=data)


def _path(request: FtpFrame) -> str:
    """Return the absolute path in a request's data."""
    text = request.data[: request.size].split(b"\0", 1)[0].decode("utf-8", errors="replace")
    return posixpath.normpath(f"/{text.lstrip('/')}")


def _content(request: FtpFrame, client: _Client) -> bytes:
    """Return what stands in the file of a request's session."""
    content = client.sessions.get(request.session)
    if content is None:
        raise _RefusedError(mavlink.MAV_FTP_ERR_INVALIDSESSION)
    return content


_HANDLERS: dict[int, Callable[[FtpServer, FtpFrame, _Client], FtpFrame]] = {
    mavlink.MAV_FTP_OPCODE_NONE: FtpServer._nothing,
    mavlink.MAV_FTP_OPCODE_TERMINATESESSION: FtpServer._terminate,
    mavlink.MAV_FTP_OPCODE_RESETSESSION: FtpServer._reset,
    mavlink.MAV_FTP_OPCODE_LISTDIRECTORY: FtpServer._list,
    mavlink.MAV_FTP_OPCODE_OPENFILERO: FtpServer._open,
    mavlink.MAV_FTP_OPCODE_READFILE: FtpServer._read,
    mavlink.MAV_FTP_OPCODE_WRITEFILE: FtpServer._write,
    mavlink.MAV_FTP_OPCODE_CALCFILECRC: FtpServer._checksum,
    mavlink.MAV_FTP_OPCODE_BURSTREADFILE: FtpServer._burst,
}


def crc32(data: bytes, state: int = 0) -> int:
    """Return MAVLink's CRC-32: zlib's polynomial, but from zero and without a last inversion.

    `state` is the checksum of the bytes before the data.
    """
    return zlib.crc32(data, state ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
