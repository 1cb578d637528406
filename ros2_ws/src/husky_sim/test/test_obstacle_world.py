"""Worlds of obstacles: distances, ways to the goal, and surfaces as MuJoCo's rays find them."""

import functools
import itertools
import math

import mujoco
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.distance import cdist

from husky_description.robot import load_robot
from husky_sim import lab_world as lab_drawing
from husky_sim import random_world as drawing
from husky_sim import terrain
from husky_sim.lab_world import lab_world
from husky_sim.obstacle_site import APART, fence
from husky_sim.obstacle_world import (
    DITCH_DEPTH,
    GoalPose,
    ObstacleWorld,
    Rectangle,
    Ridge,
    UprightBox,
)
from husky_sim.ramp import Ramp
from husky_sim.random_world import APPROACH, SQUARE, random_world
from husky_sim.reachability import goal_is_reachable
from husky_sim.scene import WorldOptions, build_scene
from husky_sim.terrain import TerrainOptions

SEEDS = range(50)
LAB_SEEDS = range(24)
CELL = 0.1
"""Edge of a cell of the raster on which ways are searched [m]."""
ROBOT = math.hypot(0.4, 0.25) + 0.3
"""Distance of the middle of a robot from obstacles from which it keeps 0.3 m while it turns [m]."""


@functools.cache
def world_of(seed):
    return random_world(np.random.default_rng(seed))


@functools.cache
def lab_of(seed):
    return lab_world(np.random.default_rng(seed))


@functools.cache
def ground_of(seed, kind="obstacles"):
    """Model and data of the ground alone, as the plant builds it."""
    spec = mujoco.MjSpec()
    for name in ("ground", "tile"):
        spec.add_material(name=name)
    terrain.build(spec, TerrainOptions(kind=kind), seed)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def seen_height(seed, x, y, kind="obstacles"):
    """Height of the ground at a point, by a ray down from 5 m [m]."""
    start, down = np.array((x, y, 5.0)), np.array((0.0, 0.0, -1.0))
    ground, hit = ground_of(seed, kind), np.zeros(1, np.int32)
    return 5.0 - mujoco.mj_ray(*ground, start, down, None, 1, -1, hit)


def places(square, count, rng):
    """Places anywhere within the fence (count, 2) [m]."""
    half = square.side / 2
    return rng.uniform((square.first_x, -half), (square.last_x, half), (count, 2))


def border(ground):
    """Points on the edges of a rectangle, at most 10 cm apart (n, 2) [m]."""
    points = []
    for share in np.linspace(-0.5, 0.5, math.ceil(max(ground.length, ground.width) / 0.1) + 1):
        for end in (-0.5, 0.5):
            points.append(ground.at(share * ground.length, end * ground.width))
            points.append(ground.at(end * ground.length, share * ground.width))
    return np.array(points)


def barrier_walls(world):
    return {box.ground for box in world.boxes[4:6]} if world.barrier else set()


# Random worlds ----------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", SEEDS)
def test_obstacles_keep_their_distance(seed):
    """From each other, the fence, the start and the goal; walls of a barrier join both."""
    world = world_of(seed)
    joined = barrier_walls(world)
    borders = {ground: border(ground) for ground in world.grounds}
    crossing = {world.ridges[0].ground} if world.barrier else set()
    sides = {box.ground for box in world.boxes[:4]}
    for first, second in itertools.combinations(world.grounds, 2):
        pair = {first, second}
        if (pair & joined and pair & (crossing | sides)) or pair <= sides:
            continue
        assert cdist(borders[first], borders[second]).min() >= APART - 1e-9, (first, second)
    ends = np.array(((0.0, 0.0), world.goal[:2]))
    for ground, points in borders.items():
        assert cdist(points, ends).min() >= APART - 1e-9, ground
        assert (ground.distance_to(*ends.T) > 0.0).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_ground_is_level_before_both_feet_of_a_ridge(seed):
    world = world_of(seed)
    assert world.ridges
    across, before = np.meshgrid(np.linspace(-0.5, 0.5, 9), np.linspace(0.01, APPROACH - 0.01, 12))
    for ridge in world.ridges:
        ground = ridge.ground
        for side in (-1.0, 1.0):
            points = ground.at(side * (ground.length / 2 + before), across * ground.width)
            assert not world.height_at(*points).any()


def ways(world, radius, climbing, flight_height=1e-9):
    """Return True if a raster of heights joins start and goal, by SciPy's distances and labels."""
    first_x, side = world.square.first_x, world.square.side
    x, y = np.meshgrid(
        np.arange(first_x + CELL / 2, world.square.last_x, CELL),
        np.arange((CELL - side) / 2, side / 2, CELL),
        indexing="ij",
    )
    level = np.pad(np.abs(world.height_at(x, y)) < flight_height, 1)
    labels, _ = ndimage.label(ndimage.distance_transform_edt(level) * CELL >= radius)

    def label(point):
        return labels[int((point[0] - first_x) / CELL) + 1, int((point[1] + side / 2) / CELL) + 1]

    reached = {label((0.0, 0.0))}
    for _ in world.ridges if climbing else ():
        for ridge in world.ridges:
            ends = {label(end) for end in ridge.ends(1.2)}
            reached |= ends if ends & reached else set()
    return 0 not in reached and label(world.goal) in reached


@pytest.mark.parametrize("seed", SEEDS)
def test_a_way_leads_to_the_goal_over_a_ridge_where_a_barrier_is(seed):
    """Nothing passes a barrier."""
    world = world_of(seed)
    assert ways(world, ROBOT, climbing=True)
    assert ways(world, ROBOT, climbing=False) != world.barrier
    assert ways(world, 0.15, climbing=False) != world.barrier


def test_worlds_have_all_slopes_and_half_of_them_a_barrier():
    worlds = [world_of(seed) for seed in SEEDS]
    barriers = [world for world in worlds if world.barrier]
    assert 15 <= len(barriers) <= 35  # 25 +- 3 standard deviations of 3.5
    for some in worlds, barriers:
        slopes = np.degrees([ridge.slope for world in some for ridge in world.ridges])
        assert 15.0 <= slopes.min() < 20.0 and 42.0 < slopes.max() <= 45.0
    assert all(world.ditches for world in worlds)


def test_the_seed_alone_decides():
    assert random_world(np.random.default_rng(3)) == world_of(3) != world_of(4)


@pytest.mark.parametrize(
    ("module", "draw", "kind"),
    [(drawing, random_world, "of obstacles"), (lab_drawing, lab_world, "of the lab")],
)
def test_a_world_without_a_way_is_an_error(module, draw, kind, monkeypatch):
    monkeypatch.setattr(module, "goal_is_reachable", lambda world, **abilities: False)
    monkeypatch.setattr(module, "_MOST_WORLDS", 2)
    with pytest.raises(RuntimeError, match=f"none of 2 worlds {kind} has a way to its goal"):
        draw(np.random.default_rng(0))


# Random worlds of the lab -----------------------------------------------------------------------
@pytest.mark.parametrize("seed", LAB_SEEDS)
def test_boxes_of_the_lab_are_wide_and_stand_before_the_goal(seed):
    """Their sizes, and their distance from the start and the goal."""
    world = lab_of(seed)
    square, sides, boxes = world.square, world.boxes[:4], world.boxes[4:]
    assert (square.side, square.first_x, square.last_x) == (8.0, -1.0, 7.0)
    assert not world.ridges and not world.ditches and len(boxes) in (3, 4)
    assert min(box.height for box in sides) > 2.2, "no flight leads over the fence"
    ends = np.array(((0.0, 0.0), world.goal[:2]))
    for box in boxes:
        assert 0.4 <= box.ground.length <= 0.8 and 2.0 <= box.ground.width <= 3.0
        assert 0.25 <= box.height <= 1.75 and box.ground.x < world.goal.x
        assert cdist(border(box.ground), ends).min() >= APART - 1e-9
        assert (box.ground.distance_to(*ends.T) > 0.0).all()
        assert (np.abs(border(box.ground) - (3.0, 0.0)) <= 4.0 - 0.075).all(), "within the fence"
    assert 5.0 <= world.goal.x <= 5.7 and abs(world.goal.y) <= 2.7


@pytest.mark.parametrize("seed", LAB_SEEDS)
def test_boxes_of_the_lab_close_the_width_or_stand_apart(seed):
    world = lab_of(seed)
    grounds = [box.ground for box in world.boxes[4:]]
    if not world.barrier:
        for pair in itertools.combinations(grounds, 2):
            assert cdist(*map(border, pair)).min() >= APART - 1e-9
        return
    right, left = (box.ground for box in world.boxes[2:4])
    for first, second in itertools.pairwise([right, *grounds, left]):
        assert 0.0 <= first.gap_to(second) < 0.3
    assert all(first.gap_to(second) >= 0.0 for first, second in itertools.combinations(grounds, 2))
    assert min(box.height for box in world.boxes[4:]) <= 1.2


@pytest.mark.parametrize("seed", LAB_SEEDS)
def test_a_way_of_the_lab_is_on_level_ground_or_in_flight(seed):
    """Nothing that walks passes boxes side by side; a robot flies over those of at most 1.2 m."""
    world = lab_of(seed)
    assert ways(world, ROBOT, climbing=False) != world.barrier
    # A gap of less than 0.3 m is at most 3 cells of the raster, whose middle is 0.2 m from both.
    assert ways(world, 0.25, climbing=False) != world.barrier
    assert ways(world, ROBOT, climbing=False, flight_height=1.2)


def test_half_of_the_worlds_of_the_lab_are_closed_with_boxes_of_all_kinds():
    worlds = [lab_of(seed) for seed in LAB_SEEDS]
    assert 5 <= sum(world.barrier for world in worlds) <= 19  # 12 +- 3 standard deviations of 2.4
    for closed in (False, True):
        boxes = [world.boxes[4:] for world in worlds if world.barrier == closed]
        assert {len(each) for each in boxes} == {3, 4}
        heights = [box.height for each in boxes for box in each]
        assert min(heights) < 0.5 and max(heights) > 1.5
    depths = [len({box.ground.x for box in w.boxes[4:]}) for w in worlds if w.barrier]
    assert min(depths) == 1 < max(depths), "in one line, and in two"


def test_the_seed_alone_decides_a_world_of_the_lab():
    assert lab_world(np.random.default_rng(3)) == lab_of(3) != lab_of(4)


# Solids -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(4))
def test_rays_find_the_heights_of_the_world(seed):
    """The plant builds the world that its seed draws."""
    world, rng = world_of(seed), np.random.default_rng(seed)
    for x, y in places(world.square, 300, rng):
        assert seen_height(seed, x, y) == pytest.approx(world.height_at(x, y), abs=1e-9), (x, y)
    for ridge in world.ridges:
        assert seen_height(seed, *ridge.ground.at(0.0, 0.0)) == pytest.approx(ridge.height)
    for ditch in world.ditches:
        assert seen_height(seed, ditch.x, ditch.y) == pytest.approx(-DITCH_DEPTH)
    for box in world.boxes:
        if box.ground not in barrier_walls(world):
            assert seen_height(seed, box.ground.x, box.ground.y) == pytest.approx(box.height)


@pytest.mark.parametrize("seed", range(4))
def test_rays_find_the_boxes_of_the_lab(seed):
    """The plant builds the world that its seed draws, within its fence and around it."""
    world, rng = lab_of(seed), np.random.default_rng(seed)
    for x, y in places(world.square, 200, rng):
        assert seen_height(seed, x, y, "lab") == pytest.approx(world.height_at(x, y), abs=1e-9)
    for box in world.boxes:
        seen = seen_height(seed, box.ground.x, box.ground.y, "lab")
        assert seen == pytest.approx(box.height, abs=1e-9)
    for x, y in (-2.0, 0.0), (8.0, 0.0), (3.0, -5.0), (3.0, 5.0):
        assert seen_height(seed, x, y, "lab") == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", SEEDS[::5])
def test_a_world_is_of_few_boxes(seed):
    """A depth image takes the longer the more there are."""
    model, _ = ground_of(seed)
    assert 20 < model.ngeom < 150
    assert not (model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD).any()


@pytest.mark.parametrize("slope", [15.0, 30.0, 45.0])
def test_a_ridge_is_an_arc_a_slope_and_an_arc_of_a_closed_form(slope):
    angle, radius, straight = math.radians(slope), 1.5, 0.4
    flank = Ramp(angle, 0.0, radius, straight, 0.0)
    arcs = 2.0 * radius * np.array((math.sin(angle), 1.0 - math.cos(angle)))
    run, height = arcs + straight * np.array((math.cos(angle), math.sin(angle)))
    ridge = Ridge(Rectangle(3.0, -1.0, 0.4, 2.0 * run + 1.0, 2.0), flank)
    assert (ridge.run, ridge.height, ridge.slope) == pytest.approx((run, height, angle))
    for along in (-0.4, 0.0, 0.4):
        assert ridge.height_at(*ridge.ground.at(along, 0.9)) == pytest.approx(height)
    for side in (-1.0, 1.0):
        point = ridge.ground.at(side * (0.5 + run / 2), 0.0)
        assert ridge.height_at(*point) == pytest.approx(height / 2), "halfway up"
        on_arc = ridge.ground.at(side * (0.5 + run - 0.2), 0.0)
        exact = radius - math.sqrt(radius**2 - 0.2**2)
        # A chord that turns 5 deg is radius (1 - cos 2.5 deg) off its arc.
        assert 0.0 <= ridge.height_at(*on_arc) - exact < 0.0015
    assert ridge.height_at(*ridge.ground.at(0.0, 1.01)) == 0.0
    assert ridge.height_at(*ridge.ground.at(run + 0.51, 0.0)) == 0.0


def fallen(kind, seed):
    """Position and orientation after 0.1 s of a robot that stands without motors (7,)."""
    options = WorldOptions(TerrainOptions(kind=kind), keyframe="stand", seed=seed)
    model = build_scene(load_robot(), options).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    mujoco.mj_step(model, data, 200)
    assert data.ncon >= 4
    return data.qpos[:7].copy()


@pytest.mark.parametrize("seed", [0, 2])
def test_a_robot_at_the_start_stands_on_level_ground(seed):
    """A foot touches the face of a box as it touches a plane."""
    assert fallen("obstacles", seed) == pytest.approx(fallen("flat", seed), abs=1e-6)


# Reachability -----------------------------------------------------------------------------------
def world_with(*boxes, ridges=()):
    goal, sides = GoalPose(9.0, 0.0, 0.0), fence(SQUARE.ground)
    return ObstacleWorld(ridges, (*sides, *boxes), (), goal, bool(ridges), SQUARE)


def wall(y_start, y_end, x=4.5):
    return UprightBox(Rectangle(x, (y_start + y_end) / 2, 0.0, 0.2, y_end - y_start), 1.0)


@pytest.mark.parametrize(("gap", "passable"), [(1.4, False), (1.8, True)])
def test_the_robot_passes_a_gap_of_its_diagonal_and_two_clearances(gap, passable):
    """0.94 m + 2 x 0.3 m, and up to two cells of the raster."""
    world = world_with(wall(-6.0, 0.0), wall(gap, 6.0))
    assert goal_is_reachable(world) == passable


def test_a_ridge_leads_over_a_barrier_if_both_its_feet_are_free():
    ridge = Ridge(Rectangle(4.5, 0.0, 0.0, 4.0, 2.0), Ramp(0.5, 0.0, 1.5, 0.2, 0.0))
    walls = wall(-6.0, -1.0), wall(1.0, 6.0)
    assert goal_is_reachable(world_with(*walls, ridges=(ridge,)))
    assert not goal_is_reachable(world_with(*walls, ridges=(ridge,)), climbing=False)
    assert not goal_is_reachable(world_with(*walls, wall(-0.1, 0.1, x=7.1), ridges=(ridge,)))


@pytest.mark.parametrize(
    ("free", "flight_height", "passable"),
    [(1.8, 1.0, True), (1.4, 1.0, False), (1.8, 0.99, False)],
)
def test_the_robot_flies_over_a_low_box_that_is_wide_enough(free, flight_height, passable):
    """Over one of 1 m, between two of 1.5 m that leave so much of it free."""
    high = (UprightBox(wall(*ends, x=4.8).ground, 1.5) for ends in ((-6.0, 0.0), (free, 6.0)))
    world = world_with(wall(-6.0, 6.0), *high)
    assert goal_is_reachable(world, flight_height=flight_height) == passable
    assert not goal_is_reachable(world)


@pytest.mark.parametrize(
    ("yaw", "gap"), [(0.0, 1.5), (math.pi / 4, 2.5 - 0.5 - 1.0 / math.sqrt(2))]
)
def test_the_gap_of_rectangles_is_between_their_nearest_edges(yaw, gap):
    first, second = Rectangle(1.0, 2.0, 0.0, 1.0, 3.0), Rectangle(3.5, 2.0, yaw, 1.0, 1.0)
    assert first.gap_to(second) == pytest.approx(gap) == second.gap_to(first)
    assert first.gap_to(Rectangle(1.2, 2.0, 1.0, 6.0, 0.1)) < 0.0, "they cross"
