"""Mode `righting`: a robot that lies on its side or back rolls over onto its perch.

A narrow body with its legs folded rests on one of its faces: side, back, or the edge between perch
and hips. Legs lever it from face to face:

1. Untangle: the legs go out of each other's way, and off the body, one joint after the other, each
   time in another order.
2. Lever: on side or back, feet of the lower legs reach past the rack, front legs ahead of the body,
   hind legs behind it, and push down. The body comes to lie on the edge of its perch.
3. Push: upper legs reach over the back and push down beside it; then lower legs, folded and turned
   outward, push with their knees, until the body tips over that edge.
4. Rise: all legs spread, so that it tips no further, and gather to the sitting posture.

Which of these is next follows from the measured attitude alone, after each and as often as it
takes. Legs that are blocked are left: no joint pushes with more than `EFFORT` of its torque limit,
and a move ends `PATIENCE` after its time. The fans do nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_control.modes.behaviour import REST_RATE, Behaviour, Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.rotation import tilt_of
from husky_control.tick_data import CYCLIC_POSITION, CYCLIC_VELOCITY, TICK, JointCommand
from husky_description.arrays import Array
from husky_description.kinematics import JOINTS, LEGS

ROUNDS = 20
"""Moves from face to face after which it gives up."""
TIPPED = math.radians(25.0)
"""Tilt below which the body is about to tip onto its perch, and pushing ends [rad]."""
FLAT = 0.2
"""Tilt of a body that lies flat on its perch, at most [rad]."""
FALLEN_BACK = math.radians(100.0)
"""Tilt above which rising has failed [rad]."""
EDGE = math.radians(80.0)
"""Roll below which the body lies on the edge of its perch [rad]."""
BACK = math.radians(150.0)
"""Roll above which it lies on its back [rad]."""

EFFORT = 0.8
"""Share of the joints' torque limit that a blocked leg pushes with."""
CALM_TIME = 0.4
"""Time in which joints that still swing are braked [s]."""
HANDOVER_TIME = 0.1
"""Time for the drives to take over targets at the joints [s]."""
PATIENCE = 0.3
"""Time that joints get beyond that of the move [s]."""
PAUSE = 0.4
"""Time for the body to come to rest [s]."""
REACHED = 0.12
"""Distance from its goal at which a joint has arrived [rad]."""
ASTRAY = 0.3
"""Distance from its goal at which a leg is blocked by something [rad]."""
MARGIN = 0.05
"""Distance that goals keep from the ends of the joints' ranges [rad]."""
QUICK, EASY = 4.0, 2.0
"""Speeds of joints [rad/s]."""

Leg = tuple[float, float, float]
Pair = tuple[Leg, Leg]
"""Front and hind leg of one side: hip frontal outward, hip sagittal, knee [rad]."""


def _turned(frontal: float, pair: Pair) -> Pair:
    """Return the posture of a pair with both hips turned outward by an angle [rad]."""
    (_, *front), (_, *hind) = pair
    return (frontal, front[0], front[1]), (frontal, hind[0], hind[1])


CLOSED: Pair = (0.0, -1.5, -2.75), (0.0, 2.15, -2.75)
"""Folded within the body's outline: thighs forward and backward."""
REACH: Pair = (0.0, -1.5, -1.64), (0.0, 2.05, -0.05)
"""Feet beside the rack, 0.3 m above the hips, ahead of the body and behind it."""
LEVER = _turned(-0.68, REACH)
OVER = _turned(1.58, REACH)
OVER_HALF: Pair = OVER[0], (0.5, *REACH[1][1:])
KNEE: Pair = (1.55, -1.15, -2.75), CLOSED[1]
KNEE_DOWN: Pair = (1.55, -0.3, -2.75), CLOSED[1]
KNEES: Pair = KNEE_DOWN[0], (1.5, 1.6, -2.75)
KNEES_DOWN: Pair = KNEE_DOWN[0], (1.5, 0.6, -2.2)
STAR: Pair = ((1.0, 0.2, -0.5),) * 2
SPREAD: Pair = ((1.15, 0.6, -1.6),) * 2
SAT_ASIDE: Pair = ((1.3, 1.34, -2.68),) * 2

FRONTAL, SAGITTAL, KNEE_JOINT = np.tile(np.eye(3, dtype=bool), LEGS)
ALL = np.ones(JOINTS, dtype=bool)
FRONT = np.repeat((True, True, False, False), 3)
UNTANGLING = (
    (SAGITTAL, SAGITTAL | KNEE_JOINT, ALL),
    (FRONTAL & FRONT, FRONT, FRONT | FRONTAL, ALL),
    (FRONTAL & ~FRONT, ~FRONT, ~FRONT | FRONTAL, ALL),
    (KNEE_JOINT, SAGITTAL | KNEE_JOINT, ALL),
    (FRONTAL, FRONTAL | KNEE_JOINT, ALL),
)
"""Joints (12,) that move first, then, last; others give way. Orders are tried in turn."""


class Move(NamedTuple):
    """Motion of legs: goal (12,) rad, speed [rad/s], joints that move (12,), pause after it [s]."""

    goal: Array
    speed: float
    joints: NDArray[np.bool_] = ALL
    pause: float = 0.0


class Righting(Behaviour):
    """Rolls the body onto its perch."""

    place_counts = velocity_counts = False

    def __init__(self, name: str, context: ModeContext) -> None:
        """Not begun."""
        super().__init__(name, context)
        robot = context.robot
        self._front = robot.hip_position[:, 0] > 0.0
        self._side = np.sign(robot.lateral_offset)
        self._lead = EFFORT * robot.joint_torque_limit / robot.servo.kp
        self._calm = 0.0  # s left of braking
        self._moves: list[Move] = []  # to come
        self._move = Move(np.zeros(JOINTS), QUICK)
        self._left = 0.0  # s of the present move
        self._pause = 0.0  # s left
        self._rounds = self._untangled = 0
        self._untangling = self._rising = False

    def enter(self, event: Event) -> None:
        """Begin by braking the joints, which may still swing."""
        self.context.safety.reset()
        self._calm, self._moves = CALM_TIME, []
        self._rounds = self._untangled = 0
        self._untangling = self._rising = False

    def estimate(self) -> None:
        """Stay where the body was: no foot is known to stand."""
        self.context.body.estimate_at_rest()

    def lean(self) -> float:
        """Return 0: no tilt is a fault here."""
        return 0.0

    @property
    def settled(self) -> bool:
        """False: `sit` follows when the robot is righted."""
        return False

    # The law ------------------------------------------------------------------------------------
    def tick(self, command: JointCommand) -> Happening | None:
        """Go on with the present move, or choose the next."""
        m, tilt = self.context.body.measurements, tilt_of(self.context.body.rotation)
        if self._calm > 0.0:
            self._calm -= TICK
            self._move = Move(m.joint_position.copy(), QUICK)
            self._left, self._pause = 0.0, HANDOVER_TIME
            command.mode_of_operation = CYCLIC_VELOCITY
            command.position[:] = m.joint_position
            command.velocity.fill(0.0)
            command.effort.fill(0.0)
            return None
        if self._rising and tilt > FALLEN_BACK:
            self._moves, self._left, self._pause, self._rising = [], 0.0, 0.0, False
        elif self._rounds > 0 and tilt < TIPPED and not (self._rising or self._untangling):
            self._moves, self._left, self._pause, self._rising = self._rise(), 0.0, 0.0, True
        away = np.abs(self._move.goal - m.joint_position)[self._move.joints].max()
        self._left = 0.0 if away < REACHED else self._left - TICK
        if self._left <= 0.0:
            self._pause -= TICK
            if self._pause <= 0.0 and (happening := self._begin_next(float(away), tilt)):
                return happening
        self._lead_joints(command)
        return None

    def _begin_next(self, away: float, tilt: float) -> Happening | None:
        """Begin the next move, of the next round if there is none; return how it has ended.

        Args:
            away: of the joint furthest from its goal [rad].
            tilt: of the body [rad].
        """
        m = self.context.body.measurements
        if not self._moves:
            turning = math.hypot(*m.angular_velocity_base_in_base)
            if self._rising and tilt < FLAT and away < ASTRAY and turning < REST_RATE:
                return (Event.DONE, "on its perch")
            if self._rounds == ROUNDS:
                return (Event.LOST, f"not upright after {ROUNDS} rounds")
            self._rounds += 1
            self._moves, self._rising = self._next_round(away), False
        self._move = move = self._moves.pop(0)
        way = np.abs(move.goal - m.joint_position)[move.joints].max()
        self._left, self._pause = float(way) / move.speed + PATIENCE, move.pause
        return None

    def _lead_joints(self, command: JointCommand) -> None:
        """Lead the joints to the goal, ahead of each by no more than its share of torque allows."""
        robot, m, move = self.context.robot, self.context.body.measurements, self._move
        most = move.speed * TICK
        step = np.clip(move.goal - command.position, -most, most)
        wanted = command.position + step
        near = np.clip(wanted, m.joint_position - self._lead, m.joint_position + self._lead)
        target = np.where(move.joints, near, m.joint_position)
        follows = np.clip(m.joint_velocity, -move.speed, move.speed)
        command.mode_of_operation = CYCLIC_POSITION
        command.velocity[:] = np.where(target == wanted, step / TICK, follows)
        np.clip(target, robot.joint_lower, robot.joint_upper, out=command.position)
        # The weight may press a joint beyond its range, where no target may be.
        command.effort[:] = robot.servo.kp * (target - command.position)

    # Rounds -------------------------------------------------------------------------------------
    def _next_round(self, away: float) -> list[Move]:
        """Return the moves that fit the attitude.

        The legs untangle first, and again after a round in which one was blocked.
        """
        down = -self.context.body.rotation[2]
        roll = math.atan2(abs(down[1]), -down[2])
        face = (roll > EDGE) + (roll > BACK)
        self._untangling = self._rounds == 1 or (away > ASTRAY and not self._untangling)
        if self._untangling:
            order = UNTANGLING[self._untangled % len(UNTANGLING)]
            self._untangled += 1
            star = self._posture(STAR, STAR)
            ways = [Move(star, QUICK, joints) for joints in order]
            if self._untangled % 2 == 0:
                aside = self._lifted_aside(star)
                lifts = (SAGITTAL, SAGITTAL | FRONTAL, ALL)
                ways[:0] = [Move(aside, QUICK, joints) for joints in lifts]
            return ways
        if face == 0:
            return self._push()
        if face == 1:
            sides = ((CLOSED, CLOSED), (REACH, CLOSED), (LEVER, CLOSED), (CLOSED, CLOSED))
            return self._moves_through(sides)
        return self._moves_through(((CLOSED, CLOSED), (CLOSED, REACH)))

    def _lifted_aside(self, posture: Array) -> Array:
        """Return a posture (12,) rad of thighs at the nearer ends of their ranges.

        A thigh that points up there goes aside by turning its hip inward, with the knee folded.
        """
        robot, aside = self.context.robot, posture.copy().reshape(LEGS, 3)
        thigh = self.context.body.measurements.joint_position[1::3]
        lower, upper = robot.joint_lower[1::3] + MARGIN, robot.joint_upper[1::3] - MARGIN
        aside[:, 1] = np.where(thigh - lower < upper - thigh, lower, upper)
        up = np.abs(aside[:, 1]) > math.pi / 2.0
        aside[up, 0] = LEVER[0][0] * self._side[up]
        aside[up, 2] = CLOSED[0][2]
        return aside.ravel()

    def _push(self) -> list[Move]:
        """Return the moves that tip a body over the edge of its perch."""
        outward, inward = _turned(1.0, KNEES_DOWN), _turned(0.6, KNEES_DOWN)
        return self._moves_through(
            (
                (CLOSED, CLOSED),
                (CLOSED, _turned(0.9, REACH)),
                (CLOSED, OVER),
                (KNEE, OVER),
                (KNEE_DOWN, OVER),
                (KNEES, OVER_HALF),
                (KNEES_DOWN, OVER_HALF),
                (outward, _turned(0.5, REACH)),
                (inward, _turned(0.5, CLOSED)),
                (_turned(1.0, CLOSED), CLOSED),
            )
        )

    def _rise(self) -> list[Move]:
        """Return the moves to the sitting posture; lower legs hold on until others spread."""
        lower = np.repeat(self._side == self._lower_side, 3)
        aside = self._posture(_turned(1.3, CLOSED), _turned(1.3, CLOSED))
        spread = self._posture(SPREAD, SPREAD)
        return [
            Move(np.where(lower, self._move.goal, aside), QUICK),
            Move(np.where(lower, self._move.goal, spread), QUICK),
            Move(spread, EASY, pause=PAUSE),
            Move(self._posture(SAT_ASIDE, SAT_ASIDE), QUICK),
            Move(np.array(self.context.robot.sit_joint_position), EASY, pause=PAUSE),
        ]

    @property
    def _lower_side(self) -> float:
        """Side that is lower: 1 left, -1 right."""
        return math.copysign(1.0, -float(self.context.body.rotation[2, 1]))

    def _moves_through(self, ways: Sequence[tuple[Pair, Pair]]) -> list[Move]:
        """Return quick moves through postures of the lower and the upper legs."""
        return [Move(self._posture(lower, upper), QUICK) for lower, upper in ways]

    def _posture(self, lower: Pair, upper: Pair) -> Array:
        """Joint positions (12,) rad of the postures of lower and upper legs, within the ranges."""
        robot, side = self.context.robot, self._lower_side
        posture = np.empty((LEGS, 3))
        for leg in range(LEGS):
            pair = lower if self._side[leg] == side else upper
            posture[leg] = pair[0 if self._front[leg] else 1]
            posture[leg, 0] *= self._side[leg]
        return np.clip(posture.ravel(), robot.joint_lower + MARGIN, robot.joint_upper - MARGIN)
