"""The robot on a ramp in one process, and its planner; the thrust is a force behind a lag."""

from __future__ import annotations

import math

import numpy as np
from in_process import InProcessRobot

from husky_control.plan_query import PlanQuery, next_query
from husky_control.planning.collocation.planner import Planner
from husky_control.planning.collocation.request import PlanRequest
from husky_control.planning.plan import Plan
from husky_control.rotation import matrix_from_quaternion
from husky_description.robot import load_robot
from husky_runtime import graph
from husky_sim.terrain import TerrainOptions
from husky_sim.world import WorldOptions

LAG, DELAY = 0.08, 10
"""Of the thrust [s], and ticks on its way to the fans."""
APPROACH, BLEND = 0.5, 0.8
"""Flat ground before the robot, and radius of the foot of the slope [m]."""
PLAN_DELAY = 100
"""Ticks from the question for a plan until it is followed."""
PLAN_INTERVALS = 20


class ClimbingRobot(InProcessRobot):
    """A robot whose fans push in any direction at its centre of mass, or along its z axis alone.

    Attributes:
        fans: they are armed and follow.
        limit: most thrust that they can make [N].
        thrust: in world [N] (3,).
        slope: of the ground [rad].
        planner: who is asked for plans, if anybody.
        blend: radius of the foot of the slope [m].
    """

    def __init__(
        self,
        slope_deg: float,
        seed: int = 0,
        *,
        blend: float = BLEND,
        length: float = 12.0,
        mounting: str = "vectoring",
        **options: float,
    ):
        """On the flat before a slope whose foot has a radius; options of `WorldOptions` beside."""
        self.slope, self.blend = math.radians(slope_deg), blend
        ground = TerrainOptions(
            kind="ramp", slope=self.slope, approach=APPROACH, blend=blend, length=length
        )
        robot = load_robot(fans__mounting=mounting)
        super().__init__(WorldOptions(terrain=ground, seed=seed, **options), robot)
        self.fans = True
        self.limit = math.inf
        self.thrust = np.zeros(3)
        self._rotation = np.eye(3)
        self._in_base = np.zeros(3)
        self._commands = [np.zeros(3)] * DELAY
        self._directions = np.array([1.0, 1.0, 1.0] if mounting == "vectoring" else [0.0, 0.0, 1.0])
        self.planner: Planner | None = None
        self._query: PlanQuery | None = None
        self._plan: Plan | None = None
        self._plan_due = 0

    def tick(self) -> None:
        """Advance by 2 ms."""
        self.measurements.fans_available = self.fans
        self.measurements.fans_limit = self.limit
        matrix_from_quaternion(self.world.base_orientation, self._rotation)
        self._commands.append(self.controller.context.thrust_in_base.copy())
        asked = self._commands.pop(0) if self.fans else np.zeros(3)
        asked = asked * self._directions
        self._in_base += (asked - self._in_base) * graph.TICK_PERIOD / LAG
        self.thrust = self._rotation @ self._in_base
        self.world.data.body("base").xfrc_applied[:3] = self.thrust
        if self.planner is not None:
            self._plan_ahead(self.planner)
        super().tick()

    def _plan_ahead(self, planner: Planner) -> None:
        """Ask for one plan at a time, and follow it a moment later, as the controller's node."""
        self._plan_due -= 1
        if self._plan_due > 0:
            return
        if self._plan is not None:
            self.controller.take_plan(self._plan)
            self._plan = None
        query = next_query(self.controller, self._query)
        if query is not None:
            self._query, self._plan_due = query, PLAN_DELAY
            self._plan = planner.plan(
                PlanRequest(
                    slope=query.slope,
                    speed=query.speed,
                    friction=query.load_slope,
                    friction_margin=0.0,
                    thrust_mode=query.thrust_mode,
                    thrust_limit=query.thrust_limit,
                    gait="climb",
                    intervals=PLAN_INTERVALS,
                )
            )

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

    def clearance(self) -> np.ndarray:
        """Distance of each foot from the ground [m] (4,)."""
        heights = []
        for x, _, z in self.world.foot_positions():
            ahead, below = x - APPROACH, self.blend - z  # of the middle of the foot's arc
            turned = math.atan2(ahead, below)
            if turned < 0.0:
                height = z
            elif turned < self.slope:
                height = self.blend - math.hypot(ahead, below)
            else:
                height = self.blend - ahead * math.sin(self.slope) - below * math.cos(self.slope)
            heights.append(height - self.controller.robot.foot_radius)
        return np.array(heights)

    def start(self) -> None:
        """Stand up and enter the mode wair.

        Raises:
            RuntimeError: refused.
        """
        self.stand()
        accepted, message = self.controller.request_mode("wair")
        if not accepted:
            raise RuntimeError(message)
