"""A planner that keeps the ground: limits of its routes, what it knows, paths that are given."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planned_ground import HIGH, Ridge, seen

from husky_navigation.cells import Lattice
from husky_navigation.frame_filter import LevelTransform
from husky_navigation.planning.given_path import GivenPath
from husky_navigation.planning.route import PlanePose, Refusal, RouteError
from husky_navigation.planning.route_planner import NO_LIMITS, Limits, RoutePlanner
from husky_navigation.planning.world_map import MapHeights

ROLLING = Lattice(0.05, 160, -80, -80)
START, GOAL = PlanePose(0.0, 0.0, 0.0), PlanePose(3.0, 0.0, 0.0)


def planner_on(elevation: np.ndarray) -> RoutePlanner:
    """Return a planner that has seen one rolling map around the origin."""
    planner = RoutePlanner("carbon")
    show(planner, elevation)
    return planner


def show(
    planner: RoutePlanner,
    elevation: np.ndarray,
    lattice: Lattice = ROLLING,
    top: np.ndarray | None = None,
) -> None:
    """Let the planner see a rolling map, all of it at this moment."""
    age, top = np.zeros_like(elevation), elevation if top is None else top
    planner.merge(MapHeights(elevation, top, age, lattice), LevelTransform())


def ridged() -> RoutePlanner:
    """Return a planner that has seen a ridge whole, with a long way around its end."""
    planner = RoutePlanner("carbon")
    ridge = Ridge(20.0)
    shown = seen(lambda x, y: np.where(y < 1.5, ridge(x, y), np.where(y < 1.7, HIGH, 0.0)))
    show(planner, shown.elevation, shown.lattice)
    return planner


def test_a_wall_of_which_the_map_holds_the_foot_is_walked_around() -> None:
    planner, level = RoutePlanner("carbon"), np.zeros((160, 160))
    x, y = np.meshgrid(*ROLLING.cell_centers(), indexing="ij")
    wall = (np.abs(x - 1.5) < 0.03) & (y < 1.0)
    show(planner, level, top=np.where(wall, HIGH, 0.0))
    assert planner.plan(START, GOAL).length > 3.5


def test_it_plans_on_the_newest_ground() -> None:
    level = np.zeros((160, 160))
    planner = planner_on(level)
    assert planner.plan(START, GOAL).length == pytest.approx(3.0, abs=0.01)
    grid = planner.grid()
    assert planner.grid() is grid
    x, y = np.meshgrid(*ROLLING.cell_centers(), indexing="ij")
    show(planner, np.where((np.abs(x - 1.5) < 0.1) & (y < 1.0), HIGH, 0.0))
    assert planner.grid() is not grid
    assert planner.plan(START, GOAL).length > 3.5
    planner.clear()
    assert not planner.grid().known.any()


def test_without_energy_for_the_way_there_is_no_route() -> None:
    planner = planner_on(np.zeros((160, 160)))
    energy = planner.plan(START, GOAL).energy
    assert planner.plan(START, GOAL, Limits(energy=1.01 * energy)).energy == energy
    with pytest.raises(RouteError) as error:
        planner.plan(START, GOAL, Limits(energy=0.5 * energy))
    assert error.value.refusal is Refusal.BATTERY


def test_little_energy_takes_the_way_that_costs_less_of_it() -> None:
    """A climb saves time; around the ridge the robot goes with less energy."""
    planner = ridged()
    before, behind = PlanePose(-5.0, 0.0, 0.0), PlanePose(5.8, 0.6, 0.0)
    quick = planner.plan(before, behind)
    around = planner.plan(before, behind, Limits(modes=("walk",)))
    assert "climb" in quick.modes
    assert around.energy < quick.energy
    thrifty = planner.plan(before, behind, Limits(energy=0.5 * (quick.energy + around.energy)))
    assert thrifty.energy <= around.energy


def test_robots_and_modes_that_there_are_not_are_named() -> None:
    with pytest.raises(ValueError, match="robot is 'delta', it must be one of carbon, beta"):
        RoutePlanner("delta")
    with pytest.raises(ValueError, match="no mode 'swim', there are walk, climb, fly"):
        planner_on(np.zeros((160, 160))).plan(START, GOAL, Limits(modes=("swim",)))


def straight_path(planner: RoutePlanner, start: float, end: float, y: float = 0.0) -> GivenPath:
    """Return a path along x."""
    return GivenPath([PlanePose(start, y, 0.0), PlanePose(end, y, 0.0)], planner)


def test_a_path_is_walked_as_it_is_given() -> None:
    planner = planner_on(np.zeros((160, 160)))
    corner = [PlanePose(0.0, 0.0, 0.0), PlanePose(0.0, 0.0, 0.0), PlanePose(2.0, 1.0, 0.0)]
    path = GivenPath([*corner, PlanePose(2.0, 3.0, 1.2)], planner)
    route = path.route(PlanePose(0.0, 0.2, 0.0), NO_LIMITS)
    assert route.modes == ("walk",)
    assert route.legs[0].yaw == 1.2
    assert route.length == pytest.approx(math.hypot(2.0, 1.0) + 2.0 + 0.2, abs=0.15)
    # From half-way on: the rest alone.
    assert path.route(PlanePose(1.9, 1.1, 0.0), NO_LIMITS).length == pytest.approx(2.0, abs=0.3)


def test_a_path_that_crosses_itself_is_not_cut_short() -> None:
    planner = planner_on(np.zeros((160, 160)))
    corners = (0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)
    loop = GivenPath([PlanePose(x, y, 0.0) for x, y in corners], planner)
    assert loop.route(START, NO_LIMITS).length == pytest.approx(8.0, abs=0.1)


def test_where_a_path_crosses_a_slope_it_is_climbed() -> None:
    planner = ridged()
    route = straight_path(planner, -5.0, 5.8).route(PlanePose(-5.0, 0.0, 0.0), NO_LIMITS)
    assert route.modes.count("climb") == 2
    assert abs(np.concatenate([leg.points for leg in route.legs])[:, 1]).max() < 0.5
    with pytest.raises(RouteError) as error:
        straight_path(planner, -5.0, 5.8).route(PlanePose(-5.0, 0.0, 0.0), Limits(("walk",)))
    assert error.value.refusal is Refusal.PATH_BLOCKED


def test_paths_on_which_nobody_can_go_are_refused() -> None:
    planner = planner_on(np.zeros((160, 160)))
    with pytest.raises(ValueError, match="the path has 0 places, it must have 2 or more"):
        GivenPath([], planner)
    with pytest.raises(ValueError, match="the path has 1 places"):
        GivenPath([START, START], planner)
    with pytest.raises(ValueError, match="the path is 300 m long, it may be 200 m long"):
        straight_path(planner, 0.0, 300.0)
    with pytest.raises(RouteError) as error:
        straight_path(planner, 0.0, 2.0, y=1.0).route(START, NO_LIMITS)
    assert error.value.refusal is Refusal.OFF_PATH
    x, _ = np.meshgrid(*ROLLING.cell_centers(), indexing="ij")
    walled = planner_on(np.where(np.abs(x - 1.5) < 0.1, HIGH, 0.0))
    with pytest.raises(RouteError) as error:
        straight_path(walled, 0.0, 3.0).route(START, NO_LIMITS)
    assert error.value.refusal is Refusal.PATH_BLOCKED
    with pytest.raises(RouteError) as error:
        straight_path(planner, 0.0, 3.0).route(START, Limits(energy=10.0))
    assert error.value.refusal is Refusal.BATTERY
