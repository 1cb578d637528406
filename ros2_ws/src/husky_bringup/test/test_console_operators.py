"""Operators in browsers: what counts as held, who drives, and when nobody does any more."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("msgspec")

from husky_bringup.console.operators import Ask, Hold, Operator, Operators, Pad, Rules, read_word
from husky_bringup.teleop_mapping import Action, JoystickLayout, Velocity

RULES = Rules(Velocity(0.5, 0.3, 0.8), JoystickLayout(), silence=0.5)
ZERO = Velocity()
AHEAD = (1.0, 0.0, 0.0)
DEAD_MAN, STAND_UP, STOP = 4, 0, 1


class Page:
    """An operator whose words come at once, ten times a second."""

    def __init__(self, operators: Operators | None = None):
        self.operators = Operators(RULES) if operators is None else operators
        self.operator: Operator = self.operators.join()
        self.now = 0.0
        self.says()

    def says(self, after: float = 0.1, late: float = 0.0, **held: Any) -> list[Action]:
        """Say what is held a while after the last word, with a beat that is so old."""
        self.now += after
        self.beat = self.operators.beat(self.operator, self.now - late)[0]
        return self.operators.hold(self.operator, Hold(self.beat, **held), self.now)

    def command(self, after: float = 0.0) -> Velocity | None:
        return self.operators.command(self.now + after)


def pad(*down: int, forward: float = 0.0) -> Pad:
    return Pad([0.0, forward, 0.0, 0.0], [button in down for button in range(8)])


@pytest.fixture
def page() -> Page:
    return Page()


# A pause of the console ------------------------------------------------------------------------
@pytest.fixture
def paused() -> Page:
    """Somebody drives; then the console of a simulation is stopped for 20 s."""
    page = Page(Operators(replace(RULES, longest_look=0.1)))
    page.says(stick=AHEAD)
    page.now += 20.0
    return page


def test_a_pause_of_the_console_is_no_silence_of_a_browser(paused: Page) -> None:
    """Motions that were held stay held; a browser that has gone counts for `silence` from there."""
    assert paused.command() == Velocity(0.5)
    paused.says(stick=AHEAD)
    assert paused.command() == Velocity(0.5)
    for _ in range(10):
        paused.now += 0.05
        moving = paused.command()
    assert moving == ZERO


def test_words_that_waited_for_the_console_neither_drive_nor_bar(paused: Page) -> None:
    old = paused.beat
    assert (
        paused.operators.hold(paused.operator, Hold(old, stick=(-1.0, 0.0, 0.0)), paused.now) == []
    )
    assert paused.command() == Velocity(0.5), "the last word from before the pause"
    for _ in range(12):  # there are many, and reading them takes longer than `silence`
        paused.now += 0.05
        assert paused.operators.hold(paused.operator, Hold(old, stick=AHEAD), paused.now) == []
    assert paused.command() == ZERO
    paused.says(stick=(0.0, 1.0, 0.0))
    assert paused.command() == Velocity(left=0.3), "who still holds it need not let go first"


def test_a_button_that_waited_for_the_console_is_as_old_as_it_is(paused: Page) -> None:
    old = paused.beat
    assert paused.operators.age(paused.operator, old, paused.now) == pytest.approx(20.0)


# What is held ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("held", "expected"),
    [
        ({"stick": (1.0, -1.0, 0.5)}, Velocity(0.5, -0.3, 0.4)),
        ({"stick": (1.0, 0.0, 0.0), "speed": 0.5}, Velocity(0.25, 0.0, 0.0)),
        ({"keys": ["w", "q"]}, Velocity(0.5, 0.0, 0.8)),
        ({"keys": ["w", "s", "a"]}, Velocity(0.0, 0.3, 0.0)),
        ({"keys": ["s"], "stick": AHEAD}, Velocity(-0.5, 0.0, 0.0)),
        ({"keys": ["w", "no key"]}, Velocity(0.5, 0.0, 0.0)),
        ({"pad": pad(DEAD_MAN, forward=1.0)}, Velocity(0.5, 0.0, 0.0)),
        ({"pad": pad(DEAD_MAN, forward=1.0), "speed": 0.1}, Velocity(0.05, 0.0, 0.0)),
        ({"pad": pad(forward=1.0)}, None),
        ({"pad": Pad([], [])}, None),
        ({"keys": ["no key"]}, None),
        ({}, None),
    ],
)
def test_what_is_held_is_sent(page: Page, held: dict[str, Any], expected: Velocity | None) -> None:
    page.says(**held)
    assert page.command() == expected


def test_a_button_of_the_pad_acts_when_it_goes_down(page: Page) -> None:
    assert page.says(pad=pad()) == []
    assert page.says(pad=pad(STAND_UP, STOP)) == [Action.STAND_UP, Action.EMERGENCY_STOP]
    assert page.says(pad=pad(STAND_UP, STOP)) == []
    assert page.says(pad=pad(STOP)) == page.says(pad=pad()) == []
    assert page.says(pad=pad(STOP)) == [Action.EMERGENCY_STOP]


def test_the_press_that_makes_a_pad_known_is_none(page: Page) -> None:
    """A browser tells of a pad once one of its buttons is pressed; also when it comes back."""
    for _ in range(2):
        assert page.says(pad=pad(STAND_UP)) == []
        page.says(pad=pad())
        assert page.says(pad=pad(STAND_UP)) == [Action.STAND_UP]
        page.says()


# The end of a command ---------------------------------------------------------------------------
def test_who_lets_go_is_sent_zero_for_a_while(page: Page) -> None:
    page.says(stick=AHEAD)
    page.says()
    assert page.command() == page.command(0.49) == ZERO
    assert page.command(0.51) is None


@pytest.mark.parametrize("held", [{"stick": AHEAD}, {"keys": ["w"]}])
def test_who_falls_silent_is_stopped(page: Page, held: dict[str, Any]) -> None:
    page.says(**held)
    assert page.command(0.49) == Velocity(0.5)
    assert page.command(0.51) == page.command(0.99) == ZERO
    assert page.command(1.01) is None


def test_a_pad_that_falls_silent_drives_no_longer(page: Page) -> None:
    page.says(pad=pad(DEAD_MAN, forward=1.0))
    assert page.command(0.49) == Velocity(0.5)
    assert page.command(0.51) in (ZERO, None)


@pytest.mark.parametrize("held", [{"stick": AHEAD}, {"pad": pad(DEAD_MAN, forward=1.0)}])
def test_who_leaves_is_stopped(page: Page, held: dict[str, Any]) -> None:
    page.says(**held)
    page.operators.leave(page.operator, page.now)
    assert page.command() == ZERO
    assert page.command(0.51) is None
    assert len(page.operators) == 0


# Words that are late ----------------------------------------------------------------------------
@pytest.mark.parametrize("held", [{"keys": ["w"]}, {"pad": pad(DEAD_MAN, forward=1.0)}])
def test_words_that_were_long_under_way_stop(page: Page, held: dict[str, Any]) -> None:
    """What a network has kept back comes all at once: the robot stays, until all is let go."""
    page.says(**held, late=0.4)
    assert page.command() == Velocity(0.5)
    page.says(**held, late=0.6)
    assert page.command() == ZERO
    page.says(**held)
    assert page.command() == ZERO
    page.says()
    page.says(**held)
    assert page.command() == Velocity(0.5)


@pytest.mark.parametrize("beat", [0, -1, 10**9])
def test_a_beat_that_was_never_sent_drives_nothing(page: Page, beat: int) -> None:
    page.operators.hold(page.operator, Hold(beat, stick=AHEAD), page.now)
    assert page.command() is None


def test_a_late_emergency_stop_of_the_pad_is_one(page: Page) -> None:
    page.says(pad=pad())
    assert page.says(pad=pad(STOP), late=30.0) == [Action.EMERGENCY_STOP]


# Several ----------------------------------------------------------------------------------------
def test_the_robot_follows_who_drives_first(page: Page) -> None:
    other = Page(page.operators)
    page.says(stick=AHEAD)
    other.says(stick=(-1.0, 0.0, 0.0))
    for _ in range(10):
        other.says(stick=(-1.0, 0.0, 0.0))
        page.says(stick=AHEAD)
        assert page.command() == Velocity(0.5)
    assert page.operators.beat(page.operator, page.now)[2] == "you"
    assert page.operators.beat(other.operator, page.now)[2] == "another"
    page.says()
    assert page.command() == Velocity(-0.5)
    other.says()
    assert page.command(0.1) == ZERO
    assert page.operators.beat(other.operator, page.now + 0.1)[2] == ""


def test_each_is_told_why_he_moves_nothing(page: Page) -> None:
    other = Page(page.operators)

    def why(each: Page) -> str:
        return page.operators.beat(each.operator, each.now).obstacle

    page.says(stick=AHEAD)
    other.says(stick=AHEAD)
    assert (why(page), why(other)) == ("", "somebody else drives")
    page.operators.stop(page.now)
    assert why(page) == "let all go, then push again"
    page.says()
    assert why(page) == ""
    page.says(stick=AHEAD, late=0.6)
    assert why(page) == "your words come too late"
    assert page.operators.beat(page.operator, page.now).holds


def test_a_stop_bars_all_of_them_until_they_let_go(page: Page) -> None:
    other = Page(page.operators)
    for each in (page, other):
        each.says(stick=AHEAD)
    page.operators.stop(page.now)
    for each in (page, other):
        each.says(stick=AHEAD, pad=pad(DEAD_MAN, forward=1.0))
    assert page.command() == ZERO
    other.says(after=0.0)
    other.says(after=0.0, stick=AHEAD)
    assert page.command() == Velocity(0.5)


def test_who_comes_with_something_held_lets_go_first() -> None:
    operators = Operators(RULES)
    operator = operators.join()
    for now in (0.1, 0.2):
        beat = operators.beat(operator, now)[0]
        operators.hold(operator, Hold(beat, stick=AHEAD), now)
    assert operators.command(0.2) is None


# Words ------------------------------------------------------------------------------------------
def test_words_are_read() -> None:
    word = {"type": "hold", "beat": 3, "stick": [1, -1, 0.5], "keys": ["w"], "pad": None}
    assert read_word(json.dumps(word)) == Hold(3, (1.0, -1.0, 0.5), ["w"])
    pad_word = {"type": "hold", "beat": 1, "pad": {"axes": [0.5], "buttons": [True]}}
    assert read_word(json.dumps(pad_word).encode()) == Hold(1, pad=Pad([0.5], [True]))
    assert read_word('{"type": "ask", "what": "mode", "value": "sit"}') == Ask("mode", "sit", 0)


@pytest.mark.parametrize(
    ("data", "wrong"),
    [
        ("", "truncated"),
        ("text", "malformed"),
        (b"\xff\xfe", "malformed"),
        ("[" * 3000, "array"),
        ("7", "Expected `object`"),
        ("{}", "missing required field `type`"),
        ('{"type": "jump"}', "Invalid value 'jump'"),
        ('{"type": "hold"}', "`beat`"),
        ('{"type": "hold", "beat": 1.5}', r"\$.beat"),
        ('{"type": "hold", "beat": 1, "stick": [1, 0]}', r"\$.stick"),
        ('{"type": "hold", "beat": 1, "stick": [1.01, 0, 0]}', r"<= 1.0.*\$.stick"),
        ('{"type": "hold", "beat": 1, "stick": [NaN, 0, 0]}', "malformed"),
        ('{"type": "hold", "beat": 1, "stick": [1e999, 0, 0]}', r"\$.stick|out of range"),
        ('{"type": "hold", "beat": 1, "speed": 1.1}', r"\$.speed"),
        ('{"type": "hold", "beat": 1, "keys": "w"}', r"\$.keys"),
        ('{"type": "hold", "beat": 1, "pad": {"axes": [2], "buttons": []}}', r"\$.pad.axes"),
        ('{"type": "hold", "beat": 1, "pad": {"axes": [], "buttons": [1]}}', r"\$.pad.buttons"),
        ('{"type": "hold", "beat": 1, "more": 1}', "unknown field `more`"),
        ('{"type": "ask"}', "`what`"),
        ('{"type": "ask", "what": 1}', r"\$.what"),
        (f'{{"type": "ask", "what": "{"x" * 65}"}}', r"\$.what"),
    ],
)
def test_what_is_no_word_is_named(data: str | bytes, wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        read_word(data)
