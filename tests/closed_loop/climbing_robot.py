"""The robot on a ramp in one process; the fans' vectored thrust as a force behind a lag."""

from __future__ import annotations

import math

import numpy as np
from in_process import InProcessRobot

from husky_control.rotation import matrix_from_quaternion
from husky_description import graph
from husky_description.robot import load_robot
from husky_sim.terrain import TerrainOptions
from husky_sim.world import WorldOptions

LAG, DELAY = 0.08, 10
"""Of the thrust [s], and ticks on its way to the fans."""
APPROACH, BLEND = 0.5, 0.8
"""Flat ground before the robot, and radius of the foot of the slope [m]."""


class ClimbingRobot(InProcessRobot):
    """A robot whose fans push in any direction at its centre of mass.

    Attributes:
        fans: they are armed and follow.
        limit: most thrust that they can make [N].
        thrust: in world [N] (3,).
        slope: of the ground [rad].
    """

    def __init__(self, slope_deg: float, seed: int = 0, **options: float):
        """On the flat before a slope; options of `WorldOptions` beside."""
        self.slope = math.radians(slope_deg)
        ground = TerrainOptions(kind="ramp", slope=self.slope, approach=APPROACH, blend=BLEND)
        robot = load_robot(fans__mounting="vectoring")
        super().__init__(WorldOptions(terrain=ground, seed=seed, **options), robot)
        self.fans = True
        self.limit = math.inf
        self.thrust = np.zeros(3)
        self._rotation = np.eye(3)
        self._in_base = np.zeros(3)
        self._commands = [np.zeros(3)] * DELAY

    def tick(self) -> None:
        """Advance by 2 ms."""
        self.measurements.fans_available = self.fans
        self.measurements.fans_limit = self.limit
        matrix_from_quaternion(self.world.base_orientation, self._rotation)
        self._commands.append(self.controller.thrust_in_base.copy())
        asked = self._commands.pop(0) if self.fans else np.zeros(3)
        self._in_base += (asked - self._in_base) * graph.TICK_PERIOD / LAG
        self.thrust = self._rotation @ self._in_base
        self.world.data.body("base").xfrc_applied[:3] = self.thrust
        super().tick()

    @property
    def normal(self) -> np.ndarray:
        """Of the slope, in world (3,)."""
        return np.array([-math.sin(self.slope), 0.0, math.cos(self.slope)])

    @property
    def uphill(self) -> np.ndarray:
        """Unit vector up the slope, in world (3,)."""
        return np.array([math.cos(self.slope), 0.0, math.sin(self.slope)])

    @property
    def lean(self) -> float:
        """Angle of the body's z axis from the slope's normal [rad]."""
        matrix_from_quaternion(self.world.base_orientation, self._rotation)
        return math.acos(min(1.0, float(self._rotation[:, 2] @ self.normal)))

    def start(self) -> None:
        """Stand up and enter the mode wair.

        Raises:
            RuntimeError: refused.
        """
        self.stand()
        accepted, message = self.controller.request_mode("wair")
        if not accepted:
            raise RuntimeError(message)
