"""Navigation over grounds that were seen, of a robot that does exactly as it is told."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from planned_ground import CARBON, HIGH, Ridge, costs, grid_seen, level, wall

from husky_description.arrays import Array
from husky_navigation.following.navigation import Navigation, Outcome
from husky_navigation.following.robot_wish import RobotView, Wish
from husky_navigation.planning.planning_grid import PlanningGrid
from husky_navigation.planning.route import PlanePose, Refusal, Route, RouteError
from husky_navigation.planning.route_finder import find_route
from husky_navigation.planning.route_search import MODES, WALK, Place, RouteGraph

PERIOD = 0.1
RIDGE = Ridge(30.0)
START = PlanePose(0.0, 0.0, 0.0)
CHANGE = 0.5
"""Time that the robot takes to change the mode [s]."""


class ObedientRobot:
    """Moves as it is told; stands between two modes that step, but not on a slope.

    Attributes:
        grid: the ground as it is known; may change on the way.
        modes: that it was in, in order.
        stalls: it goes nowhere.
        on_slope: it is refused to stand.
        blind: no map comes any more.
        has_fans: no fan is lost.
        energy: of the battery [J].
    """

    def __init__(self, grid: PlanningGrid, pose: PlanePose = START) -> None:
        self.grid, self.pose, self.mode = grid, pose, "stand"
        self.modes, self.stalls, self.on_slope, self.blind = ["stand"], False, False, False
        self.has_fans, self.energy, self.plans = True, math.inf, 0
        self._routes: dict[object, tuple[PlanningGrid, RouteGraph]] = {}
        self.time = self._asked_at = 0.0
        self.wish = Wish("stand")

    def plan(
        self,
        start: PlanePose,
        goal: PlanePose,
        closed: tuple[Place, ...],
        altitude: float | None = None,
    ) -> Route:
        self.plans += 1
        modes = MODES if self.has_fans else (WALK,)
        grid, routes = self._routes.get((modes, closed), (None, None))
        if grid is not self.grid or routes is None:
            routes = RouteGraph(self.grid, CARBON, costs(), modes=modes, closed=closed)
            self._routes[modes, closed] = self.grid, routes
        route = find_route(routes, start, goal)
        if route.energy > self.energy:
            raise RouteError(Refusal.BATTERY)
        return route

    def step(self, navigation: Navigation) -> None:
        """Make a step of the navigation, and do what it wants."""
        age = self.time if self.blind else 0.0
        told = self.wish.fans, age, 0.0, self.has_fans, self.energy
        view = RobotView(self.time, self.pose, self.mode, *told)
        wish = navigation.step(view, self.grid)
        self.time += PERIOD
        if wish is None:
            return
        self.wish = wish
        if self.wish.mode == self.mode:
            self._asked_at = self.time
            self._move()
        elif self.time > self._asked_at + CHANGE and not self.on_slope:
            self.mode = "stand" if self.mode in ("walk", "wair") else self.wish.mode
            self.modes.append(self.mode)

    def _move(self) -> None:
        velocity, (x, y, yaw) = self.wish.velocity, self.pose
        assert self.mode in ("walk", "wair") or velocity == (0.0, 0.0, 0.0)
        forward, left, turn = (0.0, 0.0, 0.0) if self.stalls else (PERIOD * v for v in velocity)
        cosine, sine = math.cos(yaw), math.sin(yaw)
        self.pose = PlanePose(
            x + cosine * forward - sine * left, y + sine * forward + cosine * left, yaw + turn
        )

    def run(self, navigation: Navigation, within: float = 200.0) -> Navigation:
        """Go on until the navigation ends."""
        end = self.time + within
        while navigation.outcome is None:
            assert self.time < end, f"{navigation.phase} at {self.pose}"
            self.step(navigation)
        return navigation

    def run_until(self, navigation: Navigation, there: Callable[[], bool]) -> None:
        """Go on until something holds, before the navigation ends."""
        while not there():
            assert navigation.outcome is None
            self.step(navigation)


def assert_at(robot: ObedientRobot, goal: PlanePose) -> None:
    """Check that the robot stands at a goal."""
    assert math.hypot(robot.pose.x - goal.x, robot.pose.y - goal.y) < 0.1
    assert abs(math.remainder(robot.pose.yaw - goal.yaw, 2.0 * math.pi)) < 0.1
    assert robot.mode == "stand"


@pytest.fixture(scope="module")
def flat() -> PlanningGrid:
    return grid_seen(level)


@pytest.fixture(scope="module")
def walled() -> PlanningGrid:
    return grid_seen(wall)


@pytest.fixture(scope="module")
def ridged() -> PlanningGrid:
    return grid_seen(RIDGE)


@pytest.mark.parametrize(
    "goal", [PlanePose(3.0, 1.0, 2.0), PlanePose(-2.0, 0.0, 0.0), PlanePose(0.0, 0.0, 3.0)]
)
def test_it_goes_to_a_goal_and_stands_there(flat: PlanningGrid, goal: PlanePose) -> None:
    robot = ObedientRobot(flat)
    navigation = robot.run(Navigation([goal], robot.plan))
    assert navigation.outcome is Outcome.REACHED, navigation.reason
    assert navigation.left == navigation.goals_left == navigation.recoveries == 0
    assert_at(robot, goal)


def test_it_climbs_over_a_ridge_with_the_fans_and_walks_without(ridged: PlanningGrid) -> None:
    goal = PlanePose(5.8, 0.6, 0.0)
    robot = ObedientRobot(ridged, PlanePose(-5.0, 0.0, 0.0))
    navigation, fans = Navigation([goal], robot.plan), set[tuple[str, bool]]()
    while navigation.outcome is None:
        robot.step(navigation)
        if robot.wish.mode == robot.mode:
            fans.add((robot.mode, robot.wish.fans))
    assert navigation.outcome is Outcome.REACHED, navigation.reason
    assert robot.modes == ["stand", *("walk", "stand", "wair", "stand") * 2, "walk", "stand"]
    assert fans == {("stand", False), ("walk", False), ("wair", True)}
    assert_at(robot, goal)


def test_what_is_left_grows_less(ridged: PlanningGrid) -> None:
    robot = ObedientRobot(ridged, PlanePose(-5.0, 0.0, 0.0))
    navigation = Navigation([PlanePose(5.8, 0.6, 0.0)], robot.plan)
    robot.step(navigation)
    assert navigation.route is not None
    whole = navigation.energy_left, navigation.time_left, navigation.left
    assert whole == pytest.approx(
        (navigation.route.energy, navigation.route.time, navigation.route.length)
    )
    robot.run_until(navigation, lambda: robot.pose.x > 0.0)
    left = navigation.energy_left, navigation.time_left, navigation.left
    assert all(0.2 * a < b < 0.8 * a for a, b in zip(whole, left, strict=True))


@pytest.mark.parametrize(("times", "recoveries"), [(1, 1), (99, 3)])
def test_a_base_that_shifts_when_the_steps_end_walks_to_the_goal_again(
    flat: PlanningGrid, times: int, recoveries: int
) -> None:
    goal = PlanePose(2.0, 0.0, 0.0)
    robot = ObedientRobot(flat)
    navigation = Navigation([goal], robot.plan)
    shifted = 0
    while navigation.outcome is None:
        before = robot.mode
        robot.step(navigation)
        if (before, robot.mode) == ("walk", "stand") and shifted < times:
            shifted += 1
            robot.pose = robot.pose._replace(y=robot.pose.y + 0.2)
    assert (navigation.outcome, navigation.recoveries) == (Outcome.REACHED, recoveries)
    assert navigation.goals_left == 0
    if times == 1:
        assert_at(robot, goal)


def test_goals_are_reached_in_order(flat: PlanningGrid) -> None:
    goals = [PlanePose(2.0, 0.0, 0.0), PlanePose(2.0, 2.0, 1.5), PlanePose(0.0, 2.0, 3.0)]
    robot = ObedientRobot(flat)
    navigation = Navigation(goals, robot.plan)
    for number, goal in enumerate(goals[:-1], 1):
        robot.run_until(navigation, lambda number=number: navigation.reached == number)
        assert math.hypot(robot.pose.x - goal.x, robot.pose.y - goal.y) < 0.1
        assert navigation.goals_left == len(goals) - number
    robot.run(navigation)
    assert robot.modes == ["stand", "walk", "stand"], "it does not stop in between"
    assert_at(robot, goals[-1])


def test_a_wall_that_appears_is_walked_around(flat: PlanningGrid, walled: PlanningGrid) -> None:
    goal = PlanePose(4.0, 0.0, 0.0)
    robot = ObedientRobot(flat)
    navigation = Navigation([goal], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.0)
    robot.grid = walled
    ahead = []
    while navigation.outcome is None:
        robot.step(navigation)
        ahead.append(robot.pose)
    assert navigation.outcome is Outcome.REACHED, navigation.reason
    assert max(pose.x for pose in ahead if pose.y < 2.0 and pose.x < 2.0) < 1.7
    assert max(pose.y for pose in ahead) > 2.3
    assert_at(robot, goal)


def begun(x: Array, y: Array, upto: float = 0.75) -> Array:
    """Return the ridge as it is seen from afar: a part of its slope [m], and nothing behind."""
    return np.where(x < upto - 4.0, RIDGE(x, y), np.nan)


def between_walls(x: Array, y: Array) -> Array:
    """Return 1.8 m of a slope that is 1.6 m wide, with walls beside it."""
    beside = (np.abs(y) > 0.8) & (np.abs(x + 3.8) < 0.1)
    slope = np.where(np.abs(y) < 0.8, begun(x, y, 1.8), np.nan)
    return np.where(x < -4.0, 0.0, np.where(beside, HIGH, slope))


def test_a_slope_that_was_seen_in_part_is_looked_at_before_it_is_climbed(
    ridged: PlanningGrid,
) -> None:
    goal = PlanePose(5.8, 0.6, 0.0)
    robot = ObedientRobot(grid_seen(begun), PlanePose(-6.0, 1.0, 0.0))
    navigation = Navigation([goal], robot.plan)
    robot.run_until(navigation, lambda: navigation.phase == "looking ahead")
    assert -5.0 < robot.pose.x < -4.0
    assert abs(robot.pose.yaw) < 0.1, "it faces the slope"
    robot.grid = ridged
    robot.run(navigation)
    assert (navigation.outcome, navigation.recoveries) == (Outcome.REACHED, 0)
    assert_at(robot, goal)


def test_where_a_slope_goes_on_is_not_seen_on_it_either_and_it_comes_back() -> None:
    robot = ObedientRobot(grid_seen(between_walls), PlanePose(-5.0, 0.0, 0.0))
    navigation, highest = Navigation([PlanePose(5.8, 0.6, 0.0)], robot.plan), -5.0
    while navigation.outcome is None:
        robot.step(navigation)
        highest = max(highest, robot.pose.x)
    assert (navigation.outcome, navigation.refusal) == (Outcome.NO_ROUTE, Refusal.NO_WAY)
    assert -3.2 < highest < -1.5
    assert robot.pose.x < -4.0
    assert robot.modes.count("wair") == 1


def test_a_robot_that_stands_on_a_slope_goes_on_up(ridged: PlanningGrid) -> None:
    goal = PlanePose(5.8, 0.6, 0.0)
    robot = ObedientRobot(ridged, PlanePose(-3.0, 0.0, 0.0))
    robot.mode = "wair"
    navigation = Navigation([goal], robot.plan)
    robot.step(navigation)
    assert navigation.leg is not None
    assert (navigation.leg.mode, navigation.leg.downwards) == ("climb", False)
    robot.run(navigation)
    assert navigation.outcome is Outcome.REACHED, navigation.reason


def test_on_a_crest_without_a_way_it_waits_for_a_map_on_its_fans(ridged: PlanningGrid) -> None:
    """Its hind feet are on the slope still: a robot that steps back there slides down."""
    robot = ObedientRobot(ridged, PlanePose(RIDGE.crest + 0.05, 0.0, 0.0))
    robot.mode, plans = "wair", list[int]()

    def plan(
        start: PlanePose, goal: PlanePose, closed: tuple[Place, ...], _: float | None
    ) -> Route:
        plans.append(1)
        if len(plans) == 1:
            raise RouteError(Refusal.NO_WAY)
        return robot.plan(start, goal, closed)

    navigation = Navigation([PlanePose(RIDGE.crest + 0.7, 0.0, 0.0)], plan)
    robot.run_until(navigation, lambda: len(plans) == 2)
    assert robot.wish.fans
    assert robot.mode == robot.wish.mode == "wair"
    assert navigation.leg is not None
    assert navigation.leg.mode == "climb"
    robot.run(navigation)
    assert navigation.outcome is Outcome.REACHED


def test_with_a_fan_lost_it_goes_back_down_the_slope(ridged: PlanningGrid) -> None:
    robot = ObedientRobot(ridged, PlanePose(-5.0, 0.0, 0.0))
    navigation = Navigation([PlanePose(5.8, 0.6, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "wair" and robot.pose.x > -3.0)
    robot.has_fans = False
    robot.run_until(navigation, lambda: robot.pose.x < -4.1)
    assert robot.mode == "wair"
    assert abs(robot.pose.yaw) < 0.1, "it comes down backwards"
    robot.run(navigation)
    assert (navigation.outcome, navigation.refusal) == (Outcome.NO_ROUTE, Refusal.NO_WAY)
    assert robot.pose.x < -4.0


def test_a_battery_that_does_not_last_any_more_ends_it(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(6.0, 0.0, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 3.0)
    robot.energy = 50.0
    robot.run(navigation)
    assert (navigation.outcome, navigation.refusal) == (Outcome.NO_ROUTE, Refusal.BATTERY)
    assert robot.pose.x < 3.2


def test_a_robot_that_stands_too_near_a_wall_leaves_it(walled: PlanningGrid) -> None:
    robot = ObedientRobot(walled, PlanePose(1.72, 0.0, 0.5 * math.pi))
    navigation = robot.run(Navigation([PlanePose(0.0, 2.0, 0.0)], robot.plan))
    assert (navigation.outcome, navigation.recoveries) == (Outcome.REACHED, 0)
    assert robot.plans < 4


@pytest.mark.parametrize("away", [0.3, 0.55])
def test_a_crate_that_appears_right_before_it_is_not_walked_into(
    flat: PlanningGrid, away: float
) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.0)
    front = robot.pose.x + away

    def crate(x: Array, y: Array) -> Array:
        return np.where((x > front) & (x < front + 0.4) & (np.abs(y) < 0.2), 0.4, 0.0)

    robot.grid, nearest = grid_seen(crate), math.inf
    while navigation.outcome is None:
        robot.step(navigation)
        if abs(robot.pose.y) < 0.2 and robot.pose.x < front:
            nearest = min(nearest, front - robot.pose.x)
    assert nearest > min(away, 0.5 * CARBON.length) - 0.05
    assert robot.pose.x < front or navigation.outcome is Outcome.REACHED


def test_a_short_ramp_across_its_way_is_no_trap() -> None:
    """Lanes are as long as their cells lie apart, which is not a whole number of steps."""

    def ramp(x: Array, y: Array) -> Array:
        along = np.clip(0.955 * x + 0.296 * y - 1.0, 0.0, 0.4) / 0.4
        return 0.12 * along**2 * (3.0 - 2.0 * along)

    robot = ObedientRobot(grid_seen(ramp))
    navigation = robot.run(Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan))
    assert navigation.outcome is not None
    assert robot.plans < 50


def test_a_robot_that_stands_on_a_gentle_slope_goes_on_too() -> None:
    slope = grid_seen(lambda x, y: np.clip(x, 0.0, 3.0) * math.tan(math.radians(7.5)))
    robot = ObedientRobot(slope, PlanePose(1.5, 0.0, 0.0))
    robot.mode = "wair"
    navigation = robot.run(Navigation([PlanePose(5.0, 0.0, 0.0)], robot.plan))
    assert navigation.outcome is Outcome.REACHED, navigation.reason


def test_a_robot_that_is_stuck_on_its_way_back_is_stopped(ridged: PlanningGrid) -> None:
    robot = ObedientRobot(ridged, PlanePose(-5.0, 0.0, 0.0))
    navigation = Navigation([PlanePose(5.8, 0.6, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "wair" and robot.pose.x > -3.0)
    robot.has_fans, robot.stalls = False, True
    robot.run(navigation, within=30.0)
    assert navigation.outcome is Outcome.STUCK


def test_a_robot_that_falls_out_of_its_mode_again_and_again_gives_up(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.stalls = True
    while navigation.outcome is None:
        assert robot.time < 1000.0
        robot.step(navigation)
        if robot.mode == "walk" and round(robot.time / PERIOD) % 30 == 0:
            robot.mode = "stand"
    assert navigation.outcome in (Outcome.STUCK, Outcome.NOT_CHANGED)


# Ends --------------------------------------------------------------------------------------------
def test_a_cancelled_robot_stops_and_stands(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.0)
    navigation.stop(RobotView(robot.time, robot.pose, robot.mode, False), Outcome.CANCELLED)
    robot.run(navigation, within=1.0)
    assert (navigation.outcome, robot.mode) == (Outcome.CANCELLED, "stand")


def test_on_a_slope_it_stops_in_the_mode_that_holds_it(ridged: PlanningGrid) -> None:
    robot = ObedientRobot(ridged, PlanePose(-5.0, 0.0, 0.0))
    navigation = Navigation([PlanePose(5.8, 0.6, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "wair" and robot.pose.x > -3.0)
    robot.on_slope = True
    there = robot.pose
    navigation.stop(RobotView(robot.time, robot.pose, robot.mode, True), Outcome.CANCELLED)
    robot.run(navigation, within=5.0)
    assert (navigation.outcome, robot.mode, robot.pose) == (Outcome.CANCELLED, "wair", there)


def test_a_robot_that_goes_nowhere_steps_back_and_gives_up(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.0)
    robot.stalls = True
    robot.run(navigation)
    assert (navigation.outcome, navigation.recoveries) == (Outcome.STUCK, 3)


def test_a_robot_that_comes_free_goes_on(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.stalls = True
    robot.run_until(navigation, lambda: navigation.recoveries == 1)
    robot.stalls, headings = False, [robot.pose.yaw]
    while navigation.outcome is None:
        robot.step(navigation)
        headings.append(robot.pose.yaw)
    assert (navigation.outcome, navigation.recoveries) == (Outcome.REACHED, 1)
    assert min(headings) < -1.0 and max(headings) > 1.0, "it looks to the left and to the right"


def half_seen(x: Array, y: Array) -> Array:
    return np.where(x < 1.5, 0.0, np.nan)


def test_it_does_not_walk_onto_ground_that_it_does_not_see(flat: PlanningGrid) -> None:
    robot = ObedientRobot(grid_seen(half_seen))
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.run(navigation)
    assert navigation.outcome is Outcome.UNSEEN
    assert robot.pose.x < 1.5
    robot.grid = flat
    assert robot.run(Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)).outcome is Outcome.REACHED


def test_around_a_strip_that_cannot_be_seen_it_goes() -> None:
    """From before its edge the bottom of a ditch is not seen; both of its edges are level."""
    goal = PlanePose(4.0, 0.0, 0.0)

    def ditch(x: Array, y: Array) -> Array:
        return np.where((np.abs(x - 2.3) < 0.3) & (np.abs(y) < 1.0), np.nan, 0.0)

    robot = ObedientRobot(grid_seen(ditch))
    navigation = robot.run(Navigation([goal], robot.plan))
    assert navigation.outcome is Outcome.REACHED
    assert 1 <= navigation.recoveries <= 3
    assert_at(robot, goal)


def test_a_goal_around_which_too_little_was_seen_is_looked_at_first() -> None:
    goal = PlanePose(2.0, 0.0, 0.0)

    def height(x: Array, y: Array) -> Array:
        return np.where(x < 2.3, 0.0, np.where(x < 3.3, np.nan, HIGH))

    def seen_whole(x: Array, y: Array) -> Array:
        return np.where(x < 3.3, 0.0, HIGH)

    robot = ObedientRobot(grid_seen(height))
    navigation = Navigation([goal], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.0)
    robot.grid = grid_seen(seen_whole)
    robot.run(navigation)
    assert navigation.outcome is Outcome.REACHED
    assert_at(robot, goal)
    robot = ObedientRobot(grid_seen(height))
    navigation = robot.run(Navigation([goal], robot.plan))
    assert navigation.outcome is Outcome.UNSEEN
    assert robot.mode == "stand"


def test_it_does_not_walk_by_an_old_map(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.5)
    robot.blind, there = True, robot.pose.x
    robot.run(navigation)
    assert navigation.outcome is Outcome.UNSEEN
    assert robot.pose.x <= there + 0.1


def test_a_wall_at_its_back_keeps_it_from_stepping_back() -> None:
    grid = grid_seen(lambda x, y: np.where(x < -0.7, HIGH, 0.0))
    robot = ObedientRobot(grid)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.stalls = True
    robot.run_until(navigation, lambda: navigation.recoveries == 1)
    robot.stalls = False
    behind = []
    while navigation.outcome is None:
        robot.step(navigation)
        behind.append(robot.pose.x)
    assert navigation.outcome is Outcome.REACHED
    assert min(behind) == 0.0


@pytest.mark.parametrize(
    ("goal", "refusal", "recoveries"),
    [
        (PlanePose(2.0, 0.0, 0.0), Refusal.GOAL_OCCUPIED, 0),
        (PlanePose(40.0, 0.0, 0.0), Refusal.GOAL_OUTSIDE, 0),
    ],
)
def test_a_goal_without_a_route_is_refused_with_the_reason(
    walled: PlanningGrid, goal: PlanePose, refusal: Refusal, recoveries: int
) -> None:
    robot = ObedientRobot(walled)
    navigation = robot.run(Navigation([goal], robot.plan))
    assert (navigation.outcome, navigation.refusal) == (Outcome.NO_ROUTE, refusal)
    assert (navigation.reason, navigation.recoveries) == (refusal.value, recoveries)
    assert robot.pose == START


@pytest.mark.parametrize("maps", [1, 100])
def test_a_goal_on_which_something_appears_is_looked_at_once(flat: PlanningGrid, maps: int) -> None:
    """A wrong measurement is gone in a second; an obstacle stays."""
    occupied = grid_seen(lambda x, y: np.where(np.hypot(x - 3.0, y) < 0.3, HIGH, 0.0))
    goal, robot = PlanePose(3.0, 0.0, 0.0), ObedientRobot(flat)
    navigation = Navigation([goal], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.0)
    robot.grid = occupied
    robot.run_until(navigation, lambda: navigation.recoveries == 1)
    robot.grid = flat if maps == 1 else occupied
    robot.run(navigation)
    assert navigation.recoveries == 1
    if maps == 1:
        assert navigation.outcome is Outcome.REACHED
        assert_at(robot, goal)
    else:
        assert (navigation.outcome, navigation.refusal) == (
            Outcome.NO_ROUTE,
            Refusal.GOAL_OCCUPIED,
        )


def test_where_no_way_is_seen_it_looks_around_first() -> None:
    robot = ObedientRobot(grid_seen(lambda x, y: np.where(np.abs(x - 2.0) < 0.1, HIGH, 0.0)))
    navigation = robot.run(Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan))
    assert (navigation.outcome, navigation.refusal) == (Outcome.NO_ROUTE, Refusal.NO_WAY)
    assert navigation.recoveries == 3


def test_a_robot_that_does_not_stand_is_told_to(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    robot.mode = "passive"
    navigation = robot.run(Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan))
    assert navigation.outcome is Outcome.NOT_READY
    assert "in mode passive, it must be in stand_up, stand, walk, wair, perch" in navigation.reason


def test_a_robot_that_was_stopped_goes_nowhere(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    navigation = Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan)
    robot.run_until(navigation, lambda: robot.pose.x > 1.0)
    view = RobotView(robot.time, robot.pose, "damping", False)
    assert navigation.step(view, flat) is None, "it must not be told to stand up"
    assert navigation.outcome is Outcome.STOPPED


def test_a_mode_that_does_not_come_ends_it(flat: PlanningGrid) -> None:
    robot = ObedientRobot(flat)
    robot.on_slope = True
    navigation = robot.run(Navigation([PlanePose(4.0, 0.0, 0.0)], robot.plan))
    assert navigation.outcome is Outcome.NOT_CHANGED
    assert "does not enter the mode walk" in navigation.reason
