"""The robot's state as its operator sees it: a word for it, the next step, what bars a stick.

It follows from topics that every robot has. Modes are known by their names (docs/modes.md); one
that is not known here is shown by its name, with the modes that may follow it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from husky_bringup.teleop_mapping import Action
from husky_msgs.msg import ControllerState, DriveStatusArray, ModeTable

SILENT = 2.0
"""Wall time without a word from the controller after which the robot counts as silent [s]."""
FALLEN = 0.8
"""Tilt of the body beyond which the controller does not stand up, `safety.max_tilt` [rad]."""
RIGHTING = "righting"
"""Mode in which a robot turns itself onto its feet, if it has one."""
STEPPING = ("walk", "wair", "position_trot")
"""Modes that step until `stand` is asked for."""

_LIMP = ("passive", "settle", "damping", "emergency_stop")
"""Modes in which the legs do not carry the body, or not for long: tilted there, it has fallen."""
_STOPPED = ("damping", "emergency_stop")
_LYING = ("passive", "sit")
_FLYING = ("fly", "quadrotor", "leap")
_STEERED_IN_FLIGHT = ("quadrotor",)
"""Flying modes that follow a velocity."""
_LETTING_GO = ("damping", "emergency_stop")
"""Requests that are no next step."""
_WAITING = {
    "stand_up": ("standing up", "wait until it stands"),
    "settle": ("stopped", "wait until its body is down"),
    RIGHTING: ("righting", "wait until it lies on its feet"),
}
"""Words and next steps for modes that end by themselves."""


class Kind(Enum):
    """Kinds of states, each with a colour of its own."""

    SILENT = "silent"
    FALLEN = "fallen"
    STOPPED = "stopped"
    LYING = "lying"
    STANDING = "standing"
    WALKING = "walking"
    FLYING = "flying"
    OTHER = "other"


@dataclass(frozen=True)
class Known:
    """Knowledge of an operator's node about the robot.

    Attributes:
        state: last word of the controller, None before the first.
        drives: the same of the joints.
        table: the robot's modes; empty before it has come.
        silence: wall time since the controller's last word, or since somebody listens [s].
        is_simulated: the world can be reset.
    """

    state: ControllerState | None
    drives: DriveStatusArray | None
    table: ModeTable
    silence: float
    is_simulated: bool

    @property
    def is_silent(self) -> bool:
        """True if the controller has been silent for longer than `SILENT`."""
        return self.state is None or self.silence > SILENT

    @property
    def requests(self) -> Sequence[str]:
        """Modes that may be asked for now, conditions aside."""
        mode = "" if self.state is None or self.is_silent else self.state.mode
        return next((tuple(row.requests) for row in self.table.modes if row.name == mode), ())

    @property
    def has_righting(self) -> bool:
        """True if the robot has the mode that turns it onto its feet."""
        return any(row.name == RIGHTING for row in self.table.modes)


@dataclass(frozen=True)
class RobotState:
    """The state in words.

    Attributes:
        kind: of state.
        title: word for it.
        next_step: of an operator, in words.
        press: button of that step, None where none helps.
        obstacle: why a stick moves nothing, "" where it does.
    """

    kind: Kind
    title: str
    next_step: str
    press: Action | None
    obstacle: str


def judge(known: Known) -> RobotState:
    """Return the robot's state; the more urgent of several counts."""
    if known.state is None and known.silence <= SILENT:
        step = "wait for the controller"
        return RobotState(Kind.OTHER, "no word yet", step, None, step)
    if known.state is None or known.is_silent:
        silence = f"no word from the controller for {known.silence:.0f} s"
        return RobotState(Kind.SILENT, "silent", f"{silence}: see that it runs", None, silence)
    mode = known.state.mode
    if mode in _LIMP and tilt(known.state.orientation) > FALLEN:
        return _fallen(known)
    if mode in _FLYING:
        return _flying(known, mode)
    if mode in _STOPPED or (mode not in _WAITING and _is_stopped(known.drives)):
        step = "press Recover"
        obstacle = f"it is stopped: {step}"
        return RobotState(Kind.STOPPED, "stopped", step, Action.RECOVER, obstacle)
    if mode in _LYING:
        step = "press Stand up"
        return RobotState(Kind.LYING, "lying", step, Action.STAND_UP, f"it lies: {step}")
    if mode == "stand":
        return RobotState(Kind.STANDING, "standing", "hold a stick or a key to walk", None, "")
    if mode in STEPPING:
        step = "let go to stop"
        return RobotState(Kind.WALKING, "walking", step, Action.STOP, "")
    name = mode.replace("_", " ")
    title, step = _WAITING.get(mode, (name, _choice(known.requests) or "wait"))
    kind = Kind.STOPPED if mode == "settle" else Kind.OTHER
    return RobotState(kind, title, step, None, f"it is in mode {name}: {step}")


def tilt(orientation: Sequence[float]) -> float:
    """Return the angle between the body's z axis and the vertical [rad].

    Args:
        orientation: base in world (x, y, z, w); 0 is returned for one that is no rotation, as a
            controller tells before its first measurement.
    """
    x, y, z, w = orientation
    square = x * x + y * y + z * z + w * w
    if not 0.5 < square < 2.0:
        return 0.0
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y) / square)))


def _is_stopped(drives: DriveStatusArray | None) -> bool:
    """Return whether the drives are stopped until an operator resets them."""
    return drives is not None and (
        drives.emergency_stop or any(drive.error_code for drive in drives.drives)
    )


def _fallen(known: Known) -> RobotState:
    """Return the state of a robot that lies on its side or back, and the way up that it has."""
    press: Action | None = Action.RIGHTING
    if RIGHTING in known.requests and not _is_stopped(known.drives):
        step = "press Right itself"
    elif known.has_righting:
        step, press = "press Recover, then Right itself", Action.RECOVER
    elif known.is_simulated:
        step, press = "press Reset simulation", Action.RESET_SIMULATION
    else:
        step, press = "turn it over by hand, then press Recover", Action.RECOVER
    if known.is_simulated and known.has_righting:
        step += " (or Reset simulation)"
    return RobotState(Kind.FALLEN, "fallen", step, press, f"it has fallen: {step}")


def _flying(known: Known, mode: str) -> RobotState:
    step = _choice(known.requests, " to land") or "wait until it has landed"
    obstacle = "" if mode in _STEERED_IN_FLIGHT else f"it flies in mode {mode}: {step}"
    if _is_stopped(known.drives):
        obstacle = f"its joints have stopped in flight: {step}"
    return RobotState(Kind.FLYING, "flying", step, None, obstacle)


def _choice(requests: Sequence[str], to: str = "") -> str:
    """Return the modes that may be asked for in words, "" for none."""
    modes = [name.replace("_", " ") for name in requests if name not in _LETTING_GO]
    return f"choose mode {' or '.join(modes)}{to}" if modes else ""
