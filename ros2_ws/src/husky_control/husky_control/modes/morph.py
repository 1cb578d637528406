"""Modes `perch` and `splay`: on the perch the legs fold into the arms of a quadrotor, and back.

The thesis's static morph (T19): the body sinks until the perch touches, the feet lift, the legs
splay about the hip frontal axes until femur and tibia are level, and a sweep about the hip sagittal
axes brings the centre of lift to the centre of mass. T20 is the same backward. Each step is begun
only when what it stands on was measured.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from husky_control.modes.behaviour import Event, Happening, Mask
from husky_control.modes.context import ModeContext
from husky_control.modes.stand_up_and_sit import PostureChange
from husky_control.posture import PEAK
from husky_control.rotation import tilt_of
from husky_control.tick_data import TICK, JointCommand
from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_description.kinematics import LEGS

CROUCH_TIME = 2.9
"""From standing to where the feet would be `SUNK` above the ground under the perch [s]."""
SUNK = 0.02
"""How much further than the perch lets it the body is lowered, so that the feet lift [m]."""
SPEED_SHARE = 0.8125
"""Of what the joints can do at most, for the one that has the longest way."""
TOUCHED = 0.6
"""Share of the weight on the feet below which the perch carries the rest."""
PATIENCE = 0.05
"""Time for which the feet must tell the perch's touch [s]."""
LEVEL = math.radians(5.0)
"""Greatest tilt of a body that rests on its perch."""
CENTRED = 0.006
"""Greatest distance of the centre of lift from the centre of mass, level, in flight [m]."""


class OnPerch(PostureChange):
    """A change of the legs' posture while the perch carries the body."""

    velocity_counts = False

    def __init__(self, name: str, context: ModeContext) -> None:
        """No motion yet."""
        super().__init__(name, context)
        assert context.morph is not None
        self._postures = context.morph
        self._speed = SPEED_SHARE * context.robot.joint_speed / PEAK  # mean on a way

    def _follow(self, *postures: Array) -> None:
        """Go from what was commanded through postures (12,) [rad], at rest in each."""
        way = [self.context.command.position.copy(), *postures]
        pairs = [np.stack(pair) for pair in itertools.pairwise(way)]
        furthest = [float(np.abs(b - a).max()) for a, b in pairs]
        self._move.start(pairs, [max(0.2, part / self._speed) for part in furthest])

    def _lifted(self) -> float:
        return 0.0

    def _load(self) -> float:
        """Return the share of the weight that the feet seem to carry."""
        c = self.context
        return float(c.body.contacts.foot_force[:, 2].sum()) / (c.walking.mass * GRAVITY)

    @property
    def perched(self) -> bool:
        """Whether the body rests on the perch: feet off the ground, level and still."""
        c = self.context
        turning = math.hypot(*c.body.measurements.angular_velocity_base_in_base)
        return self.settled and tilt_of(c.body.rotation) < LEVEL and turning < 0.1


class Perch(OnPerch):
    """Crouches until the perch touches, lifts and folds the legs; or folds them back."""

    def __init__(self, name: str, context: ModeContext) -> None:
        """No motion yet."""
        super().__init__(name, context)
        self._crouches = False
        self._touching = 0.0  # s

    def enter(self, event: Event) -> None:
        """Crouch, if the robot stands; come back from the arms' posture, if it is splayed."""
        c, postures = self.context, self._postures
        start = c.command.position.copy()
        self._touching = 0.0
        self._crouches = not postures.splay(start)
        if not self._crouches:
            self._follow(postures.splayed, postures.folded)
            return
        low = c.postures.low(start, SUNK)
        fold = np.stack((low, postures.folded))
        furthest = float(np.abs(postures.folded - low).max())
        ways = [c.postures.straight(start, low), fold]
        self._move.start(ways, [CROUCH_TIME, furthest / self._speed])

    def estimate(self) -> None:
        """Estimate by the feet until the perch is felt; then stay."""
        if self._is_on_feet:
            super().estimate()
        else:
            self.context.body.stay()

    def tick(self, command: JointCommand) -> Happening | None:
        """Go on; give up when no ground is felt under the perch."""
        crouching = self._crouches and self._move.on_first_way
        super().tick(command)
        if crouching:
            self._touching = self._touching + TICK if self._load() < TOUCHED else 0.0
            if not self._move.on_first_way and self._touching < PATIENCE:
                return (Event.LOST, "no ground is felt under the perch")
        return None

    def _lifted(self) -> float:
        return 1.0 - self._move.progress if self._crouches and self._move.on_first_way else 0.0

    @property
    def touching(self) -> bool:
        """Whether the perch has been felt to touch the ground."""
        return self._touching >= PATIENCE

    @property
    def stance(self) -> Mask:
        """Legs that stand until the perch is felt, (4,) bool."""
        return np.full(LEGS, self._is_on_feet)

    @property
    def _is_on_feet(self) -> bool:
        return self._crouches and self._move.on_first_way and not self.touching


class Splay(OnPerch):
    """Splays the legs until they are arms, sweeps them until the lift is centred, and holds."""

    def enter(self, event: Event) -> None:
        """Go on from the folded posture; stay, when a flight has ended."""
        if event is Event.DONE:
            self._move.start([np.tile(self.context.command.position, (2, 1))], [0.2])
        else:
            self._follow(self._postures.splayed, self._postures.flight)

    def estimate(self) -> None:
        """Stay: the feet tell nothing."""
        self.context.body.stay()

    @property
    def stance(self) -> Mask:
        """No leg stands."""
        return np.zeros(LEGS, np.bool_)

    @property
    def lift_centred(self) -> bool:
        """Whether the measured legs hold the propellers as flight needs them."""
        measured = self.context.body.measurements.joint_position
        return self.settled and self._postures.off_centre(measured) < CENTRED
