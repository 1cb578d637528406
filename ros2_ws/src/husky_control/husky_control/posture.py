"""Standing up and sitting down: smooth joint trajectories between postures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from husky_description.arrays import Array
from husky_description.kinematics import JOINTS, Kinematics

if TYPE_CHECKING:
    from husky_description.robot import Robot


TUCKED = 0.01  # m, feet above the ground of a body on its perch, as they go to their places
CROUCH_FEET = (0.30, 0.28)  # m ahead and beside the base, on an incline; scaled to the legs
KNOTS = 9  # postures on the way of feet that go straight
PEAK = 1.875  # greatest over mean speed of a minimum-jerk motion


class Postures:
    """The named postures of one robot, and ways between them on which its feet do not slide."""

    def __init__(self, robot: Robot) -> None:
        """Postures of a robot that sits on its perch and stands on level ground."""
        self._kinematics = Kinematics(robot)
        self._side = np.sign(robot.lateral_offset)
        self._sit_height = robot.sit_height
        ahead, beside = CROUCH_FEET
        self._crouch_feet = ahead * robot.size.length, beside * robot.size.length
        self._sit = np.array(robot.sit_joint_position)
        self._sit_feet = self._kinematics.foot_positions(self._sit)
        self._stand_feet = self._kinematics.foot_positions(robot.stand_joint_position)

    def stand(self, lateral_spread: float, height_offset: float) -> Array:
        """Joint positions (12,) rad: the robot's own posture, feet further out, body higher (m)."""
        feet = self._stand_feet.copy()
        feet[:, 1] += self._side * lateral_spread
        feet[:, 2] -= height_offset
        return self._kinematics.joint_positions(feet)

    def low(self, posture: Array, clearance: float = 0.0) -> Array:
        """Joint positions (12,) rad of a body on its perch over the feet of a posture (12,) rad.

        Args:
            posture: whose feet keep their places.
            clearance: m, of the feet above the ground.

        Raises:
            ValueError: a foot is out of reach then.
        """
        feet = self._kinematics.foot_positions(posture)
        feet[:, 2] = clearance - self._sit_height
        return self._kinematics.joint_positions(feet)

    def crouch(self) -> Array:
        """Joint positions (12,) rad low over wide feet, so that a slide down is no tumble."""
        feet = self._sit_feet.copy()
        feet[:, 0] = np.sign(feet[:, 0]) * self._crouch_feet[0]
        feet[:, 1] = self._side * self._crouch_feet[1]
        return self._kinematics.joint_positions(feet)

    def ways_up(self, start: Array, stand: Array) -> list[Array]:
        """Ways from a posture to a standing one: the feet to their places, down, the body up.

        Args:
            start: (12,) rad, of a body that lies.
            stand: (12,) rad.
        """
        tucked, low = self.low(stand, TUCKED), self.low(stand)
        return [np.stack((start, tucked)), self.straight(tucked, low), self.straight(low, stand)]

    def ways_down(self, start: Array) -> list[Array]:
        """Ways from a posture (12,) rad to the sitting one: the body down, the feet up, gathered.

        Where legs are so far out that the body cannot sink between the feet, one way alone.
        """
        try:
            low, tucked = self.low(start), self.low(start, TUCKED)
            ways = [self.straight(start, low), self.straight(low, tucked)]
        except ValueError:
            return [np.stack((start, self._sit))]
        return [*ways, np.stack((tucked, self._sit))]

    def straight(self, start: Array, end: Array) -> Array:
        """Postures (KNOTS, 12) rad between two on which each foot goes straight in base.

        Raises:
            ValueError: a foot is out of reach on its way.
        """
        kinematics = self._kinematics
        first, last = kinematics.foot_positions(start), kinematics.foot_positions(end)
        part = np.linspace(0.0, 1.0, KNOTS)
        way = np.array([kinematics.joint_positions(first + b * (last - first)) for b in part])
        # Legs that are bent the other way are led over.
        return way + np.outer(1.0 - part, start - way[0]) + np.outer(part, end - way[-1])


class PostureMove:
    """Minimum-jerk motion along ways through postures, at rest after each."""

    def __init__(self) -> None:
        """No motion, at zero."""
        self.joint_position = np.zeros(JOINTS)
        self.joint_velocity = np.zeros(JOINTS)
        self._ways: list[tuple[CubicSpline, float]] = []
        self._taken = 0
        self._elapsed = 0.0

    def start(self, ways: list[Array], durations: list[float]) -> None:
        """Begin at rest at the start of the first way and take one after the other.

        Args:
            ways: n times (k, 12) rad, postures in even steps; k is 2 for a straight line between
                two. Each starts where the one before ends. None is a motion that has ended.
            durations: n times in s.
        """
        if len(ways) != len(durations):
            raise ValueError(f"{len(ways)} ways need as many durations, not {len(durations)}")
        self._ways = [
            (CubicSpline(np.linspace(0.0, 1.0, len(way)), way), duration)
            for way, duration in zip(ways, durations, strict=True)
        ]
        self._taken = 0
        self._elapsed = 0.0
        if ways:
            self.joint_position[:] = ways[0][0]
        self.joint_velocity.fill(0.0)

    @property
    def done(self) -> bool:
        """Whether the last posture is reached."""
        return self._taken >= len(self._ways)

    @property
    def on_first_way(self) -> bool:
        """Whether the first way is not at its end yet."""
        return self._taken == 0 and not self.done

    @property
    def on_last_way(self) -> bool:
        """Whether the motion is on its last way, or at its end."""
        return self._taken >= len(self._ways) - 1

    @property
    def progress(self) -> float:
        """Time spent of the present way, 0 to 1."""
        return 1.0 if self.done else min(1.0, self._elapsed / self._ways[self._taken][1])

    def tick(self, dt: float) -> None:
        """Advance joint_position (rad) and joint_velocity (rad/s) by dt s."""
        if self.done:
            self.joint_velocity.fill(0.0)
            return
        way, duration = self._ways[self._taken]
        self._elapsed += dt
        s = min(1.0, self._elapsed / duration)
        blend = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        slope = 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration
        self.joint_position[:] = way(blend)
        np.multiply(way(blend, 1), slope, out=self.joint_velocity)
        if s >= 1.0:
            self._taken += 1
            self._elapsed = 0.0
