"""CiA 402 tables against words seen on real drives and against the standard's rules."""

import itertools
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_drivers.cia402 import (
    COMMAND_OF_CONTROLWORD,
    COMMANDS,
    CONTROLWORD_TOWARD,
    CONTROLWORDS,
    NEXT_STATE,
    STATE_OF_STATUSWORD,
    STATUSWORDS,
    TRANSITIONS,
    DriveCommand,
    DriveEvent,
    DriveState,
    OperationMode,
    controlword_toward,
    decode_controlword,
    decode_statusword,
    error_name,
    next_command,
    state_diagram,
)

words = st.integers(0, 0xFFFF)
states = st.sampled_from([s for s in DriveState if s is not DriveState.UNKNOWN])
standing = st.sampled_from(
    [
        DriveState.SWITCH_ON_DISABLED,
        DriveState.READY_TO_SWITCH_ON,
        DriveState.SWITCHED_ON,
        DriveState.OPERATION_ENABLED,
    ]
)


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0218, DriveState.FAULT),  # Gold Twitter, before a fault reset
        (0x0250, DriveState.SWITCH_ON_DISABLED),  # and after it
        (0x0231, DriveState.READY_TO_SWITCH_ON),  # SOEM issue 245
        (0x0233, DriveState.SWITCHED_ON),
        (0x0637, DriveState.OPERATION_ENABLED),
        (0x12B7, DriveState.OPERATION_ENABLED),  # SOEM issue 518, with a warning
        (0x0217, DriveState.QUICK_STOP_ACTIVE),
        (0x021F, DriveState.FAULT_REACTION_ACTIVE),
        (0x0200, DriveState.NOT_READY_TO_SWITCH_ON),
        (0x0222, DriveState.UNKNOWN),
    ],
)
def test_statuswords_seen_on_drives(word, state):
    assert decode_statusword(word) is state


def test_no_statusword_tells_two_states():
    for word in range(0x100):
        assert sum(word & w.mask == w.value for w in STATUSWORDS.values()) <= 1


def test_no_controlword_is_two_commands():
    for word in range(0x100):
        assert sum(word & w.mask == w.value for w in COMMANDS.values()) <= 1


@pytest.mark.parametrize("command", list(CONTROLWORDS))
def test_a_written_command_is_read_as_that_command(command):
    assert decode_controlword(CONTROLWORDS[command], previous=0) is command


@given(words, words)
def test_fault_reset_is_a_rising_edge(word, previous):
    edge = bool(word & 0x80) and not previous & 0x80
    assert (decode_controlword(word, previous) is DriveCommand.FAULT_RESET) == edge


@given(words)
def test_while_bit_7_is_held_nothing_gives_torque(word):
    held = decode_controlword(word | 0x80, previous=0x80)
    assert held in (DriveCommand.DISABLE_VOLTAGE, DriveCommand.QUICK_STOP, DriveCommand.NONE)


@given(words, words)
def test_tables_agree_with_the_functions(word, previous):
    assert STATE_OF_STATUSWORD[word & 0x7F] == decode_statusword(word)
    if not word & ~previous & 0x80:
        assert COMMAND_OF_CONTROLWORD[word & 0xFF] == decode_controlword(word, previous)


def test_standard_transitions_are_all_there():
    # IEC 61800-7-201, by number: 0 is power on, 3 comes twice in the drive's table (switch on and
    # enable in one word), 7, 10 and 12 have two triggers, 13 leaves every state but fault
    numbers = sorted({t.number for t in TRANSITIONS})
    assert numbers == [*range(1, 17)]


def test_torque_states_are_entered_by_command_only():
    into = [t for t in TRANSITIONS if t.target is DriveState.OPERATION_ENABLED]
    assert {t.source for t in into} == {DriveState.SWITCHED_ON, DriveState.QUICK_STOP_ACTIVE}
    assert {t.trigger for t in into} == {DriveCommand.ENABLE_OPERATION}


def test_only_a_reset_leaves_fault():
    out = [t for t in TRANSITIONS if t.source is DriveState.FAULT]
    assert [(t.trigger, t.target) for t in out] == [
        (DriveCommand.FAULT_RESET, DriveState.SWITCH_ON_DISABLED)
    ]


def walk(observed, wanted):
    """States that a drive passes which obeys the table, driven by `controlword_toward`."""
    passed, previous = [observed], 0
    for _ in range(12):
        word = controlword_toward(passed[-1], wanted)
        command = decode_controlword(word, previous)
        passed.append(DriveState(int(NEXT_STATE[passed[-1], command])))
        previous = word
    return passed


@given(states, standing)
def test_every_standing_state_is_reached_and_held(observed, wanted):
    if observed in (DriveState.NOT_READY_TO_SWITCH_ON, DriveState.FAULT_REACTION_ACTIVE):
        return  # the drive moves on by itself first
    assert walk(observed, wanted)[6:] == [wanted] * 7


@given(states, states)
def test_no_drive_is_enabled_on_the_way_elsewhere(observed, wanted):
    if DriveState.OPERATION_ENABLED not in (observed, wanted):
        assert DriveState.OPERATION_ENABLED not in walk(observed, wanted)


@given(states)
def test_quick_stop_is_asked_of_moving_drives_only(observed):
    word = controlword_toward(observed, DriveState.QUICK_STOP_ACTIVE)
    moving = observed in (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)
    assert word == (0x02 if moving else 0x00)


def test_no_command_where_there_is_nothing_to_do():
    assert next_command(DriveState.SWITCHED_ON, DriveState.SWITCHED_ON) is None
    assert next_command(DriveState.FAULT_REACTION_ACTIVE, DriveState.OPERATION_ENABLED) is None
    assert next_command(DriveState.UNKNOWN, DriveState.OPERATION_ENABLED) is None
    assert controlword_toward(DriveState.UNKNOWN, DriveState.OPERATION_ENABLED) == 0x00


def test_master_table_agrees_with_the_function():
    for observed, wanted in itertools.product(DriveState, DriveState):
        assert CONTROLWORD_TOWARD[observed, wanted] == controlword_toward(observed, wanted)


def test_events_lead_where_the_standard_says():
    events = {
        (t.source, t.trigger): t.target for t in TRANSITIONS if isinstance(t.trigger, DriveEvent)
    }
    assert events[DriveState.FAULT_REACTION_ACTIVE, DriveEvent.STOPPED] is DriveState.FAULT
    assert events[DriveState.QUICK_STOP_ACTIVE, DriveEvent.STOPPED] is DriveState.SWITCH_ON_DISABLED
    faults = {source for source, trigger in events if trigger is DriveEvent.FAULT}
    assert faults == set(DriveState) - {
        DriveState.NOT_READY_TO_SWITCH_ON,
        DriveState.FAULT_REACTION_ACTIVE,
        DriveState.FAULT,
        DriveState.UNKNOWN,
    }


def test_supported_modes_bits():
    # a Gold Twitter reports 0x3ED: all of the modes below
    bits = sum(mode.supported_bit for mode in OperationMode)
    assert bits == 0x3ED
    assert OperationMode.CYCLIC_SYNCHRONOUS_POSITION.supported_bit == 1 << 7


def test_error_names():
    assert error_name(0x8611) == "position tracking"
    assert error_name(0x1234) == "unknown error 0x1234"


def test_documentation_shows_this_table():
    documentation = Path(__file__).parents[4] / "docs" / "drives.md"
    assert f"```mermaid\n{state_diagram()}\n```" in documentation.read_text(encoding="utf-8")
