"""CiA 402 drive profile as tables: states, words, transitions, modes, error codes.

The state machine of IEC 61800-7-201 (CiA 402). Everything follows from three tables:
`STATUSWORDS`, `COMMANDS` and `TRANSITIONS`; a drive walks them forward (which state does this
command lead to), a master backward (which command leads to the state I want). Numbers of
transitions are the standard's.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Unsigned = TypeVar("Unsigned", np.uint8, np.uint16)


class DriveState(IntEnum):
    """State of a drive; UNKNOWN is a statusword that matches no row of the standard's table."""

    NOT_READY_TO_SWITCH_ON = 0
    SWITCH_ON_DISABLED = 1
    READY_TO_SWITCH_ON = 2
    SWITCHED_ON = 3
    OPERATION_ENABLED = 4
    QUICK_STOP_ACTIVE = 5
    FAULT_REACTION_ACTIVE = 6
    FAULT = 7
    UNKNOWN = 8

    @property
    def title(self) -> str:
        """Name as the standard writes it, e.g. "operation enabled"."""
        return self.name.lower().replace("_", " ")


class DriveCommand(IntEnum):
    """Device control commands; the value is the row of a drive's transition table."""

    DISABLE_VOLTAGE = 0
    QUICK_STOP = 1
    SHUTDOWN = 2
    SWITCH_ON = 3  # also "disable operation"
    ENABLE_OPERATION = 4
    FAULT_RESET = 5
    NONE = 6


class DriveEvent(StrEnum):
    """What moves a drive without a command."""

    STARTED = "self-test done"
    STOPPED = "slow-down done"
    FAULT = "fault"


class OperationMode(IntEnum):
    """Modes of operation (0x6060, 0x6061)."""

    NONE = 0
    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    HOMING = 6
    INTERPOLATED_POSITION = 7
    CYCLIC_SYNCHRONOUS_POSITION = 8
    CYCLIC_SYNCHRONOUS_VELOCITY = 9
    CYCLIC_SYNCHRONOUS_TORQUE = 10

    @property
    def supported_bit(self) -> int:
        """The mode's bit in object 0x6502."""
        return 1 << (self - 1) if self else 0


class Status:
    """Bits of the statusword (0x6041) beside the state."""

    VOLTAGE = 1 << 4
    WARNING = 1 << 7
    REMOTE = 1 << 9
    INTERNAL_LIMIT = 1 << 11
    FOLLOWS_COMMAND = 1 << 12
    FOLLOWING_ERROR = 1 << 13


class Control:
    """Bits of the controlword (0x6040) that the tables below do not carry."""

    FAULT_RESET = 1 << 7
    HALT = 1 << 8


@dataclass(frozen=True)
class Word:
    """A bit pattern: `word & mask == value`."""

    mask: int
    value: int


STATUSWORDS: dict[DriveState, Word] = {
    DriveState.NOT_READY_TO_SWITCH_ON: Word(0x4F, 0x00),
    DriveState.SWITCH_ON_DISABLED: Word(0x4F, 0x40),
    DriveState.READY_TO_SWITCH_ON: Word(0x6F, 0x21),
    DriveState.SWITCHED_ON: Word(0x6F, 0x23),
    DriveState.OPERATION_ENABLED: Word(0x6F, 0x27),
    DriveState.QUICK_STOP_ACTIVE: Word(0x6F, 0x07),
    DriveState.FAULT_REACTION_ACTIVE: Word(0x4F, 0x0F),
    DriveState.FAULT: Word(0x4F, 0x08),
}
"""How a state is read from the statusword."""

COMMANDS: dict[DriveCommand, Word] = {
    DriveCommand.DISABLE_VOLTAGE: Word(0x02, 0x00),
    DriveCommand.QUICK_STOP: Word(0x06, 0x02),
    DriveCommand.SHUTDOWN: Word(0x87, 0x06),
    DriveCommand.SWITCH_ON: Word(0x8F, 0x07),
    DriveCommand.ENABLE_OPERATION: Word(0x8F, 0x0F),
}
"""How a command is read from the controlword. FAULT_RESET is not a level but the rising edge of bit
7; while that bit is high only the commands that take torque away are heard."""

CONTROLWORDS: dict[DriveCommand, int] = {
    **{command: word.value for command, word in COMMANDS.items()},
    DriveCommand.FAULT_RESET: Control.FAULT_RESET,
}
"""The controlword that a master writes for a command."""


@dataclass(frozen=True)
class DriveTransition:
    """One arrow of the state machine.

    Attributes:
        number: number in the standard.
        source: state it leaves.
        trigger: command, or event inside the drive.
        target: state it enters, at the latest after a slow-down.
        planned: whether a master may count on it (transition 16 depends on the quick-stop option).
    """

    number: int
    source: DriveState
    trigger: DriveCommand | DriveEvent
    target: DriveState
    planned: bool = True


_DISABLED, _READY, _ON = (
    DriveState.SWITCH_ON_DISABLED,
    DriveState.READY_TO_SWITCH_ON,
    DriveState.SWITCHED_ON,
)
_ENABLED, _STOP = DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE

TRANSITIONS: tuple[DriveTransition, ...] = (
    DriveTransition(1, DriveState.NOT_READY_TO_SWITCH_ON, DriveEvent.STARTED, _DISABLED),
    DriveTransition(2, _DISABLED, DriveCommand.SHUTDOWN, _READY),
    DriveTransition(3, _READY, DriveCommand.SWITCH_ON, _ON),
    DriveTransition(3, _READY, DriveCommand.ENABLE_OPERATION, _ON, planned=False),
    DriveTransition(4, _ON, DriveCommand.ENABLE_OPERATION, _ENABLED),
    DriveTransition(5, _ENABLED, DriveCommand.SWITCH_ON, _ON),
    DriveTransition(6, _ON, DriveCommand.SHUTDOWN, _READY),
    DriveTransition(7, _READY, DriveCommand.DISABLE_VOLTAGE, _DISABLED),
    DriveTransition(7, _READY, DriveCommand.QUICK_STOP, _DISABLED, planned=False),
    DriveTransition(8, _ENABLED, DriveCommand.SHUTDOWN, _READY),
    DriveTransition(9, _ENABLED, DriveCommand.DISABLE_VOLTAGE, _DISABLED),
    DriveTransition(10, _ON, DriveCommand.DISABLE_VOLTAGE, _DISABLED),
    DriveTransition(10, _ON, DriveCommand.QUICK_STOP, _DISABLED, planned=False),
    DriveTransition(11, _ENABLED, DriveCommand.QUICK_STOP, _STOP),
    DriveTransition(12, _STOP, DriveCommand.DISABLE_VOLTAGE, _DISABLED),
    DriveTransition(12, _STOP, DriveEvent.STOPPED, _DISABLED),
    *(
        DriveTransition(13, state, DriveEvent.FAULT, DriveState.FAULT_REACTION_ACTIVE)
        for state in (_DISABLED, _READY, _ON, _ENABLED, _STOP)
    ),
    DriveTransition(14, DriveState.FAULT_REACTION_ACTIVE, DriveEvent.STOPPED, DriveState.FAULT),
    DriveTransition(15, DriveState.FAULT, DriveCommand.FAULT_RESET, _DISABLED),
    DriveTransition(16, _STOP, DriveCommand.ENABLE_OPERATION, _ENABLED, planned=False),
)
"""The state machine. The standard's transition 0 (power on) leads to NOT_READY_TO_SWITCH_ON."""


def state_diagram() -> str:
    """Return `TRANSITIONS` as a Mermaid state diagram; labels are number and trigger."""
    lines = ["stateDiagram-v2", f"    [*] --> {DriveState.NOT_READY_TO_SWITCH_ON.name}: 0 power on"]
    for t in TRANSITIONS:
        trigger = t.trigger.name.lower() if isinstance(t.trigger, DriveCommand) else t.trigger.value
        label = f"{t.number} {trigger.replace('_', ' ')}"
        lines.append(f"    {t.source.name} --> {t.target.name}: {label}")
    return "\n".join(lines)


def decode_statusword(statusword: int) -> DriveState:
    """Return the state that a statusword tells."""
    for state, word in STATUSWORDS.items():
        if statusword & word.mask == word.value:
            return state
    return DriveState.UNKNOWN


def decode_controlword(controlword: int, previous: int = 0) -> DriveCommand:
    """Return the command that a drive reads from its controlword and the one before it."""
    if controlword & ~previous & Control.FAULT_RESET:
        return DriveCommand.FAULT_RESET
    for command, word in COMMANDS.items():
        if controlword & word.mask == word.value:
            return command
    return DriveCommand.NONE


def next_command(observed: DriveState, wanted: DriveState) -> DriveCommand | None:
    """Return the command on the shortest way from one state to another.

    No way leads through "operation enabled": a drive is never enabled in order to be stopped.

    Returns:
        None when `observed` is `wanted`, when no command leads there, or when the drive has to move
        by itself first (not ready, fault reaction).
    """
    first: dict[DriveState, DriveCommand] = {}
    frontier = [observed]
    while frontier and wanted not in first:
        reached = []
        for state in frontier:
            if state is DriveState.OPERATION_ENABLED and state is not observed:
                continue
            for t in TRANSITIONS:
                if t.source != state or not t.planned or not isinstance(t.trigger, DriveCommand):
                    continue
                if t.target != observed and t.target not in first:
                    first[t.target] = first.get(state, t.trigger)
                    reached.append(t.target)
        frontier = reached
    return first.get(wanted)


_HOLD: dict[DriveState, DriveCommand] = {
    DriveState.READY_TO_SWITCH_ON: DriveCommand.SHUTDOWN,
    DriveState.SWITCHED_ON: DriveCommand.SWITCH_ON,
    DriveState.OPERATION_ENABLED: DriveCommand.ENABLE_OPERATION,
    DriveState.QUICK_STOP_ACTIVE: DriveCommand.QUICK_STOP,
}


def controlword_toward(observed: DriveState, wanted: DriveState) -> int:
    """Return the controlword that brings a drive one step from an observed state to a wanted one.

    A drive already there is held there; where nothing helps, the word is "disable voltage". The
    fault reset (0x80) is an edge: a master that repeats it must write a word without bit 7 between.
    """
    command = _HOLD.get(observed) if observed is wanted else next_command(observed, wanted)
    return CONTROLWORDS[DriveCommand.DISABLE_VOLTAGE if command is None else command]


def _transition_table() -> NDArray[np.uint8]:
    table = np.tile(np.arange(len(DriveState), dtype=np.uint8)[:, None], (1, len(DriveCommand)))
    for t in TRANSITIONS:
        if isinstance(t.trigger, DriveCommand):
            table[t.source, t.trigger] = t.target
    return table


def _frozen(array: NDArray[Unsigned]) -> NDArray[Unsigned]:
    array.flags.writeable = False
    return array


STATE_OF_STATUSWORD = _frozen(np.array([decode_statusword(w) for w in range(0x80)], np.uint8))
"""State of `statusword & 0x7F` (128,)."""
COMMAND_OF_CONTROLWORD = _frozen(
    np.array([decode_controlword(word, Control.FAULT_RESET) for word in range(0x100)], np.uint8)
)
"""Command of `controlword & 0xFF` when bit 7 does not rise (256,)."""
NEXT_STATE = _frozen(_transition_table())
"""State that a drive enters, by state and command (9, 7)."""
CONTROLWORD_TOWARD = _frozen(
    np.array([[controlword_toward(o, w) for w in DriveState] for o in DriveState], np.uint16)
)
"""`controlword_toward` by observed and wanted state (9, 9)."""

ERRORS: dict[int, str] = {
    0x0000: "no error",
    0x2311: "serial feedback",
    0x2340: "short circuit",
    0x3120: "undervoltage",
    0x3130: "loss of phase",
    0x3310: "overvoltage",
    0x4310: "drive too hot",
    0x5280: "internal",
    0x5281: "timing",
    0x5400: "cannot start motor",
    0x5441: "disabled by limit switch",
    0x5442: "disabled by switch",
    0x6181: "processor exception",
    0x6320: "inconsistent parameters",
    0x7121: "motor stuck",
    0x7300: "feedback",
    0x7306: "commutation",
    0x7380: "feedback loss",
    0x7381: "Hall sensor",
    0x8110: "bus message lost",
    0x8130: "heartbeat lost",
    0x8311: "peak current exceeded",
    0x8480: "speed tracking",
    0x8481: "speed limit exceeded",
    0x8611: "position tracking",
    0x8680: "position limit exceeded",
    0xFF02: "interpolation underflow",
    0xFF10: "cannot start motor",
    0xFF20: "safe torque off",
}
"""Error codes of object 0x603F and of emergency messages (Elmo Gold line: devices' command
reference as quoted by public drivers)."""


def error_name(code: int) -> str:
    """Return what an error code means."""
    return ERRORS.get(code, f"unknown error 0x{code:04X}")
