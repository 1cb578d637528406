"""One MAVLink connection of the flight controller: its codec, its streams, its parameter list."""

from __future__ import annotations

import time
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.flight_parameters import (
    TABLE,
    FlightParameters,
    ParameterError,
    from_wire,
    to_wire,
)
from husky_pu.mavlink_frames import FrameReader, signing_time
from husky_pu.telemetry import STREAMS, Message, Vehicle

TICKS_PER_SECOND = 500
_BREAK_TICKS = 25
"""Silence within a frame after which it will not be completed: 50 ms."""
_NAMES = tuple(TABLE)


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
    """

    def __init__(
        self,
        vehicle: Vehicle,
        number: int,
        signing_key: bytes = b"",
        unix_time: Callable[[], float] = time.time,
    ):
        """Open it.

        Args:
            vehicle: whose link it is.
            number: of the link, in signatures.
            signing_key: 32 bytes, empty for no signing.
            unix_time: stamps signatures [s since 1970]; nothing else.
        """
        self._codec = mavlink.MAVLink(None)
        self._unix_time = unix_time
        if signing_key:
            signing = self._codec.signing
            signing.secret_key, signing.sign_outgoing = signing_key, True
            signing.link_id = number & 0xFF
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
        self._list_index = len(_NAMES)
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

    # Streams ------------------------------------------------------------------------------------
    def tick(self, count: int, made: dict[int, Message]) -> list[Message]:
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
                    message = made.get(number)
                    if message is None:
                        message = made[number] = STREAMS[number].make(self._vehicle)
                    self.send(message)
        if count % TICKS_PER_SECOND == 0 and self._codec.signing.secret_key is not None:
            signing = self._codec.signing
            signing.timestamp = max(signing.timestamp, signing_time(self._unix_time()))
        if self._list_index < len(_NAMES):
            self._send_parameter(_NAMES[self._list_index])
            self._list_index += 1
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
        self.send(stream.make(self._vehicle))
        return True

    # Parameters ---------------------------------------------------------------------------------
    def start_list(self) -> None:
        """Send every parameter, one a tick."""
        self._list_index = 0

    def read_parameter(self, name: str, index: int) -> None:
        """Answer PARAM_REQUEST_READ: by index, or by name when it is -1; silence for neither."""
        if index >= 0:
            name = _NAMES[index] if index < len(_NAMES) else ""
        if name in TABLE:
            self._send_parameter(name)

    def set_parameter(self, name: str, field: float, type_: int) -> str:
        """Carry PARAM_SET out and answer with the value in force; return why it was refused."""
        problem = ""
        parameters: FlightParameters = self._vehicle.parameters
        try:
            row = TABLE.get(name)
            if row is not None and row.type != type_:
                raise ParameterError(f"{name}: type must be {row.type.name}")
            parameters.set(name, from_wire(field, type_))
        except ParameterError as error:
            problem = str(error)
        if name in TABLE:
            self._send_parameter(name)
        return problem

    def _send_parameter(self, name: str) -> None:
        value = self._vehicle.parameters[name]
        row = TABLE[name]
        self.send(
            mavlink.MAVLink_param_value_message(
                name.encode(), to_wire(value), row.type, len(_NAMES), _NAMES.index(name)
            )
        )


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
