"""Mode `quadrotor`: flies on the propellers of the splayed legs, from the perch and back (T19).

In the air letting go of the joints would be a fall. So whatever fails or is asked for, the arms
hold until the body is down: a stop that an operator wants lands first and follows then.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from husky_control.flight.hover import AIRBORNE, HoverPhase
from husky_control.modes.arms_in_flight import ArmsInFlight
from husky_control.modes.behaviour import (
    STOPS,
    Event,
    Happening,
    Mask,
    Velocity,
    VelocityLimits,
)
from husky_control.modes.context import ModeContext
from husky_control.modes.fly import Fly
from husky_control.tick_data import TICK, JointCommand
from husky_description.arrays import Array
from husky_description.kinematics import LEGS

OWN_GAINS = ("position_gain", "velocity_gain", "trim_gain", "trim_limit")
"""Of `HoverGains`, which are live parameters here."""
LEFT_ALONE = 20.0
"""Time after which a flight controller that says nothing any more counts as landed [s]."""


class Quadrotor(Fly):
    """One flight; the legs are arms."""

    answers = frozenset({"splay"}) | STOPS

    def __init__(self, name: str, context: ModeContext) -> None:
        """On the perch; nobody has asked for a landing."""
        super().__init__(name, context)
        self._arms = ArmsInFlight(context)
        self._stop = ""  # what is asked for once it is down
        self._may_hold_again = False  # the landing was asked for, not enforced by a fault or a stop
        self._alone_for = 0.0  # s

    def enter(self, event: Event) -> None:
        """Take off from the perch; with a fault in flight, land."""
        hover = self.context.hover
        self._may_hold_again = False
        if event is Event.FAULT:
            hover.land()
            return
        if hover.phase is HoverPhase.HOLD:  # a leap has led here
            self._posture[:] = self.context.command.position
            self._start[:] = self.context.body.estimator.position
        else:
            super().enter(event)
        hover.lands_anywhere = True
        own = {name: self.context.parameters[f"quadrotor.{name}"] for name in OWN_GAINS}
        hover.gains = replace(hover.gains, **own)
        self._arms.begin()
        self._stop, self._alone_for = "", 0.0

    def leave(self, event: Event) -> str:
        """Switch the thrust off after a landing, else let it fade; then stop, if that is wanted."""
        hover = self.context.hover
        hover.lead = 0.0
        if event is Event.FAULT:
            return ""
        if event is Event.DONE:
            hover.finish()
            self.context.body.rest_on_perch()
        else:
            hover.end()
        return self._stop

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Land, when asked for the mode that follows or for a stop."""
        if request in STOPS:
            self._stop, self._may_hold_again = request, False
            self.context.hover.land()
            return True, f"landing; {request} when the body is down"
        answer = super().answer(request)
        self._may_hold_again = self._may_hold_again or (answer is not None and not self._stop)
        return answer

    def estimate(self) -> None:
        """Know from the flight where the body is; on the perch, that it is still."""
        if self.context.hover.phase in AIRBORNE:
            super().estimate()
        else:
            self.context.body.stay()

    def prepare(self) -> Happening | None:
        """Hold the arms while the flight controller lands by itself; end when it has."""
        c = self.context
        if self.fans_available:
            self._alone_for = 0.0
            return None
        if self._alone_for == 0.0:
            self._may_hold_again = False
            c.hover.land()
            c.reason = "the flight controller lands by itself"
        self._alone_for += TICK
        if c.body.measurements.fans_disarmed or self._alone_for > LEFT_ALONE:
            return Event.LOST, "the propellers are off"
        return None

    def tick(self, command: JointCommand) -> Happening | None:
        """Fly at the height that is wished; a silent command ends the way."""
        c, hover = self.context, self.context.hover
        hover.top = c.parameters["quadrotor.height"]
        if c.watch.silent and (any(hover.velocity_wish) or hover.yaw_rate):
            c.counters.command_timeouts += 1
            hover.velocity_wish, hover.yaw_rate = (0.0, 0.0), 0.0
            c.reason = "velocity command silent"
        if self._may_hold_again and hover.height < -c.parameters["quadrotor.landing_depth"]:
            self._may_hold_again = False
            hover.hold()
            c.reason = "no ground is found where it was to land: it holds again"
        happening = super().tick(command)
        self._arms.move(command)
        return happening

    def without_creep(self, velocity: Velocity) -> Velocity:
        """Return the command as it is: a flight goes as slowly as it is told."""
        return velocity

    @property
    def velocity_limits(self) -> VelocityLimits:
        """Parameters that limit the velocity command in flight."""
        speed = "quadrotor.max_speed"
        return VelocityLimits(speed, speed, "quadrotor.max_yaw_rate")

    def drive(self, velocity: Velocity, *, wakes: bool) -> str:
        """Go on over the ground and turn, as long as the place is held."""
        hover = self.context.hover
        if hover.phase is not HoverPhase.HOLD:
            return f"it is {hover.phase.value}" if any(velocity) else ""
        ahead, left, hover.yaw_rate = velocity
        hover.velocity_wish = (ahead, left)
        return ""

    @property
    def stance(self) -> Mask:
        """No leg stands: they are arms, also on the perch."""
        return np.zeros(LEGS, np.bool_)

    def _feet_down(self) -> int:
        """None: it lands on its perch, and feels it by sinking no further."""
        return 0

    def _carry(self, joint_torque: Array) -> None:
        """Feed nothing forward: servos hold their angles."""
