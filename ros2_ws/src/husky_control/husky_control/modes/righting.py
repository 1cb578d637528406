"""Mode `righting`: a robot that lies on its side or back rolls over onto its perch.

DRAFT
"""

from __future__ import annotations

import math, os

import numpy as np

from husky_control.kinematics import JOINTS, LEGS
from husky_control.modes.behaviour import Behaviour, Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand
from husky_description.arrays import Array

ATTEMPTS = 16
EFFORT = 0.8
REACHED = 0.12
STALL = 0.3
LOWER, UPPER = True, False

Leg = tuple[float, float, float]


class Righting(Behaviour):
    """Rolls the body by strokes of the legs on the lower side."""

    place_counts = velocity_counts = False

    def __init__(self, name: str, context: ModeContext) -> None:
        super().__init__(name, context)
        robot = context.robot
        self._lead = EFFORT * robot.joint_torque_limit / robot.servo.kp
        self._side = np.sign(robot.lateral_offset)
        self._front = np.asarray(robot.hip_position)[:, 0] > 0
        self._sit = np.array(robot.sit_joint_position)
        self._steps = []
        self._goal = np.zeros(JOINTS)
        self._speed = 0.0
        self._left = 0.0
        self._attempts = 0
        self._again = False
        self._ending = False
        self.log = []

    def enter(self, event: Event) -> None:
        self.context.safety.reset()
        self._attempts = 0
        self._mask = np.ones(12, bool)
        self._first, self._spread = True, False
        self._damp = 0.4
        self._hold = True
        self._ending = False
        self._steps = []
        self._goal[:] = self.context.command.position
        self._left = 0.1
        self.log = []

    def estimate(self) -> None:
        self.context.body.estimate_at_rest()

    def lean(self) -> float:
        return 0.0

    def _posture(self, lower, upper, side: float) -> Array:
        out = np.zeros((LEGS, 3))
        for leg in range(LEGS):
            pair = lower if self._side[leg] == side else upper
            out[leg] = pair[0 if self._front[leg] else 1]
            out[leg, 0] *= self._side[leg]
        return np.clip(out.reshape(-1), self.context.robot.joint_lower, self.context.robot.joint_upper)

    def _plan(self):
        d = -self.context.body.rotation[2]
        roll = math.degrees(math.atan2(abs(d[1]), -d[2]))
        side = 1.0 if d[1] > 0 else -1.0
        self.log.append((round(roll), side))
        CLOSED = (-1.5, -2.75), (2.15, -2.75)
        TAIL = (-1.5, -2.75), (1.6, -0.03)
        TAILUP = (-1.5, -2.75), (2.15, -0.03)
        HOOK = (-1.5, -1.64), (2.05, -0.03)
        L = lambda q, pair: ((q, *pair[0]), (q, *pair[1]))
        P = lambda lower, speed, upper=L(0, CLOSED): (self._posture(lower, upper, side), speed)
        HOLD = (None, 0.4)
        SW = float(os.environ.get('SW', 8))
        if roll < 30 and abs(d[0]) < 0.5:
            SIT = (1.34, -2.68), (1.34, -2.68)
            OUT = (0.6, -1.6), (0.6, -1.6)
            def stay(upper):
                p = self._posture(upper, upper, side)
                for leg in range(LEGS):
                    if self._side[leg] == side:
                        p[3*leg:3*leg+3] = before[3*leg:3*leg+3]
                return p
            before = self._goal.copy()
            return [(stay(L(1.3, CLOSED)), 4), (stay(L(1.15, OUT)), 4), P(L(1.15, OUT), 2, L(1.15, OUT)), HOLD,
                    P(L(1.3, SIT), 3, L(1.3, SIT)), (self._sit, 2.0), HOLD], True
        if roll < 80:
            M = lambda qf, f, qh, h: ((qf, *f), (qh, *h))
            HIND = (2.15, -2.75)
            over = L(1.58, HOOK)
            half = M(1.58, HOOK[0], 0.5, HOOK[1])
            return [P(L(0, CLOSED), 4), P(L(0, CLOSED), 4, L(0.9, HOOK)), P(L(0, CLOSED), 4, over),
                    P(M(1.55, (-1.15, -2.75), 0, HIND), 4, over),
                    P(M(1.55, (-0.3, -2.75), 0, HIND), 4.4, over), 
                    P(M(1.55, (-0.3, -2.75), 1.5, (1.6, -2.75)), 4, half),
                    P(M(1.55, (-0.3, -2.75), 1.5, (0.6, -2.2)), 4, half), 
                    P(M(1.0, (-0.3, -2.75), 1.0, (0.6, -2.0)), 4.4, L(0.5, HOOK)), 
                    P(M(0.6, (-0.3, -2.75), 0.6, (0.6, -2.0)), 4.4, L(0.5, CLOSED)), 
                    P(L(1.0, CLOSED), 4),
                    P(L(0.0, CLOSED), 4),
                    ], False
        if roll < 150:
            return [P(L(0, CLOSED), 3), P(L(0, HOOK), 3), P(L(-0.68, HOOK), 3), P(L(0.0, TAIL), 3)], False
        return [P(L(0,CLOSED), 3), (self._posture(L(0,CLOSED), L(0, HOOK), side), 4)], False

    def tick(self, command: JointCommand) -> Happening | None:
        m = self.context.body.measurements
        if self._damp > 0.0:
            self._damp -= TICK
            command.mode_of_operation = 9
            command.position[:] = m.joint_position
            command.velocity.fill(0.0)
            command.effort.fill(0.0)
            self._goal[:] = np.clip(m.joint_position, self.context.robot.joint_lower, self.context.robot.joint_upper)
            return None
        self._left -= TICK
        d = self.context.body.rotation[2, 2]
        if self._attempts and not self._ending and d > math.cos(math.radians(25)):
            self._steps, self._ending = self._plan()
            self._left = 0.0
        if self._left <= 0.0 or (self._attempts and not self._hold and np.abs(self._goal - m.joint_position)[self._mask].max() < REACHED):
            if not self._steps:
                if self._ending:
                    if self.upright and np.abs(self._goal - m.joint_position).max() < REACHED:
                        return (Event.DONE, "upright")
                    self._ending = False
                if self._attempts >= ATTEMPTS:
                    return (Event.LOST, f"not upright after {ATTEMPTS} attempts")
                self._attempts += 1
                stuck = np.abs(self._goal - m.joint_position).max() > 0.3
                self._steps, self._ending = self._plan()
                if (self._first or stuck and not self._spread) and not self._ending:
                    star = self._posture(((1.0, 0.2, -0.5),) * 2, ((1.0, 0.2, -0.5),) * 2, 1.0)
                    self._steps = [(star, 4, (0, 1, 0)), (star, 4, (0, 1, 1)), (star, 4, (1, 1, 1))]
                    self._spread = True
                    self._first = False
                else:
                    self._spread = False
            goal, speed, *mask = self._steps.pop(0)
            self._mask = np.tile(mask[0] if mask else (1, 1, 1), 4) > 0
            self._hold = goal is None
            if goal is None:
                self._left = speed
            else:
                self._goal, self._speed = goal, speed
                self._left = np.abs(self._goal - m.joint_position)[self._mask].max() / self._speed + STALL
        p = command.position
        step = np.clip(self._goal - p, -self._speed * TICK, self._speed * TICK)
        new = p + step
        lead = 0.2 if self._speed > 4.5 else self._lead
        bounded = np.clip(new, m.joint_position - lead, m.joint_position + lead)
        bounded = np.where(self._mask, bounded, m.joint_position)
        held = bounded != new
        command.velocity[:] = np.where(held, np.clip(m.joint_velocity, -self._speed, self._speed), step / TICK)
        robot = self.context.robot
        p[:] = np.clip(bounded, robot.joint_lower, robot.joint_upper)
        command.effort[:] = robot.servo.kp * (bounded - p)
        command.mode_of_operation = CYCLIC_POSITION
        return None
