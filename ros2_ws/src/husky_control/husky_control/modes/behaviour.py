"""What a mode is: an object that owns entry, tick, leave, refusals, conditions and report."""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_control.rotation import tilt_of
from husky_control.tick_data import TICK, JointCommand
from husky_description.arrays import Array

if TYPE_CHECKING:
    from husky_control.gait.table import GaitClock
    from husky_control.modes.context import ModeContext

Mask = NDArray[np.bool_]
Velocity = tuple[float, float, float]
"""Forward and to the left [m/s], yaw rate [rad/s]."""

STOPS = frozenset({"damping", "emergency_stop"})
"""Requests to let go of the joints; some modes bring the body down first."""
REST_SPEED = 0.08
"""Below it a standing body is at rest [m/s]."""
REST_RATE = 0.3
"""Likewise [rad/s]."""


class Event(Enum):
    """What may cause a transition."""

    REQUEST = "request"
    DONE = "done"
    FAULT = "fault"
    LOST = "lost"


Happening = tuple[Event, str]
"""An event that a mode raises, and the reason in words."""


class VelocityLimits(NamedTuple):
    """Names of the parameters that limit the parts of a velocity command."""

    vx: str
    vy: str
    yaw_rate: str


class Behaviour:
    """One mode of the controller; what most modes do is written here.

    Conditions of the table are properties of the mode that is to be left, by their names.

    Attributes:
        active: the drives follow positions, and safety can trip.
        assisted: the fans may help the legs.
        place_counts: the estimated position says something.
        velocity_counts: the estimated velocity says something: the filter runs.
        wakes_to: what a velocity command asks for on behalf of the operator, "" for nothing.
        answers: requests that `answer` meets or refuses; all others it leaves to the table.
    """

    active: ClassVar[bool] = True
    assisted: ClassVar[bool] = False
    place_counts: ClassVar[bool] = True
    velocity_counts: ClassVar[bool] = True
    wakes_to: ClassVar[str] = ""
    answers: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, name: str, context: ModeContext) -> None:
        """Not entered yet; shares the context with all modes."""
        self.name = name
        self.context = context

    # Entry, tick, leave -------------------------------------------------------------------------
    def enter(self, event: Event) -> None:
        """Prepare, when an event has led here."""

    def leave(self, event: Event) -> str:
        """Clean up, when an event leads elsewhere; return what to ask for there, "" for nothing."""
        return ""

    def estimate(self) -> None:
        """Estimate where the body is and how it moves."""
        c = self.context
        c.body.estimate_from_feet(c.walking.clock, c.climbing.normal, all_stand=False)

    def prepare(self) -> Happening | None:
        """Look at this tick's estimate; return what happens before anything is commanded."""
        self.context.climbing.fade(TICK)
        return None

    def tick(self, command: JointCommand) -> Happening | None:
        """Fill the command of this tick; return what happens after it."""
        raise NotImplementedError

    # Requests, and why they are refused ---------------------------------------------------------
    def answer(self, request: str) -> tuple[bool, str] | None:
        """Meet a request within the mode, or refuse it; None leaves it to the table."""
        return None

    def change_gait(self, name: str) -> tuple[bool, str]:
        """Take over a gait of the table for the next walk."""
        self.context.gait = name
        return True, name

    def without_creep(self, velocity: Velocity) -> Velocity:
        """Return a velocity command, zero in place of one too slow to step for."""
        p, (vx, vy, yaw_rate) = self.context.parameters, velocity
        slow = math.hypot(vx, vy) < p["command.zero_speed"]
        return (0.0, 0.0, 0.0) if slow and abs(yaw_rate) < p["command.zero_yaw_rate"] else velocity

    def refuse_velocity(self, velocity: Velocity) -> str:
        """Return which part of a velocity command is out of its range, "" if none is."""
        p, limits = self.context.parameters, self.velocity_limits
        for part, value, name in zip(limits._fields, velocity, limits, strict=True):
            if not math.isfinite(value) or abs(value) > p[name]:
                unit = "rad/s" if part == "yaw_rate" else "m/s"
                return f"{part} must be within +-{p[name]:g} {unit} ({name}), not {value}"
        return ""

    def drive(self, velocity: Velocity, *, wakes: bool) -> str:
        """Follow a velocity command; return why not, "" if it does.

        Args:
            velocity: within the range.
            wakes: it may set a robot at rest in motion.
        """
        return f"it is in mode {self.name}" if any(velocity) else ""

    # Conditions ---------------------------------------------------------------------------------
    @property
    def drives_operational(self) -> bool:
        """Whether the drives follow."""
        return self.context.body.measurements.drives_operational

    @property
    def measurements_fresh(self) -> bool:
        """Whether something was measured of late."""
        body = self.context.body
        return body.measured and self.context.safety.stale(body.measurements) is None

    @property
    def upright(self) -> bool:
        """Whether the body is no more tilted than safety allows."""
        return tilt_of(self.context.body.rotation) < self.context.parameters["safety.max_tilt"]

    @property
    def legs_below(self) -> bool:
        """Whether the legs hang below the body: splayed ones cannot lift it."""
        c = self.context
        return c.morph is None or not c.morph.splay(c.body.measurements.joint_position)

    @property
    def legs_aside(self) -> bool:
        """Whether the legs are splayed, or were when they were let go."""
        return not self.legs_below

    @property
    def propellers_off(self) -> bool:
        """Whether the flight controller says that it is not armed, or is not there."""
        m = self.context.body.measurements
        return m.fans_disarmed or not m.fans_available

    @property
    def grounded(self) -> bool:
        """True if the legs may carry the body."""
        return True

    @property
    def at_rest(self) -> bool:
        """Whether the body does not move."""
        body = self.context.body
        speed = math.hypot(*body.estimator.velocity[:2])
        turning = math.hypot(*body.measurements.angular_velocity_base_in_base)
        return speed < REST_SPEED and turning < REST_RATE

    @property
    def fans_available(self) -> bool:
        """Whether the fans are armed and follow."""
        return self.context.body.measurements.fans_available

    @property
    def pose_fresh(self) -> bool:
        """Whether the T265 tells where the body is."""
        m = self.context.body.measurements
        return m.pose.usable(m.time)

    # Report -------------------------------------------------------------------------------------
    @property
    def gait(self) -> str:
        """Name of the gait whose speeds count."""
        return self.context.gait

    @property
    def velocity_limits(self) -> VelocityLimits:
        """Parameters that limit the velocity command in this mode, of several the least one."""
        gait, forward = f"gait.{self.gait}", f"gait.{self.gait}.max_speed"
        sideways = (f"{gait}.max_lateral_speed", forward, "command.max_lateral_speed")
        turning = (f"{gait}.max_yaw_rate", "command.max_yaw_rate")
        size = self.context.parameters.__getitem__
        return VelocityLimits(forward, min(sideways, key=size), min(turning, key=size))

    @property
    def clock(self) -> GaitClock:
        """Clock of the legs."""
        return self.context.walking.clock

    @property
    def ramped_velocity(self) -> Array:
        """The velocity command that the mode follows, behind its limits of acceleration.

        (3,) as `Velocity`; zero in a mode that follows none.
        """
        return np.zeros(3)

    @property
    def settled(self) -> bool:
        """Whether no motion from posture to posture is under way."""
        return True

    @property
    def stance(self) -> Mask:
        """Legs that are to stand on the ground, (4,) bool; none in the air, or as arms."""
        return ~self.clock.swinging & self.grounded

    @property
    def aims(self) -> Mask:
        """Legs that swing to a foothold, (4,) bool."""
        return np.zeros_like(self.clock.swinging)

    def lean(self) -> float:
        """Angle of the body's z axis from where it is to point [rad]: up, or as an incline asks."""
        c = self.context
        if not c.climbing.active:
            return tilt_of(c.body.rotation)
        wanted = c.walking.body_rotation[:, 2]
        cosine = float(c.body.rotation_on_ground[:, 2] @ wanted)
        return math.acos(min(1.0, max(-1.0, cosine)))
