"""The mode machine: every mode and every transition in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from husky_control.modes.balance import Balance
from husky_control.modes.behaviour import Behaviour, Event
from husky_control.modes.fly import Fly
from husky_control.modes.hang_and_tread import Hang, Tread
from husky_control.modes.leap import Leap
from husky_control.modes.let_go import Damping, EmergencyStop, Passive
from husky_control.modes.morph import Perch, Splay
from husky_control.modes.position_trot import PositionTrot
from husky_control.modes.quadrotor import Quadrotor
from husky_control.modes.righting import Righting
from husky_control.modes.settle import Settle
from husky_control.modes.stand import Stand
from husky_control.modes.stand_up_and_sit import Sit, StandUp
from husky_control.modes.wair import Wair
from husky_control.modes.walk import Walk

if TYPE_CHECKING:
    from husky_description.robot import Robot


class Mode(Enum):
    """What the controller is doing: name, class that does it, meaning.

    Attributes:
        behaviour: class of the mode's object.
        meaning: in words, for the documents.
    """

    behaviour: type[Behaviour]
    meaning: str

    def __new__(cls, name: str, behaviour: type[Behaviour], meaning: str) -> Mode:
        """Make a row of the table; its value is its name."""
        mode = object.__new__(cls)
        mode._value_ = name
        mode.behaviour, mode.meaning = behaviour, meaning
        return mode

    # fmt: off
    PASSIVE        = ("passive", Passive,
        "joints get zero torque")
    STAND_UP       = ("stand_up", StandUp,
        "brings the feet to their places while the body lies, then raises it")
    STAND          = ("stand", Stand,
        "holds the body over four feet")
    WALK           = ("walk", Walk,
        "steps in a gait; also while it comes to a stop")
    WAIR           = ("wair", Wair,
        "walks up and down inclines, held against them by the fans; stands at speed zero")
    FLY            = ("fly", Fly,
        "hovers on the fans, legs in the standing posture; also take-off and landing")
    PERCH          = ("perch", Perch,
        "crouches until the perch touches, folds the legs above it; or folds them back (T19)")
    SPLAY          = ("splay", Splay,
        "splays the legs on the perch until they are the arms of a quadrotor, and holds them (T19)")
    QUADROTOR      = ("quadrotor", Quadrotor,
        "flies on the propellers of the splayed legs; also take-off and landing on the perch (T19)")
    POSITION_TROT  = ("position_trot", PositionTrot,
        "trots by foot positions in the base's frame alone, whatever the feet feel (T18)")
    BALANCE        = ("balance", Balance,
        "one or two legs are arms whose propellers help the others to stand (dynamic morphing)")
    LEAP           = ("leap", Leap,
        "leaps from standing into flight, all legs becoming arms in the air (dynamic morphing)")
    HANG           = ("hang", Hang,
        "holds the standing posture without the ground, for a robot in ropes")
    TREAD          = ("tread", Tread,
        "steps in place under its hips, in the base's frame, for a robot in ropes (T40)")
    SIT            = ("sit", Sit,
        "lowers the body between the feet, gathers the legs, holds the sitting posture")
    RIGHTING       = ("righting", Righting,
        "rolls a body that lies on its side or back onto its perch, and gathers the legs")
    SETTLE         = ("settle", Settle,
        "lies down on the perch within half a second; then the joints let go")
    DAMPING        = ("damping", Damping,
        "joints are held at zero velocity: the robot sinks")
    EMERGENCY_STOP = ("emergency_stop", EmergencyStop,
        "joints get zero torque until an operator asks for passive")
    # fmt: on


ACTIVE = frozenset(mode for mode in Mode if mode.behaviour.active)
"""Modes in which the drives follow positions, and in which safety can trip."""
IN_THE_AIR = frozenset({Mode.QUADROTOR})
"""Modes in which letting go of the joints would be a fall: a fault lands the robot."""
ON_LEGS = frozenset(
    {
        Mode.STAND_UP,
        Mode.STAND,
        Mode.WALK,
        Mode.WAIR,
        Mode.FLY,
        Mode.POSITION_TROT,
        Mode.BALANCE,
        Mode.PERCH,
        Mode.SIT,
    }
)
"""Modes in which the robot settles before it lets go, unless it flies."""


@dataclass(frozen=True)
class Transition:
    """One row of the machine: in any of `sources`, on `event`, if `conditions` hold."""

    sources: frozenset[Mode]
    event: Event
    target: Mode
    requests: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()
    label: str = ""


FOR_FANS = frozenset({Mode.WAIR, Mode.FLY, Mode.RIGHTING})
"""Modes of a robot that carries the propulsion unit, whose legs carry no propellers."""
FOR_PROPELLERS = frozenset(
    {
        Mode.PERCH,
        Mode.SPLAY,
        Mode.QUADROTOR,
        Mode.POSITION_TROT,
        Mode.BALANCE,
        Mode.LEAP,
    }
)
"""Modes of a robot whose legs carry propellers, on servos that hold angles."""

CONDITIONS: dict[str, str] = {
    "drives_operational": "the drives are not operational",
    "measurements_fresh": "measurements are missing or stale",
    "upright": "the body is tilted too far",
    "legs_below": "the legs are splayed: ask for perch, which folds them",
    "legs_aside": "the legs are not splayed: ask for stand_up",
    "stopped": "the robot is still stepping",
    "at_rest": "the body is still moving",
    "fans_available": "the fans are not armed or do not follow",
    "pose_fresh": "the T265 gives no pose, or a doubtful one",
    "grounded": "the robot is in the air",
    "level": "the robot is still stepping, or stands on an incline",
    "landed": "the legs do not carry the weight yet",
    "posture_reached": "the legs are still on their way to the posture",
    "feet_still": "the feet are still stepping",
    "perched": "the body does not rest on its perch yet",
    "propellers_off": "the propellers are not off",
    "lift_centred": "the legs do not hold the propellers as flight needs them",
}
"""Name of each condition, a property of the mode's object, and the reason when it does not hold."""

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
    _row(Mode.PASSIVE,        Event.REQUEST, Mode.STAND_UP, ("stand_up", "stand"),
         (*_READY, "legs_below")),
    _row(Mode.SIT,            Event.REQUEST, Mode.STAND_UP, ("stand_up", "stand"), _READY),
    _row(Mode.STAND_UP,       Event.DONE,    Mode.STAND,    label="body raised"),
    _row(Mode.STAND_UP,       Event.REQUEST, Mode.SIT,      ("sit",)),
    _row(Mode.STAND,          Event.REQUEST, Mode.WALK,     ("walk",), _READY),
    _row(Mode.STAND,          Event.REQUEST, Mode.SIT,      ("sit",), ("at_rest",)),
    _row(Mode.WALK,           Event.DONE,    Mode.STAND,    conditions=("stopped",),
         label="stand requested, gait changed or command silent; all feet down"),
    _row(Mode.STAND,          Event.REQUEST, Mode.POSITION_TROT, ("position_trot",), _READY),
    _row(Mode.POSITION_TROT,  Event.DONE,    Mode.STAND,    conditions=("feet_still", "at_rest"),
         label="stand requested or command silent; all feet down"),
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
    _row(Mode.STAND,          Event.REQUEST, Mode.PERCH,    ("perch",), (*_READY, "at_rest")),
    _row(Mode.PASSIVE,        Event.REQUEST, Mode.PERCH,    ("perch",),
         (*_READY, "legs_aside", "propellers_off")),
    _row(Mode.STAND,          Event.REQUEST, Mode.BALANCE,  ("balance",),
         (*_READY, "at_rest", "fans_available")),
    _row(Mode.BALANCE,        Event.DONE,    Mode.STAND,
         label="stand requested, a guard fails or the propellers are lost; all feet down"),
    _row(Mode.STAND,          Event.REQUEST, Mode.LEAP,     ("leap",),
         (*_READY, "at_rest", "fans_available", "pose_fresh")),
    _row(Mode.LEAP,           Event.DONE,    Mode.QUADROTOR, label="in the air; arms out"),
    _row(Mode.LEAP,           Event.LOST,    Mode.STAND,
         label="stand requested, propellers or T265 lost before the push; risen again"),
    _row(Mode.PERCH,          Event.LOST,    Mode.STAND_UP,
         label="no ground is felt under the perch"),
    _row(Mode.PERCH,          Event.REQUEST, Mode.STAND_UP, ("stand_up", "stand"),
         (*_READY, "perched")),
    _row(Mode.PERCH,          Event.REQUEST, Mode.SPLAY,    ("splay",), (*_READY, "perched")),
    _row(Mode.SPLAY,          Event.REQUEST, Mode.PERCH,    ("perch",),
         (*_READY, "propellers_off")),
    _row(Mode.SPLAY,          Event.REQUEST, Mode.QUADROTOR, ("quadrotor",),
         (*_READY, "lift_centred", "fans_available", "pose_fresh")),
    _row(Mode.QUADROTOR,      Event.DONE,    Mode.SPLAY,    conditions=("landed",),
         label="splay requested or T265 lost; down, weight on the perch"),
    _row(Mode.QUADROTOR,      Event.LOST,    Mode.SPLAY,
         label="landed by the flight controller alone"),
    _row(Mode.QUADROTOR,      Event.FAULT,   Mode.QUADROTOR,
         label="a safety check trips: it lands, and holds its arms"),
    _row(Mode.PASSIVE,        Event.REQUEST, Mode.RIGHTING, ("righting",),
         ("drives_operational", "measurements_fresh", "at_rest")),
    _row(Mode.RIGHTING,       Event.DONE,    Mode.SIT,      label="on its perch"),
    _row(Mode.RIGHTING,       Event.LOST,    Mode.DAMPING,  label="not upright after all rounds"),
    _row(Mode.PERCH,          Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(Mode.SIT,            Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(Mode.DAMPING,        Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(Mode.EMERGENCY_STOP, Event.REQUEST, Mode.PASSIVE,  ("passive",)),
    _row(Mode.BALANCE,        Event.FAULT,   Mode.BALANCE,
         label="a safety check trips, it puts legs and body down"),
    _row(ON_LEGS,             Event.FAULT,   Mode.SETTLE,   conditions=("grounded",),
         label="a safety check trips"),
    _row(ON_LEGS,             Event.REQUEST, Mode.SETTLE,   ("damping", "emergency_stop"),
         ("grounded",)),
    _row(Mode.SETTLE,         Event.DONE,    Mode.DAMPING,  label="body down"),
    _row(ACTIVE - IN_THE_AIR - {Mode.SETTLE}, Event.FAULT, Mode.DAMPING,
         label="a safety check trips"),
    _row(ACTIVE | {Mode.PASSIVE}, Event.REQUEST, Mode.DAMPING, ("damping",)),
    _row(frozenset(Mode) - {Mode.EMERGENCY_STOP}, Event.REQUEST, Mode.EMERGENCY_STOP,
         ("emergency_stop",)),
)
# fmt: on


def modes_of(robot: Robot) -> tuple[Mode, ...]:
    """Return the modes that a robot has."""
    others = FOR_FANS if robot.legs_carry_propellers else FOR_PROPELLERS
    return tuple(mode for mode in Mode if mode not in others)


class ModeMachine:
    """The present mode, changed only by rows of the table."""

    def __init__(
        self,
        holds: Callable[[str], bool],
        modes: Iterable[Mode] = Mode,
        transitions: Iterable[Transition] = TRANSITIONS,
    ) -> None:
        """A machine in passive.

        Args:
            holds: tells whether a condition, by its name, holds now.
            modes: that there are.
            transitions: between them; of several that answer, the first counts.
        """
        self.mode = Mode.PASSIVE
        own = tuple(modes)
        self.requests = tuple(mode.value for mode in own)
        self._transitions = tuple(row for row in transitions if row.target in own)
        self._holds = holds

    def request(self, name: str) -> tuple[Transition | None, str]:
        """Take the first transition that an operator asks for whose conditions hold.

        Returns:
            The transition taken, or None and the reason in words.
        """
        if name not in self.requests:
            return None, f"there is no mode '{name}'; there are {', '.join(self.requests)}"
        if name == self.mode.value:
            return None, f"already in {name}"
        refusal = ""
        for row in self._transitions:
            if row.event is Event.REQUEST and self.mode in row.sources and name in row.requests:
                failed = next((each for each in row.conditions if not self._holds(each)), "")
                if not failed:
                    self.mode = row.target
                    return row, row.target.value
                refusal = refusal or f"{name} refused: {CONDITIONS[failed]}"
        if refusal:
            return None, refusal
        allowed = ", ".join(self.allowed_requests(self.mode)) or "nothing"
        return None, f"{name} cannot follow {self.mode.value}; it allows {allowed}"

    def raise_event(self, event: Event) -> Transition | None:
        """Take the first transition of an event from within whose conditions hold, if any does."""
        for row in self._transitions:
            meant = row.event is event and self.mode in row.sources
            if meant and all(self._holds(condition) for condition in row.conditions):
                self.mode = row.target
                return row
        return None

    def allowed_requests(self, mode: Mode) -> tuple[str, ...]:
        """Return what may be asked for in a mode, conditions aside, in the order of the modes.

        Rows of the table lead there, or the mode's object answers to it.
        """
        rows = [row for row in self._transitions if row.event is Event.REQUEST]
        known = {name for row in rows if mode in row.sources for name in row.requests}
        return tuple(n for n in self.requests if n in known | mode.behaviour.answers)
