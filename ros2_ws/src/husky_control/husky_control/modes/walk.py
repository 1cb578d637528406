"""Mode `walk`: steps in a gait; also while it comes to a stop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from husky_control.modes.behaviour import Event, Happening, Velocity
from husky_control.modes.context import ModeContext
from husky_control.modes.stand import Stand
from husky_control.tick_data import TICK, JointCommand
from husky_description.arrays import Array

Mask = NDArray[np.bool_]

REST_TIME = 0.5
"""Time at zero command after which the feet stay down, where zero ends the steps [s]."""


class Walk(Stand):
    """Follows a velocity command; a change of gait goes through a stand."""

    wakes_to = ""
    answers = frozenset({"stand"})

    def __init__(self, name: str, context: ModeContext) -> None:
        """No other gait is waiting."""
        super().__init__(name, context)
        self._next_gait = ""
        self._rest = 0.0

    def enter(self, event: Event) -> None:
        """Let the feet lift off."""
        c = self.context
        c.watch.begin()
        self._rest = 0.0
        c.walking.start_stepping(c.parameters.gait(c.gait), c.body.estimator.position)

    def leave(self, event: Event) -> str:
        """Walk on in the gait that waits, if the feet have come down for it."""
        gait, self._next_gait = self._next_gait, ""
        if not gait or event is not Event.DONE:
            return ""
        self.context.gait = gait
        return self.name

    def tick(self, command: JointCommand) -> Happening | None:
        """Step; at zero only if somebody has asked for this mode."""
        if self.context.watch.leads and self.count_rest() and self.context.walking.stepping:
            self.context.walking.stop_stepping()
            self.context.reason = "velocity command zero"
        super().tick(command)
        return (Event.DONE, "feet down") if self.stopped else None

    def count_rest(self) -> bool:
        """Count a tick; return whether the command has been zero for `REST_TIME`, speed ramped."""
        reference = self.context.walking.reference
        self._rest = 0.0 if reference.command.any() else self._rest + TICK
        return self._rest > REST_TIME and reference.at_rest

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Stop, when asked to stand."""
        if request not in self.answers:
            return None
        self.context.walking.stop_stepping()
        self._next_gait = ""
        return True, "stopping"

    def change_gait(self, name: str) -> tuple[bool, str]:
        """Stop first for another gait."""
        if name == self.context.gait:
            return super().change_gait(name)
        self._next_gait = name
        self.context.walking.stop_stepping()
        return True, f"changing to {name} through stand"

    def drive(self, velocity: Velocity, *, wakes: bool) -> str:
        """Follow the command; one that wakes takes back the stop that was under way."""
        walking = self.context.walking
        if wakes and not self._next_gait:
            walking.stepping = True
        if walking.stepping:
            walking.reference.command[:] = velocity
            return ""
        return "it is coming to a stop" if any(velocity) else ""

    @property
    def ramped_velocity(self) -> Array:
        """What the steps follow, (3,) as `Velocity`."""
        return self.context.walking.reference.ramped

    @property
    def stopped(self) -> bool:
        """Whether all feet are down, to stay."""
        return self.context.walking.stopped

    @property
    def aims(self) -> Mask:
        """Legs that swing to a foothold, (4,) bool."""
        return self.clock.swinging
