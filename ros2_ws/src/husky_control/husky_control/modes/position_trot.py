"""Mode `position_trot`: the thesis's two-beat trot, by foot positions alone (T18).

Feet go along a pattern of positions in the base's frame, inverse kinematics makes joint angles of
them, and nothing that is felt changes them: neither contact nor attitude.
"""

from __future__ import annotations

import numpy as np

from husky_control.modes.behaviour import Event, Happening, Velocity
from husky_control.modes.context import ModeContext
from husky_control.modes.hang_and_tread import Tread
from husky_control.tick_data import TICK, JointCommand
from husky_description.arrays import Array


class PositionTrot(Tread):
    """Steps at a commanded velocity, as far as the feet do not slip."""

    answers = frozenset({"stand"})
    place_counts = velocity_counts = True

    def __init__(self, name: str, context: ModeContext) -> None:
        """At rest."""
        super().__init__(name, context)
        self._wish = np.zeros(3)  # as `Suspended.velocity`

    def enter(self, event: Event) -> None:
        """Take the feet over from where they stand."""
        c = self.context
        c.watch.begin()
        self._wish.fill(0.0)
        c.suspended.take_over(c.command.position, c.stand_posture())
        c.suspended.tread(c.parameters.gait(self.gait))

    def leave(self, event: Event) -> str:
        """Stand where the feet have come down."""
        if event is Event.DONE:
            self.context.stand_on(self.context.suspended.joint_position)
        return ""

    def estimate(self) -> None:
        """Estimate by the feet that stand: for the report, the law does not need it."""
        c = self.context
        c.body.estimate_from_feet(self.clock, c.climbing.normal, all_stand=False)

    def tick(self, command: JointCommand) -> Happening | None:
        """Step; stop when the velocity command has become silent."""
        c, legs = self.context, self.context.suspended
        if c.watch.silent and legs.treading:
            c.counters.command_timeouts += 1
            legs.stop()
            c.reason = "velocity command silent"
        along, turning = "command.acceleration", "command.yaw_acceleration"
        most = TICK * np.array([c.parameters[name] for name in (along, along, turning)])
        wish = self._wish if legs.treading else 0.0
        legs.velocity += np.clip(wish - legs.velocity, -most, most)
        return super().tick(command)

    def drive(self, velocity: Velocity, *, wakes: bool) -> str:
        """Follow the command; one that wakes takes back the stop that was under way."""
        legs = self.context.suspended
        legs.treading = legs.treading or wakes
        if not legs.treading:
            return "it is coming to a stop" if any(velocity) else ""
        self._wish[:] = velocity
        return ""

    @property
    def ramped_velocity(self) -> Array:
        """What the feet that stand follow, (3,) as `Velocity`."""
        return self.context.suspended.velocity

    @property
    def gait(self) -> str:
        """Name of the gait whose speeds count: two beats, whatever is chosen for the walk."""
        return "trot"
