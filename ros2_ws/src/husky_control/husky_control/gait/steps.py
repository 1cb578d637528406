"""The feet in the air: where they left, where they come down, and what ground is expected there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from husky_control.gait.foothold import Approach, FootholdLaw, foothold_of, nominal_footholds
from husky_control.gait.ground import Ground
from husky_control.gait.swing import SwingPaths, SwingShape, swing_feet
from husky_control.gait.table import GaitClock
from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.kinematics import LEGS, LegGeometry

if TYPE_CHECKING:
    from husky_control.parameters import Parameters


MOST_RISE = 0.10  # m, of a foot's own ground over the feet's plane; scaled to the robot's legs
GROUND_RATE = 0.35  # m/s, at which the expected height of the ground changes within a step; scaled
LEANING_ACCELERATION = 60.0  # m/s^2, of a leaning body's foot towards a foothold that moves


class Steps:
    """The swings of a walk, from liftoff to touchdown.

    Attributes:
        paths: of the feet, in the frame of the ground.
    """

    def __init__(
        self, geometry: LegGeometry, parameters: Parameters, clock: GaitClock, length: float
    ) -> None:
        """All feet at the origin; the legs are `length` times as long as Husky Carbon's."""
        self._most_rise = MOST_RISE * length
        self._ground_rate = GROUND_RATE * math.sqrt(length)
        self.paths = SwingPaths(*np.zeros((4, LEGS, 3)))
        self._geometry = geometry
        self._parameters = parameters
        self._clock = clock
        self._swing_feet = Compiled(swing_feet)
        self._nominal = np.zeros((LEGS, 2))
        self._rise = np.zeros(LEGS)  # m, of the expected ground over where the foot stood

    def begin(self) -> None:
        """Take over the gait of the clock."""
        gait = self._clock.gait
        self._nominal = nominal_footholds(self._geometry, gait.forward_spread, gait.lateral_spread)

    def lift(self, leg: int, place: Array) -> None:
        """Let a leg swing from where its foot was placed, (3,) m."""
        self.paths.start[leg] = self.paths.position[leg] = place
        self.paths.velocity[leg] = 0.0

    def turn(self, turn: Array, height: float) -> None:
        """Express what is remembered in a frame of the ground that has turned.

        Args:
            turn: (3, 3), the old frame to the new one, about their common origin.
            height: of the feet's plane in the old one [m].
        """
        start, foothold, position, velocity = self.paths
        for points in (start, position, velocity):
            points[:] = points @ turn.T
        on_plane = np.column_stack((foothold[:, :2], np.full(LEGS, height)))
        foothold[:, :2] = (on_plane @ turn.T)[:, :2]

    def tick(self, ground: Ground, height: float, approach: Approach | None, dt: float) -> None:
        """Move the swing feet.

        Args:
            ground: that is walked on.
            height: of the feet's plane [m].
            approach: of the body, where footholds are to be placed anew.
            dt: [s].
        """
        p, clock = self._parameters, self._clock
        for leg in range(LEGS):
            if clock.swinging[leg]:
                if approach is not None:
                    self._place(leg, approach, ground.pitch)
                self._expect_ground(leg, ground, height, self._ground_rate * dt)
        shape = SwingShape(
            clock.swing_time,
            clock.gait.swing_height,
            p["walk.search_speed"],
            p["walk.search_depth"],
        )
        self._swing_feet.call(clock.swinging, clock.swing_progress, self.paths, shape, dt)

    def _place(self, leg: int, approach: Approach, pitch: float) -> None:
        """Place a foothold; under a leaning body it moves as far as the time left allows.

        Its feet bear so little that a leg that jerks feels a touchdown.
        """
        p, clock, foothold = self._parameters, self._clock, self.paths.foothold[leg, :2]
        law = FootholdLaw(clock.stance_time, p["foothold.velocity_gain"], p["foothold.reach"])
        remaining = (1.0 - float(clock.swing_progress[leg])) * clock.swing_time
        x, y = self._nominal[leg].tolist()
        way = foothold_of((x * math.cos(pitch), y), remaining, approach, law) - foothold
        if pitch and not clock.liftoff[leg]:
            most = LEANING_ACCELERATION * remaining**2 / 6.0
            way *= min(1.0, most / max(math.hypot(way[0], way[1]), 1e-9))
        foothold += way

    def _expect_ground(self, leg: int, ground: Ground, height: float, most: float) -> None:
        """Set the height of a foothold: of the feet's plane, or as the foot's own ground goes on.

        Within a step it changes smoothly, by `most` [m] a tick, though other feet land and
        footholds are placed anew: a leg that jerks feels a touchdown that is none.
        """
        start, foothold = self.paths.start[leg], self.paths.foothold[leg]
        rise = height - float(start[2])
        if ground.bend is not None:
            # Ground that bends upward comes a little early: better than late, as it would come
            # where it bends downward.
            way = foothold[:2] - start[:2]
            fall = min(0.0, 0.5 * float(way @ ground.curve @ way))
            bent = float(ground.bend[leg] @ way) + fall - rise
            rise += min(self._most_rise, max(-self._most_rise, bent))
        if not self._clock.liftoff[leg]:
            before = float(self._rise[leg])
            rise = before + min(most, max(-most, rise - before))
        self._rise[leg] = rise
        foothold[2] = float(start[2]) + rise
