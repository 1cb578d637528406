"""One MAVLink connection of the flight controller: its codec, its streams, its lists."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeAlias

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.autopilot.mavlink_ftp import Client, FtpServer
from husky_pu.autopilot.mavlink_parameters import ParameterTalk
from husky_pu.autopilot.telemetry import STREAMS, Message, Vehicle
from husky_pu.mavlink.frames import FrameReader, signing_time

TICKS_PER_SECOND = 500
_BREAK_TICKS = 25
"""Silence within a frame after which it will not be completed: 50 ms."""
_FILE_TICKS = 4
"""Between two packets of a file: 30 kB/s, a third of a line of 921600 baud."""

SignedAt: TypeAlias = dict[tuple[int, int, int], int]
"""Newest time stamp [10 us] of each signer: link id, system, component."""


def _default_intervals() -> dict[int, int]:
    return {
        number: round(TICKS_PER_SECOND / stream.rate) if stream.rate else 0
        for number, stream in STREAMS.items()
    }


class MavlinkLink:
    """One peer or one line.

    Attributes:
        reader: finds frames in its bytes.
        streaming: messages go out by themselves.
        permanent: it stays though nobody speaks on it.
        heard_ns: when it last spoke [ns], -1 for never.
        parameters: its side of the parameter protocols.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        number: int,
        signing_key: bytes = b"",
        unix_time: Callable[[], float] = time.time,
        signed_at: SignedAt | None = None,
    ):
        """Open it.

        Args:
            vehicle: whose link it is.
            number: of the link, in signatures.
            signing_key: 32 bytes, empty for no signing.
            unix_time: stamps signatures [s since 1970]; nothing else.
            signed_at: newest signatures of all links together, so that what was recorded on one
                is not taken on another.
        """
        self._codec = mavlink.MAVLink(None)
        self._unix_time = unix_time
        if signing_key:
            signing = self._codec.signing
            signing.secret_key, signing.sign_outgoing = signing_key, True
            signing.link_id = number & 0xFF
            signing.timestamp = signing_time(unix_time())
            signing.stream_timestamps = {} if signed_at is None else signed_at
        self.reader = FrameReader(self._codec)
        self.streaming = self.permanent = False
        self.heard_ns = -1
        self._output = bytearray()
        self._pending_ticks = 0
        self.restart(vehicle)

    def restart(self, vehicle: Vehicle) -> None:
        """The flight controller has started again: default rates, no list under way."""
        self._vehicle = vehicle
        self._codec.srcSystem = int(vehicle.parameters["MAV_SYS_ID"])
        self._codec.srcComponent = int(vehicle.parameters["MAV_COMP_ID"])
        self.intervals = _default_intervals()
        self._due = _by_interval(self.intervals)
        self.parameters = ParameterTalk(vehicle.parameters, self.send)
        self._files = FtpServer(vehicle.files)
        self._told_state: tuple[int, int, int] | None = None

    # Bytes --------------------------------------------------------------------------------------
    def feed(self, data: bytes) -> list[Message]:
        """Take bytes; return the messages in them."""
        self._pending_ticks = 0
        return self.reader.feed(data)

    def send(self, message: Message) -> None:
        """Put a message on the line."""
        codec = self._codec
        self._output += message.pack(codec)
        codec.seq = (codec.seq + 1) % 256

    def take_output(self) -> bytes:
        """Return the bytes to put on the line since the last call."""
        if not self._output:
            return b""
        data = bytes(self._output)
        self._output.clear()
        return data

    def parting_output(self) -> bytes:
        """Return the bytes that are left, with a heartbeat if none has been sent yet."""
        if self.streaming and self._told_state is None:
            self.send_once(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        return self.take_output()

    # Streams ------------------------------------------------------------------------------------
    def send_due(self, count: int, made: dict[int, list[Message]]) -> list[Message]:
        """Send what is due in a tick; return messages of a frame that was given up.

        Args:
            count: of ticks since boot.
            made: messages that were built in this tick, by id; shared by all links.
        """
        late: list[Message] = []
        if self.reader.pending:
            self._pending_ticks += 1
            if self._pending_ticks > _BREAK_TICKS:
                self._pending_ticks = 0
                late = self.reader.give_up()
        if not self.streaming:
            return late
        state = self._vehicle.heartbeat_state
        if state != self._told_state:  # told at once
            self._told_state = state
            self.send_once(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        for interval, numbers in self._due:
            if count % interval == 0:
                for number in numbers:
                    messages = made.get(number)
                    if messages is None:
                        messages = made[number] = STREAMS[number].messages(self._vehicle)
                    for message in messages:
                        self.send(message)
        if count % TICKS_PER_SECOND == 0 and self._codec.signing.secret_key is not None:
            signing = self._codec.signing
            signing.timestamp = max(signing.timestamp, signing_time(self._unix_time()))
        if self.parameters.listing:
            self.parameters.send_next()
        if self._files.bursting and count % _FILE_TICKS == 0:
            for client, payload in self._files.stream():
                self._send_file(payload, client)
        return late

    def set_interval(self, message_id: int, microseconds: float) -> bool:
        """Change how often a message is sent [us]; -1 never, 0 as by default."""
        if message_id not in STREAMS:
            return False
        if microseconds == 0:
            interval = _default_intervals()[message_id]
        elif microseconds < 0:
            interval = 0
        else:
            interval = max(1, round(1e-6 * microseconds * TICKS_PER_SECOND))
        self.intervals[message_id] = interval
        self._due = _by_interval(self.intervals)
        return True

    def get_interval(self, message_id: int) -> int:
        """Return how often it is sent [us], -1 never, 0 for one that there is not."""
        if message_id not in STREAMS:
            return 0
        return self.intervals[message_id] * 1_000_000 // TICKS_PER_SECOND or -1

    def send_once(self, message_id: int) -> bool:
        """Send a message now; False for one that there is not."""
        stream = STREAMS.get(message_id)
        if stream is None:
            return False
        for message in stream.messages(self._vehicle):
            self.send(message)
        return True

    # Files --------------------------------------------------------------------------------------
    def transfer(self, payload: bytes, client: Client) -> None:
        """Answer a FILE_TRANSFER_PROTOCOL of a client: system and component."""
        reply = self._files.answer(payload, client)
        if reply is not None:
            self._send_file(reply, client)

    def _send_file(self, payload: bytes, client: Client) -> None:
        self.send(mavlink.MAVLink_file_transfer_protocol_message(0, *client, list(payload)))


def _by_interval(intervals: dict[int, int]) -> list[tuple[int, list[int]]]:
    """Return the streams in the order of a bundle, neighbours of one interval together."""
    due: list[tuple[int, list[int]]] = []
    for number, interval in intervals.items():
        if not interval:
            continue
        if due and due[-1][0] == interval:
            due[-1][1].append(number)
        else:
            due.append((interval, [number]))
    return due
