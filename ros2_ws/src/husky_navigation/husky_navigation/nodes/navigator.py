"""Node `navigator`: leads the robot to goals in `map`, walking, climbing and flying."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped
from grid_map_msgs.msg import GridMap
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.action.client import ActionClient
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import BatteryState
from visualization_msgs.msg import MarkerArray

from husky_description.actuation import BUS_SERVOS, DRIVES
from husky_description.rotation import Quaternion, Vector
from husky_description.sections import BatterySection
from husky_msgs.msg import ControllerState, NavigatorState, PropulsionState
from husky_navigation.following.navigation import Navigation, Outcome
from husky_navigation.following.robot_wish import QUADROTOR, SPLAY, RobotView
from husky_navigation.frame_filter import LevelTransform, heading_between
from husky_navigation.nodes.map_messages import heights_of
from husky_navigation.nodes.navigation_actions import Errand, NavigationActions
from husky_navigation.nodes.robot_commands import RobotCommands
from husky_navigation.nodes.route_messages import cost_message, path_message, route_markers
from husky_navigation.planning.given_path import GivenPath
from husky_navigation.planning.planning_grid import PlanningGrid
from husky_navigation.planning.route import PlanePose, Route
from husky_navigation.planning.route_planner import Limits, RoutePlanner
from husky_navigation.planning.route_search import FLY, MODES, WALK, Place
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.message_guard import Refused
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.run import run

_PERIOD_NS = 100_000_000
"""Between two steps, in the poses' time [ns]."""
_RESTART_NS = 1_000_000_000
"""A stamp so far back is that of a world that has started again [ns]."""
_SILENT = 1.0
"""Time without a pose after which the robot does not know where it is [s]."""
_FARTHEST = 1000.0
"""Greatest x and y of a goal [m]."""
_OFF_UNIT = 0.1
"""Most that the norm of a goal's quaternion differs from 1."""
_WATCH = 0.2
"""Wall time between two looks for that [s]."""
_RESERVE = 0.15
"""Charge of the battery that no route is to use [-]."""
_ROUNDING = 1e-3
"""Of a cell's age in the map's message [s]."""
_VOLTAGES = 41
"""Charges at which its voltage is taken for its energy."""
_PLANS_KEPT = 100
"""Plans whose processor time is kept."""
_ROBOTS = {DRIVES: "carbon", BUS_SERVOS: "beta"}
"""Whose abilities and costs go with a kind of actuation."""


class Navigator(OneClock, Node):
    """Puts the ground together, plans on it, and commands the robot as an operator does.

    Steps are made in the thread that serves messages, one for each fifth pose in `map`; actions
    wait in threads of their own.
    """

    def __init__(self) -> None:
        """Declare parameters and subscribe."""
        super().__init__(graph.NAVIGATOR)
        robot = declare_robot(self)
        what = "ways of moving that a route may have; walking always may"
        self._modes = self._declare_modes(what)
        self._planner = RoutePlanner(_ROBOTS[robot.actuation])
        self._battery = robot.battery
        self._charge = math.nan
        self._drawn: PlanningGrid | None = None
        self.hot: Sequence[Subscription] = []
        self._map_to_odom = LevelTransform()
        self._take_off = math.nan  # height of the base on its perch [m]
        self._odometry: Odometry | None = None
        self._pose: PoseWithCovarianceStamped | None = None
        self._state: ControllerState | None = None
        self._step_ns = self._map_ns = -1
        self._errand: Errand | None = None
        self._newest: Errand | None = None
        self._route: Route | None = None  # as it is drawn
        self._changing = threading.Lock()  # of the errand
        self._told = NavigatorState(phase="idle")
        self._planning_ms: deque[float] = deque(maxlen=_PLANS_KEPT)
        self._counts = dict.fromkeys(("maps", "reached", "failed"), 0)
        self._commands = RobotCommands(self, self._tell_if_owed)
        self._owes_state = False
        self._states = self.create_publisher(NavigatorState, graph.NAVIGATOR_STATE, qos.STATUS)
        self._paths = self.create_publisher(Path, graph.PLAN, qos.LATCHED)
        self._routes = self.create_publisher(MarkerArray, graph.ROUTE, qos.LATCHED)
        self._cost_maps = self.create_publisher(OccupancyGrid, graph.COST_MAP, qos.LATCHED)
        self._listen()
        what = "a waypoint that cannot be reached ends its tour; else the next one is gone to"
        stop = bool(declare(self, "stop_on_failure", True, what))
        self._actions = NavigationActions(self, self, stop_on_failure=stop)
        self._to_itself = ActionClient(self, NavigateToPose, graph.NAVIGATE_TO_POSE)
        self.create_timer(_WATCH, self._watch)
        self._diagnostics = diagnostics.Diagnostics(self, "navigator", self._report)

    def _declare_modes(self, what: str) -> tuple[str, ...]:
        """Declare the ways of moving; raises ValueError for one that there is not."""
        modes = tuple(declare(self, "modes", list(MODES), what, constraints=", ".join(MODES)))
        if unknown := sorted(set(modes) - set(MODES)):
            raise ValueError(f"modes has {unknown[0]!r}, it may have {', '.join(MODES)}")
        return modes

    def _listen(self) -> None:
        """Subscribe, in the order in which messages are taken."""
        self._taken_with_poses = (
            self.create_subscription(
                ControllerState, graph.CONTROLLER_STATE, self._on_controller_state, qos.SEQUENCE
            ),
            self.create_subscription(
                PropulsionState, graph.PROPULSION_STATE, self._commands.hear, qos.STATUS
            ),
            self.create_subscription(Odometry, graph.ODOMETRY, self._on_odometry, qos.SEQUENCE),
        )
        self.create_subscription(
            PoseWithCovarianceStamped, graph.MAP_POSE, self._on_pose, qos.SEQUENCE
        )
        self.create_subscription(GridMap, graph.ELEVATION_MAP, self._on_map, qos.LATCHED)
        self.create_subscription(BatteryState, graph.BATTERY, self._on_battery, qos.STATUS)
        for topic in (graph.GOAL_POSE, graph.SIMPLE_GOAL):
            self.create_subscription(PoseStamped, topic, self._on_goal, qos.COMMAND)

    @property
    def unawaited(self) -> tuple[Subscription, ...]:
        """Poses wake the node: what else is said as often comes before them."""
        return (*super().unawaited, *self._taken_with_poses)

    # Messages -----------------------------------------------------------------------------------
    def _on_controller_state(self, state: ControllerState) -> None:
        self._state = state
        self._step_if_due()

    def _on_odometry(self, odometry: Odometry) -> None:
        self._odometry = odometry

    def _on_pose(self, pose: PoseWithCovarianceStamped) -> None:
        stamp = stamps.to_ns(pose.header.stamp)
        if stamp < self._step_ns - _RESTART_NS:
            self._restart()
        self._pose = pose
        odometry = self._odometry
        if odometry is not None and stamps.to_ns(odometry.header.stamp) == stamp:
            in_map, in_odom = pose.pose.pose, odometry.pose.pose
            yaw = heading_between(_quaternion(in_map), _quaternion(in_odom))
            self._map_to_odom = LevelTransform.through(_place(in_odom), _place(in_map), yaw)
        self._step_if_due()

    def _on_map(self, message: GridMap) -> None:
        """Take over a map of the ground, once the robot knows where it is."""
        try:
            heights = heights_of(message)
        except ValueError as error:
            raise Refused(str(error)) from error
        if self._pose is None:
            return
        stamp, before = stamps.to_ns(message.header.stamp), self._map_ns
        since = 1e-9 * (stamp - before) + _ROUNDING if stamp >= before >= 0 else math.inf
        self._planner.merge(heights, self._map_to_odom, since)
        self._counts["maps"] += 1
        self._map_ns = stamp

    def _on_battery(self, battery: BatteryState) -> None:
        self._charge = battery.percentage

    def _on_goal(self, message: PoseStamped) -> None:
        """Go where a click tells, by the node's own action, so that clients can cancel that."""
        try:
            self.goal_of(message)
        except ValueError as error:
            raise Refused(str(error)) from error
        self._to_itself.send_goal_async(NavigateToPose.Goal(pose=message))

    def _restart(self) -> None:
        """The world has started again at an earlier time: nothing is known of it."""
        self._planner.clear()
        self._step_ns = self._map_ns = -1
        self._take_off = math.nan
        self._finish(Outcome.LOST, "time has gone back")

    # What actions ask for -----------------------------------------------------------------------
    def goal_of(self, message: PoseStamped) -> PlanePose:
        """Return a goal; raises ValueError for another frame than `map`, or for no level pose."""
        frame = message.header.frame_id.lstrip("/")
        if frame != graph.FRAME_MAP:
            raise ValueError(f"frame_id is {frame[:40]!r}, it must be {graph.FRAME_MAP!r}")
        (x, y, _), turn = _place(message.pose), _quaternion(message.pose)
        if not (abs(x) <= _FARTHEST and abs(y) <= _FARTHEST):
            raise ValueError(f"position is {x}, {y}, it must be within {_FARTHEST:g} m")
        if not abs(math.hypot(*turn) - 1.0) <= _OFF_UNIT:
            raise ValueError(f"the norm of orientation is {math.hypot(*turn)}, it must be 1")
        return plane_pose(message.pose)

    def here(self) -> PlanePose:
        """Return where the robot is in `map`; raises ValueError if it does not know."""
        pose = self._pose
        if pose is None or self._is_silent():
            raise ValueError(f"there is no pose on {graph.absolute(graph.MAP_POSE)}")
        return plane_pose(pose.pose.pose)

    def altitude(self) -> float | None:
        """Return the height of the base in `map` of a robot in flight [m], None on the ground."""
        pose, state = self._pose, self._state
        if pose is None or state is None or state.mode != QUADROTOR:
            return None
        return float(pose.pose.pose.position.z)

    def begin(self, goals: Sequence[PlanePose], after: Errand | None = None) -> Errand:
        """Go to goals from the next step on; a navigation that goes on is replaced.

        Args:
            goals: one or more.
            after: another errand than this having come meanwhile, it is that one that goes on.
        """
        return self._begin(Navigation(goals, self.plan), after)

    def begin_along(self, poses: Sequence[PlanePose]) -> Errand:
        """Go along a path from the next step on, as `begin` does.

        Raises:
            ValueError: it has no two places.
        """
        path = GivenPath(poses, self._planner)

        def plan(
            start: PlanePose, _: PlanePose, closed: tuple[Place, ...], altitude: float | None
        ) -> Route:
            return self._timed(lambda limits: path.route(start, limits, altitude), closed, altitude)

        return self._begin(Navigation([path.goal], plan))

    def _begin(self, navigation: Navigation, after: Errand | None = None) -> Errand:
        errand = Errand(navigation)
        with self._changing:
            if after is not None and after is not self._newest:
                navigation.finish(Outcome.REPLACED)
                return errand
            before, self._errand, self._newest = self._errand, errand, errand
        if before is not None:
            before.navigation.finish(Outcome.REPLACED)
            before.tell(None)
        return errand

    def plan(
        self,
        start: PlanePose,
        goal: PlanePose,
        closed: tuple[Place, ...] = (),
        altitude: float | None = None,
    ) -> Route:
        """Return the cheapest route over the ground that was seen; raises RouteError for none."""
        return self._timed(
            lambda limits: self._planner.plan(start, goal, limits, altitude), closed, altitude
        )

    def _timed(
        self,
        make: Callable[[Limits], Route],
        closed: tuple[Place, ...],
        altitude: float | None,
    ) -> Route:
        """Return a route within what it may have now; raises RouteError for none."""
        begun = time.thread_time()
        try:
            return make(Limits(self._usable(altitude is not None), self._energy(), closed))
        finally:
            self._planning_ms.append(1e3 * (time.thread_time() - begun))

    def _usable(self, is_in_air: bool) -> tuple[str, ...]:
        """Return the ways of moving that a route may have now: with a fan lost, walking alone; a
        robot in the air flies on until it has landed.
        """
        usable = [mode for mode in self._modes if mode == WALK or self._commands.has_fans]
        return (*usable, FLY) if is_in_air and FLY not in usable else tuple(usable)

    def _energy(self) -> float:
        """Return what the battery has for the way [J], inf where nothing tells its charge."""
        energy = energy_between(self._battery, _RESERVE, self._charge)
        return math.inf if math.isnan(energy) else energy

    def path_of(self, route: Route) -> Path:
        """Return a route as a path."""
        return path_message(route, self._planner.world, self.get_clock().now().nanoseconds)

    def _show(self, route: Route | None) -> None:
        """Draw a route, or take the last one away."""
        self._route = route
        if route is not None:
            self._paths.publish(self.path_of(route))
        now = self.get_clock().now().nanoseconds
        self._routes.publish(route_markers(route, self._planner.world, now))

    def _ground(self) -> PlanningGrid:
        """Return the ground as it is known now; tell its costs when they are new."""
        grid = self._planner.grid()
        if grid is not self._drawn:
            self._drawn = grid
            self._cost_maps.publish(cost_message(grid, self._step_ns))
        return grid

    # Steps --------------------------------------------------------------------------------------
    def _step_if_due(self) -> None:
        """Make a step when the pose and the controller's state of its time are here."""
        pose, state = self._pose, self._state
        if pose is None or state is None:
            return
        stamp = stamps.to_ns(pose.header.stamp)
        is_due = self._step_ns < 0 or stamp // _PERIOD_NS > self._step_ns // _PERIOD_NS
        if not is_due or stamps.to_ns(state.stamp) < stamp:
            return
        self._step_ns = stamp
        now = 1e-9 * stamp
        height = pose.pose.pose.position.z
        if state.mode == SPLAY:
            self._take_off = height
        elif state.mode != QUADROTOR:
            self._take_off = math.nan
        view = RobotView(
            time=now,
            pose=plane_pose(pose.pose.pose),
            mode=state.mode,
            fans_ready=self._commands.fans_ready(now),
            map_age=now - 1e-9 * self._map_ns,
            speed=self._speed(),
            has_fans=self._commands.has_fans,
            energy=self._energy(),
            waits=self._commands.waits,
            height=height,
            take_off=self._take_off,
            lands=self._commands.lands,
        )
        errand = self._errand
        if errand is not None:
            self._step(errand, view)
        else:
            self._commands.rest(state.mode, now)
        self._tell(errand, stamp)

    def _speed(self) -> float:
        """Return the speed of the base over ground [m/s]."""
        if self._odometry is None:
            return 0.0
        velocity = self._odometry.twist.twist.linear
        return math.hypot(velocity.x, velocity.y)

    def _step(self, errand: Errand, view: RobotView) -> None:
        navigation = errand.navigation
        if errand.cancelled:
            navigation.stop(view, Outcome.CANCELLED)
        wish = navigation.step(view, self._ground(), self._planner.air())
        if wish is not None:
            self._commands.follow(wish, view.mode, view.time)
        if navigation.route is not self._route:
            self._show(navigation.route)
        if navigation.outcome is not None:
            self._end(errand)
        errand.tell(view)

    def _end(self, errand: Errand) -> None:
        """Note how a navigation has ended."""
        navigation = errand.navigation
        reached = navigation.outcome is Outcome.REACHED
        self._counts["reached" if reached else "failed"] += 1
        with self._changing:
            if self._errand is errand:
                self._errand = None
        self._show(None)
        self.get_logger().info(navigation.reason)

    def _finish(self, outcome: Outcome, reason: str) -> None:
        """End the navigation that goes on, at once."""
        errand = self._errand
        if errand is not None:
            errand.navigation.finish(outcome, f"{outcome.value}: {reason}")
            self._end(errand)
            errand.tell(None)

    def _watch(self) -> None:
        """End a navigation of a robot that does not know any more where it is."""
        if self._errand is not None and self._is_silent():
            self._finish(Outcome.LOST, f"no pose on {graph.absolute(graph.MAP_POSE)}")

    def _is_silent(self) -> bool:
        """Return whether no pose has come for long."""
        if self._pose is None:
            return True
        age = self.get_clock().now().nanoseconds - stamps.to_ns(self._pose.header.stamp)
        return age > _SILENT * 1e9

    # Reports ------------------------------------------------------------------------------------
    def _tell(self, errand: Errand | None, stamp: int) -> None:
        told = self._told
        stamps.fill(told.stamp, stamp)
        if errand is not None:
            navigation, leg = errand.navigation, errand.navigation.leg
            told.phase, told.leg = navigation.phase, leg.mode if leg else ""
            told.distance_left, told.time_left = navigation.left, navigation.time_left
            told.energy_left, told.recoveries = navigation.energy_left, navigation.recoveries
            told.goals_left = navigation.goals_left
            told.outcome = navigation.reason if navigation.outcome else ""
        elif told.phase != "idle":
            told.phase, told.leg = "idle", ""
            told.distance_left = told.time_left = told.energy_left = 0.0
            told.goals_left = 0
        self._owes_state = True
        self._tell_if_owed()

    def _tell_if_owed(self) -> None:
        """Tell the state once the requests of its step are answered: lockstep waits for it."""
        if self._owes_state and not self._commands.waits:
            self._owes_state = False
            self._told.refusal = self._commands.refusal
            self._states.publish(self._told)

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {**self._counts, "phase": self._told.phase}
        if self._planning_ms:
            values["plan_cpu_ms_max"] = f"{max(self._planning_ms):.0f}"  # of the newest
        if self._pose is None:
            return diagnostics.WARN, "waiting for a pose in map", values
        if self._is_silent():
            return diagnostics.WARN, "no pose in map: the robot does not know where it is", values
        if self._counts["maps"] == 0:
            return diagnostics.WARN, "waiting for a map of the ground", values
        return diagnostics.OK, self._told.phase, values

    def quiet(self) -> None:
        """Nothing to do: messages wake the node."""

    def close(self) -> None:
        """Take no more goals; a robot that is not told to go on stands."""
        self._finish(Outcome.STOPPED, "the navigator ends")
        self._to_itself.destroy()
        self._actions.close()


def energy_between(battery: BatterySection, low: float, high: float) -> float:
    """Return what a pack gives from one charge down to another, 0 to 1, without losses [J]."""
    charge = np.linspace(0.0, 1.0, len(battery.cell_voltage))
    between = np.linspace(min(low, high), high, _VOLTAGES)
    voltage = battery.cells * np.interp(between, charge, battery.cell_voltage)
    return float(battery.capacity * np.trapezoid(voltage, between))


def _place(pose: Pose) -> Vector:
    at = pose.position
    return at.x, at.y, at.z


def _quaternion(pose: Pose) -> Quaternion:
    q = pose.orientation
    return q.x, q.y, q.z, q.w


def plane_pose(pose: Pose) -> PlanePose:
    """Return place and heading of a pose."""
    yaw = heading_between(_quaternion(pose), (0.0, 0.0, 0.0, 1.0))
    return PlanePose(pose.position.x, pose.position.y, yaw)


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(Navigator)


if __name__ == "__main__":
    sys.exit(main())
