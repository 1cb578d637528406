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


class State(IntEnum):
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


class Command(IntEnum):
    """Device control commands; the value is the row of a drive's transition table."""

    DISABLE_VOLTAGE = 0
    QUICK_STOP = 1
    SHUTDOWN = 2
    SWITCH_ON = 3  # also "disable operation"
    ENABLE_OPERATION = 4
    FAULT_RESET = 5
    NONE = 6


class Event(StrEnum):
    """What moves a drive without a command."""

    STARTED = "self-test done"
    STOPPED = "slow-down done"
    FAULT = "fault"


class Mode(IntEnum):
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
    TARGET_REACHED = 1 << 10
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


STATUSWORDS: dict[State, Word] = {
    State.NOT_READY_TO_SWITCH_ON: Word(0x4F, 0x00),
    State.SWITCH_ON_DISABLED: Word(0x4F, 0x40),
    State.READY_TO_SWITCH_ON: Word(0x6F, 0x21),
    State.SWITCHED_ON: Word(0x6F, 0x23),
    State.OPERATION_ENABLED: Word(0x6F, 0x27),
    State.QUICK_STOP_ACTIVE: Word(0x6F, 0x07),
    State.FAULT_REACTION_ACTIVE: Word(0x4F, 0x0F),
    State.FAULT: Word(0x4F, 0x08),
}
"""How a state is read from the statusword."""

COMMANDS: dict[Command, Word] = {
    Command.DISABLE_VOLTAGE: Word(0x02, 0x00),
    Command.QUICK_STOP: Word(0x06, 0x02),
    Command.SHUTDOWN: Word(0x87, 0x06),
    Command.SWITCH_ON: Word(0x8F, 0x07),
    Command.ENABLE_OPERATION: Word(0x8F, 0x0F),
}
"""How a command is read from the controlword. FAULT_RESET is not a level but the rising edge of bit
7; while that bit is high only the commands that take torque away are heard."""

CONTROLWORDS: dict[Command, int] = {
    Command.DISABLE_VOLTAGE: 0x00,
    Command.QUICK_STOP: 0x02,
    Command.SHUTDOWN: 0x06,
    Command.SWITCH_ON: 0x07,
    Command.ENABLE_OPERATION: 0x0F,
    Command.FAULT_RESET: 0x80,
}
"""The controlword that a master writes for a command."""


@dataclass(frozen=True)
class Transition:
    """One arrow of the state machine.

    Attributes:
        number: number in the standard.
        source: state it leaves.
        trigger: command, or event inside the drive.
        target: state it enters, at the latest after a slow-down.
        planned: whether a master may count on it (transition 16 depends on the quick-stop option).
    """

    number: int
    source: State
    trigger: Command | Event
    target: State
    planned: bool = True


_DISABLED, _READY, _ON = (
    State.SWITCH_ON_DISABLED,
    State.READY_TO_SWITCH_ON,
    State.SWITCHED_ON,
)
_ENABLED, _STOP = State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE

TRANSITIONS: tuple[Transition, ...] = (
    Transition(1, State.NOT_READY_TO_SWITCH_ON, Event.STARTED, _DISABLED),
    Transition(2, _DISABLED, Command.SHUTDOWN, _READY),
    Transition(3, _READY, Command.SWITCH_ON, _ON),
    Transition(3, _READY, Command.ENABLE_OPERATION, _ON, planned=False),
    Transition(4, _ON, Command.ENABLE_OPERATION, _ENABLED),
    Transition(5, _ENABLED, Command.SWITCH_ON, _ON),
    Transition(6, _ON, Command.SHUTDOWN, _READY),
    Transition(7, _READY, Command.DISABLE_VOLTAGE, _DISABLED),
    Transition(7, _READY, Command.QUICK_STOP, _DISABLED, planned=False),
    Transition(8, _ENABLED, Command.SHUTDOWN, _READY),
    Transition(9, _ENABLED, Command.DISABLE_VOLTAGE, _DISABLED),
    Transition(10, _ON, Command.DISABLE_VOLTAGE, _DISABLED),
    Transition(10, _ON, Command.QUICK_STOP, _DISABLED, planned=False),
    Transition(11, _ENABLED, Command.QUICK_STOP, _STOP),
    Transition(12, _STOP, Command.DISABLE_VOLTAGE, _DISABLED),
    Transition(12, _STOP, Event.STOPPED, _DISABLED),
    Transition(13, _DISABLED, Event.FAULT, State.FAULT_REACTION_ACTIVE),
    Transition(13, _READY, Event.FAULT, State.FAULT_REACTION_ACTIVE),
    Transition(13, _ON, Event.FAULT, State.FAULT_REACTION_ACTIVE),
    Transition(13, _ENABLED, Event.FAULT, State.FAULT_REACTION_ACTIVE),
    Transition(13, _STOP, Event.FAULT, State.FAULT_REACTION_ACTIVE),
    Transition(14, State.FAULT_REACTION_ACTIVE, Event.STOPPED, State.FAULT),
    Transition(15, State.FAULT, Command.FAULT_RESET, _DISABLED),
    Transition(16, _STOP, Command.ENABLE_OPERATION, _ENABLED, planned=False),
)
"""The state machine. The standard's transition 0 (power on) leads to NOT_READY_TO_SWITCH_ON."""


def state_diagram() -> str:
    """Return `TRANSITIONS` as a Mermaid state diagram; labels are number and trigger."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.NOT_READY_TO_SWITCH_ON.name}: 0 power on"]
    for t in TRANSITIONS:
        trigger = t.trigger.name.lower() if isinstance(t.trigger, Command) else t.trigger.value
        label = f"{t.number} {trigger.replace('_', ' ')}"
        lines.append(f"    {t.source.name} --> {t.target.name}: {label}")
    return "\n".join(lines)


def decode_statusword(statusword: int) -> State:
    """Return the state that a statusword tells."""
    for state, word in STATUSWORDS.items():
        if statusword & word.mask == word.value:
            return state
    return State.UNKNOWN


def decode_controlword(controlword: int, previous: int = 0) -> Command:
    """Return the command that a drive reads from its controlword and the one before it."""
    if controlword & ~previous & Control.FAULT_RESET:
        return Command.FAULT_RESET
    for command, word in COMMANDS.items():
        if controlword & word.mask == word.value:
            return command
    return Command.NONE


def next_command(observed: State, wanted: State) -> Command | None:
    """Return the command on the shortest way from one state to another.

    No way leads through "operation enabled": a drive is never enabled in order to be stopped.

    Returns:
        None when `observed` is `wanted`, when no command leads there, or when the drive has to move
        by itself first (not ready, fault reaction).
    """
    first: dict[State, Command] = {}
    frontier = [observed]
    while frontier and wanted not in first:
        reached = []
        for state in frontier:
            if state is State.OPERATION_ENABLED and state is not observed:
                continue
            for t in TRANSITIONS:
                if t.source != state or not t.planned or not isinstance(t.trigger, Command):
                    continue
                if t.target != observed and t.target not in first:
                    first[t.target] = first.get(state, t.trigger)
                    reached.append(t.target)
        frontier = reached
    return first.get(wanted)


_HOLD: dict[State, Command] = {
    State.READY_TO_SWITCH_ON: Command.SHUTDOWN,
    State.SWITCHED_ON: Command.SWITCH_ON,
    State.OPERATION_ENABLED: Command.ENABLE_OPERATION,
    State.QUICK_STOP_ACTIVE: Command.QUICK_STOP,
}


def controlword_toward(observed: State, wanted: State) -> int:
    """Return the controlword that brings a drive one step from an observed state to a wanted one.

    A drive already there is held there; where nothing helps, the word is "disable voltage". The
    fault reset (0x80) is an edge: a master that repeats it must write a word without bit 7 between.
    """
    command = _HOLD.get(observed) if observed is wanted else next_command(observed, wanted)
    return CONTROLWORDS[Command.DISABLE_VOLTAGE if command is None else command]


def _state_table() -> NDArray[np.uint8]:
    return np.array([decode_statusword(word) for word in range(0x80)], dtype=np.uint8)


def _command_table() -> NDArray[np.uint8]:
    return np.array(
        [decode_controlword(word, Control.FAULT_RESET) for word in range(0x100)], dtype=np.uint8
    )


def _transition_table() -> NDArray[np.uint8]:
    table = np.tile(np.arange(len(State), dtype=np.uint8)[:, None], (1, len(Command)))
    for t in TRANSITIONS:
        if isinstance(t.trigger, Command):
            table[t.source, t.trigger] = t.target
    return table


def _controlword_table() -> NDArray[np.uint16]:
    return np.array([[controlword_toward(o, w) for w in State] for o in State], dtype=np.uint16)


def _frozen(array: NDArray[Unsigned]) -> NDArray[Unsigned]:
    array.flags.writeable = False
    return array


STATE_OF_STATUSWORD = _frozen(_state_table())
"""State of `statusword & 0x7F` (128,)."""
COMMAND_OF_CONTROLWORD = _frozen(_command_table())
"""Command of `controlword & 0xFF` when bit 7 does not rise (256,)."""
NEXT_STATE = _frozen(_transition_table())
"""State that a drive enters, by state and command (9, 7)."""
CONTROLWORD_TOWARD = _frozen(_controlword_table())
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
