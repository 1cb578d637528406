"""Node `planner`: plans a gait cycle on a slope for whoever asks by action."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence

from rclpy.action.server import ActionServer, CancelResponse, ServerGoalHandle
from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_control.gait.table import GAITS
from husky_control.nodes.plan_markers import PlanMarkers
from husky_control.nodes.plan_message import to_message
from husky_control.planning.collocation.compiled import cache_directory
from husky_control.planning.collocation.planner import PlanFailure, Planner
from husky_control.planning.collocation.request import PlanRequest, machine_of
from husky_control.planning.plan import Plan
from husky_description.robot import Robot
from husky_msgs.action import PlanIncline
from husky_msgs.msg import InclinePlan
from husky_msgs.srv import PlanCycle
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.run import run


class PlannerNode(OneClock, Node):
    """Answers goals one after the other, each in a thread of its own, and publishes every plan.

    A goal that is cancelled while it is being solved is solved to its end, and then dropped.
    """

    def __init__(self) -> None:
        """Declare parameters; nothing is derived before the first goal."""
        super().__init__(graph.PLANNER)
        robot = declare_robot(self)
        declare(
            self,
            "friction",
            float(robot.contact.friction),
            "coefficient of friction where a goal gives none [-]",
            lower=0.05,
            upper=3.0,
            read_only=False,
        )
        self._gait = declare(
            self, "gait", "climb", "gait where a goal gives none", allowed=tuple(GAITS)
        )
        self._intervals = declare(
            self, "intervals", 20, "of the collocation in a cycle [-]", lower=8, upper=100
        )
        self._planner = self._make_planner(robot)
        self._one_at_a_time = threading.Lock()
        self._made = self._failed = 0
        self._last = "no goal yet"
        self.hot: Sequence[Subscription] = []
        self._plans = self.create_publisher(InclinePlan, graph.INCLINE_PLAN, qos.LATCHED)
        self._markers = PlanMarkers(self)
        self._server = ActionServer(
            self,
            PlanIncline,
            graph.PLAN_INCLINE,
            execute_callback=self._execute,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self.create_service(PlanCycle, graph.PLAN_CYCLE, self._on_plan_cycle)
        self._diagnostics = diagnostics.Diagnostics(self, "planner", self._report)

    def _make_planner(self, robot: Robot) -> Planner:
        compiled = declare(
            self, "compile", True, "derivatives become machine code, where there is a C compiler"
        )
        keep = declare(
            self, "keep", True, "plans are kept in the user's cache directory and found there again"
        )
        directory = cache_directory() / "plans" if keep else None
        return Planner(machine_of(robot), directory, compiled)

    def _on_plan_cycle(
        self, request: PlanCycle.Request, response: PlanCycle.Response
    ) -> PlanCycle.Response:
        """Answer the controller; who asks by action meanwhile is served first."""
        goal = PlanIncline.Goal(
            slope=request.slope,
            speed=request.speed,
            friction=request.load_slope,
            thrust_mode=request.thrust_mode,
            gait="climb",
            thrust_limit=request.thrust_limit,
        )
        with self._one_at_a_time:
            result = self._plan(goal)
        self._count(result)
        response.success, response.message = result.success, result.message
        response.plan = result.plan
        return response

    def _count(self, result: PlanIncline.Result) -> None:
        self._last = result.message
        self._made += result.success
        self._failed += not result.success

    def _execute(self, goal: ServerGoalHandle) -> PlanIncline.Result:
        begun = time.monotonic()
        with self._one_at_a_time:
            goal.publish_feedback(
                PlanIncline.Feedback(stage="solving", elapsed=time.monotonic() - begun)
            )
            result = self._plan(goal.request)
        if goal.is_cancel_requested:
            goal.canceled()
            return PlanIncline.Result(reason="cancelled", message="cancelled")
        self._count(result)
        if result.success:
            self._plans.publish(result.plan)
            goal.succeed()
        else:
            goal.abort()
        self.get_logger().info(f"{result.message} ({time.monotonic() - begun:.2f} s)")
        return result

    def _plan(self, goal: PlanIncline.Goal) -> PlanIncline.Result:
        try:
            plan = self._planner.plan(self._request(goal))
        except ValueError as error:
            return PlanIncline.Result(reason="request", message=f"request: {error}")
        except PlanFailure as failure:
            return PlanIncline.Result(
                reason=failure.reason, constraint=failure.constraint, message=str(failure)
            )
        self._markers.show(plan)
        stamp = self.get_clock().now().to_msg()
        return PlanIncline.Result(
            success=True, message=_describe(plan), plan=to_message(plan, stamp)
        )

    def _request(self, goal: PlanIncline.Goal) -> PlanRequest:
        return PlanRequest(
            slope=goal.slope,
            speed=goal.speed,
            friction=goal.friction or self.get_parameter("friction").value,
            friction_margin=goal.friction_margin,
            thrust_mode=goal.thrust_mode,
            gait=goal.gait or self._gait,
            thrust_limit=goal.thrust_limit or None,
            intervals=self._intervals,
        )

    def _report(self) -> diagnostics.Report:
        values = {
            "plans": self._made,
            "failures": self._failed,
            "warm_starts": self._planner.warm_starts,
            "planning": self._one_at_a_time.locked(),
            "last": self._last,
        }
        message = "planning" if self._one_at_a_time.locked() else "ready"
        store = self._planner.store
        if store is None:
            return diagnostics.OK, message, values
        values |= {"dropped_files": store.dropped, "problem": store.problem}
        if store.problem:
            return diagnostics.WARN, f"{message}; {store.problem}", values
        return diagnostics.OK, message, values

    def quiet(self) -> None:
        """Nothing to do: goals wake the node."""

    def close(self) -> None:
        """Take no more goals."""
        self._server.destroy()


def _describe(plan: Plan) -> str:
    """A plan in one line."""
    thrust = (plan.thrust**2).sum(axis=1) ** 0.5
    return (
        f"{plan.gait} at {plan.speed:.2f} m/s on {57.29578 * plan.slope:.1f} deg, thrust "
        f"{thrust.min():.1f} to {thrust.max():.1f} N ({plan.thrust_mode})"
    )


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(PlannerNode)


if __name__ == "__main__":
    sys.exit(main())
