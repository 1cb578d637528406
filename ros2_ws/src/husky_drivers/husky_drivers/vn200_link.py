"""The serial port of a VN-200 and the thread that serves it: bytes in, samples out at once."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
import termios
import threading
import time
from collections.abc import Callable
from typing import Protocol

import serial

from husky_drivers.vn200_imu import Values
from husky_drivers.vn200_session import Session, SessionConfig

_READ_SIZE = 4096
_RETRY_PERIOD = 0.05
"""Time between two attempts to open a port that is not there [s]."""
_ERROR_EVENTS = select.POLLHUP | select.POLLERR | select.POLLNVAL


class Port(Protocol):
    """What the link needs of a serial port; `serial.Serial` has it."""

    baudrate: int

    def fileno(self) -> int:
        """Return the file descriptor, to wait on, to read and to write."""

    def close(self) -> None:
        """Give the port back."""


def open_serial(path: str, baud: int) -> Port:
    """Open a serial port, raw, 8N1, for us alone, without the USB adapter's waiting time.

    Raises:
        OSError: no such port, no permission, taken by another process.
    """
    port = serial.Serial(path, baud, timeout=0.0, exclusive=True)
    with contextlib.suppress(ValueError, OSError, NotImplementedError):
        port.set_low_latency_mode(True)
    opened: Port = port
    return opened


class Vn200Link:
    """Holds the line to the device: opens it, talks, hands samples out, and opens it again.

    Attributes:
        path: the serial port.
        session: the dialogue, with its counters; read by other threads for reports only.
        connected: whether the port is open.
        connections: how often it has been opened.
        error: why the port is not open, "" when it is.
    """

    def __init__(
        self,
        path: str,
        config: SessionConfig,
        on_sample: Callable[[Values, int], None],
        open_port: Callable[[str, int], Port] = open_serial,
        on_state: Callable[[str], None] = lambda text: None,
    ):
        """Prepare; nothing is opened yet.

        Args:
            path: the serial port.
            config: what is wanted of the device.
            on_sample: called in the link's thread with the values of each good sample and the
                host's time of its arrival [ns since 1970].
            open_port: opens a port at a baud rate; raises OSError when it cannot.
            on_state: called in the link's thread with a sentence when the state changes.
        """
        self.path = path
        self.session = Session(config)
        self.connected = False
        self.connections = 0
        self.error = ""
        self._on_sample = on_sample
        self._on_state = on_state
        self._open_port = open_port
        self._told = ""
        self._wake_read, self._wake_write = os.pipe()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread."""
        self._thread = threading.Thread(target=self._run, name="vn200", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close everything; the link cannot be started again."""
        if self._thread is None:
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        self._thread = None
        os.close(self._wake_read)
        os.close(self._wake_write)

    @property
    def state(self) -> str:
        """What the link is doing: "stopped", "no port", or the session's state."""
        if self._thread is None or not self._thread.is_alive():
            return "stopped"
        return self.session.state.value if self.connected else "no port"

    # In the thread ------------------------------------------------------------------------------
    def _run(self) -> None:
        stopped = False
        while not stopped:
            try:
                port = self._open_port(self.path, self.session.baud)
            except (OSError, termios.error, ValueError) as error:
                self.error = str(error)
                self._tell()
                stopped = bool(select.select([self._wake_read], [], [], _RETRY_PERIOD)[0])
                continue
            try:
                self.connected = True
                self.connections += 1
                self.error = ""
                stopped = self._serve(port)
            except (OSError, termios.error, ValueError) as error:
                self.error = str(error)
            finally:
                self.connected = False
                with contextlib.suppress(OSError, termios.error):
                    port.close()
            if not stopped:
                self._tell()

    def _serve(self, port: Port) -> bool:
        """Talk on an open port until it is to be reopened; return whether the link is to stop.

        Raises:
            OSError: the port is gone.
        """
        session = self.session
        on_sample = self._on_sample
        descriptor = port.fileno()
        os.set_blocking(descriptor, False)
        poller = select.poll()
        poller.register(descriptor, select.POLLIN)
        poller.register(self._wake_read, select.POLLIN)
        session.start(time.monotonic())
        while True:
            now = time.monotonic()
            if now >= session.deadline:
                self._talk(port, descriptor, now)
                if session.reopen_wanted:
                    return False
                self._tell()
            wait = max(0, math.ceil(1e3 * (session.deadline - now)))
            for ready, events in poller.poll(wait):
                if ready != descriptor:
                    return True
                if events & select.POLLIN:
                    host_ns = time.time_ns()
                    data = os.read(descriptor, _READ_SIZE)
                    if not data:
                        raise OSError(errno.EIO, "the serial line has been hung up")
                    for values in session.feed(data, time.monotonic()):
                        on_sample(values, host_ns)
                elif events & _ERROR_EVENTS:
                    raise OSError(errno.EIO, "the serial line has been hung up")

    def _talk(self, port: Port, descriptor: int, now: float) -> None:
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
        text = f"{state}: {self.error}" if self.error else state
        if text != self._told:
            self._told = text
            self._on_state(text)
