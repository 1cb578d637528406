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
from typing import NamedTuple, Protocol

from husky_runtime.lockstep import Peer

GROUP = "husky_drivers.bus"
"""Entry-point group of bus factories."""


class AlState(IntEnum):
    """State of a slave's application layer (registers 0x0120 and 0x0130)."""

    INIT = 1
    PREOP = 2
    SAFEOP = 4
    OP = 8


_AL_STATE_NAMES = {0: "no state", 3: "BOOT", **{int(state): state.name for state in AlState}}
AL_ERROR = 0x10
"""Bit of the AL status that says the slave left a state by itself; it also acknowledges."""

AL_STATUS_CODES: dict[int, str] = {
    0x0000: "no error",
    0x0001: "unspecified error",
    0x0011: "invalid requested state change",
    0x0012: "unknown requested state",
    0x0013: "BOOT not supported",
    0x0016: "invalid mailbox configuration",
    0x0017: "invalid sync manager configuration",
    0x0018: "no valid inputs available",
    0x0019: "no valid outputs",
    0x001A: "synchronisation error",
    0x001B: "process data watchdog",
    0x001D: "invalid output configuration",
    0x001E: "invalid input configuration",
    0x0024: "invalid input mapping",
    0x0025: "invalid output mapping",
    0x002C: "fatal SYNC error",
    0x002D: "no SYNC signal",
    0x0030: "invalid DC SYNC configuration",
}
"""Meanings of register 0x0134 (ETG.1000.6)."""


class AlStatus(NamedTuple):
    """Registers 0x0130 and 0x0134 of a slave.

    Attributes:
        status: an `AlState`, with `AL_ERROR` when the slave fell there by itself; 0 for a slave
            that does not answer.
        code: says why it fell there, one of `AL_STATUS_CODES`.
    """

    status: int
    code: int

    @property
    def state(self) -> str:
        """Name of the state."""
        return _AL_STATE_NAMES.get(self.status & ~AL_ERROR, f"AL status 0x{self.status:02X}")

    @property
    def reason(self) -> str:
        """Meaning of the code."""
        return AL_STATUS_CODES.get(self.code, f"AL status code 0x{self.code:04X}")


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


TIMED_OUT = 0x05040000
"""Abort code of a slave that does not answer."""
NO_OBJECT, NO_SUBINDEX = 0x06020000, 0x06090011
"""Abort codes of an entry that a slave does not have."""
SDO_ABORT_CODES: dict[int, str] = {
    TIMED_OUT: "timed out",
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


@dataclass(frozen=True)
class BusOptions:
    """Options of a bus on a network interface; a bus inside the process has no use for them.

    Attributes:
        interface: name of the network interface.
        patience: time after which a frame counts as lost [s].
        cycle: time between two exchanges, the period of SYNC0 [s].
        far_side: simulated drives in lockstep: a frame counts as lost when they do, and `patience`
            is for what has come. None where `patience` alone counts.
    """

    interface: str = "ecat0"
    patience: float = 0.002
    cycle: float = 0.002
    far_side: Peer | None = None


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

    def close(self, outputs: bytes | bytearray | memoryview = b"") -> None:
        """Send last outputs, bring the slaves to INIT and let go of the segment; wait for nothing.

        Args:
            outputs: of all slaves, none by default.
        """

    def identity(self, position: int) -> Identity:
        """Who the slave is."""

    def bring_to(self, state: AlState) -> None:
        """Bring all slaves to a state; return when they are there, or after a time-out.

        SAFEOP sets up the process data as the slaves map it. On the way to OP frames with outputs
        that are all zero go round. May block for seconds on a real segment.
        """

    def request_state(self, state: AlState, position: int) -> None:
        """Ask one slave for a state, and acknowledge an error that stands; do not wait for it."""

    def take_back(self, position: int, set_up: Callable[[], object]) -> None:
        """Bring a slave that has lost its configuration to SAFEOP, while frames go round.

        Args:
            position: of the slave.
            set_up: writes its objects, and the rest of what a slave keeps; called in PREOP.

        Raises:
            OSError: the slave does not answer at its place, is another one, or refuses a state.
        """

    def al_states(self) -> Sequence[AlStatus]:
        """Read the AL status of every slave."""

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

    It is called with the robot (`husky_description.robot.Robot`) and `BusOptions`.

    Raises:
        LookupError: when there is none of that name; lists those there are.
    """
    for point in entry_points(group=GROUP):
        if point.name == name:
            factory: Callable[..., Bus] = point.load()
            return factory
    known = ", ".join(available_buses()) or "none"
    raise LookupError(f"no EtherCAT bus {name!r}; available: {known}")
