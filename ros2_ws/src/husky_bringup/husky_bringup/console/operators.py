"""Those who drive by the page: what each of them holds, and which one the robot follows.

A browser says twenty times a second what is held, as long as anything is. What it says counts for
a moment, and only while it answers promptly: each time it sends back the last of the beats that it
has been sent, so that words which were long under way drive nothing.

In simulation a console that was stopped itself (`PatientClock`) does not take that for the silence
of a browser. Words that waited meanwhile drive nothing either, but nobody has to let go for them.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections import deque
from dataclasses import astuple, dataclass
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from husky_bringup.outcome import Outcome
from husky_bringup.teleop_mapping import (
    MOTION_KEYS,
    RELEASE,
    Action,
    DeadMan,
    Joystick,
    JoystickLayout,
    Velocity,
)
from husky_runtime.patient_clock import PatientClock

_BEATS = 100
"""Beats that are remembered; a word with an older one is old."""
_Share = Annotated[float, Meta(ge=-1.0, le=1.0)]
_Text = Annotated[str, Meta(max_length=64)]


class Pad(msgspec.Struct, forbid_unknown_fields=True):
    """A gamepad, in the order of `sensor_msgs/Joy`: axes -1 to 1, buttons that are down."""

    axes: Annotated[list[_Share], Meta(max_length=32)]
    buttons: Annotated[list[bool], Meta(max_length=32)]


class Hold(msgspec.Struct, forbid_unknown_fields=True, tag="hold"):
    """What is held.

    Attributes:
        beat: the last that has come.
        stick: forward, left and to the left around, as shares of the limits; None if let go.
        keys: that are down, of `MOTION_KEYS`.
        pad: None without one.
        speed: share of the limits that all of them are shares of.
    """

    beat: int
    stick: tuple[_Share, _Share, _Share] | None = None
    keys: Annotated[list[_Text], Meta(max_length=16)] = []
    pad: Pad | None = None
    speed: Annotated[float, Meta(ge=0.0, le=1.0)] = 1.0


class Ask(msgspec.Struct, forbid_unknown_fields=True, tag="ask"):
    """A button that is pressed: what it is of, and which; the last beat that has come."""

    what: _Text
    value: _Text
    beat: int = 0


Word = Hold | Ask
_DECODER = msgspec.json.Decoder(Word)


def read_word(data: str | bytes) -> Word:
    """Read what a browser has sent.

    Raises:
        ValueError: it is none; says what is wrong.
    """
    try:
        word: Word = _DECODER.decode(data)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return word


@dataclass(frozen=True)
class Rules:
    """What holds for all operators.

    Attributes:
        limits: velocities at full deflection.
        layout: where things are on a gamepad.
        silence: how long a word counts, and how old the beat in it may be [s].
        longest_look: most that the time between two looks counts as silence [s].
    """

    limits: Velocity
    layout: JoystickLayout
    silence: float
    longest_look: float = math.inf


class Beat(NamedTuple):
    """A beat that is sent to an operator.

    Attributes:
        number: that he sends back with his next word.
        delay: how long his last word and its beat were under way together [s].
        driver: "you", "another", or "" while nobody drives.
        holds: he holds a stick, keys or the gamepad's dead-man button.
        obstacle: why that moves nothing as far as operators go, "" where it does.
    """

    number: int
    delay: float
    driver: str
    holds: bool
    obstacle: str


class Operator:
    """One page. At its beginning, and after a button that ends a motion, all must be let go first.

    Attributes:
        delay: how long the last word and its beat were under way together [s].
        outcome: of what he asked for last.
        holds: whether something was held in the last word, barred or not.
        has_waited: whether that word waited while this process was stopped: it was passed over.
        is_barred: whether all must be let go before anything counts.
    """

    def __init__(self, rules: Rules, clock: PatientClock):
        """Nothing is held; times are of this clock."""
        self._rules, self._clock = rules, clock
        self._dead_man = DeadMan(rules.silence, RELEASE)
        self._joystick = Joystick(rules.limits, rules.layout, rules.silence)
        self._beats: deque[tuple[int, tuple[float, float]]] = deque(maxlen=_BEATS)
        self._count = itertools.count(1)
        self.is_barred = True
        self._speed = 1.0
        self.delay = 0.0
        self.outcome = Outcome()
        self.holds = self.has_waited = False

    def beat(self, now: float) -> int:
        """Return the number of the beat that is sent at a time [s]."""
        number = next(self._count)
        self._beats.append((number, (now, self._clock.missed)))
        return number

    def age(self, beat: int, now: float) -> float:
        """Return how long ago a beat was sent by the wall's clock [s]; infinite for another."""
        return sum(self._ages(beat, now))

    def _ages(self, beat: int, now: float) -> tuple[float, float]:
        """Return how long ago a beat was sent by the clock, and what that has missed since [s]."""
        sent = dict(self._beats).get(beat)
        if sent is None:
            return math.inf, 0.0
        return now - sent[0], self._clock.missed - sent[1]

    def hold(self, word: Hold, now: float) -> list[Action]:
        """Take what is held at a time [s]; return actions of buttons that have just gone down."""
        silence, (age, missed) = self._rules.silence, self._ages(word.beat, now)
        self.has_waited = missed > silence or age <= silence < age + missed
        if self.has_waited:
            return []  # it has waited for this process; who holds something says so again soon
        self.delay = age + missed
        if self.delay > silence:
            self.bar(now)
        share, pad = _share(word), word.pad
        dead_man = self._rules.layout.dead_man
        holds_pad = pad is not None and any(pad.buttons[max(dead_man, 0) : dead_man + 1])
        self.holds = share is not None or holds_pad
        self.is_barred = self.is_barred and self.holds
        self._speed = word.speed
        if share is None or self.is_barred:
            self._dead_man.let_go(now)
        else:
            self._dead_man.press(share.scaled(self._rules.limits), now)
        if pad is None:
            self._joystick.lose(now)
            return []
        buttons = [
            down and not (self.is_barred and place == dead_man)
            for place, down in enumerate(pad.buttons)
        ]
        return self._joystick.joy(pad.axes, buttons, now)

    def bar(self, now: float) -> None:
        """End what is held now [s], until all has been let go."""
        self._dead_man.let_go(now)
        self._joystick.let_go(now)
        self.is_barred = True

    def held(self, now: float) -> bool:
        """Return whether he drives at a time [s]."""
        return self._dead_man.held(now) or self._joystick.held(now)

    def command(self, now: float) -> Velocity | None:
        """Return what to send at a time [s], None for nothing."""
        command = self._dead_man.command(now)
        if command is None or not self._dead_man.held(now):
            command = self._joystick.command(now) or command
        speed = Velocity(self._speed, self._speed, self._speed)
        return command.scaled(speed) if command is not None else None


def _share(word: Hold) -> Velocity | None:
    """Return what stick and keys say, keys first; None when neither is held."""
    keys = [MOTION_KEYS[key] for key in word.keys if key in MOTION_KEYS]
    if keys:
        sums = map(sum, zip(*map(astuple, keys), strict=True))
        return Velocity(*(max(-1.0, min(1.0, each)) for each in sums))
    return Velocity(*word.stick) if word.stick is not None else None


class Operators:
    """All of them; the robot follows one who drives until he lets go.

    For any thread; times are of the wall's monotonic clock.
    """

    def __init__(self, rules: Rules):
        """Nobody is there."""
        self._rules, self._lock = rules, threading.Lock()
        self._clock = PatientClock(rules.longest_look)  # under the lock
        self._present: list[Operator] = []
        self._driver: Operator | None = None

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._present)

    def join(self) -> Operator:
        """Return a new one."""
        with self._lock:
            self._present.append(Operator(self._rules, self._clock))
            return self._present[-1]

    def leave(self, operator: Operator, now: float) -> None:
        """Let one go at a time [s]; if the robot followed him, it is sent zero."""
        with self._lock:
            operator.bar(self._clock.read(now))
            self._present.remove(operator)

    def hold(self, operator: Operator, word: Hold, now: float) -> list[Action]:
        """Take what one holds at a time [s]; return actions of buttons that have just gone down."""
        with self._lock:
            now = self._clock.read(now)
            actions = operator.hold(word, now)
            self._driver = self._choose(now) or self._driver
            return actions

    def age(self, operator: Operator, beat: int, now: float) -> float:
        """Return how long ago a beat was sent to one [s]."""
        with self._lock:
            return operator.age(beat, self._clock.read(now))

    def beat(self, operator: Operator, now: float) -> Beat:
        """Return the beat to send him at a time [s]."""
        with self._lock:
            now = self._clock.read(now)
            driver = self._choose(now)
            drives = "" if driver is None else "you" if driver is operator else "another"
            obstacle = ""
            if operator.delay > self._rules.silence:
                obstacle = "your words come too late"
            elif operator.is_barred:
                obstacle = "let all go, then push again"
            elif drives == "another":
                obstacle = "somebody else drives"
            return Beat(operator.beat(now), operator.delay, drives, operator.holds, obstacle)

    @property
    def driver(self) -> Operator | None:
        """The one whom the robot followed last, None before anybody drove."""
        return self._driver

    def stop(self, now: float) -> None:
        """End what any of them holds now [s], until they have let go."""
        with self._lock:
            now = self._clock.read(now)
            for operator in self._present:
                operator.bar(now)

    def command(self, now: float) -> Velocity | None:
        """Return what to send the robot at a time [s], None for nothing."""
        with self._lock:
            now = self._clock.read(now)
            self._driver = self._choose(now) or self._driver
            return self._driver.command(now) if self._driver is not None else None

    def _choose(self, now: float) -> Operator | None:
        """Return who drives at a time [s]: who did already, or the first of the others."""
        if self._driver is not None and self._driver.held(now):
            return self._driver
        return next((each for each in self._present if each.held(now)), None)
