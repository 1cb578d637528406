"""Keys and joystick: the robot moves only while somebody means it to."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from husky_bringup.teleop_mapping import (
    ACTION_KEYS,
    CUT_KEY,
    HELP,
    MOTION_KEYS,
    Action,
    HeldKey,
    Joystick,
    JoystickLayout,
    Keyboard,
    Velocity,
    next_gait,
    split_keys,
)

LIMITS = Velocity(0.5, 0.3, 0.8)
STOP = Velocity()
XBOX = JoystickLayout()


def pad(*, forward: float = 0.0, left: float = 0.0, yaw: float = 0.0, down: tuple[int, ...] = ()):  # type: ignore[no-untyped-def]
    axes = [0.0] * 8
    axes[XBOX.forward], axes[XBOX.left], axes[XBOX.yaw] = forward, left, yaw
    return axes, [int(i in down) for i in range(11)]


# Keyboard -------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("w", Velocity(forward=0.5)),
        ("s", Velocity(forward=-0.5)),
        ("a", Velocity(left=0.3)),
        ("d", Velocity(left=-0.3)),
        ("q", Velocity(yaw=0.8)),
        ("e", Velocity(yaw=-0.8)),
    ],
)
def test_motion_keys(key: str, expected: Velocity) -> None:
    keyboard = Keyboard(LIMITS)
    assert keyboard.key(key, 0.0) is None
    assert keyboard.command(0.1) == expected


def test_nothing_is_sent_before_the_first_key() -> None:
    assert Keyboard(LIMITS).command(100.0) is None


def test_letting_go_stops_and_then_falls_silent() -> None:
    keyboard = Keyboard(LIMITS, hold=0.7, release=0.5)
    keyboard.key("w", 10.0)
    assert keyboard.command(10.69) == Velocity(forward=0.5)
    assert keyboard.command(10.71) == STOP
    assert keyboard.command(11.19) == STOP
    assert keyboard.command(11.21) is None


def test_keys_add_up_and_the_opposite_turns_round() -> None:
    keyboard = Keyboard(LIMITS)
    keyboard.key("w", 0.0)
    keyboard.key("q", 0.1)
    assert keyboard.command(0.2) == Velocity(forward=0.5, yaw=0.8)
    keyboard.key("s", 0.3)
    assert keyboard.command(0.4) == Velocity(forward=-0.5, yaw=0.8)
    keyboard.key("a", 5.0)
    assert keyboard.command(5.0) == Velocity(left=0.3), "what was let go is forgotten"


@pytest.mark.parametrize("key", [" ", "x", "j", "u", "r", "t", "n"])
def test_actions_end_the_motion(key: str) -> None:
    keyboard = Keyboard(LIMITS)
    keyboard.key("w", 0.0)
    assert keyboard.key(key, 0.1) is ACTION_KEYS[key]
    assert keyboard.command(0.1) == STOP
    assert keyboard.command(0.7) is None


def test_a_gait_is_chosen_on_the_move() -> None:
    keyboard = Keyboard(LIMITS)
    keyboard.key("w", 0.0)
    assert keyboard.key("g", 0.1) is Action.NEXT_GAIT
    assert keyboard.command(0.2) == Velocity(forward=0.5)


def test_unknown_keys_do_nothing() -> None:
    keyboard = Keyboard(LIMITS)
    for key in "zZ1\x1b\x03\t":
        assert keyboard.key(key, 0.0) is None
    assert keyboard.command(0.0) is None


def test_arrow_keys_and_capitals() -> None:
    assert split_keys("W\x1b[Aa\x1b[D\x1b[B\x1b[CX ") == ["w", "w", "a", "q", "s", "e", "x", " "]
    assert split_keys("cC") == ["c", CUT_KEY]
    assert split_keys("") == []


@given(st.text())
def test_any_input_is_split(text: str) -> None:
    assert len("".join(split_keys(text))) <= 2 * len(text)


def test_the_help_names_every_key() -> None:
    shown = HELP.replace("space", " ").split()
    for key in [*MOTION_KEYS, *ACTION_KEYS, CUT_KEY]:
        assert key in shown or key == " "
    assert "space" in HELP


@pytest.mark.parametrize(
    ("times", "acts"),
    [
        ([0.0], []),
        ([0.0, 0.6], []),  # a double press, however slow
        ([0.0, 0.05, 0.1, 0.15], []),
        ([0.0, 0.25, 0.28, 0.31, 0.49, 0.51, 0.54], [0.51]),
        ([0.0, 0.66, 0.69, 0.72], [0.69]),  # the slowest keyboard
        ([0.0, 0.2, 0.95, 1.15], []),  # let go in between
        ([0.0, 0.3, 0.6, 0.9, 1.2, 5.0, 5.3, 5.6], [0.6, 5.6]),
    ],
)
def test_a_key_acts_once_when_it_has_been_held(times: list[float], acts: list[float]) -> None:
    key = HeldKey()
    assert [now for now in times if key.press(now)] == acts


def test_power_is_cut_by_a_key_that_is_held() -> None:
    keyboard = Keyboard(LIMITS)
    keyboard.key("w", 0.0)
    assert [keyboard.key(CUT_KEY, now) for now in (0.1, 0.4)] == [None, None]
    assert keyboard.key(CUT_KEY, 0.7) is Action.CUT
    assert keyboard.command(0.7) == STOP


class OperatorAtTheKeys(RuleBasedStateMachine):
    """Whatever is typed: no motion without a motion key in the last 0.7 s, none above limits."""

    @initialize()
    def begin(self) -> None:
        self.now = 0.0
        self.keyboard = Keyboard(LIMITS, hold=0.7)
        self.meant = -math.inf

    @rule(wait=st.floats(0.0, 2.0))
    def wait(self, wait: float) -> None:
        self.now += wait

    @rule(key=st.sampled_from([*MOTION_KEYS, *ACTION_KEYS, "z"]))
    def press(self, key: str) -> None:
        action = self.keyboard.key(key, self.now)
        if key in MOTION_KEYS:
            self.meant = self.now
        elif action not in (None, Action.NEXT_GAIT):
            self.meant = -math.inf

    @invariant()
    def safe(self) -> None:
        command = self.keyboard.command(self.now) or STOP
        assert abs(command.forward) <= LIMITS.forward
        assert abs(command.left) <= LIMITS.left
        assert abs(command.yaw) <= LIMITS.yaw
        if command.moving:
            assert self.now - self.meant < 0.7 + 1e-9


TestOperatorAtTheKeys = OperatorAtTheKeys.TestCase


# Joystick -------------------------------------------------------------------------------------
def test_sticks_count_only_with_the_dead_man_held() -> None:
    joystick = Joystick(LIMITS)
    joystick.joy(*pad(forward=1.0, yaw=-1.0), 0.0)
    assert joystick.command(0.0) is None
    joystick.joy(*pad(forward=1.0, yaw=-1.0, down=(XBOX.dead_man,)), 0.1)
    assert joystick.command(0.1) == Velocity(forward=0.5, yaw=-0.8)
    joystick.joy(*pad(forward=1.0), 0.2)
    assert joystick.command(0.2) == STOP
    joystick.joy(*pad(forward=1.0), 0.8)
    assert joystick.command(0.8) is None


def test_a_silent_joystick_sends_nothing() -> None:
    joystick = Joystick(LIMITS, silence=0.3)
    joystick.joy(*pad(forward=1.0, down=(XBOX.dead_man,)), 5.0)
    assert joystick.command(5.29) == Velocity(forward=0.5)
    assert joystick.command(5.31) is None


def test_dead_band() -> None:
    joystick = Joystick(LIMITS)
    joystick.joy(*pad(forward=XBOX.dead_band, left=-0.54, down=(XBOX.dead_man,)), 0.0)
    command = joystick.command(0.0)
    assert command is not None
    assert command.forward == 0.0
    assert command.left == pytest.approx(-0.3 * (0.54 - 0.08) / 0.92)


def test_a_button_acts_once_when_it_goes_down() -> None:
    joystick = Joystick(LIMITS)
    assert joystick.joy(*pad(down=(XBOX.stand_up,)), 0.0) == [], "held since before the start"
    assert joystick.joy(*pad(), 0.1) == []
    assert joystick.joy(*pad(down=(XBOX.stand_up,)), 0.2) == [Action.STAND_UP]
    assert joystick.joy(*pad(down=(XBOX.stand_up,)), 0.3) == []
    both = joystick.joy(*pad(down=(XBOX.sit, XBOX.emergency_stop)), 0.4)
    assert set(both) == {Action.SIT, Action.EMERGENCY_STOP}
    assert joystick.joy(*pad(down=(XBOX.next_gait,)), 0.5) == [Action.NEXT_GAIT]


@given(
    st.lists(st.floats(width=32), max_size=8),
    st.lists(st.integers(-5, 5), max_size=12),
)
def test_any_message_is_safe(axes: list[float], buttons: list[int]) -> None:
    joystick = Joystick(LIMITS)
    joystick.joy(axes, buttons, 0.0)
    command = joystick.command(0.0) or STOP
    for value, limit in (
        (command.forward, LIMITS.forward),
        (command.left, LIMITS.left),
        (command.yaw, LIMITS.yaw),
    ):
        assert abs(value) <= limit


# Gaits ----------------------------------------------------------------------------------------
def test_gaits_go_round() -> None:
    gaits = ["trot", "crawl", "bound"]
    assert next_gait(gaits, "trot") == "crawl"
    assert next_gait(gaits, "bound") == "trot"
    assert next_gait(gaits, "unheard of") == "trot"


def test_a_gait_that_is_slower_than_full_command_gets_the_same_share_of_its_own_limits():
    full, crawl = Velocity(0.5, 0.3, 0.8), Velocity(0.05, 0.02, 0.1)
    assert full.fitted(full, crawl) == crawl  # to the bit, or it would be refused
    assert Velocity(-0.25, 0.15, 0.0).fitted(full, crawl) == Velocity(-0.025, 0.01, 0.0)
    assert full.fitted(full, Velocity(1.6, 0.3, 2.0)) == full
    assert full.fitted(full, Velocity()) == Velocity()
