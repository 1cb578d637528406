"""Journeys: goals sent to the navigator by Nav2's action, as any client sends them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose

from husky_bringup.system import ParameterValue
from husky_experiments.morph_scripts import beta_settings
from husky_experiments.session import Session, SessionError
from husky_experiments.steering import heading_of
from husky_navigation.planning.route import PlanePose
from husky_navigation.planning.route_planner import RoutePlanner
from husky_runtime import graph
from husky_sim.lab_world import lab_world
from husky_sim.obstacle_world import ObstacleWorld
from husky_sim.random_world import random_world

OBSTACLES, LAB = "obstacles", "lab"
WORLDS: dict[str, Callable[[np.random.Generator], ObstacleWorld]] = {
    OBSTACLES: random_world,
    LAB: lab_world,
}
"""Makers of random worlds, by the name of the plant's terrain."""
REACHED_WITHIN = {"carbon": (0.2, 0.3), "beta": (0.15, 0.5)}
"""Distance [m] and angle [rad] from a goal within which each robot has reached it."""
_LOOK = 0.1
"""Simulated time between two looks: the navigator's period [s]."""


class Traveller:
    """Sends the robot of a session to goals.

    Attributes:
        goal: that was sent last.
        recoveries: of the newest journey.
    """

    def __init__(self, session: Session) -> None:
        """Find the action.

        Raises:
            SessionError: it is not there.
        """
        self._session = session
        self._client = session.add_action(NavigateToPose, graph.NAVIGATE_TO_POSE)
        self._handle: Any = None
        self._result: Any = None
        self.goal = PlanePose(math.nan, math.nan, math.nan)
        self.recoveries = 0

    def send(self, goal: PlanePose) -> None:
        """Send a goal in `map`; one that goes on is replaced.

        Raises:
            SessionError: it is not accepted.
        """
        self.goal = goal
        pose = PoseStamped()
        pose.header.frame_id = graph.FRAME_MAP
        pose.pose.position.x, pose.pose.position.y = float(goal.x), float(goal.y)
        turn = pose.pose.orientation
        turn.z, turn.w = math.sin(0.5 * goal.yaw), math.cos(0.5 * goal.yaw)
        sent = self._client.send_goal_async(NavigateToPose.Goal(pose=pose), self._on_feedback)
        self._session.wait_for(sent.done, "an answer to a goal")
        self._handle = sent.result()
        if not self._handle.accepted:
            raise SessionError(f"the goal {goal} is not accepted")
        self._result = self._handle.get_result_async()
        self.recoveries = 0

    def cancel(self) -> None:
        """Cancel the goal that was sent last."""
        answer = self._handle.cancel_goal_async()
        self._session.wait_for(answer.done, "an answer to a cancellation")

    def go_on(self, within: float) -> bool:
        """Let time go by until the journey ends; return whether it did within a time [s]."""
        end = self._session.time + within
        while not self._result.done():
            if self._session.time > end - 1e-9:
                return False
            self._session.advance(_LOOK)
        return True

    @property
    def said(self) -> str:
        """The navigator's reason for the end, "" if the goal is reached."""
        return str(self._result.result().result.error_msg)

    def _on_feedback(self, message: Any) -> None:
        self.recoveries = int(message.feedback.number_of_recoveries)


def journey_settings(
    seed: int, robot: str = "carbon", course: str = OBSTACLES
) -> dict[str, dict[str, ParameterValue]]:
    """Return the parameters of a robot that sees and has fans, in the random world of a seed.

    Args:
        seed: of the world and all sensor noise.
        robot: `carbon`, or `beta`, whose legs become the arms of a quadrotor.
        course: name of one of `WORLDS`.
    """
    return seeing_settings(robot, seed, {"terrain": course})


def seeing_settings(
    robot: str, seed: int, plant: Mapping[str, ParameterValue]
) -> dict[str, dict[str, ParameterValue]]:
    """Return the parameters of a robot that sees and has fans, with more of the plant's."""
    plant = {**plant, "camera": True}
    if robot == "beta":
        return beta_settings(seed, plant=plant)
    carbon: dict[str, ParameterValue] = {"mounting": "vectoring", "body": "robot_with_unit"}
    return {graph.PLANT: {**plant, **carbon, "seed": seed}}


def off_goal(session: Session, goal: PlanePose) -> tuple[float, float]:
    """Return the true distance [m] and angle [rad] of the base from a goal."""
    assert session.truth is not None
    at, turn = session.truth.pose.pose.position, session.truth.pose.pose.orientation
    yaw = heading_of((turn.x, turn.y, turn.z, turn.w))
    away = math.remainder(yaw - goal.yaw, 2.0 * math.pi)
    return math.hypot(at.x - goal.x, at.y - goal.y), abs(away)


def planner_of(world: ObstacleWorld, robot: str = "carbon") -> RoutePlanner:
    """Return a planner that has seen all ground of a world, as it truly is."""
    planner = RoutePlanner(robot)
    x, y = np.meshgrid(*planner.world.lattice.cell_centers(), indexing="ij")
    planner.world.elevation[:] = world.height_at(x, y)
    return planner
