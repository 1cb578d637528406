"""Mode `wair`: walks up and down inclines, held against them by the fans."""

from __future__ import annotations

import math

from husky_control.incline.climbing import LEVEL
from husky_control.modes.behaviour import Behaviour, Event, Happening, Velocity
from husky_control.modes.context import ModeContext
from husky_control.modes.walk import Walk
from husky_control.tick_data import TICK, JointCommand

LIGHTEST = 0.4
"""Share of the weight on the feet, down to which contact thresholds shrink with it."""


class Wair(Walk):
    """A walk on the plane that is climbed; at speed zero it stands there."""

    assisted = False

    def __init__(self, name: str, context: ModeContext) -> None:
        """Level."""
        super().__init__(name, context)
        self._leaving = False

    def enter(self, event: Event) -> None:
        """Start on level ground, all feet down."""
        c = self.context
        c.watch.begin()
        self._leaving = False
        c.climbing.begin(c.body.estimator.foot_in_world)

    def leave(self, event: Event) -> str:
        """Come back to the flat; a robot that crouches on an incline keeps its frame."""
        if event is not Event.LOST:
            self.context.come_to_level()
        return ""

    def prepare(self) -> Happening | None:
        """Measure the plane, ask for thrust, turn the walk's frame."""
        c, climbing, walking = self.context, self.context.climbing, self.context.walking
        body, m, estimator = c.body, c.body.measurements, c.body.estimator
        climbing.tick(
            estimator.foot_in_world,
            body.contacts.contact & ~walking.clock.swinging,
            walking.clock.touchdown,
            body.rotation[:, 1],
            walking.reference.velocity - (climbing.plane @ estimator.velocity)[:2],
            m.fans_limit if m.fans_available else 0.0,
            TICK,
        )
        walking.stand_on(climbing.ground(walking.height))
        rested = self.count_rest()
        if walking.stepping and (rested or c.watch.silent):
            walking.stop_stepping()
        body.turn_ground(climbing.plane)
        body.set_lightness(min(1.0, max(LIGHTEST, climbing.lightness)))
        if climbing.lost:
            return Event.LOST, "the fans are lost on an incline: crouching"
        return None

    def tick(self, command: JointCommand) -> Happening | None:
        """Step, or stand."""
        super().tick(command)
        return (Event.DONE, "level, feet down") if self._leaving and self.level else None

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Stop, to stand as on the flat; refused on an incline."""
        if request not in self.answers:
            return None
        slope = self.context.climbing.slope
        if slope > LEVEL:
            degrees = math.degrees(slope)
            return False, f"stand refused: the robot is on an incline of {degrees:.0f} deg"
        self._leaving = True
        self.context.walking.stop_stepping()
        return True, "stopping"

    def change_gait(self, name: str) -> tuple[bool, str]:
        """Take over a gait for the next walk on the flat."""
        return Behaviour.change_gait(self, name)

    def refuse_velocity(self, velocity: Velocity) -> str:
        """Refuse also to go up with a fan lost where the ground is not level."""
        climbing = self.context.climbing
        refusal = super().refuse_velocity(velocity)
        only_down = 0.0 < climbing.limit < math.inf and climbing.slope > LEVEL
        if not refusal and only_down and velocity[0] > 0.0:
            return f"vx must not be above 0 with a fan lost on an incline, not {velocity[0]}"
        return refusal

    def drive(self, velocity: Velocity, *, wakes: bool) -> str:
        """Follow the command, in steps again if the robot is to stay in the mode."""
        c, walking = self.context, self.context.walking
        if any(velocity) and not self._leaving and walking.stopped:
            self._rest = 0.0
            walking.start_stepping(
                c.parameters.gait(self.gait), c.climbing.plane @ c.body.estimator.position
            )
        if walking.stepping:
            walking.reference.command[:] = velocity
            return ""
        return Behaviour.drive(self, velocity, wakes=wakes)

    @property
    def lift(self) -> float:
        """Thrust away from the plane that is walked on [N]."""
        return self.context.climbing.lift

    @property
    def gait(self) -> str:
        """Name of the gait whose speeds count."""
        return "climb"

    @property
    def level(self) -> bool:
        """Whether the feet are down, on ground where the robot may stand as on the flat."""
        return self.stopped and self.context.climbing.slope < LEVEL
