"""What an EtherCAT segment is to its master, and how one is found by name.

A bus is a plug-in: packages register a factory under the entry-point group
`husky_drivers.bus`, and `find_bus` returns it. So the master drives a simulated segment and a
network card alike, and this package imports neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from importlib.metadata import entry_points
from typing import Protocol

GROUP = "husky_drivers.bus"
"""Entry-point group of bus factories."""


class AlState(IntEnum):
    """State of a slave's application layer (registers 0x0120 and 0x0130)."""

    INIT = 1
    PREOP = 2
    SAFEOP = 4
    OP = 8


AL_ERROR = 0x10
"""Bit of the AL status that says the slave left a state by itself; it also acknowledges."""

AL_STATUS_CODES: dict[int, str] = {
    0x0000: "no error",
    0x0011: "invalid requested state change",
    0x001B: "process data watchdog",
    0x001D: "invalid output configuration",
    0x001E: "invalid input configuration",
}
"""Meanings of register 0x0134."""


@dataclass(frozen=True)
class Identity:
    """Who a slave is (object 0x1018)."""

    vendor: int
    product: int
    revision: int


GOLD_TWITTER = Identity(0x0000009A, 0x00030924, 0x00010420)
"""Elmo Gold Twitter (slave dumps)."""


@dataclass(frozen=True)
class Emergency:
    """A CoE emergency message: which slave, and its error code (as in object 0x603F)."""

    position: int
    error_code: int


NO_OBJECT, NO_SUBINDEX = 0x06020000, 0x06090011
"""Abort codes of an entry that a slave does not have."""
SDO_ABORT_CODES: dict[int, str] = {
    0x05040000: "timed out",
    0x06010001: "write-only object",
    0x06010002: "read-only object",
    NO_OBJECT: "no such object",
    0x06040041: "object cannot be mapped",
    0x06070010: "wrong length",
    NO_SUBINDEX: "no such subindex",
    0x06090030: "value out of range",
    0x08000022: "not in this state",
}
"""Meanings of abort codes (CiA 301)."""


class SdoAbort(Exception):
    """A slave refused access to an object; `code` says why."""

    def __init__(self, code: int, position: int, index: int, subindex: int):
        """Say what was refused."""
        self.code = code
        meaning = SDO_ABORT_CODES.get(code, "general error")
        super().__init__(
            f"slave {position}, object 0x{index:04X}:{subindex}: abort 0x{code:08X}, {meaning}"
        )


class Bus(Protocol):
    """An EtherCAT segment as its master sees it; slaves are numbered from 0 along the wire."""

    @property
    def slave_count(self) -> int:
        """Number of slaves that answered `open`."""

    @property
    def expected_working_counter(self) -> int:
        """Working counter of a complete exchange: 2 a slave for outputs and 1 for inputs."""

    def open(self) -> None:
        """Find the slaves and bring them to PREOP; raises OSError when there is no segment."""

    def close(self) -> None:
        """Bring the slaves to INIT and let go of the segment."""

    def identity(self, position: int) -> Identity:
        """Who the slave is."""

    def request_state(self, state: AlState, position: int | None = None) -> None:
        """Ask one slave, or all, for a state; an error that stands is acknowledged."""

    def al_status(self, position: int) -> int:
        """The slave's AL status: an `AlState`, with `AL_ERROR` when it fell there by itself."""

    def al_status_code(self, position: int) -> int:
        """Why it fell there, one of `AL_STATUS_CODES`."""

    def set_watchdog(self, position: int, seconds: float) -> None:
        """Set the slave's process data watchdog (registers 0x0400 and 0x0420)."""

    def exchange(self, outputs: bytes | bytearray | memoryview) -> tuple[memoryview, int]:
        """Send the outputs of all slaves and return their inputs and the working counter.

        Inputs are those that the slaves had before these outputs reached them. A slave that did not
        take part leaves its inputs as they were, which the working counter shows.
        """

    def sdo_read(self, position: int, index: int, subindex: int = 0) -> bytes:
        """Read an object; may block for milliseconds on a real segment; raises SdoAbort."""

    def sdo_write(self, position: int, index: int, subindex: int, data: bytes) -> None:
        """Write an object; may block for milliseconds on a real segment; raises SdoAbort."""

    def emergencies(self) -> Sequence[Emergency]:
        """Emergency messages that have come in since the last call; does not block."""


def available_buses() -> tuple[str, ...]:
    """Return the names of the registered bus factories."""
    return tuple(sorted(point.name for point in entry_points(group=GROUP)))


def find_bus(name: str) -> Callable[..., Bus]:
    """Return the bus factory registered under a name.

    It is called with the robot (`husky_description.robot.Robot`) and the bus's own options.

    Raises:
        LookupError: when there is none of that name; lists those there are.
    """
    for point in entry_points(group=GROUP):
        if point.name == name:
            factory: Callable[..., Bus] = point.load()
            return factory
    known = ", ".join(available_buses()) or "none"
    raise LookupError(f"no EtherCAT bus {name!r}; available: {known}")
