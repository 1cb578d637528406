"""The mode machine: only rows of its table, every refusal with a reason."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_control.controller import Controller
from husky_control.modes.behaviour import Event
from husky_control.modes.table import (
    ACTIVE,
    CONDITIONS,
    IN_THE_AIR,
    ON_LEGS,
    TRANSITIONS,
    Mode,
    ModeMachine,
    modes_of,
)
from husky_description.robot import ROBOTS, load_robot

REQUESTS = [mode.value for mode in Mode]
WORDS = [*REQUESTS, "hover", "", "STAND"]
STEP = st.tuples(
    st.one_of(st.sampled_from(WORDS), st.sampled_from([Event.DONE, Event.FAULT])),
    st.frozensets(st.sampled_from(sorted(CONDITIONS))),
)


def in_mode(mode, holds=lambda condition: True, modes=Mode):
    machine = ModeMachine(holds, modes)
    machine.mode = mode
    return machine


# ------------------------------------------------------------------ the table


def test_every_condition_is_described_and_known_to_the_modes_that_it_guards():
    used = {condition for row in TRANSITIONS for condition in row.conditions}
    assert used == set(CONDITIONS)
    for row in TRANSITIONS:
        for mode in row.sources:
            for condition in row.conditions:
                assert isinstance(getattr(mode.behaviour, condition), property), (mode, condition)


def test_rows_are_well_formed():
    for row in TRANSITIONS:
        lands = row.event is Event.FAULT and row.sources <= IN_THE_AIR | {Mode.BALANCE}
        assert row.sources and (lands or row.target not in row.sources)
        assert bool(row.requests) == (row.event is Event.REQUEST)
        assert row.label or row.event is Event.REQUEST
        assert set(row.requests) <= set(REQUESTS) - {mode.value for mode in row.sources}


def test_a_mode_answers_an_event_or_a_request_in_one_way():
    """But that robots which settle do so instead of others' damping, first with legs put down."""
    fault, request = Event.FAULT, Event.REQUEST
    instead = {(fault, Mode.BALANCE), (fault, Mode.SETTLE), (request, Mode.SETTLE)}
    for a, b in itertools.combinations(TRANSITIONS, 2):
        if a.event is b.event and a.sources & b.sources and (a.event, a.target) not in instead:
            assert a.event is Event.REQUEST and not set(a.requests) & set(b.requests)


def test_every_mode_can_be_reached_and_left():
    reached, frontier = {Mode.PASSIVE}, [Mode.PASSIVE]
    while frontier:
        mode = frontier.pop()
        for row in TRANSITIONS:
            if mode in row.sources and row.target not in reached:
                reached.add(row.target)
                frontier.append(row.target)
    assert reached == set(Mode)
    assert all(any(mode in row.sources for row in TRANSITIONS) for mode in Mode)


@pytest.mark.parametrize("mode", [Mode.DAMPING, Mode.EMERGENCY_STOP])
def test_a_stopped_robot_moves_again_only_by_way_of_passive(mode):
    targets = {row.target for row in TRANSITIONS if mode in row.sources}
    assert targets - {Mode.EMERGENCY_STOP} == {Mode.PASSIVE}


def test_legs_carry_the_body_only_after_standing_up():
    sources = {mode for row in TRANSITIONS if row.target is Mode.STAND for mode in row.sources}
    on_legs = {Mode.WALK, Mode.POSITION_TROT, Mode.WAIR, Mode.FLY, Mode.BALANCE, Mode.LEAP}
    assert sources == {Mode.STAND_UP, *on_legs}
    for mode in (Mode.BALANCE, Mode.LEAP):
        before = {row.sources for row in TRANSITIONS if row.target is mode}
        assert before - {frozenset({mode})} == {frozenset({Mode.STAND})}
    for stepping in (Mode.WALK, Mode.POSITION_TROT):
        before = {mode for row in TRANSITIONS if row.target is stepping for mode in row.sources}
        assert before == {Mode.STAND}


def test_flight_begins_from_standing_and_ends_there_or_in_a_stop():
    assert {mode for row in TRANSITIONS if row.target is Mode.FLY for mode in row.sources} == {
        Mode.STAND
    }
    targets = {row.target for row in TRANSITIONS if Mode.FLY in row.sources}
    assert targets == {Mode.STAND, Mode.SETTLE, Mode.DAMPING, Mode.EMERGENCY_STOP}
    for missing in ("fans_available", "pose_fresh", "at_rest", "drives_operational"):
        machine = in_mode(Mode.STAND, lambda condition, missing=missing: condition != missing)
        assert machine.request("fly") == (None, f"fly refused: {CONDITIONS[missing]}")


def test_flight_becomes_standing_only_when_the_legs_have_the_weight():
    machine = in_mode(Mode.FLY, lambda condition: condition != "landed")
    assert machine.raise_event(Event.DONE) is None and machine.mode is Mode.FLY
    machine = in_mode(Mode.FLY)
    assert machine.raise_event(Event.DONE) is not None and machine.mode is Mode.STAND


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_active_mode_can_be_stopped(robot):
    """No condition may stand in the way; on its legs the robot settles, in the air it does not."""
    modes = modes_of(load_robot(robot))
    for grounded, mode in itertools.product((True, False), ACTIVE.intersection(modes)):
        settles = ON_LEGS if grounded else set()
        deaf = lambda condition, here=grounded: here and condition == "grounded"  # noqa: E731
        for request, target in (("damping", Mode.DAMPING), ("emergency_stop", Mode.EMERGENCY_STOP)):
            machine = in_mode(mode, deaf, modes)
            row, _ = machine.request(request)
            assert row is not None and machine.mode is (Mode.SETTLE if mode in settles else target)
        machine = in_mode(mode, deaf, modes)
        stays = mode in IN_THE_AIR | {Mode.SETTLE, Mode.BALANCE}  # which end by themselves
        assert (machine.raise_event(Event.FAULT) is None) == (mode is Mode.SETTLE)
        assert machine.mode is (mode if stays else Mode.SETTLE if mode in settles else Mode.DAMPING)
    machine = in_mode(Mode.SETTLE, deaf, modes)
    assert machine.raise_event(Event.DONE) is not None and machine.mode is Mode.DAMPING


# ----------------------------------------------------------------- the machine


@given(st.lists(STEP, max_size=40))
def test_whatever_happens_only_rows_of_the_table_are_taken(steps):
    now = frozenset()
    machine = ModeMachine(lambda condition: condition in now)
    assert machine.mode is Mode.PASSIVE
    for what, now in steps:
        before = machine.mode
        if isinstance(what, Event):
            row, message = machine.raise_event(what), ""
        else:
            row, message = machine.request(what)
            assert message, "every answer has words"
        if row is None:
            assert machine.mode is before
            continue
        assert row in TRANSITIONS
        assert before in row.sources and machine.mode is row.target
        assert set(row.conditions) <= now
        assert row.event is what if isinstance(what, Event) else what in row.requests
        if before is Mode.EMERGENCY_STOP:
            assert machine.mode is Mode.PASSIVE and what == "passive"


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("request_", WORDS)
def test_requests_are_taken_or_refused_with_their_reason(mode, request_):
    machine = in_mode(mode)
    allowed = machine.allowed_requests(mode)
    row, message = machine.request(request_)
    if row is not None:
        assert request_ in allowed and message == row.target.value == machine.mode.value
        return
    assert machine.mode is mode
    assert request_ not in allowed or request_ in mode.behaviour.answers
    if request_ not in REQUESTS:
        assert message.startswith(f"there is no mode '{request_}'; there are passive")
    elif request_ == mode.value:
        assert message == f"already in {mode.value}"
    else:
        assert message.startswith(f"{request_} cannot follow {mode.value}; it allows ")
        assert all(name in message for name in allowed)


def controller_in(robot, mode):
    """A controller of a robot at rest, just come into a mode."""
    controller = Controller(robot, warm_up=False)
    controller.command.position[:] = controller.context.stand_posture()
    controller._machine.mode, controller.present = mode, controller._modes[mode]
    controller.present.enter(Event.REQUEST)
    return controller


@pytest.mark.parametrize("name", ROBOTS)
def test_a_mode_allows_just_what_its_controller_does_not_refuse_because_of_it(name):
    """Whoever is to offer the requests of a mode learns them before anything is asked for."""
    robot = load_robot(name)
    told = Controller(robot, warm_up=False).allowed_requests()
    assert tuple(told) == modes_of(robot)
    for mode, allowed in told.items():
        assert allowed == tuple(request for request in REQUESTS if request in allowed)
        controller = controller_in(robot, mode)
        for request in REQUESTS:
            accepted, message = controller.request_mode(request)
            refused = f"{request} cannot follow {mode.value}; it allows {', '.join(allowed)}"
            no_such = message.startswith((f"there is no mode '{request}'", f"already in {request}"))
            assert (message == refused or no_such) == (request not in allowed), (mode, message)
            assert not (accepted and request not in allowed), (mode, message)
            if accepted:  # else it is as it was
                controller = controller_in(robot, mode)


def test_what_a_mode_answers_itself_is_allowed_in_it():
    machine = in_mode(Mode.PASSIVE)
    assert machine.allowed_requests(Mode.WALK) == ("stand", "damping", "emergency_stop")
    assert machine.allowed_requests(Mode.BALANCE)[:2] == ("stand", "balance")
    assert machine.allowed_requests(Mode.QUADROTOR) == ("splay", "damping", "emergency_stop")
    assert machine.allowed_requests(Mode.EMERGENCY_STOP) == ("passive",)


@pytest.mark.parametrize("missing", sorted(set(CONDITIONS) - {"grounded"}))
def test_a_condition_that_does_not_hold_is_named_in_the_refusal(missing):
    needing = [row for row in TRANSITIONS if missing in row.conditions]
    for row in needing:
        for mode in row.sources:
            machine = in_mode(mode, lambda condition: condition != missing)
            if row.event is Event.REQUEST:
                for name in row.requests:
                    assert machine.request(name) == (None, f"{name} refused: {CONDITIONS[missing]}")
            elif row.event is Event.FAULT:  # a fault leads somewhere whatever holds
                assert machine.raise_event(row.event) not in (None, row)
                continue
            else:
                assert machine.raise_event(row.event) is None
            assert machine.mode is mode


@pytest.mark.parametrize("mode", sorted(set(Mode) - ACTIVE, key=lambda mode: mode.value))
def test_faults_trip_active_modes_only(mode):
    machine = in_mode(mode)
    assert machine.raise_event(Event.FAULT) is None
    assert machine.mode is mode
