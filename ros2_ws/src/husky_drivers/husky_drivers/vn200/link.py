"""The serial port of a VN-200 and the thread that serves it: bytes in, samples out at once."""

from __future__ import annotations

import contextlib
import math
import os
import select
import time
from collections.abc import Callable

from husky_drivers.silence import WorldTime
from husky_drivers.vn200.imu import Values
from husky_drivers.vn200.session import SessionConfig, Vn200Session
from husky_runtime.patient_clock import PatientClock
from husky_runtime.ports.port_thread import PortThread
from husky_runtime.ports.serial_line import SerialPort, hung_up, open_serial, read_bytes

_RETRY_PERIOD = 0.05
"""Time between two attempts to open a port that is not there [s]."""
_ERROR_EVENTS = select.POLLHUP | select.POLLERR | select.POLLNVAL


class Vn200Link(PortThread[SerialPort]):
    """Holds the line to the device: opens it, talks, hands samples out, and opens it again.

    Attributes:
        path: the serial port.
        session: the dialogue, with its counters; read by other threads for reports only.
    """

    def __init__(
        self,
        path: str,
        config: SessionConfig,
        on_sample: Callable[[Values, int], None],
        on_state: Callable[[str], None] = lambda text: None,
        world_time: WorldTime = lambda: None,
        longest_look: float = math.inf,
    ):
        """Prepare; nothing is opened yet.

        Args:
            path: the serial port.
            config: what is wanted of the device.
            on_sample: called in the link's thread with the values of each good sample and the
                host's time of its arrival [ns since 1970].
            on_state: called in the link's thread with a sentence when the state changes.
            world_time: of the device; called in the link's thread.
            longest_look: most that the time between two looks at the line counts [s].
        """
        super().__init__("vn200", _RETRY_PERIOD)
        self._clock, self._longest_wait = PatientClock(longest_look), 0.5 * longest_look
        self.path = path
        self.session = Vn200Session(config, world_time)
        self._on_sample = on_sample
        self._on_state = on_state
        self._told = ""
        self._told_changes: dict[int, str] = {}

    def _dialogue_state(self) -> str:
        return self.session.told_state.value

    # In the thread ------------------------------------------------------------------------------
    def _open(self) -> SerialPort:
        return open_serial(self.path, self.session.baud)

    def _serve(self, port: SerialPort) -> bool:
        """Talk on an open port until it is to be reopened; return whether the link is to stop.

        Raises:
            OSError: the port is gone.
        """
        session = self.session
        on_sample = self._on_sample
        descriptor = port.fileno()
        poller = self._poller(descriptor)
        session.start(self._now())
        while True:
            now = self._now()
            if now >= session.deadline:
                self._talk(port, descriptor, now)
                if session.reopen_wanted:
                    return False
                self._tell()
            wait = max(0.0, min(session.deadline - now, self._longest_wait))
            for ready, events in poller.poll(math.ceil(1e3 * wait)):
                if ready != descriptor:
                    return True
                if events & select.POLLIN:
                    host_ns = time.time_ns()
                    data = read_bytes(descriptor)
                    for values in session.feed(data, self._now()):
                        on_sample(values, host_ns)
                elif events & _ERROR_EVENTS:
                    raise hung_up()

    def _now(self) -> float:
        return self._clock.read(time.monotonic())

    def _talk(self, port: SerialPort, descriptor: int, now: float) -> None:
        """Send what the session has to say, at its baud rate."""
        message = self.session.poll(now)
        if self.session.baud != port.baudrate:
            port.baudrate = self.session.baud
        if message:
            with contextlib.suppress(BlockingIOError):  # Lost, as on a wire: it is said again.
                os.write(descriptor, message)

    def _tell(self) -> None:
        """Report a change of state once."""
        state = self.state
        if state == "probing" and self._told.startswith("probing"):
            return
        why = self.error or self.session.problem
        text = f"{state}: {why}" if why else state
        for register, change in self.session.setup.changes.items():
            if self._told_changes.get(register) != change:
                self._told_changes[register] = change
                self._on_state(f"changed in the device: {change}")
        if text != self._told:
            self._told = text
            self._on_state(text)
