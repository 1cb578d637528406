"""Modes `stand_up` and `sit`: from posture to posture, while the legs take over the weight."""

from __future__ import annotations

import numpy as np

from husky_control.modes.behaviour import Behaviour, Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.posture import PostureMove
from husky_control.rotation import tilt_of
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand
from husky_description.gravity import GRAVITY


class PostureChange(Behaviour):
    """Leads the joints along a motion; the body may lie on the ground on its way."""

    def __init__(self, name: str, context: ModeContext) -> None:
        """No motion yet."""
        super().__init__(name, context)
        self._move = PostureMove()

    def estimate(self) -> None:
        """Estimate by all feet: unloaded ones still stand."""
        c = self.context
        c.body.estimate_from_feet(c.walking.clock, c.climbing.normal, all_stand=True)

    def tick(self, command: JointCommand) -> Happening | None:
        """Go on along the motion."""
        c, move = self.context, self._move
        move.tick(TICK)
        c.body.carry(c.walking.mass * GRAVITY * min(1.0, 4.0 * self._lifted()), command.effort)
        command.mode_of_operation = CYCLIC_POSITION
        command.position[:] = move.joint_position
        command.velocity[:] = move.joint_velocity
        return None

    def _lifted(self) -> float:
        """Return how much of its way up the body has made, 0 to 1."""
        raise NotImplementedError

    @property
    def settled(self) -> bool:
        """Whether the motion has ended."""
        return self._move.done


class StandUp(PostureChange):
    """Brings the feet to their places while the body lies, and lifts it straight up."""

    def enter(self, event: Event) -> None:
        """Start from where the joints are."""
        c = self.context
        c.safety.reset()
        c.walking.clock.swinging.fill(False)
        c.walking.clock.swing_progress.fill(-1.0)
        *before, up = c.postures.ways_up(c.command.position, c.stand_posture())
        durations = [c.gathering_time(way[0], way[-1]) for way in before]
        self._move.start([*before, up], [*durations, c.parameters["stand.duration"]])

    def estimate(self) -> None:
        """Estimate as ever; a body that lies on a perch of its own stays until it is raised."""
        if self.context.morph is not None and not self._move.on_last_way:
            self.context.body.stay()
        else:
            super().estimate()

    def leave(self, event: Event) -> str:
        """Stand, if the body is up."""
        if event is Event.DONE:
            self.context.stand_on(self._move.joint_position)
        return ""

    def tick(self, command: JointCommand) -> Happening | None:
        """Go on up."""
        super().tick(command)
        return (Event.DONE, "body raised") if self._move.done else None

    def _lifted(self) -> float:
        return self._move.progress if self._move.on_last_way else 0.0


class Sit(PostureChange):
    """Lowers the body onto the perch between the feet, gathers the legs, and stays so."""

    def enter(self, event: Event) -> None:
        """Start from what was commanded; on an incline without fans crouch, wide and soon."""
        c, p, start = self.context, self.context.parameters, self.context.command.position
        if event is Event.LOST:
            crouching = np.stack((start, c.postures.crouch()))
            self._move.start([crouching], [p["wair.crouch_time"]])
            return
        down, *after = c.postures.ways_down(start)
        durations = [c.gathering_time(way[0], way[-1]) for way in after]
        self._move.start([down, *after], [p["stand.duration"], *durations])

    def leave(self, event: Event) -> str:
        """Come back to the flat: until then a robot that has crouched keeps its frame."""
        if self.context.climbing.active:
            self.context.come_to_level()
        return ""

    def _lifted(self) -> float:
        return 1.0 - self._move.progress if self._move.on_first_way else 0.0

    def lean(self) -> float:
        """Angle of the body from where it is to point; one that crouches may slide to the flat."""
        return min(super().lean(), tilt_of(self.context.body.rotation))
