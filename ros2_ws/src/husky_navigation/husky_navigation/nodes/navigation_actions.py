"""The navigator's actions and services, with the interfaces of Nav2."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import (
    ComputePathToPose,
    FollowPath,
    FollowWaypoints,
    NavigateThroughPoses,
    NavigateToPose,
)
from nav2_msgs.msg import MissedWaypoint
from nav_msgs.msg import Path
from rclpy.action.server import ActionServer, CancelResponse, ServerGoalHandle
from rclpy.duration import Duration
from rclpy.node import Node
from std_srvs.srv import Trigger

from husky_navigation.following.navigation import Navigation, Outcome
from husky_navigation.following.robot_wish import RobotView
from husky_navigation.nodes.route_messages import pose_message
from husky_navigation.planning.route import PlanePose, Refusal, Route, RouteError
from husky_navigation.planning.route_search import Place
from husky_runtime import graph

_PLANNING = ComputePathToPose.Result
_REFUSALS = {
    Refusal.START_OUTSIDE: _PLANNING.START_OUTSIDE_MAP,
    Refusal.GOAL_OUTSIDE: _PLANNING.GOAL_OUTSIDE_MAP,
    Refusal.START_OCCUPIED: _PLANNING.START_OCCUPIED,
    Refusal.GOAL_OCCUPIED: _PLANNING.GOAL_OCCUPIED,
    Refusal.NO_WAY: _PLANNING.NO_VALID_PATH,
    Refusal.BATTERY: _PLANNING.NO_VALID_PATH,
    Refusal.OFF_PATH: FollowPath.Result.INVALID_PATH,
    Refusal.PATH_BLOCKED: FollowPath.Result.INVALID_PATH,
}
"""Codes of Nav2 for reasons why there is no route."""
_FOLLOWING = FollowPath.Result
_OUTCOMES = {
    Outcome.REACHED: _FOLLOWING.NONE,
    Outcome.STUCK: _FOLLOWING.FAILED_TO_MAKE_PROGRESS,
    Outcome.UNSEEN: _FOLLOWING.NO_VALID_CONTROL,
    Outcome.NOT_CHANGED: _FOLLOWING.NO_VALID_CONTROL,
    Outcome.LOST: _FOLLOWING.TF_ERROR,
}
"""Codes of Nav2 for ends of a navigation; of the others UNKNOWN."""
_ENDS_A_TOUR = (Outcome.REPLACED, Outcome.STOPPED, Outcome.LOST, Outcome.NOT_READY)
"""Ends after which no other waypoint is gone to."""
_LOOK = 0.5
"""Longest wall time between two looks at whether a goal is cancelled [s]."""


class Errand:
    """One navigation, whose end another thread may wait for.

    Attributes:
        navigation: what is done.
        begun: time of its first step [s], None before.
        view: what the robot has told last, None before the first step.
        cancelled: set by whoever wants it to stop.
    """

    def __init__(self, navigation: Navigation) -> None:
        """Begin with the next step."""
        self.navigation = navigation
        self.begun: float | None = None
        self.view: RobotView | None = None
        self.cancelled = False
        self._news = threading.Condition()

    def tell(self, view: RobotView | None) -> None:
        """Wake whoever waits: a step was made, or it has ended."""
        with self._news:
            if view is not None and self.begun is None:
                self.begun = view.time
            self.view = view or self.view
            self._news.notify_all()

    def wait(self, timeout: float) -> bool:
        """Wait for the next step for a while of wall time [s]; return whether it has ended."""
        with self._news:
            if self.navigation.outcome is None:
                self._news.wait(timeout)
            return self.navigation.outcome is not None


class GoalTaker(Protocol):
    """Do for the actions what they are asked for."""

    def goal_of(self, message: PoseStamped) -> PlanePose:
        """Return a goal; raises ValueError for a frame other than `map`."""

    def here(self) -> PlanePose:
        """Return where the robot is in `map`; raises ValueError if it does not know."""

    def altitude(self) -> float | None:
        """Return the height of the base in `map` of a robot in flight [m], None on the ground."""

    def begin(self, goals: Sequence[PlanePose], after: Errand | None = None) -> Errand:
        """Go to goals; a navigation that goes on is replaced, but for one that came after a given
        errand.
        """

    def begin_along(self, poses: Sequence[PlanePose]) -> Errand:
        """Go along a path; raises ValueError if it has no two places."""

    def plan(
        self,
        start: PlanePose,
        goal: PlanePose,
        closed: tuple[Place, ...] = (),
        altitude: float | None = None,
    ) -> Route:
        """Return the cheapest route, of a robot in the air from its altitude [m]; raises RouteError
        for none.
        """

    def path_of(self, route: Route) -> Path:
        """Return a route as a path."""


class NavigationActions:
    """Takes goals by action; each runs in a thread of its own, and waits for the navigator.

    The services are what RViz's Nav2 panel and `nav2_simple_commander` look for before they send a
    goal.
    """

    def __init__(self, node: Node, taker: GoalTaker, *, stop_on_failure: bool) -> None:
        """Offer actions and services.

        Args:
            node: that offers them.
            taker: does what they ask for.
            stop_on_failure: a waypoint that cannot be reached ends its tour.
        """
        self._taker, self._stop_on_failure = taker, stop_on_failure
        offered: tuple[tuple[type, str, Callable[[ServerGoalHandle], Any]], ...] = (
            (NavigateToPose, graph.NAVIGATE_TO_POSE, self._to_pose),
            (NavigateThroughPoses, graph.NAVIGATE_THROUGH_POSES, self._through_poses),
            (ComputePathToPose, graph.COMPUTE_PATH, self._compute_path),
            (FollowPath, graph.FOLLOW_PATH, self._follow_path),
            (FollowWaypoints, graph.FOLLOW_WAYPOINTS, self._follow_waypoints),
        )
        self._servers = [
            ActionServer(
                node,
                kind,
                name,
                execute_callback=execute,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
            for kind, name, execute in offered
        ]
        node.create_service(Trigger, graph.NAVIGATION_ACTIVE, partial(_say_active, lambda: ""))
        node.create_service(Trigger, graph.LOCALIZATION_ACTIVE, partial(_say_active, self._lost))
        node.create_service(GetState, graph.BT_NAVIGATOR_STATE, _say_state)

    def close(self) -> None:
        """Take no more goals."""
        for server in self._servers:
            server.destroy()

    # Navigation ---------------------------------------------------------------------------------
    def _to_pose(self, handle: ServerGoalHandle) -> NavigateToPose.Result:
        return self._navigate(handle, NavigateToPose, [handle.request.pose])

    def _through_poses(self, handle: ServerGoalHandle) -> NavigateThroughPoses.Result:
        return self._navigate(handle, NavigateThroughPoses, handle.request.poses)

    def _navigate(
        self, handle: ServerGoalHandle, kind: Any, goals: Sequence[PoseStamped]
    ) -> NavigateToPose.Result | NavigateThroughPoses.Result:
        """Go to goals and tell how it goes; the result is one of an action's kind."""
        try:
            if not goals:
                raise ValueError("there are no poses")
            self._taker.here()
            errand = self._taker.begin([self._taker.goal_of(goal) for goal in goals])
        except ValueError as error:
            handle.abort()
            return kind.Result(error_code=_FOLLOWING.TF_ERROR, error_msg=str(error))
        return self._end(handle, kind, _wait(handle, errand, lambda e: _feedback(e, kind)))

    def _follow_path(self, handle: ServerGoalHandle) -> FollowPath.Result:
        """Go along a path; an empty `frame_id` of a pose is that of the path."""
        path = handle.request.path
        try:
            self._taker.here()
            for pose in path.poses:
                pose.header.frame_id = pose.header.frame_id or path.header.frame_id
            errand = self._taker.begin_along([self._taker.goal_of(pose) for pose in path.poses])
        except ValueError as error:
            handle.abort()
            return FollowPath.Result(error_code=_FOLLOWING.INVALID_PATH, error_msg=str(error))

        def feedback(errand: Errand) -> FollowPath.Feedback:
            assert errand.view is not None
            left, speed = errand.navigation.left, errand.view.speed
            return FollowPath.Feedback(distance_to_goal=left, speed=speed)

        return self._end(handle, FollowPath, _wait(handle, errand, feedback))

    def _follow_waypoints(self, handle: ServerGoalHandle) -> FollowWaypoints.Result:
        """Go to poses one after the other, and stop at each; then all over again, as asked."""
        request, result = handle.request, FollowWaypoints.Result()
        try:
            self._taker.here()
            goals = [self._taker.goal_of(pose) for pose in request.poses]
            if request.goal_index >= len(goals):
                count = len(goals)
                raise ValueError(f"goal_index is {request.goal_index}, there are {count} poses")
        except ValueError as error:
            handle.abort()
            result.error_code, result.error_msg = result.UNKNOWN, str(error)
            return result
        tour = range(len(goals) * (request.number_of_loops + 1))
        errand: Errand | None = None
        for index in (each % len(goals) for each in tour[request.goal_index :]):
            feedback = partial(_same, FollowWaypoints.Feedback(current_waypoint=index))
            errand = self._taker.begin([goals[index]], errand)
            navigation = _wait(handle, errand, feedback)
            if navigation.outcome is Outcome.REACHED:
                continue
            result.error_msg = f"waypoint {index}: {navigation.reason}"
            if navigation.outcome is Outcome.CANCELLED:
                handle.canceled()
                return result
            missed = MissedWaypoint(index=index, goal=request.poses[index])
            missed.error_code = _code_of(navigation)
            result.missed_waypoints.append(missed)
            if self._stop_on_failure or navigation.outcome in _ENDS_A_TOUR:
                handle.abort()
                result.error_code = result.TASK_EXECUTOR_FAILED
                return result
        handle.succeed()
        return result

    def _end(self, handle: ServerGoalHandle, kind: Any, navigation: Navigation) -> Any:
        """Return the result of an action that was one navigation."""
        if navigation.outcome is Outcome.REACHED:
            handle.succeed()
        elif navigation.outcome is Outcome.CANCELLED:
            handle.canceled()
        else:
            handle.abort()
        return kind.Result(error_code=_code_of(navigation), error_msg=_message_of(navigation))

    # Planning -----------------------------------------------------------------------------------
    def _compute_path(self, handle: ServerGoalHandle) -> ComputePathToPose.Result:
        request, result, begun = handle.request, _PLANNING(), time.monotonic()
        try:
            goal = self._taker.goal_of(request.goal)
            use_start = request.use_start
            start = self._taker.goal_of(request.start) if use_start else self._taker.here()
            altitude = None if use_start else self._taker.altitude()
            route = self._taker.plan(start, goal, altitude=altitude)
        except RouteError as error:
            result.error_code, result.error_msg = _REFUSALS[error.refusal], str(error)
        except ValueError as error:
            result.error_code, result.error_msg = _PLANNING.TF_ERROR, str(error)
        else:
            result.path = self._taker.path_of(route)
        result.planning_time = Duration(seconds=time.monotonic() - begun).to_msg()
        if result.error_code:
            handle.abort()
        else:
            handle.succeed()
        return result

    def _lost(self) -> str:
        """Return why the robot does not know where it is, "" if it does."""
        try:
            self._taker.here()
        except ValueError as error:
            return str(error)
        return ""


def _wait(
    handle: ServerGoalHandle, errand: Errand, feedback: Callable[[Errand], Any]
) -> Navigation:
    """Wait for the end of an errand, and tell how it goes; return its navigation.

    An errand of which nobody is told any more is cancelled.
    """
    try:
        while not errand.wait(_LOOK):
            errand.cancelled = errand.cancelled or handle.is_cancel_requested
            if errand.view is not None and handle.is_active:
                handle.publish_feedback(feedback(errand))
    except Exception:
        errand.cancelled = True
        raise
    return errand.navigation


def _same(feedback: Any, _: Errand) -> Any:
    return feedback


def _feedback(errand: Errand, kind: Any) -> Any:
    """Return how a navigation goes."""
    navigation, view = errand.navigation, errand.view
    assert view is not None and errand.begun is not None
    feedback = kind.Feedback(
        current_pose=pose_message(view.pose, 0.0, round(1e9 * view.time)),
        navigation_time=Duration(seconds=view.time - errand.begun).to_msg(),
        estimated_time_remaining=Duration(seconds=navigation.time_left).to_msg(),
        number_of_recoveries=navigation.recoveries,
        distance_remaining=navigation.left,
    )
    if kind is NavigateThroughPoses:
        feedback.number_of_poses_remaining = navigation.goals_left
    return feedback


def _code_of(navigation: Navigation) -> int:
    """Return Nav2's code of an end."""
    if navigation.outcome is Outcome.NO_ROUTE and navigation.refusal is not None:
        return int(_REFUSALS[navigation.refusal])
    assert navigation.outcome is not None
    return int(_OUTCOMES.get(navigation.outcome, _FOLLOWING.UNKNOWN))


def _message_of(navigation: Navigation) -> str:
    return "" if navigation.outcome is Outcome.REACHED else navigation.reason


def _say_active(
    fault: Callable[[], str], _: Trigger.Request, response: Trigger.Response
) -> Trigger.Response:
    response.message = fault()
    response.success = not response.message
    return response


def _say_state(_: GetState.Request, response: GetState.Response) -> GetState.Response:
    response.current_state = State(id=State.PRIMARY_STATE_ACTIVE, label="active")
    return response
