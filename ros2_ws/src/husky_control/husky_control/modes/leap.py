"""Mode `leap`: from standing into flight without the perch, all four legs becoming arms in the air.

The body crouches and the propellers spin up while they still push outward, left against right, on
feet that friction holds. Then the legs extend, and as the feet leave the ground they splay: thrust
opens the arms with the servos and lifts as they rise. With the arms level the robot flies on.
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from husky_control.flight.hover import HoverPhase
from husky_control.modes.behaviour import Behaviour, Event, Happening, Mask
from husky_control.modes.context import ModeContext
from husky_control.posture import PostureMove
from husky_control.rotation import tilt_of, yaw_of
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand
from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.kinematics import LEGS, Kinematics

LOW, HIGH = 0.59, 0.94
"""Base above the feet before and after the push, over the length of a leg [-]."""
CROUCH_TIME, PUSH_TIME = 0.8, 0.14
"""[s]."""
SPIN_TIME, FULL_TIME = 1.2, 0.3
"""Of the thrust's rise, and of full thrust before the push [s]."""
OPEN = 0.15
"""Distance of every hip from level arms at which the splay has ended [rad]."""
LATEST = 0.5
"""Longest time of the splay [s]."""
LEVEL = math.radians(3.0)
"""Greatest tilt at which the push is begun [rad]."""


class LeapPhase(Enum):
    """What a leap is doing."""

    CROUCH = "crouching"
    SPIN = "spinning up"
    PUSH = "pushing off"
    SPLAY = "splaying in the air"
    RETURN = "rising again"


class Leap(Behaviour):
    """One leap.

    Attributes:
        phase: see `LeapPhase`.
    """

    answers = frozenset({"stand"})

    def __init__(self, name: str, context: ModeContext) -> None:
        """Standing."""
        super().__init__(name, context)
        assert context.morph is not None
        self._kinematics = Kinematics(context.robot)
        self._most = len(context.robot.legs) * FanModel.of(context.robot).max_thrust
        self._flight = context.morph.flight
        self._length = context.robot.leg_length
        self._move = PostureMove()
        self.phase = LeapPhase.CROUCH
        self._force = self._spent = 0.0
        self._start = self._low = self._high = np.zeros(12)

    def enter(self, event: Event) -> None:
        """Crouch over the feet as they stand."""
        start = self.context.command.position.copy()
        feet = self._kinematics.foot_positions(start)
        self._start = start
        self._begin(LeapPhase.CROUCH)
        self._force = 0.0
        try:
            feet[:, 2] = -LOW * self._length
            self._low = self._kinematics.joint_positions(feet)
            feet[:, 2] = -HIGH * self._length
            self._high = self._kinematics.joint_positions(feet)
            way = self.context.postures.straight(start, self._low)
        except ValueError as error:
            self._give_up(f"no leap: {error}")
            return
        self._move.start([way], [CROUCH_TIME])

    def _begin(self, phase: LeapPhase) -> None:
        self.phase, self._spent = phase, 0.0

    def leave(self, event: Event) -> str:
        """Leave the propellers to the flight, or off."""
        c = self.context
        c.assist.reset()
        if event is Event.LOST:
            c.stand_on(self._move.joint_position)
        elif event is not Event.DONE:
            c.hover.end(at_once=True)
        return ""

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Rise again, when asked to stand before the push."""
        if request not in self.answers:
            return None
        if self.phase in (LeapPhase.PUSH, LeapPhase.SPLAY):
            return False, "stand refused: it leaps"
        self._give_up("stand requested")
        return True, "going back to stand"

    def _give_up(self, reason: str) -> None:
        if self.phase is LeapPhase.RETURN:
            return
        self._begin(LeapPhase.RETURN)
        self._force = 0.0
        self.context.reason = reason
        now = self.context.command.position.copy()
        self._move.start([np.stack((now, self._start))], [CROUCH_TIME])

    def estimate(self) -> None:
        """Estimate by the feet until they leave the ground; then hold on to that."""
        if self.phase is LeapPhase.SPLAY:
            self.context.body.stay()
        else:
            super().estimate()

    @property
    def stance(self) -> Mask:
        """Legs that stand, (4,) bool: all, or none once they have left the ground."""
        return np.full(LEGS, self.phase is not LeapPhase.SPLAY)

    def prepare(self) -> Happening | None:
        """Give up without propellers or camera, as long as it stands."""
        super().prepare()
        grounded = self.phase in (LeapPhase.CROUCH, LeapPhase.SPIN)
        if grounded and not (self.fans_available and self.pose_fresh):
            self._give_up("the propellers or the T265 are lost: no leap")
        return None

    def tick(self, command: JointCommand) -> Happening | None:
        """Go on."""
        c, move = self.context, self._move
        self._spent += TICK
        happening = self._advance()
        move.tick(TICK)
        command.mode_of_operation = CYCLIC_POSITION
        command.position[:] = move.joint_position
        command.velocity[:] = move.joint_velocity
        if self.phase is LeapPhase.SPLAY:
            command.position[:] = self._flight
            command.velocity.fill(0.0)
            command.effort.fill(0.0)
            self._fly()
        else:
            c.body.carry(c.walking.mass * GRAVITY, command.effort)
            c.assist.ask(self._force, np.zeros(3))
        return happening

    def _advance(self) -> Happening | None:
        """Pass from phase to phase; return how the leap ended."""
        c, move = self.context, self._move
        if self.phase is LeapPhase.CROUCH and move.done:
            self._begin(LeapPhase.SPIN)
        elif self.phase is LeapPhase.SPIN:
            self._force = min(self._most, self._force + self._most * TICK / SPIN_TIME)
            if self._spent > SPIN_TIME + FULL_TIME:
                self._push()
        elif self.phase is LeapPhase.PUSH and move.done:
            self._begin(LeapPhase.SPLAY)
            c.hover.phase = HoverPhase.HOLD
        elif self.phase is LeapPhase.SPLAY:
            hips = c.body.measurements.joint_position[0::3]
            open_ = np.abs(hips - self._flight[0::3]).max() < OPEN
            if open_ or self._spent > LATEST:
                return (Event.DONE, f"in the air, arms out after {self._spent:.2f} s")
        elif self.phase is LeapPhase.RETURN and move.done:
            return (Event.LOST, c.reason)
        return None

    def _push(self) -> None:
        """Extend the legs, if the body is level; from here on there is no way back."""
        c, m = self.context, self.context.body.measurements
        if tilt_of(c.body.rotation) > LEVEL:
            self._give_up("the body is tilted: no leap")
            return
        self._begin(LeapPhase.PUSH)
        yaw = yaw_of(c.body.rotation)
        fans_yaw = m.fans_yaw if math.isfinite(m.fans_yaw) else yaw
        c.hover.begin(m.pose, yaw, fans_yaw, self._force)
        c.hover.phase = HoverPhase.OFF  # a wrench is asked for until the feet leave the ground
        self._move.start([c.postures.straight(self._low, self._high)], [PUSH_TIME])

    def _fly(self) -> None:
        """Hold the attitude at full thrust while the arms open."""
        c, m = self.context, self.context.body.measurements
        yaw = yaw_of(c.body.rotation)
        c.hover.tick(m.time, m.pose, c.body.rotation, m.specific_force_base, 0, yaw, TICK)
        c.hover.force = self._most

    @property
    def settled(self) -> bool:
        """Never: a leap ends in another mode."""
        return False
