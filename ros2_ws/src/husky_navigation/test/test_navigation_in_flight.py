"""Navigation of Husky-beta over what closes its way, of a robot that does exactly as it is told."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from planned_ground import costs, seen

from husky_description.arrays import Array
from husky_navigation.following import ground_checks, robot_wish
from husky_navigation.following.ground_checks import air_is_blocked, nearest_landing
from husky_navigation.following.leg_follower import follower_of
from husky_navigation.following.navigation import Navigation, Outcome
from husky_navigation.following.robot_wish import RobotView, Wish
from husky_navigation.planning.abilities import ABILITIES
from husky_navigation.planning.air_layers import STRIDE, AirLayers, air_layers_of
from husky_navigation.planning.planning_grid import grid_of
from husky_navigation.planning.route import Leg, PlanePose, Route
from husky_navigation.planning.route_finder import find_route
from husky_navigation.planning.route_search import FLY, MODES, WALK, Place, RouteGraph

BETA = ABILITIES["beta"]
PERIOD = 0.1
SPEED = 0.25
"""Of rising and sinking [m/s]."""
BEFORE, BEHIND = PlanePose(-2.5, 0.0, 0.0), PlanePose(2.8, 0.0, 0.0)
UP = {"walk": "stand", "stand": "perch", "perch": "splay", "splay": "quadrotor"}
DOWN = {"splay": "perch", "perch": "stand", "stand": "walk"}

Ground = Callable[[Array, Array], Array]


class FlyingRobot:
    """Goes through one mode after the other, rises, flies and sinks as it is told.

    Attributes:
        ground: height at x, y [m], as it truly is.
        known: the same as far as it was seen, NaN elsewhere; may change on the way.
        modes: that it was in, in order.
        planned_in: mode in which each route was planned.
        landing: it comes down, whatever is wished, until it is down or finds no ground.
        stalls: it stays over its place in the air.
        noise: of the height that it tells, to and fro [m].
    """

    def __init__(self, ground: Ground, known: Ground | None = None) -> None:
        self.ground, self.pose, self.mode, self.time = ground, BEFORE, "stand", 0.0
        self.modes, self.has_fans, self.take_off = ["stand"], True, math.nan
        self.height, self.wish, self.top, self.depth = 0.5, Wish("stand"), math.nan, 0.25
        self.landing = self.lands = self.stalls = False
        self.noise, self.planned_in = 0.0, list[str]()
        self.see(known or ground)

    def see(self, known: Ground) -> None:
        self.grid = grid_of(seen(known, cells=160), BETA)
        assert BETA.fly is not None
        self.air = air_layers_of(self.grid, BETA.fly)
        self._graphs: dict[object, RouteGraph] = {}

    def plan(
        self, start: PlanePose, goal: PlanePose, closed: tuple[Place, ...], altitude: float | None
    ) -> Route:
        self.planned_in.append(self.mode)
        modes = MODES if self.has_fans or altitude is not None else (WALK,)
        if (modes, closed) not in self._graphs:
            moves = RouteGraph(self.grid, BETA, costs("beta"), modes=modes, closed=closed)
            self._graphs[modes, closed] = moves
        return find_route(self._graphs[modes, closed], start, goal, altitude)

    @property
    def below(self) -> float:
        """Height of the ground under the robot [m]."""
        return float(self.ground(np.array(self.pose.x), np.array(self.pose.y)))

    @property
    def view(self) -> RobotView:
        """Report of the robot."""
        view = RobotView(self.time, self.pose, self.mode, self.wish.fans, has_fans=self.has_fans)
        noise = self.noise * (-1.0) ** round(self.time / PERIOD)
        height = self.height + noise
        told = view._replace(height=height, take_off=self.take_off, lands=self.lands)
        return told._replace(map_age=math.fmod(self.time, 1.0))

    def step(self, navigation: Navigation) -> None:
        """Make a step of the navigation, and do what it wants."""
        wish = navigation.step(self.view, self.grid, self.air)
        self.time += PERIOD
        if wish is None:
            return
        self.wish = wish
        mode = self.mode
        if mode == "quadrotor":
            self._fly(wish)
        elif wish.mode != mode:
            self.mode = UP.get(mode, mode) if wish.mode == "quadrotor" else DOWN.get(mode, "stand")
        if self.mode == "quadrotor" and mode == "splay":
            assert wish.fans
            assert wish.heights is not None
            self._set_heights(wish)
        self.height = self.height if self.mode == "quadrotor" else self.below + 0.29
        if self.mode != "quadrotor":
            self.take_off = self.height if self.mode == "splay" else math.nan
            self.landing, self.lands = False, self.lands and self.mode == "splay"
        if self.mode == wish.mode:
            self._move()
        if self.mode != self.modes[-1]:
            self.modes.append(self.mode)

    def _set_heights(self, wish: Wish) -> None:
        if wish.heights is not None:
            self.top, self.depth = self.take_off + wish.heights.height, wish.heights.landing_depth

    def _fly(self, wish: Wish) -> None:
        self._set_heights(wish)
        if wish.mode != "quadrotor":
            self.landing = self.lands = True
        if self.height < self.take_off - self.depth:
            self.landing = False
        target = self.below + 0.29 if self.landing else self.top
        self.height += min(PERIOD * SPEED, max(-PERIOD * SPEED, target - self.height))
        assert self.height > self.below + 0.28, "it has hit something"
        if self.landing and self.height < self.below + 0.3:
            self.mode = "splay"

    def _move(self) -> None:
        if self.mode == "quadrotor" and (self.landing or self.stalls):
            return
        (forward, left, turn), (x, y, yaw) = self.wish.velocity, self.pose
        assert self.mode in ("walk", "quadrotor") or not any((forward, left, turn))
        c, s = math.cos(yaw), math.sin(yaw)
        self.pose = PlanePose(
            x + PERIOD * (c * forward - s * left),
            y + PERIOD * (s * forward + c * left),
            yaw + PERIOD * turn,
        )

    def run(self, navigation: Navigation, within: float = 200.0) -> Navigation:
        """Go on until the navigation ends."""
        end = self.time + within
        while navigation.outcome is None:
            assert self.time < end, f"{navigation.phase} in {self.mode} at {self.pose}"
            self.step(navigation)
        return navigation

    def run_until(self, navigation: Navigation, there: Callable[[], bool]) -> None:
        """Go on until something holds, before the navigation ends."""
        while not there():
            assert navigation.outcome is None, navigation.reason
            self.step(navigation)


def wall(x: Array, y: Array) -> Array:
    """Return a wall from edge to edge."""
    return np.where(np.abs(x) < 0.1, 0.5, 0.0)


def step_up(x: Array, y: Array) -> Array:
    """Return a gap of 0.5 m, 1 m deep, and behind it ground that is 0.5 m higher."""
    return np.where(x < 0.0, 0.0, np.where(x < 0.5, -1.0, 0.5))


def unseen_behind(x: Array, y: Array) -> Array:
    """Return that wall, behind which nothing was seen."""
    return np.where(x > 0.1, np.nan, wall(x, y))


def assert_stands_at(robot: FlyingRobot, goal: PlanePose) -> None:
    """Check that the robot stands at a goal."""
    assert robot.mode == "stand"
    assert math.hypot(robot.pose.x - goal.x, robot.pose.y - goal.y) < 0.1


@pytest.mark.parametrize("ground", [wall, step_up])
def test_it_flies_over_what_closes_its_way_and_walks_on(ground: Ground) -> None:
    robot = FlyingRobot(ground)
    navigation = robot.run(Navigation([BEHIND], robot.plan))
    assert navigation.outcome is Outcome.REACHED
    assert_stands_at(robot, BEHIND)
    flight = robot.modes[robot.modes.index("quadrotor") - 2 :][:5]
    assert flight == ["perch", "splay", "quadrotor", "splay", "perch"]
    assert robot.modes.count("quadrotor") == 1


def test_a_landing_looks_for_ground_as_deep_as_it_was_seen() -> None:
    robot = FlyingRobot(step_up)
    robot.pose = BEHIND
    navigation = Navigation([PlanePose(-2.5, 0.0, math.pi)], robot.plan)
    robot.run_until(navigation, lambda: robot.wish.heights is not None)
    assert robot.wish.heights is not None
    assert robot.wish.heights.landing_depth == pytest.approx(0.5 + 0.29, abs=0.02)
    robot.run(navigation)
    assert navigation.outcome is Outcome.REACHED


def test_it_rises_no_further_once_it_sees_the_top_of_what_closes_its_way() -> None:
    robot, highest = FlyingRobot(wall, lambda x, y: np.where(x > -0.05, np.nan, wall(x, y))), 0.0
    navigation = Navigation([BEHIND], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "quadrotor" and robot.height > 0.6)
    assert navigation.leg is not None
    assert navigation.leg.altitude == 2.0
    robot.see(wall)
    while navigation.outcome is None:
        robot.step(navigation)
        highest = max(highest, robot.height)
    assert navigation.outcome is Outcome.REACHED
    assert highest == pytest.approx(1.0, abs=0.05)


def flown_to_behind(robot: FlyingRobot, x: float, known: Ground) -> None:
    """Let a robot fly, see a ground from x [m] on, and come to stand behind the wall."""
    navigation = Navigation([BEHIND], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "quadrotor" and robot.pose.x > x)
    robot.see(known)
    robot.run(navigation)
    assert navigation.outcome is Outcome.REACHED
    assert_stands_at(robot, BEHIND)


def test_behind_a_wall_it_lands_once_it_has_seen_the_ground() -> None:
    flown_to_behind(FlyingRobot(wall, unseen_behind), -0.3, wall)


def test_where_it_never_sees_the_ground_it_lands_where_it_has_seen_some() -> None:
    robot = FlyingRobot(wall, unseen_behind)
    navigation = robot.run(Navigation([BEHIND], robot.plan), within=400.0)
    assert navigation.outcome is not Outcome.REACHED
    assert robot.mode == "stand"
    assert robot.pose.x < -0.5


def test_something_that_turns_out_too_high_is_not_flown_into() -> None:
    def tower(x: Array, y: Array) -> Array:
        return np.where((np.abs(x - 0.5) < 0.2) & (np.abs(y) < 0.5), 1.6, wall(x, y))

    flown_to_behind(FlyingRobot(tower, wall), -0.8, tower)


@pytest.mark.parametrize("x", [-1.0, 0.0])
def test_a_cancelled_flight_lands_beside_what_it_flies_over(x: float) -> None:
    robot = FlyingRobot(wall)
    navigation = Navigation([BEHIND], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "quadrotor" and robot.pose.x > x)
    navigation.stop(robot.view, Outcome.CANCELLED)
    robot.run(navigation)
    assert navigation.outcome is Outcome.CANCELLED
    assert robot.mode == "stand"
    assert abs(robot.pose.x) > 0.8


def test_a_goal_that_comes_in_flight_is_flown_to() -> None:
    robot = FlyingRobot(wall)
    navigation = Navigation([BEHIND], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "quadrotor" and robot.pose.x > -0.2)
    home = PlanePose(-2.5, 0.0, math.pi)
    navigation = robot.run(Navigation([home], robot.plan))
    assert navigation.outcome is Outcome.REACHED
    assert_stands_at(robot, home)


def test_without_propellers_it_does_not_fly() -> None:
    robot = FlyingRobot(wall)
    robot.has_fans = False
    navigation = robot.run(Navigation([BEHIND], robot.plan))
    assert navigation.outcome is Outcome.NO_ROUTE
    assert "quadrotor" not in robot.modes


# Landings that were not planned -------------------------------------------------------------------
def flight_to(x: float) -> tuple[FlyingRobot, Navigation]:
    """Return a robot in flight over the wall at x, and its navigation."""
    robot = FlyingRobot(wall)
    navigation = Navigation([BEHIND], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "quadrotor" and robot.pose.x > x)
    return robot, navigation


def test_a_robot_that_was_landed_does_not_take_off_again() -> None:
    robot, navigation = flight_to(-0.8)
    robot.landing = True
    robot.run(navigation)
    assert navigation.outcome is Outcome.STOPPED
    assert "has landed" in navigation.reason
    assert robot.modes.count("quadrotor") == 1


def test_a_goal_that_comes_in_a_landing_is_gone_to_from_the_ground() -> None:
    robot, navigation = flight_to(-1.2)
    navigation.stop(robot.view, Outcome.CANCELLED)
    robot.run_until(navigation, lambda: robot.landing)
    robot.planned_in.clear()
    navigation = robot.run(Navigation([BEHIND], robot.plan))
    assert navigation.outcome is Outcome.REACHED
    assert_stands_at(robot, BEHIND)
    assert robot.planned_in[:2] == ["quadrotor", "splay"]
    assert robot.modes.count("quadrotor") == 2


def test_a_robot_that_loses_a_fan_in_flight_lands() -> None:
    robot, navigation = flight_to(-0.3)
    robot.has_fans = False
    robot.run(navigation)
    assert navigation.outcome is Outcome.STOPPED
    assert "fan is lost" in navigation.reason
    assert robot.mode == "stand"


def test_a_robot_that_loses_a_fan_on_its_perch_does_not_take_off() -> None:
    robot = FlyingRobot(wall)
    navigation = Navigation([BEHIND], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "perch")
    robot.has_fans = False
    robot.run(navigation)
    assert navigation.outcome is Outcome.NO_ROUTE
    assert "quadrotor" not in robot.modes


def test_ground_that_is_lower_than_was_hoped_is_landed_on() -> None:
    def step_down(x: Array, y: Array) -> Array:
        return np.where(x > 0.1, -0.5, wall(x, y))

    robot = FlyingRobot(step_down, unseen_behind)
    navigation = Navigation([BEHIND], robot.plan)
    robot.run_until(navigation, lambda: robot.mode == "quadrotor" and robot.pose.x > -0.3)
    robot.see(step_down)
    robot.step(navigation)
    assert robot.depth == pytest.approx(0.5 + 0.29, abs=0.02), "as seen, not as hoped"
    robot.run(navigation)
    assert navigation.outcome is Outcome.REACHED
    assert robot.modes.count("quadrotor") == 1


def test_a_robot_whose_height_cannot_be_set_lands_at_once() -> None:
    """A navigator that begins in flight does not know where the flight began."""
    robot = FlyingRobot(wall)
    robot.mode, robot.height, robot.top = "quadrotor", 0.6, 0.6
    navigation = robot.run(Navigation([BEHIND], robot.plan), within=30.0)
    assert navigation.outcome is Outcome.NOT_READY
    assert "cannot rise" in navigation.reason
    assert robot.mode == "stand"


def test_a_landing_has_its_own_time_after_the_way_to_it() -> None:
    robot, navigation = flight_to(0.0)
    navigation.stop(robot.view, Outcome.CANCELLED)
    robot.stalls = True
    until = robot.time + 39.0
    robot.run_until(navigation, lambda: robot.time > until)
    robot.run(navigation)
    assert robot.mode == "stand"


def test_the_height_of_a_flight_to_a_landing_is_set_once() -> None:
    robot, navigation = flight_to(0.0)
    robot.noise = 0.03
    navigation.stop(robot.view, Outcome.CANCELLED)
    heights = set()
    while navigation.outcome is None:
        robot.step(navigation)
        heights.add(robot.wish.heights)
    assert len(heights - {None}) == 1


# Judgements of the air ----------------------------------------------------------------------------
def air_over(ground: Ground) -> tuple[FlyingRobot, AirLayers]:
    """Return a robot that has seen a ground, and the air over it without any place to land."""
    robot = FlyingRobot(ground)
    return robot, robot.air._replace(landing=np.zeros_like(robot.air.landing))


@pytest.mark.parametrize(("half", "is_blocked"), [(0, False), (1, True)])
def test_a_cell_beside_which_it_is_free_is_no_obstacle(half: int, is_blocked: bool) -> None:
    robot, air = air_over(lambda x, y: 0.0 * x)
    i, j = robot.grid.lattice.index_of(0.0, 0.0) or (0, 0)
    air.lowest[i - half : i + half + 1, j - half : j + half + 1] = 2.0
    leg = Leg(FLY, np.array(((-1.0, 0.0), (1.0, 0.0))), 0.0, 0.0, 0.0, altitude=1.0)
    assert air_is_blocked(robot.grid, air, follower_of(leg), 1.0) is is_blocked


def test_it_lands_on_its_side_of_a_high_fence() -> None:
    def fence(x: Array, y: Array) -> Array:
        return np.where(np.abs(x) < 0.1, 2.0, 0.0)

    robot, air = air_over(fence)
    pose = PlanePose(-0.6, 0.0, 0.0)

    def landing_x(*places: float) -> float:
        for x in places:
            i, j = robot.grid.lattice.index_of(x, 0.0) or (0, 0)
            air.landing[i // STRIDE, j // STRIDE] = True
        leg = nearest_landing(robot.grid, air, pose, 1.0, may_rise=True)
        assert leg is not None
        assert leg.altitude == 1.0
        return float(leg.points[-1, 0])

    assert -1.5 < landing_x(1.2) < 0.0, "ground on which it fits, rather than over the fence"
    assert landing_x(-2.6) == pytest.approx(-2.6, abs=0.2)


def test_all_that_a_flight_may_be_lower_keeps_the_perch_off_the_ground() -> None:
    assert BETA.fly is not None
    lower = ground_checks._LOWER + robot_wish.NEAR_TOP
    assert lower < BETA.fly.clearance - BETA.fly.perched
