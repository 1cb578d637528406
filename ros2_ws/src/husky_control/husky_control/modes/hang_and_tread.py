"""Modes `hang` and `tread`: a robot in ropes, whose feet move in the base's frame."""

from __future__ import annotations

from husky_control.gait.table import GaitClock
from husky_control.modes.behaviour import Behaviour, Event, Happening
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand


class Hang(Behaviour):
    """Holds the standing posture without the ground."""

    place_counts = velocity_counts = False

    def enter(self, event: Event) -> None:
        """Go to the posture from where the joints are, unless the robot hangs already."""
        if event is Event.DONE:
            return
        c, posture = self.context, self.context.stand_posture()
        c.safety.reset()
        start = c.command.position
        c.suspended.begin(start, posture, c.gathering_time(start, posture))

    def estimate(self) -> None:
        """Stay where the body was: nothing is known of the ground."""
        self.context.body.estimate_at_rest()

    def tick(self, command: JointCommand) -> Happening | None:
        """Lead the legs."""
        legs = self.context.suspended
        legs.tick(TICK)
        command.mode_of_operation = CYCLIC_POSITION
        command.position[:] = legs.joint_position
        command.velocity[:] = legs.joint_velocity
        command.effort.fill(0.0)
        return None

    @property
    def posture_reached(self) -> bool:
        """Whether the legs hold the posture."""
        return self.context.suspended.ready


class Tread(Hang):
    """Steps in place under its hips (T40)."""

    answers = frozenset({"hang"})

    def enter(self, event: Event) -> None:
        """Let the feet lift off."""
        self.context.suspended.tread(self.context.parameters.gait(self.context.gait))

    def tick(self, command: JointCommand) -> Happening | None:
        """Step."""
        super().tick(command)
        return (Event.DONE, "feet down") if self.feet_still else None

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Stop, when asked for the mode before."""
        if request not in self.answers:
            return None
        self.context.suspended.stop()
        return True, "stopping"

    @property
    def clock(self) -> GaitClock:
        """Clock of the legs."""
        return self.context.suspended.clock

    @property
    def feet_still(self) -> bool:
        """Whether all feet are down, to stay."""
        return self.context.suspended.at_rest
