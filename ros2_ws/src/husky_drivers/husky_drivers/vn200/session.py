"""The driver's side of the dialogue with a VN-200, as a state machine of bytes and time.

It sends what ArduPilot's driver sends: pause, baud rate, registers, resume; each request again and
again until its echo has come. Nothing here opens a port.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import chain

from husky_drivers.silence import Silence, WorldTime
from husky_drivers.vn200 import requests
from husky_drivers.vn200.binary import IMU_LAYOUT, BinaryOutput
from husky_drivers.vn200.commissioning import IDENTITY, Vn200Commissioning, check_frame
from husky_drivers.vn200.imu import GravityCheck, SampleGate, Values
from husky_drivers.vn200.protocol import (
    BAUDS,
    BITS_PER_BYTE,
    IMU_RATE,
    AsciiMessage,
    ErrorCode,
    ProtocolError,
    Register,
    hexadecimal,
)
from husky_drivers.vn200.requests import Request
from husky_drivers.vn200.stream import BinaryPacket, StreamParser

_GARBAGE_LIMIT = 200
"""Bytes of garbage in a row from a stale line after which its baud rate is in doubt."""
_TRANSIENT = (
    ErrorCode.HARD_FAULT,
    ErrorCode.SERIAL_BUFFER_OVERFLOW,
    ErrorCode.INVALID_CHECKSUM,
    ErrorCode.INVALID_COMMAND,
    ErrorCode.WATCHDOG_RESET,
)
"""Errors that damage on the line explains: the request is sent again soon."""


class SessionState(Enum):
    """How far the dialogue has come."""

    PROBING = "probing"
    """Asks at one baud rate after the other until the device answers."""
    CHANGING_BAUD = "changing baud rate"
    """The device has been told to use another rate."""
    CONFIGURING = "configuring"
    """The device answers at the right rate; its registers are being set."""
    STREAMING = "streaming"
    """Samples come."""
    STALE = "stale"
    """No new sample for a while: the device is asked, without disturbing it, how it is set up."""


@dataclass(frozen=True)
class SessionConfig:
    """What the driver wants of the device, and its patience.

    Attributes:
        baud: rate to run the line at [baud].
        rate: packet rate [Hz], a divisor of 800.
        frame_rotation: reference frame rotation that the device must hold (9,), row by row.
        stale_after: silence after which the line counts as stale [s].
        silence_timeout: time a stale device may answer nothing before the port is reopened [s].
        request_period: time after which a request without echo is sent again [s].
        dwell: time that an answer may take while probing, beyond that of its bytes [s].
    """

    baud: int = 921600
    rate: int = IMU_RATE
    frame_rotation: tuple[float, ...] = IDENTITY
    stale_after: float = 0.05
    silence_timeout: float = 0.25
    request_period: float = 0.5
    dwell: float = 0.04

    def __post_init__(self) -> None:
        if self.baud not in BAUDS:
            raise ValueError(f"baud is {self.baud}, it must be one of {BAUDS}")
        if not 1 <= self.rate <= IMU_RATE or IMU_RATE % self.rate:
            raise ValueError(f"rate is {self.rate} Hz, it must be a divisor of {IMU_RATE}")
        if self.output.bits_per_second > self.baud:
            raise ValueError(
                f"rate is {self.rate} Hz: packets of {IMU_LAYOUT.size} bytes fit into {self.baud} "
                f"baud up to {self.baud / BITS_PER_BYTE / IMU_LAYOUT.size:.0f} Hz"
            )
        check_frame(self.frame_rotation)
        for name in ("stale_after", "silence_timeout", "request_period", "dwell"):
            least = 2.0 / self.rate if name == "stale_after" else 0.001
            if not least <= getattr(self, name) <= 60.0:
                value = getattr(self, name)
                raise ValueError(f"{name} is {value} s, it must be within {least:g} and 60")

    @property
    def output(self) -> BinaryOutput:
        """What register 75 shall hold."""
        return BinaryOutput(1, IMU_RATE // self.rate, IMU_LAYOUT)


class Vn200Session:
    """One VN-200 on one line.

    Whoever owns the port sends what `poll` returns at `baud`, hands in what arrives with `feed`,
    calls `poll` again by `deadline`, and opens the port anew (then calls `start`) when
    `reopen_wanted`. Times are of one monotonic clock [s].

    Attributes:
        config: see `SessionConfig`.
        baud: rate that the port must have now [baud].
        state: see `SessionState`.
        setup: what the device holds, what was changed in it, and why it cannot be used.
        deadline: time by which `poll` must be called.
        reopen_wanted: the line is dead as it is.
        times_stale: how often the line went stale, by the time of the device's world.
        device_errors: `$VNERR` messages received.
        samples: which samples are good, and how many were not.
        gravity: compares the reported attitude with the measured direction of gravity.
        parser: the stream parser with its own counters.
    """

    def __init__(self, config: SessionConfig, world_time: WorldTime = lambda: None):
        """Start with a port that is not open; `world_time` is the device's."""
        self.config = config
        self.baud = config.baud
        self.state = SessionState.PROBING
        self.setup = Vn200Commissioning(config.output, config.frame_rotation)
        self._complaint = ""
        self.deadline = -math.inf
        self.reopen_wanted = False
        self.times_stale = 0
        self.device_errors = 0
        self.samples = SampleGate(config.rate)
        self.gravity = GravityCheck()
        self.parser = StreamParser(IMU_LAYOUT)
        self._pause = requests.pause(True)
        self._resume = requests.pause(False)
        self._read_output = requests.read(Register.BINARY_OUTPUT_1)
        self._steps: Iterator[Request] = iter(())
        self._request: Request | None = None
        self._send_at = math.inf
        self._give_up_at = math.inf
        self._scan: Iterator[int] = iter(())
        self._heard = False
        self._sample_at = -math.inf
        self._silence = Silence(world_time)
        self._told_stale = False
        self._garbage_mark = 0

    def start(self, now: float) -> None:
        """The port has been opened: begin to talk, at the rate that worked last."""
        self.reopen_wanted = False
        self._probe(now)

    # Time ---------------------------------------------------------------------------------------
    def poll(self, now: float) -> bytes:
        """Return what must be sent now, at the rate `baud`; b"" for nothing."""
        if now >= self._give_up_at:
            self._give_up(now)
        if self.state is SessionState.STALE and not self._told_stale:
            silence = self._silence.lasts(now - self._sample_at)
            self._told_stale = silence >= self.config.stale_after
            self.times_stale += self._told_stale
        message = b""
        if self._request is not None and now >= self._send_at:
            self._send_at = now + self._repeat_period
            message = self._request.message
        self._update_deadline()
        return message

    @property
    def problem(self) -> str:
        """Why the device cannot be used, or its last complaint; "" when all is well."""
        return self.setup.refusal or self._complaint

    @property
    def told_state(self) -> SessionState:
        """What is told of the state: a line that is late because its world stands still is fine."""
        late = self.state is SessionState.STALE and not self._told_stale
        return SessionState.STREAMING if late else self.state

    @property
    def _repeat_period(self) -> float:
        """Time until a request is sent again [s]; a stale device gets two chances to answer."""
        if self.state is SessionState.STALE:
            return min(self.config.request_period, 0.4 * self.config.silence_timeout)
        return self.config.request_period

    def _give_up(self, now: float) -> None:
        """What was awaited has not come in time."""
        if self.state is SessionState.PROBING:
            self._probe_next(now)
        elif self.state is SessionState.CHANGING_BAUD:
            self._follow_baud(now)
        elif self.state is SessionState.CONFIGURING:
            self._probe(now)
        elif self.state is SessionState.STREAMING:
            self._give_up_at = self._sample_at + self.config.stale_after
            if now >= self._give_up_at:
                self._go_stale(now)
        else:
            self.reopen_wanted = True
            self._probe(now)

    # Bytes --------------------------------------------------------------------------------------
    def feed(self, data: bytes, now: float) -> list[Values]:
        """Take bytes from the port; return the good samples in them."""
        samples: list[Values] = []
        messages = self.parser.feed(data)
        for message in messages:
            if not isinstance(message, BinaryPacket):
                self._take_message(message, now)
            elif self.state is SessionState.STREAMING or self.state is SessionState.STALE:
                if self.samples.accept(message.values):
                    samples.append(message.values)
            else:
                self._hear(now)
        if samples:
            self.gravity.take(samples[-1])
            self._sample_at = now
            self._silence.heard(1e-9 * samples[-1][0])
            if self.state is SessionState.STALE:
                self._stream(now)
        elif self.state is SessionState.STALE:
            self._watch_stale(bool(messages), now)
        return samples

    def _take_message(self, message: AsciiMessage, now: float) -> None:
        """Go on in the dialogue."""
        if message.command == "ERR":
            self._take_error(message, now)
        elif self._request is not None and self._request.answered_by(message):
            self._take_answer(message, now)
        self._hear(now)
        self._update_deadline()

    def _take_error(self, message: AsciiMessage, now: float) -> None:
        self.device_errors += 1
        self._complaint = f"device error {','.join(message.fields)}"
        try:
            code = ErrorCode(hexadecimal(message.fields[0]))
        except (ProtocolError, ValueError, IndexError):
            return
        self._complaint += f" ({code.name.lower().replace('_', ' ')})"
        if code in _TRANSIENT:
            self._send_at = min(self._send_at, now + 0.1 * self.config.request_period)

    def _take_answer(self, message: AsciiMessage, now: float) -> None:
        """The echo of the current request has come."""
        self._complaint = ""
        if self.state is SessionState.PROBING:
            self._configure(now)
        elif self.state is SessionState.CHANGING_BAUD:
            self._follow_baud(now)
        elif self.state is SessionState.CONFIGURING:
            self._next_step(now)
        elif self._request is self._resume:
            self._ask(self._read_output, now + self._repeat_period)
        elif requests.output_in(message) == self.config.output:
            self._ask(self._resume, now)
        else:
            self._probe(now)

    # Probing ------------------------------------------------------------------------------------
    def _probe(self, now: float) -> None:
        """Look for the device, first at the present rate."""
        self.state = SessionState.PROBING
        self.samples.restart()
        self._scan = iter(requests.scan_order(self.baud, self.config.baud))
        self._probe_next(now)

    def _probe_next(self, now: float) -> None:
        """Look for the device at the next rate of the scan."""
        baud = next(self._scan, None)
        if baud is None:  # All rates tried: the port itself may be dead.
            self.reopen_wanted = True
            self._scan = iter(requests.scan_order(self.config.baud, self.config.baud))
            baud = next(self._scan)
        self._probe_at(baud, now)

    def _probe_at(self, baud: int, at: float) -> None:
        self.parser.reset()
        self._heard = False
        self.baud = baud
        self._ask(self._pause, at)
        self._give_up_at = at + self.config.dwell + requests.answer_time(baud)

    def _hear(self, now: float) -> None:
        """Something sensible has come: stay with it for a while."""
        patience = 3.0 * self.config.request_period
        if self.state is SessionState.CONFIGURING:
            self._give_up_at = now + patience
        elif self.state is SessionState.PROBING and not self._heard and self._send_at > now:
            self._heard = True
            self._give_up_at = now + patience

    def _follow_baud(self, now: float) -> None:
        """The device has been told to change its rate: follow it, whether it said so or not.

        The manual puts the reply before the change in one place and behind it in another, and a
        reply can be lost. What counts is that the device answers at the new rate; if it does not,
        the scan finds it at the old one.
        """
        self.state = SessionState.PROBING
        self._scan = iter(requests.scan_order(self.baud, self.config.baud))
        self._probe_at(self.config.baud, now + 0.25 * self.config.dwell)

    # Configuring and streaming ------------------------------------------------------------------
    def _configure(self, now: float) -> None:
        """Begin to set the device up; at another baud rate than the wanted one, to change that."""
        self.state = SessionState.CONFIGURING
        if self.baud == self.config.baud:
            self._steps = chain(self.setup.before_streaming(), (self._resume,))
        elif self.baud > self.config.baud:
            self._steps = self.setup.before_slower_baud()
        else:
            self._steps = iter(())
        self._next_step(now)

    def _next_step(self, now: float) -> None:
        """Ask what comes next, or go on when all is set."""
        request = next(self._steps, None)
        if request is not None:
            self._ask(request, now)
        elif self.baud != self.config.baud:
            self.state = SessionState.CHANGING_BAUD
            self.setup.changes[Register.BAUD] = (
                f"baud rate was {self.baud}: set to {self.config.baud}"
            )
            self._ask(requests.write_number(Register.BAUD, self.config.baud), now)
            self._give_up_at = now + self.config.dwell + requests.answer_time(self.baud)
        else:
            self._sample_at = now
            self._stream(now)

    def _stream(self, now: float) -> None:
        self.state = SessionState.STREAMING
        self._silence.heard()
        self._request = None
        self._send_at = math.inf
        self._give_up_at = now + self.config.stale_after
        self._update_deadline()

    def _go_stale(self, now: float) -> None:
        self.state = SessionState.STALE
        self._told_stale = False
        self._garbage_mark = self.parser.counters.garbage_bytes
        self._ask(self._read_output, now)
        self._give_up_at = now + self.config.silence_timeout

    def _watch_stale(self, heard: bool, now: float) -> None:
        """Bytes without a new sample have come from a stale line."""
        garbage = self.parser.counters.garbage_bytes
        if heard:
            self._garbage_mark = garbage
            self._give_up_at = now + self.config.silence_timeout
        elif garbage - self._garbage_mark > _GARBAGE_LIMIT:
            self._probe(now)
        self._update_deadline()

    def _ask(self, request: Request, at: float) -> None:
        """Send a request at a time, and again until it is answered."""
        self._request = request
        self._send_at = at
        self._update_deadline()

    def _update_deadline(self) -> None:
        self.deadline = min(self._send_at, self._give_up_at)
