"""The process `navigator` between a controller that moves as it is told and Nav2's clients."""

import math

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from grid_map_msgs.msg import GridMap
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import (
    ComputePathToPose,
    FollowPath,
    FollowWaypoints,
    NavigateThroughPoses,
    NavigateToPose,
)
from nav_msgs.msg import Odometry, Path
from node_bench import NodeBench, assert_refused, every, values_of
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float32MultiArray, MultiArrayDimension, MultiArrayLayout
from std_srvs.srv import SetBool, Trigger

from husky_msgs.msg import ControllerState, NavigatorState, PropulsionState
from husky_msgs.srv import SetFlightMode, SetMode
from husky_navigation.grid_layout import to_grid_map
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

pytestmark = pytest.mark.graph

MODULE = "husky_navigation.nodes.navigator"
PERIOD = 0.1
CELLS, RESOLUTION = 200, 0.05
WALL_X = 2.5
"""Where a wall from y = -5 to 1 stands [m]."""
SHIFT = 1.0, 0.5, 0.3
"""Of `odom` in `map`: x, y [m] and yaw [rad]."""


class NavigatorBench(NodeBench):
    """A robot on flat ground with a wall, which does exactly as it is told.

    Attributes:
        pose: of the base in `map`: x, y, yaw.
        mode: of its controller.
        sees: a map comes each second.
        states: what the navigator has told.
    """

    def __init__(self, domain, directory, **parameters):
        super().__init__(domain, directory, MODULE)
        self.pose, self.mode, self.asked, self.time = np.zeros(3), "stand", [], 0.0
        self.states, self._twist, self.sees = [], Twist(), False
        made = {
            ControllerState: graph.CONTROLLER_STATE,
            Odometry: graph.ODOMETRY,
            PoseWithCovarianceStamped: graph.MAP_POSE,
            PropulsionState: graph.PROPULSION_STATE,
            GridMap: graph.ELEVATION_MAP,
            Clock: graph.CLOCK,
            PoseStamped: graph.GOAL_POSE,
        }
        self._publishers = {
            kind: self.node.create_publisher(kind, name, qos.OFFERED[graph.topic(name).qos])
            for kind, name in made.items()
        }
        for kind, name, take in (
            (NavigatorState, graph.NAVIGATOR_STATE, self.states.append),
            (Twist, graph.CMD_VEL, self._on_twist),
        ):
            profile = qos.PROFILES[graph.topic(name).qos]
            self.node.create_subscription(kind, name, take, profile)
        self.node.create_service(SetMode, graph.SET_MODE, self._on_set_mode)
        self.node.create_service(SetFlightMode, graph.PROPULSION_SET_MODE, self._on_request)
        self.node.create_service(SetBool, graph.PROPULSION_ARM, self._on_request)
        self.start(**parameters)
        self.to_pose = ActionClient(self.node, NavigateToPose, graph.NAVIGATE_TO_POSE)
        self.through = ActionClient(self.node, NavigateThroughPoses, graph.NAVIGATE_THROUGH_POSES)
        self.compute = ActionClient(self.node, ComputePathToPose, graph.COMPUTE_PATH)
        self.along = ActionClient(self.node, FollowPath, graph.FOLLOW_PATH)
        self.waypoints = ActionClient(self.node, FollowWaypoints, graph.FOLLOW_WAYPOINTS)
        self.feedback = []
        for client in (self.to_pose, self.through, self.compute, self.along, self.waypoints):
            self.wait(client.server_is_ready, "the actions")

    def _on_twist(self, twist):
        self._twist = twist

    def _on_set_mode(self, request, response):
        self.asked.append(request.mode)
        self.mode, response.success = request.mode, True
        return response

    def _on_request(self, request, response):
        self.asked.append(request)
        response.success = True
        return response

    # The robot ----------------------------------------------------------------------------------
    def tell(self):
        """Tell where the robot is now."""
        stamp = round(1e9 * self.time)
        x, y, yaw = self.pose
        (dx, dy, turn), odometry = SHIFT, Odometry()
        c, s = math.cos(turn), math.sin(turn)
        place(odometry.pose.pose, c * (x - dx) + s * (y - dy), c * (y - dy) - s * (x - dx))
        turn_by(odometry.pose.pose, yaw - turn)
        pose, state = PoseWithCovarianceStamped(), ControllerState(mode=self.mode)
        place(pose.pose.pose, x, y)
        turn_by(pose.pose.pose, yaw)
        state.orientation[3] = 1.0
        for message in (odometry, pose):
            stamps.fill(message.header.stamp, stamp)
        stamps.fill(state.stamp, stamp)
        for message in (state, odometry, pose):
            self._publishers[type(message)].publish(message)

    def step(self):
        """Let a tenth of a second go by, and the navigator answer it."""
        if self.mode == "walk":
            v, c, s = self._twist, math.cos(self.pose[2]), math.sin(self.pose[2])
            forward, left = v.linear.x, v.linear.y
            velocity = c * forward - s * left, s * forward + c * left, v.angular.z
            self.pose += PERIOD * np.array(velocity)
        self.time += PERIOD
        if self.sees and round(10 * self.time) % 10 == 0:
            self.see()
        self.tell()
        now = round(1e9 * self.time)
        self.wait(
            lambda: self.states and stamps.to_ns(self.states[-1].stamp) >= now,
            "an answer",
            every(0.2, self.tell),
        )

    def go_on_until(self, condition, what, most=600):
        """Step until something is true."""
        for _ in range(most):
            if condition():
                return
            self.step()
        pytest.fail(f"{what} does not come; {self.states[-1]}; {self.said()}")

    def see(self, walled=True, age=0.0):
        """Tell a map of the ground, in `odom`, all of it measured some time before [s]."""
        edge = (np.arange(CELLS) + 0.5 - CELLS // 2) * RESOLUTION
        x, y = np.meshgrid(edge, edge, indexing="ij")
        dx, dy, turn = SHIFT
        c, s = math.cos(turn), math.sin(turn)
        in_map = dx + c * x - s * y, dy + s * x + c * y
        wall = (np.abs(in_map[0] - WALL_X) < 0.1) & (in_map[1] < 1.0)
        elevation = np.where(wall & walled, 0.8, 0.0)
        message = GridMap(layers=["elevation", "age"], basic_layers=["elevation"])
        for layer in map(to_grid_map, (elevation, np.full_like(elevation, age))):
            dim = [MultiArrayDimension(**each._asdict()) for each in layer.dim]
            layout = MultiArrayLayout(dim=dim)
            message.data.append(Float32MultiArray(layout=layout, data=layer.data.tolist()))
        message.header.frame_id = "odom"
        stamps.fill(message.header.stamp, round(1e9 * self.time))
        message.info.resolution = RESOLUTION
        message.info.length_x = message.info.length_y = CELLS * RESOLUTION
        self._publishers[GridMap].publish(message)

    # Clients ------------------------------------------------------------------------------------
    def send(self, client, **goal):
        """Send a goal, which is accepted, and return its handle."""
        kind = client._action_type.Goal
        sent = client.send_goal_async(kind(**goal), lambda m: self.feedback.append(m.feedback))
        self.wait(sent.done, "an answer to a goal")
        assert sent.result().accepted
        return sent.result()

    def result(self, handle):
        """Go on until a goal has ended; return its status and its result."""
        future = handle.get_result_async()
        self.go_on_until(future.done, "a result")
        return future.result().status, future.result().result


def place(pose, x, y):
    pose.position.x, pose.position.y = float(x), float(y)


def turn_by(pose, yaw):
    pose.orientation.z, pose.orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def goal_at(x, y, yaw=0.0, frame="map"):
    """Return a goal."""
    goal = PoseStamped()
    goal.header.frame_id = frame
    place(goal.pose, x, y)
    turn_by(goal.pose, yaw)
    return goal


@pytest.fixture(scope="module")
def robot(domain, tmp_path_factory):
    """One navigator for all tests: each begins where the robot of the last one has ended."""
    bench = NavigatorBench(domain, tmp_path_factory.mktemp("bench"))
    yield bench
    bench.close()


def assert_at(robot, x, y, yaw):
    """Check that the robot stands at a goal."""
    assert math.hypot(robot.pose[0] - x, robot.pose[1] - y) < 0.1
    assert abs(math.remainder(robot.pose[2] - yaw, 2.0 * math.pi)) < 0.1
    assert robot.mode == "stand"


def test_it_says_that_it_is_ready(robot):
    robot.step()
    assert robot.call(Trigger, graph.NAVIGATION_ACTIVE).success
    assert robot.call(Trigger, graph.LOCALIZATION_ACTIVE).success
    state = robot.call(GetState, graph.BT_NAVIGATOR_STATE).current_state
    assert state.id == State.PRIMARY_STATE_ACTIVE


def test_it_goes_around_a_wall_and_tells_how_far_it_is(robot):
    robot.sees = True
    robot.see()
    robot.wait_for_report(lambda r: int(values_of(r)["maps"]) > 0, "the map")
    status, result = robot.result(robot.send(robot.to_pose, pose=goal_at(4.0, 0.0, 1.0)))
    assert (status, result.error_code, result.error_msg) == (GoalStatus.STATUS_SUCCEEDED, 0, "")
    assert_at(robot, 4.0, 0.0, 1.0)
    assert robot.asked == ["walk", "stand"]
    left = [each.distance_remaining for each in robot.feedback]
    times = [stamps.to_ns(each.navigation_time) for each in robot.feedback]
    assert 5.0 < max(left) < 8.0
    assert min(left) < 0.5
    assert times == sorted(times)
    assert times[-1] > 5_000_000_000
    assert max(each.current_pose.pose.position.y for each in robot.feedback) > 1.2
    robot.step()
    assert (robot.states[-1].phase, robot.states[-1].outcome) == ("idle", "the goal is reached")


def test_poses_are_gone_through_in_order(robot):
    robot.feedback.clear()
    poses = [goal_at(4.5, 1.0, 1.5), goal_at(4.0, 2.0, 3.0)]
    status, result = robot.result(robot.send(robot.through, poses=poses))
    assert (status, result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0)
    assert_at(robot, 4.0, 2.0, 3.0)
    remaining = [each.number_of_poses_remaining for each in robot.feedback]
    assert set(remaining) >= {2, 1}
    assert remaining == sorted(remaining, reverse=True)


@pytest.mark.parametrize(
    ("goal", "code", "words"),
    [
        (goal_at(2.5, 0.0), ComputePathToPose.Result.GOAL_OCCUPIED, "obstacle"),
        (goal_at(20.0, 0.0), ComputePathToPose.Result.GOAL_OUTSIDE_MAP, "off the map"),
        (goal_at(0.0, 0.0, frame="odom"), ComputePathToPose.Result.TF_ERROR, "must be 'map'"),
        (goal_at(math.nan, 0.0), ComputePathToPose.Result.TF_ERROR, "position is nan"),
        (goal_at(1.0, 0.0, math.nan), ComputePathToPose.Result.TF_ERROR, "norm of orientation"),
    ],
)
def test_a_refusal_has_a_code_and_a_reason(robot, goal, code, words):
    status, result = robot.result(robot.send(robot.compute, goal=goal))
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, code)
    assert words in result.error_msg
    before = robot.pose.copy()
    status, result = robot.result(robot.send(robot.to_pose, pose=goal))
    assert status == GoalStatus.STATUS_ABORTED
    assert words in result.error_msg
    np.testing.assert_array_equal(robot.pose, before)


def test_only_ground_that_was_measured_since_the_last_map_is_taken_over(robot):
    robot.sees = False
    count = int(robot.wait_for_report(lambda _: True, "a report")["maps"])

    def code(**seen):
        """Return the code for a goal in the wall after one more map."""
        nonlocal count
        robot.step()
        robot.see(**seen)
        count += 1
        robot.wait_for_report(lambda r: int(values_of(r)["maps"]) == count, "the map")
        return robot.result(robot.send(robot.compute, goal=goal_at(WALL_X, 0.0)))[1].error_code

    occupied = ComputePathToPose.Result.GOAL_OCCUPIED
    assert code() == occupied
    assert code(walled=False, age=1e4) == occupied
    assert code(walled=False, age=0.0) == 0
    assert code() == occupied
    robot.sees = True


def test_a_path_is_planned_and_not_gone(robot):
    before = robot.pose.copy()
    start = goal_at(0.0, 0.0)
    handle = robot.send(robot.compute, goal=goal_at(4.0, 0.0), start=start, use_start=True)
    status, result = robot.result(handle)
    assert (status, result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0)
    assert result.path.header.frame_id == "map"
    way = np.array([(p.pose.position.x, p.pose.position.y) for p in result.path.poses])
    np.testing.assert_allclose(way[[0, -1]], [[0.0, 0.0], [4.0, 0.0]], atol=0.1)
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    assert steps.max() <= 0.1 + 1e-6
    assert way[:, 1].max() > 1.2
    np.testing.assert_array_equal(robot.pose, before)


def test_a_path_is_followed(robot):
    robot.feedback.clear()
    (x, y, yaw), path = robot.pose, Path()
    path.header.frame_id = "map"
    path.poses = [goal_at(x, y, yaw, frame=""), goal_at(x, y + 1.0, 0.5)]
    status, result = robot.result(robot.send(robot.along, path=path))
    assert (status, result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0)
    assert_at(robot, x, y + 1.0, 0.5)
    left = [each.distance_to_goal for each in robot.feedback]
    assert 0.8 < max(left) < 1.2
    far = Path(header=path.header, poses=[goal_at(x + 1.0, y), goal_at(x + 2.0, y)])
    status, result = robot.result(robot.send(robot.along, path=far))
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, result.INVALID_PATH)
    assert result.error_msg == "the robot is more than 0.5 m from the path"


def test_waypoints_are_visited_again_and_again_until_one_is_out_of_reach(robot):
    robot.feedback.clear()
    x, y, _ = robot.pose
    poses = [goal_at(x + 0.3, y), goal_at(x, y)]
    status, result = robot.result(robot.send(robot.waypoints, poses=poses, number_of_loops=1))
    assert (status, result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0)
    visited = [each.current_waypoint for each in robot.feedback]
    assert [n for n, before in zip(visited, [-1, *visited], strict=False) if n != before] == [
        0,
        1,
        0,
        1,
    ]
    poses.insert(1, goal_at(WALL_X, 0.0))
    status, result = robot.result(robot.send(robot.waypoints, poses=poses, goal_index=1))
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, result.TASK_EXECUTOR_FAILED)
    missed = [(each.index, each.error_code) for each in result.missed_waypoints]
    assert missed == [(1, ComputePathToPose.Result.GOAL_OCCUPIED)]
    assert result.error_msg.startswith("waypoint 1: the goal is on or too near an obstacle")
    status, result = robot.result(robot.send(robot.waypoints, poses=poses, goal_index=3))
    assert (status, result.error_msg) == (
        GoalStatus.STATUS_ABORTED,
        "goal_index is 3, there are 3 poses",
    )


def test_a_cancelled_goal_stops_the_robot(robot):
    handle = robot.send(robot.to_pose, pose=goal_at(0.0, 3.0))
    robot.go_on_until(lambda: robot.mode == "walk", "a walk")
    cancelled = handle.cancel_goal_async()
    robot.go_on_until(cancelled.done, "an answer to the cancellation")
    status, _ = robot.result(handle)
    assert (status, robot.mode) == (GoalStatus.STATUS_CANCELED, "stand")


def test_another_goal_replaces_the_one_before(robot):
    first = robot.send(robot.to_pose, pose=goal_at(0.0, 3.0))
    robot.go_on_until(lambda: robot.mode == "walk", "a walk")
    x, y, _ = robot.pose
    robot._publishers[PoseStamped].publish(goal_at(x, y + 0.5, 1.5))
    status, result = robot.result(first)
    assert (status, result.error_msg) == (GoalStatus.STATUS_ABORTED, "another goal has come")
    robot.go_on_until(lambda: robot.states[-1].outcome, "an end")
    assert robot.states[-1].outcome == "the goal is reached"
    assert_at(robot, x, y + 0.5, 1.5)


def test_a_goal_by_topic_is_cancelled_with_those_of_the_action(robot):
    cancel = robot.node.create_client(CancelGoal, f"{graph.NAVIGATE_TO_POSE}/_action/cancel_goal")
    robot.wait(cancel.service_is_ready, "the service")
    x, y, _ = robot.pose
    robot._publishers[PoseStamped].publish(goal_at(x, y - 1.0, 1.5))
    robot.go_on_until(lambda: robot.mode == "walk", "a walk")
    answer = cancel.call_async(CancelGoal.Request())
    robot.wait(answer.done, "an answer")
    assert len(answer.result().goals_canceling) == 1
    robot.go_on_until(lambda: robot.states[-1].outcome, "an end")
    assert robot.states[-1].outcome == "cancelled"
    assert robot.mode == "stand"


def test_a_robot_that_has_no_pose_any_more_is_stopped(robot):
    handle = robot.send(robot.to_pose, pose=goal_at(0.0, 3.0))
    robot.go_on_until(lambda: robot.mode == "walk", "a walk")
    future, clock = handle.get_result_async(), Clock()
    stamps.fill(clock.clock, round(1e9 * (robot.time + 2.0)))
    robot.wait(future.done, "a result", every(0.2, lambda: robot._publishers[Clock].publish(clock)))
    assert future.result().status == GoalStatus.STATUS_ABORTED
    assert future.result().result.error_code == 102
    assert "no pose" in future.result().result.error_msg
    answer = robot.call(Trigger, graph.LOCALIZATION_ACTIVE)
    assert (answer.success, "no pose" in answer.message) == (False, True)


def test_modes_that_there_are_not_are_refused():
    assert_refused(MODULE, "modes has 'swim', it may have walk, climb", modes="['swim']")
