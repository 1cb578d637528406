"""A serial port of the simulation: a pseudo-terminal under a stable path, with a wire's manners."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
import tty
from pathlib import Path
from typing import Protocol

from husky_runtime import record_lock
from husky_runtime.ports import port_lock
from husky_runtime.ports.socket_port import StreamDevice

_TCGETS2 = 0x802C542A
"""ioctl that returns `struct termios2`, whose last two words are the speeds in plain numbers."""
_SPEED_OFFSET = 36
_READ_SIZE = 4096


class SerialDevice(StreamDevice, Protocol):
    """Device at the far end of a serial line."""

    @property
    def baud(self) -> int:
        """Rate of the bytes that `feed` takes and of those that `take_output` has returned."""


class PtyPort:
    """The device's end of a serial line whose other end a driver opens by its path.

    As on a wire, bytes go at a rate: what is sent at one and received at another arrives as the
    garbage that a UART makes of it. What nobody reads is lost, and counted. Nothing blocks, and
    bytes are delivered within the call.

    Attributes:
        path: where the driver finds the port.
        dropped: bytes to the host that were lost for want of a reader.
        connected: whether a driver has the port open, as of the last `read`.
    """

    def __init__(self, path: str | Path):
        """Make the port and plug it in.

        Args:
            path: a symbolic link is made here, its directory too. A link left behind by a dead
                process is replaced.

        Raises:
            FileExistsError: another process serves this path, or it is something else than a link.
            PermissionError: another user has left something there.
        """
        self.path = Path(path)
        self.dropped = 0
        self.connected = False
        self._master = -1
        self._slave_name = ""
        self._speeds = bytearray(44)
        self._lock = port_lock.lock(self.path)
        try:
            self.replug()
        except BaseException:
            self._unlock()
            raise

    # Bytes --------------------------------------------------------------------------------------
    def service(self, device: SerialDevice) -> None:
        """Carry what is on the wire in both directions."""
        data = self.read(device.baud)
        if data:
            device.feed(data)
        output = device.take_output()
        if output:
            self.write(output, device.baud)

    def read(self, baud: int) -> bytes:
        """Return what the driver has sent, as a UART at this rate receives it."""
        if self._master < 0:
            return b""
        try:
            data = os.read(self._master, _READ_SIZE)
        except BlockingIOError:
            self.connected = True
            return b""
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            self.connected = False  # No driver has it open.
            return b""
        self.connected = True
        return receive(data, self.host_baud, baud)

    def write(self, data: bytes, baud: int) -> int:
        """Send to the driver at this rate; return the bytes that found room."""
        written = 0
        if self._master >= 0 and self.connected:
            received = receive(data, baud, self.host_baud)
            with contextlib.suppress(BlockingIOError):
                written = os.write(self._master, received) if received else 0
            self.dropped += len(received) - written
        else:
            self.dropped += len(data)
        return written

    @property
    def host_baud(self) -> int:
        """Rate that the driver has set its end to [baud]."""
        fcntl.ioctl(self._master, _TCGETS2, self._speeds)
        return int(struct.unpack_from("<II", self._speeds, _SPEED_OFFSET)[1])

    def fileno(self) -> int:
        """Return the descriptor of the device's end, to wait on; it changes with the plug."""
        return self._master

    # The plug -----------------------------------------------------------------------------------
    @property
    def plugged(self) -> bool:
        """Whether the port is there."""
        return self._master >= 0

    def unplug(self) -> None:
        """Pull the plug: the path vanishes and whoever has the port open is hung up on."""
        if self._master < 0:
            return
        with contextlib.suppress(OSError):
            if os.readlink(self.path) == self._slave_name:
                self.path.unlink()
        os.close(self._master)
        self._master = -1
        self.connected = False

    def replug(self) -> None:
        """Plug in again; raises FileExistsError if the path is taken by anything but a link."""
        if self._master >= 0:
            return
        if self.path.exists() and not self.path.is_symlink():
            raise FileExistsError(f"{self.path} exists and is no symbolic link")
        master, slave = os.openpty()
        tty.setraw(slave)
        self._slave_name = os.ttyname(slave)
        os.close(slave)  # So that the kernel tells whether a driver has it open.
        os.set_blocking(master, False)
        fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(self._slave_name)
        try:
            fresh.replace(self.path)
        except PermissionError as error:
            fresh.unlink()
            os.close(master)
            raise record_lock.left_by_another(self.path) from error
        self._master = master

    def close(self) -> None:
        """Unplug for good."""
        self.unplug()
        self._unlock()

    def _unlock(self) -> None:
        if self._lock >= 0:
            port_lock.path_of_lock(self.path).unlink(missing_ok=True)
            os.close(self._lock)
            self._lock = -1

    def __enter__(self) -> PtyPort:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def receive(data: bytes, transmit_baud: int, receive_baud: int) -> bytes:
    """Return what a UART makes of bytes that were sent at another rate (8N1, line idle at the end).

    The receiver waits for a falling edge and then samples the middle of nine bits by its own clock.
    """
    if transmit_baud == receive_baud:
        return data
    level = [1]
    for byte in data:
        level += [0, *(byte >> bit & 1 for bit in range(8)), 1]
    step = transmit_baud / receive_baud
    received = bytearray()
    position = 1
    while position < len(level):
        if level[position] or not level[position - 1]:
            position += 1
            continue
        byte = 0
        for bit in range(8):
            sample = int(position + (bit + 1.5) * step)
            byte |= (level[sample] if sample < len(level) else 1) << bit
        received.append(byte)
        position = max(position + 1, int(position + 9.5 * step) + 1)
    return bytes(received)
