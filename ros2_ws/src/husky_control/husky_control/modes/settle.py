"""Mode `settle`: a robot on its legs lies down on its perch before its joints let go.

Without torque a robot drops by the length of its legs, damped it sinks over the feet that stand at
that moment, and both end on its side. `husky_description.settling` is the motion; the stop that was
asked for, or is due, follows on the perch. It needs no measurement.
"""

from __future__ import annotations

from husky_control.modes.behaviour import STOPS, Behaviour, Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand
from husky_description.settling import Settling


class Settle(Behaviour):
    """Lowers the body at once; then lets go."""

    velocity_counts = False
    answers = STOPS

    def __init__(self, name: str, context: ModeContext) -> None:
        """Nothing is wanted yet."""
        super().__init__(name, context)
        self._stop = ""  # what is asked for once it is down
        self._motion = Settling(context.robot)

    def enter(self, event: Event) -> None:
        """Go down from where the joints are; legs that do not stand stay where they are."""
        c = self.context
        c.assist.withhold()
        self._stop = ""
        if event is Event.REQUEST:
            self._follow_with(c.request)
        velocity = c.body.rotation.T @ c.body.estimator.velocity
        self._motion.begin(c.command.position, velocity)
        if c.parameters["safety.stop_category"] < 1.0:
            self._motion.done = True

    def _follow_with(self, stop: str) -> None:
        self._stop = stop
        if stop == "emergency_stop":
            self.context.hover.end(at_once=True)

    def leave(self, event: Event) -> str:
        """Tell what is to follow."""
        return self._stop if event is Event.DONE else ""

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Remember the stop that is asked for last."""
        if request not in self.answers:
            return None
        self._follow_with(request)
        return True, f"settling; {request} when the body is down"

    def estimate(self) -> None:
        """Stay: nobody needs to know, and the feet may tell nothing."""
        self.context.body.stay()

    def tick(self, command: JointCommand) -> Happening | None:
        """Go on down."""
        command.mode_of_operation = CYCLIC_POSITION
        command.effort.fill(0.0)
        if self._motion.done:
            command.velocity.fill(0.0)
            return (Event.DONE, self.context.reason)
        self._motion.advance(TICK)
        command.position[:] = self._motion.joint_position
        command.velocity[:] = self._motion.joint_velocity
        return None
