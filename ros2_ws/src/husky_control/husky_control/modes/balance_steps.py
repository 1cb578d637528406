"""Steps of a morph on some legs: from standing on four feet to one or two legs as arms."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from husky_control.flight.knee_thrust import edge_of
from husky_control.modes.morph_postures import MorphPostures
from husky_control.posture import PEAK
from husky_description.arrays import Array
from husky_description.kinematics import LEGS, Kinematics

if TYPE_CHECKING:
    from husky_description.robot import Robot

SHIFT_TIME, FOLD_TIME, SPLAY_TIME, SPIN_TIME = 1.6, 0.5, 0.9, 0.5
"""Least ones: of moving the body, of a leg's way from ground to folded, from there to an arm; of
spinning a propeller up [s]."""
BESIDE = 0.065
"""Centre of mass inside of the edge while no propeller works, over the length of a leg [-]."""
BETWEEN = -0.059
"""The same, on the first leg's side, while the second one is lifted: its propeller can give less
and more [-]."""
SPEED_SHARE = 0.5
"""Of what the joints can do at most, for the fastest on a way."""
_ARM, _FOLDED, _DOWN = "arm", "folded", "down"
_PLACES = 6
"""Times that the body's place is corrected for the centre of mass."""


class BalanceStep(NamedTuple):
    """A posture at rest, and what holds it.

    Attributes:
        what: in words.
        posture: joints (12,) [rad].
        time: of the way there from the step before [s].
        lifted: legs in the air.
        working: legs whose propellers work.
        pressure: centre of pressure inside of the edge that one propeller is to hold [m].
        clears: leg whose foot is to have left the ground there, -1 for none.
    """

    what: str
    posture: Array
    time: float
    lifted: tuple[int, ...] = ()
    working: tuple[int, ...] = ()
    pressure: float = 0.0
    clears: int = -1


def legs_of(choice: float) -> tuple[int, ...]:
    """Return the legs that `balance.legs` names: 0 to 3 one, 4 and 5 a diagonal."""
    number = round(choice)
    return (number,) if number < LEGS else ((0, 3), (1, 2))[number - LEGS]


class BalanceSteps:
    """Reckons the steps of one robot."""

    def __init__(self, robot: Robot, postures: MorphPostures) -> None:
        """Of a robot whose legs carry propellers."""
        self._kinematics = Kinematics(robot)
        self._beside, self._between = BESIDE * robot.leg_length, BETWEEN * robot.leg_length
        self._speed = SPEED_SHARE * robot.joint_speed / PEAK
        self._shape = {_ARM: postures.flight, _FOLDED: postures.folded}

    def plan(
        self, start: Array, legs: tuple[int, ...], margin: float, beyond: float
    ) -> list[BalanceStep]:
        """Return the steps, the first of them the start.

        Args:
            start: joints (12,) [rad] of a robot that stands.
            legs: that become arms, one or two across from each other.
            margin: of the centre of pressure inside of the edge [m].
            beyond: centre of mass outside of the edge, held by the propeller [m].

        Raises:
            ValueError: a foot is out of reach.
        """
        a, *others = legs
        feet = self._kinematics.foot_positions(start)

        def posture(inside: float, first: str, second: str = _DOWN) -> Array:
            shapes = {leg: shape for leg, shape in zip(legs, (first, second), strict=False)}
            return self._at(feet, a, inside, shapes)

        beside, between = self._beside, self._between
        one = ((a,), (a,))
        steps = [
            BalanceStep("standing", start.copy(), SHIFT_TIME),
            BalanceStep("shifting", posture(beside, _DOWN), SHIFT_TIME),
            BalanceStep("lifting", posture(beside, _FOLDED), FOLD_TIME, (a,), clears=a),
            BalanceStep("splaying", posture(beside, _ARM), SPLAY_TIME, (a,)),
            BalanceStep("spinning up", posture(beside, _ARM), SPIN_TIME, *one, margin),
        ]
        if not others:
            steps.append(BalanceStep("leaning", posture(-beyond, _ARM), SHIFT_TIME, *one, margin))
            return self._in_time(steps)
        b = others[0]
        both = (a, b)
        steps += [
            BalanceStep("leaning", posture(between, _ARM), SHIFT_TIME, *one, 0.004),
            BalanceStep("lifting", posture(between, _ARM, _FOLDED), FOLD_TIME, both, (a,), 0.0, b),
            BalanceStep("splaying", posture(between, _ARM, _ARM), SPLAY_TIME, both, (a,)),
            BalanceStep("spinning up", posture(between, _ARM, _ARM), SPIN_TIME, both, both),
            BalanceStep("between", posture(0.0, _ARM, _ARM), SHIFT_TIME, both, both),
        ]
        return self._in_time(steps)

    def standing_earlier(
        self, steps: list[BalanceStep], leg: int, touched: Array, near: float
    ) -> list[BalanceStep]:
        """Return steps with a foot where it has touched the ground above where it was expected.

        Args:
            steps: all in which the leg stands, the last of them the one that is gone to.
            leg: whose foot touched.
            touched: joints (12,) at that moment [rad].
            near: farthest that the foot may be from its place in the last step [m].

        Returns:
            The same with this leg's joints changed; none of them if the foot is farther away, or
            out of reach there.
        """
        k, own = self._kinematics, slice(3 * leg, 3 * leg + 3)
        higher = k.foot_positions(touched)[leg] - k.foot_positions(steps[-1].posture)[leg]
        if np.linalg.norm(higher) > near:
            return []
        changed = []
        for step in steps:
            feet, posture = k.foot_positions(step.posture), step.posture.copy()
            feet[leg] += higher
            try:
                posture[own] = k.joint_positions(feet)[own]
            except ValueError:
                return []
            changed.append(step._replace(posture=posture))
        return changed

    def _in_time(self, steps: list[BalanceStep]) -> list[BalanceStep]:
        """Give the steps' ways as much time as the joint with the longest one takes."""
        timed = steps[:1]
        for before, step in itertools.pairwise(steps):
            furthest = float(np.abs(step.posture - before.posture).max())
            timed.append(step._replace(time=max(step.time, furthest / self._speed)))
        return timed

    def _at(self, feet: Array, leg: int, inside: float, shapes: dict[int, str]) -> Array:
        """Return the joints (12,) [rad] with the centre of mass so far inside of a leg's edge [m].

        Args:
            feet: (4, 3) [m], of the robot standing with its body in the middle.
            leg: first one in the air, or to be.
            inside: wanted [m].
            shapes: of legs that do not keep their feet where they are.
        """
        k, moved = self._kinematics, feet.copy()
        for _ in range(_PLACES):
            joints = k.joint_positions(moved)
            for own, shape in shapes.items():
                if shape != _DOWN:
                    joints[3 * own : 3 * own + 3] = self._shape[shape][3 * own : 3 * own + 3]
            up = np.tile((0.0, 0.0, 1.0), (LEGS, 1))
            edge = edge_of(moved, leg, k.center_of_mass(joints), moved, up)
            moved -= (inside - edge.inside) * edge.inward
        return joints
