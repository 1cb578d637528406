"""Mode `settle`: a robot that is to let go lowers its body onto the perch first.

Legs on servos let go one way alone: they hold or they drop. Damped, the body sinks for seconds over
what feet just stand, and falls aside over two; without torque it drops by the length of its legs.
So all feet go under their hips and the body down as fast as the joints can, and what was asked for,
or is due, follows on the perch. It needs no measurement.
"""

from __future__ import annotations

import math

import numpy as np

from husky_control.kinematics import JOINTS
from husky_control.modes.behaviour import STOPS, Behaviour, Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand
from husky_description.arrays import Array
from husky_description.gravity import GRAVITY

SLOWER = 1.4
"""Least time of the way down, over that of a free fall."""
LIFTED = 0.08
"""How far the feet are lifted off the ground in the end, so that the perch alone carries [m]."""


class Settle(Behaviour):
    """Lowers the body at once; then lets go."""

    velocity_counts = False
    answers = STOPS

    def __init__(self, name: str, context: ModeContext) -> None:
        """Nothing is wanted yet."""
        super().__init__(name, context)
        self._stop = ""  # what is asked for once it is down
        self._ways: list[tuple[Array, float]] = []  # to come: goal (12,) rad, least time [s]
        self._step = np.zeros(JOINTS)  # of a tick, on the way to a goal [rad]
        self._ticks = 0  # left of that way

    def enter(self, event: Event) -> None:
        """Go down from where the joints are; legs that do not stand stay where they are."""
        c = self.context
        c.assist.withhold()
        self._stop = c.request if event is Event.REQUEST else ""
        self._ways, self._ticks = [], 0
        height = c.postures.perch_height(c.command.position)
        if height > 0.0:
            stand = c.stand_posture()
            down = self._way_down(c.postures.low(stand))
            least = SLOWER * math.sqrt(2.0 * height / GRAVITY) / len(down)
            self._ways = [(goal, least) for goal in down]
            self._ways.append((c.postures.low(stand, LIFTED), 0.0))

    def _way_down(self, low: Array) -> Array:
        """Return postures (n, 12) rad on the way to the low one; evenly, where legs can."""
        c = self.context
        try:
            return c.postures.straight(c.command.position, low)[1:]
        except ValueError:
            return low[None]

    def leave(self, event: Event) -> str:
        """Tell what is to follow."""
        return self._stop if event is Event.DONE else ""

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Remember the stop that is asked for last."""
        if request not in self.answers:
            return None
        self._stop = request
        return True, f"settling; {request} when the body is down"

    def estimate(self) -> None:
        """Stay: nobody needs to know, and the feet may tell nothing."""
        self.context.body.stay()

    def tick(self, command: JointCommand) -> Happening | None:
        """Go on down."""
        command.mode_of_operation = CYCLIC_POSITION
        command.effort.fill(0.0)
        if self._ticks == 0:
            if not self._ways:
                command.velocity.fill(0.0)
                return (Event.DONE, self.context.reason)
            goal, least = self._ways.pop(0)
            way = goal - command.position
            needed = float(np.abs(way).max()) / self.context.robot.joint_speed
            self._ticks = math.ceil(max(least, needed) / TICK)
            self._step[:] = way / self._ticks
        self._ticks -= 1
        command.position += self._step
        command.velocity[:] = self._step / TICK
        return None
