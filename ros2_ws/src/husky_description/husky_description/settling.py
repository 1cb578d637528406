"""Motion that puts a standing or stepping robot down on its perch in less than 0.6 s.

A stop of category 1 in the sense of IEC 60204-1 brings the machine to rest before power is taken
away. The controller runs this motion for its own stops, the bridge of the drives for stops of the
drives and when no controller commands them. It is open loop: it takes joint targets and velocity of
the body at the beginning, and needs no measurement after that.

- The body falls a little slower than freely up to a speed that the legs can brake, then slows down
  until the perch is on the ground.
- Feet on the ground keep their places on it while the body brakes. The two feet that are furthest
  behind are unloaded by the fall and set ahead; otherwise the body would end before its feet and
  pitch over them. Another foot in the air comes straight down.
- Feet end outside of the hips, as outriggers of a narrow perch, and hold until the body is at rest.
- A leg without the drive of its knee or of its hip's sagittal axis does not carry. Three legs do
  not carry a body whose centre of mass lies between two of them: the neighbours of the lost leg
  step towards it, and the body goes down faster. A lost leg whose knee has its drive folds aside.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_description.kinematics import JOINTS, LEGS, Kinematics, inverse_kinematics

if TYPE_CHECKING:
    from husky_description.robot import Robot


class Descent(NamedTuple):
    """Speeds of the body downwards, of a robot of Carbon's size."""

    fall: float  # m/s^2, at first: less than gravity, so that feet keep contact
    fastest: float  # m/s
    landing: float  # m/s, when the perch meets the ground


# Chosen by simulation over all gaits (tests/closed_loop/test_settling.py), as the numbers below.
ON_FOUR_LEGS = Descent(fall=0.8 * GRAVITY, fastest=1.25, landing=0.55)
ON_THREE_LEGS = Descent(fall=0.92 * GRAVITY, fastest=1.5, landing=1.5)
BRAKING = 1.2
"""Horizontal deceleration that feet on the ground allow for [m/s^2]: more pitches the body over."""
SET_AHEAD = 0.2
"""Time by which feet are set ahead of their standing places at the body's velocity [s]."""
TRAVEL = 0.12
"""Time that a foot takes to another place [s]."""
PUT_DOWN = 0.06
"""Time in which other feet in the air come down [s]."""
HOP = 0.015
"""Height of a foot over its straight way to another place [m]."""
SPREAD = 0.05
"""Distance of the feet in the end outside of their standing places [m]."""
SLOW = 0.2
"""Speed below which only feet in the air are set to another place [m/s]."""
AIRBORNE = 0.01
"""Height over the lowest foot above which a foot counts as in the air [m]."""
IN_THE_AIR = 0.1
"""Distance by which a foot in the air counts as further behind than it is [m]."""
REST = 0.57
"""Time from the beginning until which the legs hold [s]: a body that rocks on its perch needs them,
and torque is to be gone after 0.6 s."""
TOWARDS_LOST = (0.10, 0.04)
"""Steps of the neighbours of a lost leg towards it [m]: along x of the one on its side, along y of
the one across."""
BESIDE_LOST = 0.06
"""Step outwards of the neighbour on its side [m]."""
OUT_AGAIN = (0.14, 0.10)
"""Time before the perch is down at which a foot that has stepped inwards goes out again, and the
time that it takes [s]."""
FOLDED_ASIDE = (0.75, -2.6)
"""Angles of a lost leg that is not to lie under the body: hip frontal outward, knee [rad]."""
FOLDING = 0.28
"""Time that it takes [s]."""
LOADED = 0.03
"""Share of the weight from which a leg that presses on the ground counts as standing."""


def _smooth(part: Array) -> Array:
    """Return a smooth way from 0 to 1, at rest at both ends."""
    return part * part * (3.0 - 2.0 * part)


class Settling:
    """One robot's way down; lengths, times and speeds above grow with its legs as a pendulum's.

    Attributes:
        joint_position: targets (12,) [rad].
        joint_velocity: their rates (12,) [rad/s].
        done: the motion has ended, or none was needed.
    """

    def __init__(self, robot: Robot) -> None:
        """Nothing to do yet."""
        self._kinematics = Kinematics(robot)
        self._lower, self._upper = np.array(robot.joint_lower), np.array(robot.joint_upper)
        self._weight = float(robot.mass) * GRAVITY
        self._perch = float(robot.sit_height)
        self._stand = self._kinematics.foot_positions(np.array(robot.stand_joint_position))[:, :2]
        self._side = np.sign(np.array(robot.lateral_offset))
        self._length = float(robot.size.length)
        self._pace = math.sqrt(self._length)
        self.joint_position, self.joint_velocity = np.zeros(JOINTS), np.zeros(JOINTS)
        self.done = True

    def begin(
        self,
        joint_position: Array,
        body_velocity: Array,
        driven: NDArray[np.bool_] | None = None,
    ) -> None:
        """Start from joint targets.

        Args:
            joint_position: (12,) rad.
            body_velocity: of base in base (3,) [m/s].
            driven: joints that have a drive (12,), None for all.
        """
        self.joint_position[:] = joint_position
        self.joint_velocity.fill(0.0)
        feet = self._kinematics.foot_positions(self.joint_position)
        lowest = float(feet[:, 2].min())
        self.done = -lowest <= self._perch
        if self.done:
            return
        self._elapsed = 0.0
        drives = np.ones((LEGS, 3), np.bool_) if driven is None else driven.reshape(LEGS, 3)
        lost = np.flatnonzero(~drives[:, 1:].all(axis=1))
        self._lost_leg = int(lost[0]) if len(lost) else -1
        self._folds_aside = bool(self._lost_leg >= 0 and drives[self._lost_leg, 2])
        self._feet, self._above = feet[:, :2], feet[:, 2] - lowest
        self._drift = np.array(body_velocity[:2])
        self._plan_descent(-lowest, float(body_velocity[2]))
        self._moves = self._choose_feet()
        self._times = np.where(self._moves, TRAVEL, PUT_DOWN) * self._pace
        self._goals = self._place_feet()
        # A leg that is bent the other way than inverse kinematics bends it is led over.
        self._bend = np.zeros(JOINTS)
        self._bend = self.joint_position - self._joints_at(0.0)

    def advance(self, dt: float) -> None:
        """Go on by dt [s]."""
        if self.done:
            self.joint_velocity.fill(0.0)
            return
        self._elapsed += dt
        joints = self._joints_at(self._elapsed)
        self.joint_velocity[:] = (joints - self.joint_position) / dt
        self.joint_position[:] = joints
        self.done = self._elapsed >= max(self._down_at, REST * self._pace) - 0.5 * dt

    # The body -----------------------------------------------------------------------------------
    def _plan_descent(self, height: float, climb: float) -> None:
        """Plan the height of base over the feet: a fall, then a constant deceleration.

        Args:
            height: at first [m].
            climb: speed upwards at first [m/s].
        """
        descent = ON_FOUR_LEGS if self._lost_leg < 0 else ON_THREE_LEGS
        drop, fall = height - self._perch, descent.fall
        climb = min(1.0, max(-1.0, climb))
        # A drop that is too short for the greatest speed has a lesser one.
        fastest = min(descent.fastest * self._pace, math.sqrt(climb * climb + fall * drop))
        landing = min(descent.landing * self._pace, fastest)
        self._height, self._climb, self._fall, self._fastest = height, climb, fall, fastest
        self._fall_time = max(0.0, (fastest + climb) / fall)
        self._fallen = (fastest * fastest - climb * climb) / (2.0 * fall)
        slowing_time = max(1e-9, 2.0 * (drop - self._fallen) / (fastest + landing))  # s
        self._slowing = (fastest - landing) / slowing_time
        self._down_at = self._fall_time + slowing_time

    def _height_at(self, time: float) -> float:
        """Return the height of base over the feet on the ground [m]."""
        if time < self._fall_time:
            return self._height + (self._climb - 0.5 * self._fall * time) * time
        time = min(time, self._down_at) - self._fall_time
        return self._height - self._fallen - (self._fastest - 0.5 * self._slowing * time) * time

    def _drifted(self, time: float) -> Array:
        """Return how far the body has gone on over the ground (2,) [m]."""
        speed = math.hypot(*self._drift)
        time = min(time, speed / BRAKING)
        gone: Array = self._drift * (time - 0.5 * BRAKING * time * time / max(speed, 1e-9))
        return gone

    # The feet -----------------------------------------------------------------------------------
    def _choose_feet(self) -> NDArray[np.bool_]:
        """Return which feet are set to other places (4,)."""
        chosen = np.zeros(LEGS, np.bool_)
        if self._lost_leg >= 0:
            chosen[[self._lost_leg ^ 1, self._lost_leg ^ 2]] = True  # its neighbours
            return chosen
        in_the_air: NDArray[np.bool_] = self._above > AIRBORNE * self._length
        speed = math.hypot(*self._drift)
        if speed <= SLOW * self._pace:
            return in_the_air
        behind = (self._stand - self._feet) @ self._drift / speed
        behind += IN_THE_AIR * self._length * in_the_air
        chosen[np.argsort(-behind)[:2]] = True
        return chosen

    def _place_feet(self) -> Array:
        """Return the places of the feet under a body that does not go on, in base (4, 2) [m]."""
        ahead = self._stand + SET_AHEAD * self._pace * self._drift
        goals = np.where(self._moves[:, None], ahead, self._feet)
        self._spread(goals, 1.0)
        goals[:, 1] = self._side * np.maximum(
            self._side * goals[:, 1], self._side * self._feet[:, 1]
        )
        if (lost := self._lost_leg) >= 0:
            along, across = self._length * np.array(TOWARDS_LOST)
            beside, opposite = lost ^ 2, lost ^ 1
            goals[beside, 0] += along * np.sign(self._stand[lost, 0])
            goals[beside, 1] += BESIDE_LOST * self._length * self._side[lost]
            goals[opposite, 1] += across * self._side[lost]
        return goals

    def _spread(self, feet: Array, part: float) -> None:
        """Move feet (4, 2 or 3) that are not outside of the hips a part of the way to there."""
        out = self._side * self._stand[:, 1] + SPREAD * self._length
        feet[:, 1] += part * self._side * np.maximum(0.0, out - self._side * feet[:, 1])

    def _joints_at(self, time: float) -> Array:
        """Return the joint targets of a time (12,) [rad]."""
        part = np.minimum(1.0, time / self._times)
        along = _smooth(part)
        across = np.where(self._moves, along, _smooth(np.minimum(1.0, time / self._down_at)))
        feet = np.empty((LEGS, 3))
        feet[:, 0] = self._feet[:, 0] + along * (self._goals[:, 0] - self._feet[:, 0])
        feet[:, 1] = self._feet[:, 1] + across * (self._goals[:, 1] - self._feet[:, 1])
        feet[:, :2] -= self._drifted(time)
        # A body that drifts sideways does not leave its feet on one side.
        rows = np.stack((self._stand[:, 1], self._feet[:, 1], self._goals[:, 1]))
        feet[:, 1] = self._side * np.maximum(
            (self._side * rows).min(axis=0), self._side * feet[:, 1]
        )
        if self._lost_leg >= 0:
            before, during = OUT_AGAIN
            self._spread(feet, min(1.0, max(0.0, (time - self._down_at + before) / during)))
        hop = HOP * self._length * np.where(self._moves, 16.0 * (part * (1.0 - part)) ** 2, 0.0)
        feet[:, 2] = (1.0 - part) * self._above + hop - self._height_at(time)
        joints = np.empty(JOINTS)
        inverse_kinematics(self._kinematics.geometry, feet, joints)
        joints += np.repeat(1.0 - part, 3) * self._bend
        if self._folds_aside:
            leg = joints[3 * self._lost_leg :][:3]
            outward, knee = FOLDED_ASIDE
            goal = np.array([outward * self._side[self._lost_leg], leg[1], knee])
            leg += _smooth(np.minimum(1.0, time / (FOLDING * self._pace))) * (goal - leg)
        clipped: Array = np.clip(joints, self._lower, self._upper)
        return clipped

    # The body's velocity, where only commands tell of it ------------------------------------------
    def velocity_of(self, commands: Array, dt: float) -> Array:
        """Return the velocity of base in base (3,) [m/s] that joint commands give the body.

        Feet of legs that press on the ground stand on it, and the body moves against them. While
        no two legs press, the body flies on as it did.

        Args:
            commands: position [rad], velocity [rad/s] and effort [N m] (n, 3, 12), oldest first.
            dt: time between two of them [s].
        """
        for age, (position, velocity, effort) in enumerate(commands[::-1]):
            _, jacobian = self._kinematics.foot_positions_and_jacobians(position)
            square = jacobian @ jacobian.transpose(0, 2, 1) + 1e-6 * np.eye(3)
            torque = effort.reshape(LEGS, 3, 1)
            pressing = -np.linalg.solve(square, jacobian @ torque)[:, 2, 0]  # on the ground [N]
            standing = pressing > LOADED * self._weight
            if standing.sum() >= 2:
                rates = np.einsum("lij,lj->li", jacobian, velocity.reshape(LEGS, 3))
                body: Array = -rates[standing].mean(axis=0)
                body[2] -= GRAVITY * age * dt
                return body
        return np.zeros(3)
