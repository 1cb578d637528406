"""The mode machine: every mode and every transition in one table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum


class Mode(Enum):
    """What the controller is doing."""

    PASSIVE = "passive"
    STAND_UP = "stand_up"
    STAND = "stand"
    WALK = "walk"
    WAIR = "wair"
    FLY = "fly"
    HANG = "hang"
    TREAD = "tread"
    SIT = "sit"
    DAMPING = "damping"
    EMERGENCY_STOP = "emergency_stop"


DESCRIPTIONS: dict[Mode, str] = {
    Mode.PASSIVE: "joints get zero torque",
    Mode.STAND_UP: "brings the feet to their places while the body lies, then raises it",
    Mode.STAND: "holds the body over four feet",
    Mode.WALK: "steps in a gait; also while it comes to a stop",
    Mode.WAIR: "walks up and down inclines, held against them by the fans; stands at speed zero",
    Mode.FLY: "hovers on the fans, legs in the standing posture; also take-off and landing",
    Mode.HANG: "holds the standing posture without the ground, for a robot in ropes",
    Mode.TREAD: "steps in place under its hips, in the base's frame, for a robot in ropes (T40)",
    Mode.SIT: "lowers the body between the feet, gathers the legs, holds the sitting posture",
    Mode.DAMPING: "joints are held at zero velocity: the robot sinks",
    Mode.EMERGENCY_STOP: "joints get zero torque until an operator asks for passive",
}

ACTIVE = frozenset(Mode) - {Mode.PASSIVE, Mode.DAMPING, Mode.EMERGENCY_STOP}
"""Modes in which the drives follow positions, and in which safety can trip."""


class Event(Enum):
    """What may cause a transition."""

    REQUEST = "request"
    DONE = "done"
    FAULT = "fault"
    LOST = "lost"


@dataclass(frozen=True)
class Transition:
    """One row of the machine: in any of `sources`, on `event`, if `conditions` hold."""

    sources: frozenset[Mode]
    event: Event
    target: Mode
    requests: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()
    label: str = ""


CONDITIONS: dict[str, str] = {
    "drives_operational": "the drives are not operational",
    "measurements_fresh": "measurements are missing or stale",
    "upright": "the body is tilted too far",
    "stopped": "the robot is still stepping",
    "at_rest": "the body is still moving",
    "fans_available": "the fans are not armed or do not follow",
    "pose_fresh": "the T265 gives no pose, or a doubtful one",
    "level": "the robot is still stepping, or stands on an incline",
    "landed": "the legs do not carry the weight yet",
    "posture_reached": "the legs are still on their way to the posture",
    "feet_still": "the feet are still stepping",
}
"""Name of each condition, and the reason given when it does not hold."""

_READY = ("drives_operational", "measurements_fresh", "upright")


def _row(
    sources: Mode | frozenset[Mode],
    event: Event,
    target: Mode,
    requests: tuple[str, ...] = (),
    conditions: tuple[str, ...] = (),
    label: str = "",
) -> Transition:
    many = sources if isinstance(sources, frozenset) else frozenset({sources})
    return Transition(many, event, target, requests, conditions, label)


# fmt: off
TRANSITIONS: tuple[Transition, ...] = (
    _row(Mode.PASSIVE,        Event.REQUEST, Mode.STAND_UP, ("stand_up", "stand"), _READY),
    _row(Mode.SIT,            Event.REQUEST, Mode.STAND_UP, ("stand_up", "stand"), _READY),
    _row(Mode.STAND_UP,       Event.DONE,    Mode.STAND,    label="body raised"),
    _row(Mode.STAND_UP,       Event.REQUEST, Mode.SIT,      ("sit",)),
    _row(Mode.STAND,          Event.REQUEST, Mode.WALK,     ("walk",), _READY),
    _row(Mode.STAND,          Event.REQUEST, Mode.SIT,      ("sit",), ("at_rest",)),
    _row(Mode.WALK,           Event.DONE,    Mode.STAND,    conditions=("stopped",),
         label="stand requested, gait changed or command silent; all feet down"),
    _row(Mode.STAND,          Event.REQUEST, Mode.WAIR,     ("wair",), (*_READY, "at_rest")),
    _row(Mode.WAIR,           Event.DONE,    Mode.STAND,    conditions=("level",),
         label="stand requested; level, all feet down"),
    _row(Mode.WAIR,           Event.LOST,    Mode.SIT,
         label="fans lost where they are needed"),
    _row(Mode.STAND,          Event.REQUEST, Mode.FLY,      ("fly",),
         (*_READY, "at_rest", "fans_available", "pose_fresh")),
    _row(Mode.FLY,            Event.DONE,    Mode.STAND,    conditions=("landed",),
         label="stand requested or T265 lost; down, weight on the legs"),
    _row(Mode.PASSIVE,        Event.REQUEST, Mode.HANG,     ("hang",), _READY),
    _row(Mode.HANG,           Event.REQUEST, Mode.TREAD,    ("tread",),
         (*_READY, "posture_reached")),
    _row(Mode.TREAD,          Event.DONE,    Mode.HANG,     conditions=("feet_still",),
         label="hang requested; all feet down"),
    _row(Mode.HANG,           Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(Mode.SIT,            Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(Mode.DAMPING,        Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(Mode.EMERGENCY_STOP, Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(ACTIVE,              Event.FAULT,   Mode.DAMPING,  label="a safety check trips"),
    _row(ACTIVE | {Mode.PASSIVE}, Event.REQUEST, Mode.DAMPING, ("damping",)),
    _row(frozenset(Mode) - {Mode.EMERGENCY_STOP}, Event.REQUEST, Mode.EMERGENCY_STOP,
         ("emergency_stop",)),
)
# fmt: on

REQUESTS: tuple[str, ...] = tuple(mode.value for mode in Mode)
"""What may be requested.

`stand` also stops walking and lands, which then end in the mode stand, and `hang` stops treading.
"""


class ModeMachine:
    """The present mode, changed only by rows of TRANSITIONS."""

    def __init__(self, holds: Callable[[str], bool]) -> None:
        """A machine in passive.

        Args:
            holds: tells whether a condition, by its name, holds now.
        """
        self.mode = Mode.PASSIVE
        self._holds = holds

    def request(self, name: str) -> tuple[Transition | None, str]:
        """Take the transition that an operator asks for.

        Returns:
            The transition taken, or None and the reason in words.
        """
        if name not in REQUESTS:
            return None, f"there is no mode '{name}'; there are {', '.join(REQUESTS)}"
        if name == self.mode.value:
            return None, f"already in {name}"
        for row in TRANSITIONS:
            if row.event is Event.REQUEST and self.mode in row.sources and name in row.requests:
                for condition in row.conditions:
                    if not self._holds(condition):
                        return None, f"{name} refused: {CONDITIONS[condition]}"
                self.mode = row.target
                return row, f"{row.target.value}"
        allowed = ", ".join(self.allowed_requests()) or "nothing"
        return None, f"{name} cannot follow {self.mode.value}; it allows {allowed}"

    def raise_event(self, event: Event) -> Transition | None:
        """Take the transition of an event from within, if there is one and its conditions hold."""
        for row in TRANSITIONS:
            if row.event is event and self.mode in row.sources:
                if all(self._holds(condition) for condition in row.conditions):
                    self.mode = row.target
                    return row
                return None
        return None

    def allowed_requests(self) -> list[str]:
        """Requests that the present mode knows, conditions aside."""
        return [
            name
            for row in TRANSITIONS
            if row.event is Event.REQUEST and self.mode in row.sources
            for name in row.requests
        ]
