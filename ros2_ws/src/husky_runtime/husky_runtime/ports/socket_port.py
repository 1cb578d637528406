"""A stream socket of the simulation under a stable path, for a device that says much at once."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from pathlib import Path
from typing import Protocol

from husky_runtime import record_lock
from husky_runtime.ports import port_lock

_READ_SIZE = 65536
_LONGEST_PATH = 107
"""Bytes of a path that a Unix socket can have."""
_SEND_BUFFER = 1 << 20
"""Bytes that the kernel takes from the device before the driver reads: some images."""


class StreamDevice(Protocol):
    """Device at the far end of a wire of bytes."""

    def feed(self, data: bytes) -> None:
        """Take bytes from the host."""

    def take_output(self) -> bytes:
        """Return the bytes to the host since the last call."""


class SocketPort:
    """The device's end of a Unix stream socket that a driver connects to by its path.

    It serves one driver at a time; the next one is accepted when the first has gone. Nothing
    blocks. The bytes of one `take_output` are sent whole or, without a driver, not at all; a driver
    that does not read is not asked for more.

    Attributes:
        path: where the driver finds the port.
        dropped: bytes to the host that were lost for want of a driver.
    """

    def __init__(self, path: str | Path):
        """Make the port and plug it in.

        Args:
            path: the socket is made here, its directory too. One left behind by a dead process is
                replaced.

        Raises:
            FileExistsError: another process serves this path, or it is something else than a
                socket.
            PermissionError: another user has left something there.
            ValueError: the path is too long for a socket.
        """
        self.path = Path(path)
        self.dropped = 0
        self._listener: socket.socket | None = None
        self._driver: socket.socket | None = None
        self._unsent = memoryview(b"")
        self._lock = port_lock.lock(self.path)
        try:
            self.replug()
        except BaseException:
            self._unlock()
            raise

    @property
    def connected(self) -> bool:
        """True while a driver is there, as of the last `service`."""
        return self._driver is not None

    def service(self, device: StreamDevice) -> bool:
        """Carry what is on the wire in both directions; return whether the driver said anything."""
        self._accept()
        heard = self._read()
        if heard:
            device.feed(heard)
        if not self._unsent:
            output = device.take_output()
            if self._driver is None:
                self.dropped += len(output)
            else:
                self._unsent = memoryview(output)
        self._send()
        return bool(heard)

    def _accept(self) -> None:
        if self._driver is None and self._listener is not None:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                self._driver, _ = self._listener.accept()
                self._driver.setblocking(False)
                self._driver.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)

    def _read(self) -> bytes:
        if self._driver is None:
            return b""
        try:
            data = self._driver.recv(_READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def _send(self) -> None:
        if self._driver is None or not self._unsent:
            return
        try:
            self._unsent = self._unsent[self._driver.send(self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self._hang_up()

    def _hang_up(self) -> None:
        self.dropped += len(self._unsent)
        self._unsent = memoryview(b"")
        if self._driver is not None:
            self._driver.close()
            self._driver = None

    # The plug -----------------------------------------------------------------------------------
    @property
    def plugged(self) -> bool:
        """True while the port is there."""
        return self._listener is not None

    def unplug(self) -> None:
        """Pull the plug: the path vanishes and the driver is hung up on."""
        if self._listener is None:
            return
        self._hang_up()
        with contextlib.suppress(OSError):
            if os.stat(self.path).st_ino == self._inode:
                self.path.unlink()
        self._listener.close()
        self._listener = None

    def replug(self) -> None:
        """Plug in again.

        Raises:
            FileExistsError: the path is taken by anything but a socket.
            ValueError: the path is too long for a socket.
        """
        if self._listener is not None:
            return
        if self.path.exists() and not stat.S_ISSOCK(os.stat(self.path).st_mode):
            raise FileExistsError(f"{self.path} exists and is no socket")
        fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        spare = _LONGEST_PATH - len(os.fsencode(fresh))
        if spare < 0:
            most = len(os.fsencode(self.path)) + spare
            raise ValueError(
                f"{self.path} is too long for the path of a socket, it may have {most} bytes"
            )
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            fresh.unlink(missing_ok=True)
            listener.bind(str(fresh))
            listener.listen(1)
            listener.setblocking(False)
            self._inode = os.stat(fresh).st_ino
            fresh.replace(self.path)
        except OSError as error:
            fresh.unlink(missing_ok=True)
            listener.close()
            if isinstance(error, PermissionError):
                raise record_lock.left_by_another(self.path) from error
            raise
        self._listener = listener

    def close(self) -> None:
        """Unplug for good."""
        self.unplug()
        self._unlock()

    def _unlock(self) -> None:
        if self._lock >= 0:
            port_lock.path_of_lock(self.path).unlink(missing_ok=True)
            os.close(self._lock)
            self._lock = -1

    def __enter__(self) -> SocketPort:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
