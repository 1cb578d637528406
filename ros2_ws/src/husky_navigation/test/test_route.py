"""Routes over grounds that were seen: around walls, over ridges, at the measured price."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planned_ground import CARBON, HIGH, Ridge, costs, grid_seen, level, wall

from husky_description.arrays import Array
from husky_navigation.planning.abilities import ABILITIES
from husky_navigation.planning.planning_grid import PlanningGrid, heading_of
from husky_navigation.planning.route import PlanePose, Refusal, RouteError
from husky_navigation.planning.route_finder import find_route
from husky_navigation.planning.route_search import Prices, RouteGraph
from husky_navigation.planning.travel_costs import TravelCosts

START = PlanePose(0.0, 0.0, 0.0)
BEFORE, BEHIND = PlanePose(-5.0, 0.0, 0.0), PlanePose(5.8, 0.6, 0.0)
"""On both sides of a ridge."""
RIDGE = Ridge(30.0)


def graph_of(grid: PlanningGrid, **more: object) -> RouteGraph:
    """Return what Carbon can do on a ground."""
    return RouteGraph(grid, CARBON, costs(), **more)  # type: ignore[arg-type]


def refusal(graph: RouteGraph, start: PlanePose, goal: PlanePose) -> Refusal:
    """Return why there is no route."""
    with pytest.raises(RouteError) as error:
        find_route(graph, start, goal)
    assert str(error.value) == error.value.refusal.value
    return error.value.refusal


@pytest.fixture(scope="module")
def flat() -> RouteGraph:
    return graph_of(grid_seen(level))


@pytest.fixture(scope="module")
def walled() -> RouteGraph:
    return graph_of(grid_seen(wall))


@pytest.fixture(scope="module")
def ridged() -> RouteGraph:
    return graph_of(grid_seen(RIDGE))


# On level ground ---------------------------------------------------------------------------------
def test_straight_ahead_costs_what_was_measured(flat: RouteGraph) -> None:
    found = find_route(flat, START, PlanePose(3.0, 0.0, 0.0))
    (leg,) = found.legs
    np.testing.assert_allclose(leg.points, [[0.0, 0.0], [3.0, 0.0]])
    assert found.energy == pytest.approx(300.0)
    assert found.time == pytest.approx(7.5)
    assert found.length == pytest.approx(3.0)


def test_turns_are_paid_for(flat: RouteGraph) -> None:
    found = find_route(flat, START, PlanePose(3.0, 0.0, math.pi))
    assert found.energy == pytest.approx(300.0 + math.pi * 80.0)
    assert found.legs[-1].yaw == math.pi


def test_a_goal_between_the_headings_of_the_grid_is_kept(flat: RouteGraph) -> None:
    found = find_route(flat, START, PlanePose(2.03, 1.01, 0.3))
    assert tuple(found.legs[-1].points[-1]) == (2.03, 1.01)
    assert found.legs[-1].yaw == 0.3


def test_a_robot_at_its_goal_has_a_route_of_no_length(flat: RouteGraph) -> None:
    found = find_route(flat, START, PlanePose(0.0, 0.0, 0.1))
    assert found.modes == ("walk",)
    assert found.length == 0.0


# Walls -------------------------------------------------------------------------------------------
def test_it_goes_around_a_wall_and_keeps_clear_of_it(walled: RouteGraph) -> None:
    (leg,) = find_route(walled, START, PlanePose(4.0, 0.0, 0.0)).legs
    assert leg.points[:, 1].max() > 2.0
    share = np.linspace(0.0, 1.0, 20)[:, None]
    for start, end in zip(leg.points[:-1], leg.points[1:], strict=True):
        x, y = (start + share * (end - start)).T
        beside = np.hypot(np.clip(np.abs(x - 2.0) - 0.1, 0.0, None), np.clip(y - 2.0, 0.0, None))
        assert beside.min() > 0.5 * CARBON.width


def test_a_robot_beside_a_wall_finds_its_way_out(walled: RouteGraph) -> None:
    beside = PlanePose(1.65, 0.0, 0.0)
    index = walled.grid.lattice.index_of(beside.x, beside.y)
    assert index is not None
    assert not walled.grid.free[int(heading_of(0.0)), *index]
    assert find_route(walled, beside, START).length > 1.0


@pytest.mark.parametrize(("step", "walked"), [(0.02, True), (0.03, False), (0.3, False)])
def test_a_low_step_is_walked_over(step: float, walked: bool) -> None:
    graph = graph_of(grid_seen(lambda x, y: np.where(x > 2.0, step, 0.0)))
    if walked:
        assert find_route(graph, START, PlanePose(4.0, 0.0, 0.0)).length == pytest.approx(4.0)
    else:
        assert refusal(graph, START, PlanePose(4.0, 0.0, 0.0)) is Refusal.NO_WAY


@pytest.mark.parametrize(
    ("start", "goal", "reason"),
    [
        (PlanePose(50.0, 0.0, 0.0), START, Refusal.START_OUTSIDE),
        (START, PlanePose(0.0, -30.0, 0.0), Refusal.GOAL_OUTSIDE),
        (START, PlanePose(2.0, 0.0, 0.0), Refusal.GOAL_OCCUPIED),
        (START, PlanePose(1.6, 0.0, 0.0), Refusal.GOAL_OCCUPIED),
    ],
)
def test_a_refusal_says_why(
    walled: RouteGraph, start: PlanePose, goal: PlanePose, reason: Refusal
) -> None:
    assert refusal(walled, start, goal) is reason


def test_a_robot_on_ground_that_it_cannot_walk_is_told_so() -> None:
    steep = graph_of(grid_seen(lambda x, y: 0.5 * x))
    assert refusal(steep, START, PlanePose(1.0, 0.0, 0.0)) is Refusal.START_OCCUPIED


@pytest.mark.parametrize(("unseen", "around"), [(1.05, False), (5.0, True)])
def test_unseen_ground_is_crossed_unless_a_way_around_is_worth_it(
    unseen: float, around: bool
) -> None:
    def height(x: Array, y: Array) -> Array:
        return np.where((x > 1.0) & (x < 3.0) & (np.abs(y) < 0.7), np.nan, 0.0)

    graph = graph_of(grid_seen(height), prices=Prices(unseen=unseen))
    found = find_route(graph, START, PlanePose(4.0, 0.0, 0.0))
    widest = np.abs(np.concatenate([leg.points for leg in found.legs])[:, 1]).max()
    assert bool(widest > 0.6) is around


def test_a_goal_beside_which_nothing_was_seen_is_gone_near_to() -> None:
    """Behind the seen ground may be an edge: the filled strip between is no ground."""

    def height(x: Array, y: Array) -> Array:
        return np.where(x < 2.3, 0.0, np.where(x < 3.3, np.nan, HIGH))

    graph, goal = graph_of(grid_seen(height)), PlanePose(2.0, 0.0, 0.0)
    found = find_route(graph, START, goal)
    assert not found.is_whole
    x, y = found.legs[-1].points[-1]
    assert math.hypot(x - goal.x, y - goal.y) < 0.7
    near_wall = graph_of(grid_seen(lambda x, y: np.where(x < 2.3, 0.0, HIGH)))
    assert refusal(near_wall, START, goal) is Refusal.GOAL_OCCUPIED
    assert find_route(graph_of(grid_seen(level)), START, goal).is_whole


# Ridges ------------------------------------------------------------------------------------------
def test_it_climbs_a_ridge_straight_up_and_straight_down(ridged: RouteGraph) -> None:
    found = find_route(ridged, BEFORE, BEHIND)
    assert found.modes == ("walk", "climb", "walk", "climb", "walk")
    for climb in (found.legs[1], found.legs[3]):
        assert climb.yaw == pytest.approx(0.0, abs=0.05)
        (x0, y0), (x1, y1) = climb.points
        assert y0 == pytest.approx(y1, abs=0.1)
        assert x1 - x0 > RIDGE.rise
        # The way is longer than its shadow, and dearer than level ground.
        way = (x1 - x0) / math.cos(RIDGE.slope)
        assert 150.0 + 200.0 * (x1 - x0) < climb.energy < 150.0 + 800.0 * way
    assert found.energy == pytest.approx(sum(leg.energy for leg in found.legs))


def test_it_climbs_over_waves_on_which_it_could_walk() -> None:
    """They rise to the side by 3.6 deg, more than the slope itself does at its foot and its top."""
    found = find_route(
        graph_of(grid_seen(lambda x, y: RIDGE(x, y) + 0.01 * np.sin(2.0 * math.pi * y))),
        BEFORE,
        BEHIND,
    )
    assert found.modes == ("walk", "climb", "walk", "climb", "walk")


def test_without_climbing_no_way_leads_over_a_ridge(ridged: RouteGraph) -> None:
    walking = graph_of(ridged.grid, modes=("walk",))
    assert refusal(walking, BEFORE, BEHIND) is Refusal.NO_WAY
    walker = RouteGraph(ridged.grid, ABILITIES["beta"], costs("beta"), modes=("walk", "climb"))
    assert refusal(walker, BEFORE, BEHIND) is Refusal.NO_WAY


def test_a_slope_steeper_than_it_can_climb_is_a_wall() -> None:
    assert refusal(graph_of(grid_seen(Ridge(49.0))), BEFORE, BEHIND) is Refusal.NO_WAY


def seen_before(end: float) -> RouteGraph:
    """Return the ridge of which nothing is seen from a place on [m]."""
    return graph_of(grid_seen(lambda x, y: np.where(x < end, RIDGE(x, y), np.nan)))


def test_it_climbs_where_the_top_is_not_seen_yet() -> None:
    found = find_route(seen_before(RIDGE.crest - 0.3), BEFORE, BEHIND)
    assert found.modes == ("walk", "climb", "walk")


@pytest.mark.parametrize("back", [False, True])
def test_a_robot_on_a_slope_goes_on_whatever_is_behind_it(back: bool) -> None:
    """A map errs most at a crest, and may find a step where the robot has just come up."""
    step_at = RIDGE.crest - 0.9

    def height(x: Array, y: Array) -> Array:
        return RIDGE(x, y) + np.where(np.abs(x - step_at) < 0.1, 0.15, 0.0)

    graph = graph_of(grid_seen(height))
    x, yaw = (step_at - 0.5, math.pi) if back else (step_at + 0.5, 0.0)
    found = find_route(graph, PlanePose(x, 0.0, yaw), BEFORE if back else on_top())
    assert found.modes == ("climb", "walk")
    assert found.legs[0].downwards is back
    assert found.legs[0].yaw == pytest.approx(yaw, abs=0.05)
    crosswise = PlanePose(x, 0.0, 0.5 * math.pi)
    assert refusal(graph, crosswise, BEFORE) is Refusal.START_OCCUPIED


def hidden(start: float, end: float) -> RouteGraph:
    """Return the ridge of which nothing is seen between two places [m]."""
    return graph_of(grid_seen(lambda x, y: np.where((x < start) | (x > end), RIDGE(x, y), np.nan)))


def on_top() -> PlanePose:
    return PlanePose(0.5 * (RIDGE.crest + RIDGE.far_crest), 0.0, 0.0)


def test_it_goes_down_where_the_middle_of_the_slope_is_hidden_by_the_crest() -> None:
    middle = RIDGE.far_crest + 0.5 * RIDGE.rise
    found = find_route(hidden(middle - 0.4, middle + 0.4), on_top(), BEHIND)
    assert found.modes[-2:] == ("climb", "walk")


@pytest.mark.parametrize("gap", [0.1, 0.3, 0.8])
def test_an_edge_behind_which_it_does_not_see_is_no_ground_to_walk_on(gap: float) -> None:
    """From the upper ground the foot of an edge is hidden."""

    def height(x: Array, y: Array) -> Array:
        return np.where(x < 0.0, 0.0, np.where(x < gap, np.nan, -1.0))

    graph = graph_of(grid_seen(height))
    assert refusal(graph, PlanePose(-3.0, 0.0, 0.0), PlanePose(4.0, 0.0, 0.0)) is Refusal.NO_WAY


def test_a_thin_wall_between_unseen_cells_is_a_wall() -> None:
    def height(x: Array, y: Array) -> Array:
        behind = (x > 0.9) & (x < 1.2)
        return np.where(behind, np.where((x > 1.0) & (x < 1.1), 0.5, np.nan), 0.0)

    graph = graph_of(grid_seen(height))
    assert refusal(graph, PlanePose(-3.0, 0.0, 0.0), PlanePose(4.0, 0.0, 0.0)) is Refusal.NO_WAY


def test_it_climbs_in_the_middle_of_a_ridge_whose_sides_were_not_seen() -> None:
    def height(x: Array, y: Array) -> Array:
        return np.where(np.abs(y) < 1.0, RIDGE(x, y), np.nan)

    lanes = graph_of(grid_seen(height)).lanes
    assert lanes is not None
    assert len(lanes.foot) > 0
    beside = np.abs(lanes.foot[:, 1] + 0.5 - 70) * 0.1
    assert beside.max() <= 1.0 - CARBON.climb.half_width + 0.1


# Room to turn ------------------------------------------------------------------------------------
def corridor(x: Array, y: Array) -> Array:
    """Return walls at both sides, too near for a turn, that end at x = 2."""
    return np.where((x < 2.0) & (np.abs(y) > 0.55), HIGH, 0.0)


def test_in_a_corridor_it_drives_out_to_turn_round() -> None:
    graph = graph_of(grid_seen(corridor))
    found = find_route(graph, PlanePose(-1.0, 0.0, 0.0), PlanePose(-4.0, 0.0, math.pi))
    (leg,) = found.legs
    assert leg.points[:, 0].max() > 2.0
    assert found.length > 9.0
    assert found.energy == pytest.approx(100.0 * found.length + 80.0 * math.pi, rel=0.2)


@pytest.mark.parametrize("name", ["start", "goal"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_pose_that_is_not_finite_is_refused(flat: RouteGraph, name: str, bad: float) -> None:
    poses = {"start": START, "goal": START}
    for field in PlanePose._fields:
        poses[name] = START._replace(**{field: bad})
        with pytest.raises(ValueError, match=f"{name} is .* must be finite"):
            find_route(flat, **poses)


def test_modes_without_costs_are_refused(flat: RouteGraph) -> None:
    with pytest.raises(ValueError, match="no mode 'swim', there are walk, climb, fly"):
        graph_of(flat.grid, modes=("walk", "swim"))
    few = TravelCosts([row for row in costs().rows if row.slope_deg < 45.0])
    with pytest.raises(LookupError, match="no costs of a climb up to 47 deg"):
        RouteGraph(flat.grid, CARBON, few)
