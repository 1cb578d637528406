"""The planner as a process: goals by action, plans on its topic."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock

from husky_bringup.interfaces import Reader, running
from husky_bringup.system import NodeSpec
from husky_control.nodes.plan_message import from_message, to_message
from husky_msgs.action import PlanIncline
from husky_msgs.msg import InclinePlan
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

pytestmark = pytest.mark.graph

SPEC = NodeSpec("husky_control", graph.PLANNER, {"keep": False, "intervals": 12})


class Client:
    """Asks the planner."""

    def __init__(self, reader: Reader):
        self.reader = reader
        self.client = ActionClient(reader.node, PlanIncline, graph.PLAN_INCLINE)
        reader.wait_until(self.client.server_is_ready, "the planner's action")
        self.stages: list[str] = []

    def send(self, **fields: Any) -> Any:
        goal = {"slope": 0.5, "speed": 0.3, "friction_margin": 0.5, "thrust_mode": "vector"}
        self.stages.clear()
        future = self.client.send_goal_async(
            PlanIncline.Goal(**{**goal, **fields}),
            feedback_callback=lambda message: self.stages.append(message.feedback.stage),
        )
        return self.reader.result(future, "an answer to the goal")

    def plan(self, **fields: Any) -> tuple[int, Any]:
        handle = self.send(**fields)
        assert handle.accepted
        answer = self.reader.result(handle.get_result_async(), "a result")
        return answer.status, answer.result


@pytest.fixture(scope="module")
def planner(domain: int) -> Iterator[Client]:
    with running([SPEC]) as reader:
        yield Client(reader)


def test_a_goal_becomes_a_plan_on_the_topic_too(planner: Client) -> None:
    clock = planner.reader.node.create_publisher(Clock, graph.CLOCK, qos.CLOCK)
    now = Clock()
    now.clock.sec = 12
    telling = planner.reader.node.create_timer(0.05, lambda: clock.publish(now))
    planner.reader.wait(0.3)
    heard: list[InclinePlan] = []
    planner.reader.node.create_subscription(
        InclinePlan, graph.INCLINE_PLAN, heard.append, qos.LATCHED
    )
    status, result = planner.plan(slope=math.radians(45.0))
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert result.success
    assert "solving" in planner.stages
    assert stamps.to_ns(result.plan.stamp) == 12_000_000_000
    telling.cancel()
    plan = from_message(result.plan)
    assert plan.slope == pytest.approx(math.pi / 4)
    assert plan.friction == 0.7  # the parameter's
    assert plan.gait == "climb"
    assert np.linalg.norm(plan.thrust, axis=1).max() <= 40.0
    again = to_message(plan, result.plan.stamp)
    assert [list(p.stance) for p in again.points] == [list(p.stance) for p in result.plan.points]
    planner.reader.wait_until(lambda: bool(heard), "the plan on its topic")
    assert np.allclose(from_message(heard[-1]).thrust, plan.thrust)


def test_what_cannot_be_says_why(planner: Client) -> None:
    status, result = planner.plan(thrust_mode="none", slope=math.radians(45.0))
    assert status == GoalStatus.STATUS_ABORTED
    assert (result.success, result.reason, result.constraint) == (False, "infeasible", "thrust")
    assert "needs 32.3 N" in result.message
    assert not result.plan.points


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"slope": 3.0}, "slope"),
        ({"speed": math.nan}, "speed"),
        ({"thrust_mode": "sideways"}, "sideways"),
        ({"gait": "gallop"}, "gallop"),
        ({"friction_margin": 1.0}, "friction_margin"),
        ({"thrust_limit": -5.0}, "thrust_limit"),
    ],
)
def test_a_bad_goal_is_refused_by_name(planner: Client, fields: dict[str, Any], word: str) -> None:
    status, result = planner.plan(**fields)
    assert status == GoalStatus.STATUS_ABORTED
    assert result.reason == "request"
    assert word in result.message


def test_goals_at_once_are_answered_each(planner: Client) -> None:
    handles = [planner.send(slope=math.radians(degrees)) for degrees in (10.0, 20.0, 30.0)]
    futures = [handle.get_result_async() for handle in handles]
    slopes = [planner.reader.result(f, "a result").result.plan.slope for f in futures]
    assert slopes == pytest.approx([math.radians(d) for d in (10.0, 20.0, 30.0)])
