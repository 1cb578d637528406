"""What an operator's keys and joystick mean: velocities under a dead-man rule, and actions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from enum import Enum


class Action(Enum):
    """What an operator may ask for besides a velocity."""

    STAND_UP = "stand up"
    SIT = "sit down"
    WALK = "walk"
    STOP = "stop walking"
    NEXT_GAIT = "next gait"
    RECOVER = "recover"
    RIGHTING = "right itself"
    RESET_SIMULATION = "reset simulation"
    EMERGENCY_STOP = "emergency stop"
    CUT = "cut"


@dataclass(frozen=True)
class Velocity:
    """A velocity of the base: forward and left [m/s], yaw rate to the left [rad/s]."""

    forward: float = 0.0
    left: float = 0.0
    yaw: float = 0.0

    def scaled(self, limits: Velocity) -> Velocity:
        """Return shares (-1 to 1) times limits."""
        return Velocity(
            self.forward * limits.forward, self.left * limits.left, self.yaw * limits.yaw
        )

    def fitted(self, full: Velocity, limits: Velocity) -> Velocity:
        """Return the same shares of the limits, on axes where these are below full command."""
        pairs = zip(astuple(self), astuple(full), astuple(limits), strict=True)
        return Velocity(*(v / top * limit if limit < top else v for v, top, limit in pairs))

    @property
    def moving(self) -> bool:
        """Whether any part is not zero."""
        return self != Velocity()


RELEASE = 0.5
"""How long zero is sent after all is let go [s]."""

MOTION_KEYS: dict[str, Velocity] = {
    "w": Velocity(forward=1.0),
    "s": Velocity(forward=-1.0),
    "a": Velocity(left=1.0),
    "d": Velocity(left=-1.0),
    "q": Velocity(yaw=1.0),
    "e": Velocity(yaw=-1.0),
}
"""Keys that move the robot while they are held, as shares of the limits."""

ACTION_KEYS: dict[str, Action] = {
    " ": Action.STOP,
    "u": Action.STAND_UP,
    "j": Action.SIT,
    "g": Action.NEXT_GAIT,
    "r": Action.RECOVER,
    "t": Action.RIGHTING,
    "n": Action.RESET_SIMULATION,
    "x": Action.EMERGENCY_STOP,
}

CUT_KEY = "C"
"""Key that cuts the power while it is held; a capital, far from that of the emergency stop."""

_ESCAPES = {"\x1b[A": "w", "\x1b[B": "s", "\x1b[C": "e", "\x1b[D": "q"}
"""Arrow keys as terminals send them: up, down, right, left."""

HELP = """hold:  w s forward, back    a d left, right    q e turn    (or the arrow keys)
press: u stand up   j sit   g next gait   space stop   r recover   t right itself
       n reset simulation   x EMERGENCY STOP
hold C for 1 s: CUT the power (category 0 of IEC 60204-1): the robot falls
Ctrl-C: end this program; the robot stops walking and stands"""


def split_keys(text: str) -> list[str]:
    """Return the keys in what a terminal has sent, arrow keys as the letters they stand for.

    Capitals are small letters (caps lock must not disable the emergency stop), except `CUT_KEY`.
    """
    keys = []
    while text:
        escape = next((known for known in _ESCAPES if text.startswith(known)), None)
        if escape is not None:
            keys.append(_ESCAPES[escape])
            text = text[len(escape) :]
        else:
            keys.append(text[0] if text[0] == CUT_KEY else text[0].lower())
            text = text[1:]
    return keys


def next_gait(gaits: Sequence[str], present: str) -> str:
    """Return the gait after the present one, the first when that is none of them."""
    return gaits[(gaits.index(present) + 1) % len(gaits)] if present in gaits else gaits[0]


class DeadMan:
    """Lets a command through only while somebody keeps giving it.

    When it is let go, zero is sent for a while, then nothing: a controller takes silence for a
    stop as well, and another source of commands can take over.
    """

    def __init__(self, hold: float, release: float):
        """Nobody gives a command.

        Args:
            hold: how long one press counts [s].
            release: how long zero is sent afterwards [s].
        """
        self._hold = hold
        self._release = release
        self._velocity = Velocity()
        self._until = -math.inf

    def press(self, velocity: Velocity, now: float) -> None:
        """Give a command [s]."""
        self._velocity, self._until = velocity, now + self._hold

    def let_go(self, now: float) -> None:
        """End the command now [s]; zero is sent from here on."""
        if self.held(now):
            self._until = now

    def held(self, now: float) -> bool:
        """Return whether somebody gives a command."""
        return now < self._until

    def command(self, now: float) -> Velocity | None:
        """Return what to send, None for nothing."""
        if self.held(now):
            return self._velocity
        return Velocity() if now < self._until + self._release else None


class HeldKey:
    """A key that acts when it has been held, as a terminal tells it: by its repeats.

    One press or two never act. Keyboards repeat a held key after 0.25 to 0.66 s, then ten to forty
    times a second.
    """

    def __init__(self, period: float = 0.5, pause: float = 0.7, least: int = 3):
        """The key is up.

        Args:
            period: from the first press to the one that acts, at least [s].
            pause: longest between two presses of one hold [s].
            least: presses of a hold, at least.
        """
        self._period, self._pause, self._least = period, pause, least
        self._presses = 0
        self._first = self._last = -math.inf

    def press(self, now: float) -> bool:
        """Take a press or a repeat at a time [s]; return whether it acts, once in a hold."""
        if now - self._last > self._pause:
            self._presses, self._first = 0, now
        self._presses, self._last = self._presses + 1, now
        if self._presses < self._least or now - self._first < self._period:
            return False
        self._first = math.inf
        return True


class Keyboard:
    """Keys to velocities. A terminal tells presses and repeats, not releases."""

    def __init__(self, limits: Velocity, hold: float = 0.7, release: float = RELEASE):
        """No key is held.

        Args:
            limits: velocities at full command.
            hold: longer than a keyboard waits before it repeats a held key [s].
            release: how long zero is sent after the last key [s].
        """
        self._limits = limits
        self._share = Velocity()
        self._dead_man = DeadMan(hold, release)
        self._cut = HeldKey()

    def key(self, key: str, now: float) -> Action | None:
        """Take a key at a time [s]; return the action that it stands for.

        Motions of different axes add up while any of their keys is held (a terminal repeats only
        the last); the opposite key turns an axis round.
        """
        motion = MOTION_KEYS.get(key)
        if motion is not None:
            held = self._share if self._dead_man.held(now) else Velocity()
            self._share = Velocity(
                motion.forward or held.forward, motion.left or held.left, motion.yaw or held.yaw
            )
            self._dead_man.press(self._share.scaled(self._limits), now)
            return None
        action = ACTION_KEYS.get(key)
        if key == CUT_KEY and self._cut.press(now):
            action = Action.CUT
        if action is not None and action is not Action.NEXT_GAIT:
            self._dead_man.let_go(now)
        return action

    def command(self, now: float) -> Velocity | None:
        """Return what to send at a time [s], None for nothing."""
        return self._dead_man.command(now)


@dataclass(frozen=True)
class JoystickLayout:
    """Places of axes and buttons in `sensor_msgs/Joy`; the defaults are those of an Xbox pad."""

    forward: int = 1  # axis, positive forward
    left: int = 0  # axis, positive to the left
    yaw: int = 3  # axis, positive to the left
    dead_man: int = 4  # button that must be held for the robot to move (left shoulder)
    stand_up: int = 0  # button A
    emergency_stop: int = 1  # B
    sit: int = 2  # X
    next_gait: int = 3  # Y
    dead_band: float = 0.08  # deflection that counts as none, 0 to 1


class Joystick:
    """Joystick messages to velocities and actions."""

    def __init__(
        self,
        limits: Velocity,
        layout: JoystickLayout | None = None,
        silence: float = 0.3,
        release: float = RELEASE,
    ):
        """Nothing is held.

        Args:
            limits: velocities at full deflection.
            layout: where things are.
            silence: time without a message after which nothing is sent any more [s].
            release: how long zero is sent after the dead-man button is let go [s].
        """
        self._limits = limits
        self._layout = layout or JoystickLayout()
        self._silence = silence
        self._dead_man = DeadMan(math.inf, release)
        self._heard = -math.inf
        self._pressed: frozenset[Action] = frozenset(Action)  # what is down at the start is ignored

    def joy(self, axes: Sequence[float], buttons: Sequence[int], now: float) -> list[Action]:
        """Take a message at a time [s]; return the actions whose buttons have just gone down."""
        layout = self._layout
        self._heard = now
        if _button(buttons, layout.dead_man):
            share = Velocity(
                _axis(axes, layout.forward, layout.dead_band),
                _axis(axes, layout.left, layout.dead_band),
                _axis(axes, layout.yaw, layout.dead_band),
            )
            self._dead_man.press(share.scaled(self._limits), now)
        else:
            self._dead_man.let_go(now)
        wired = {
            Action.STAND_UP: layout.stand_up,
            Action.SIT: layout.sit,
            Action.NEXT_GAIT: layout.next_gait,
            Action.EMERGENCY_STOP: layout.emergency_stop,
        }
        down = frozenset(action for action, place in wired.items() if _button(buttons, place))
        new = [action for action in wired if action in down - self._pressed]
        self._pressed = down
        return new

    def let_go(self, now: float) -> None:
        """End the command now [s], whatever is held."""
        self._dead_man.let_go(now)

    def lose(self, now: float) -> None:
        """There is none any more [s]; what is down when it comes back is ignored."""
        self.let_go(now)
        self._pressed = frozenset(Action)

    def held(self, now: float) -> bool:
        """Return whether the dead-man button is held at a time [s]."""
        return self._dead_man.held(now) and now - self._heard < self._silence

    def command(self, now: float) -> Velocity | None:
        """Return what to send at a time [s], None for nothing."""
        return self._dead_man.command(now) if now - self._heard < self._silence else None


def _button(buttons: Sequence[int], place: int) -> bool:
    return 0 <= place < len(buttons) and bool(buttons[place])


def _axis(axes: Sequence[float], place: int, dead_band: float) -> float:
    """Return a deflection, -1 to 1, that grows from zero at the edge of the dead band."""
    value = axes[place] if 0 <= place < len(axes) else 0.0
    if not math.isfinite(value) or abs(value) <= dead_band:
        return 0.0
    return math.copysign((min(1.0, abs(value)) - dead_band) / (1.0 - dead_band), value)
