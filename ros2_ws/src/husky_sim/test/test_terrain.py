"""Gaps, stairs and scenes: what is built is what its measures say, by MuJoCo's rays."""

import functools

import mujoco
import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_sim import terrain
from husky_sim.gap import BEHIND, DEPTH, Gap
from husky_sim.scene import WorldOptions
from husky_sim.terrain import TerrainOptions
from husky_sim.world import World

GROUND = TerrainOptions(kind="gap", approach=2.0, size=0.8, height=0.5, top=3.0)
LANE, APPROACH, START, END, EDGE = 1.2, 6.0, 0.8, 8.8, 3.0
"""Width of the lane and its end; start, end and half width of the scene [m]."""
SCENES = {
    name: TerrainOptions(kind=name, height=height, size=size, lane=LANE, approach=APPROACH)
    for name, height, size in (
        ("rough", 0.08, 0.45),
        ("boxes", 0.35, 0.2),
        ("steps", 0.08, 0.35),
        ("mixed", 0.35, 0.5),
    )
}
STEEPEST = {
    "rough": TerrainOptions(kind="rough", height=0.4, size=0.8, lane=LANE, approach=APPROACH),
    "mixed": TerrainOptions(kind="mixed", height=1.0, size=0.4, lane=LANE, approach=APPROACH),
}
"""The steepest facets that are allowed: their feet reach out furthest."""


def seen_height(world, x, y=0.3):
    """Of the ground below a point 2 m up, by a ray of MuJoCo's [m]."""
    start, down = np.array((x, y, 2.0)), np.array((0.0, 0.0, -1.0))
    hit = np.zeros(1, np.int32)
    robot = world.model.body("base").id
    return 2.0 - mujoco.mj_ray(world.model, world.data, start, down, None, 1, robot, hit)


def test_rays_find_the_ground_that_the_measures_say():
    world = World(load_robot("beta"), WorldOptions(terrain=GROUND, start_distance=4.0))
    gap = GROUND.gap
    for x, wanted in (
        (-BEHIND + 0.01, 0.0), (-BEHIND - 0.01, -DEPTH), (1.99, 0.0), (2.01, -DEPTH),
        (2.79, -DEPTH), (2.81, 0.5), (5.79, 0.5), (5.81, -DEPTH),
    ):  # fmt: skip
        assert gap.height(x) == wanted
        assert seen_height(world, x) == pytest.approx(wanted, abs=1e-9), x
    assert world.base_position[2] == pytest.approx(
        0.5 + world.robot.sit_height + world.robot.foot_radius
    ), "it starts on the step"


def test_a_ridge_is_a_solid_hill_along_the_surface_of_its_ramp():
    options = TerrainOptions(kind="ridge", slope=0.8, approach=2.0, blend=1.5, length=0.4, top=1.0)
    world = World(load_robot("beta"), WorldOptions(terrain=options))
    for distance in np.linspace(0.5, options.ramp.slope_end + options.ramp.arc + 0.9, 40):
        x, z, _ = options.at(distance)
        assert seen_height(world, x) == pytest.approx(z, abs=2e-3)
        assert seen_height(world, 2.0 * options.ridge.ground.x - x) == pytest.approx(z, abs=2e-3)
    hit, robot = np.zeros(1, np.int32), world.model.body("base").id
    for x in np.linspace(-1.4, 2.0 * options.ridge.ground.x + 1.4, 50):  # its side, from outside
        for height, wanted in (0.1, 0.425), (0.8, 0.5):  # in the fence and over it
            if height == 0.8 and options.ridge.height_at(x, 0.0) < 0.82:
                continue
            start, inwards = np.array((x, 2.5, height)), np.array((0.0, -1.0, 0.0))
            away = mujoco.mj_ray(world.model, world.data, start, inwards, None, 1, robot, hit)
            assert away == pytest.approx(wanted), (x, height)


@pytest.mark.parametrize("slope", [0.0, -0.1, 1.2])
def test_a_ridge_of_another_slope_is_refused(slope):
    with pytest.raises(ValueError, match="slope is"):
        TerrainOptions(kind="ridge", slope=slope)


def test_the_edge_belongs_to_the_ground():
    gap = Gap(approach=1.0, width=0.5, step=0.2, top=1.0)
    assert gap.height(1.0) == 0.0 and gap.height(1.5) == 0.2


# Scenes -----------------------------------------------------------------------------------------
@functools.cache
def ground_alone(options, seed):
    spec = mujoco.MjSpec()
    for name in ("ground", "tile"):
        spec.add_material(name=name)
    terrain.build(spec, options, seed)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def heights(options, seed, x, y):
    """Heights of the ground at the places of a grid, by rays down from 5 m [m] (len(x), len(y))."""
    ground, hit = ground_alone(options, seed), np.zeros(1, np.int32)
    down = np.array((0.0, 0.0, -1.0))
    return np.array(
        [
            [5.0 - mujoco.mj_ray(*ground, np.array((a, b, 5.0)), down, None, 1, -1, hit) for b in y]
            for a in x
        ]
    )


def heights_around(options, seed):
    """Heights on a grid over the scene: left, right, ahead; 2 cm from its borders at least."""
    beside = np.linspace(START + 0.02, APPROACH - 0.02, 40)
    ahead = np.linspace(APPROACH + 0.05, END - 0.02, 20)
    left = np.linspace(LANE / 2 + 0.05, EDGE - 0.02, 20)
    across = np.linspace(-EDGE + 0.02, EDGE - 0.02, 40)
    grids = (beside, left), (beside, -left), (ahead, across)
    return [heights(options, seed, *grid) for grid in grids]


@pytest.mark.parametrize(
    "options", [*SCENES.values(), *STEEPEST.values()], ids=[*SCENES, "rough_steep", "mixed_steep"]
)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_stands_in_the_lane_or_at_the_start(options, seed):
    inside = 1e-6  # from its borders
    x = np.linspace(-1.0, APPROACH - inside, 60)
    y = np.linspace(-LANE / 2 + inside, LANE / 2 - inside, 7)
    np.testing.assert_allclose(heights(options, seed, x, y), 0.0, atol=1e-9)
    x, y = np.linspace(-1.0, START - 0.2, 5), np.linspace(-EDGE, EDGE, 20)
    np.testing.assert_allclose(heights(options, seed, x, y), 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rough_ground_undulates_everywhere_beside_the_lane_and_ahead(seed):
    for part in heights_around(SCENES["rough"], seed):
        assert 0.0 < part.min() and part.max() <= 0.08
        assert np.ptp(part) > 0.03 and part.std() > 0.005
    # Between two places 5 mm apart, it rises as a slope does, or there is a ledge.
    x = np.linspace(START + 0.02, APPROACH - 0.02, 1000)
    rises = np.abs(np.diff(heights(SCENES["rough"], seed, x, [1.0, -2.0]), axis=0))
    assert np.median(rises) < 0.005 * 0.2 and 0.002 < rises.max() < 0.04


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_boxes_stand_apart_beside_the_lane_and_ahead(seed):
    """Their level tops are all that is higher than the ground."""
    for part in heights_around(SCENES["boxes"], seed):
        standing = part[part > 1e-6]
        assert 0.06 <= standing.min() and standing.max() <= 0.35
        assert 0.04 < standing.size / part.size < 0.3


def test_tiers_rise_with_the_distance_from_the_lane():
    """The height in closed form."""
    options = SCENES["steps"]
    random = np.random.default_rng(5)  # no place is on an edge
    x, y = random.uniform(START, END, 50), random.uniform(-EDGE, EDGE, 50)
    distance = np.maximum(np.abs(y) - LANE / 2, x[:, None] - APPROACH)
    tier = np.clip(np.floor(distance / options.size) + 1, 0, 5)
    np.testing.assert_allclose(heights(options, 0, x, y), 0.08 * tier, atol=1e-9)


def test_banks_rise_from_the_lane():
    """The height in closed form; across the corners the higher bank is the ground."""
    options = TerrainOptions(kind="banks", slope=0.26, lane=LANE, approach=APPROACH)
    random = np.random.default_rng(6)
    x, y = random.uniform(START, END - 0.05, 50), random.uniform(-EDGE + 0.05, EDGE - 0.05, 50)
    distance = np.maximum(np.abs(y) - LANE / 2, x[:, None] - APPROACH)
    expected = np.tan(0.26) * np.maximum(0.0, distance)
    np.testing.assert_allclose(heights(options, 0, x, y), expected, atol=1e-9)
    with pytest.raises(ValueError, match="slope is 60 deg, of banks it must be 0 to 45 deg"):
        TerrainOptions(kind="banks", slope=np.radians(60.0))


def test_few_tiers_fit_where_they_are_deep():
    options = TerrainOptions(kind="steps", height=0.1, size=1.0, lane=LANE, approach=APPROACH)
    found = heights(options, 0, [3.0], [0.0, 1.5, 1.7, 2.9])
    np.testing.assert_allclose(found, [[0.0, 0.1, 0.2, 0.2]], atol=1e-9)


def test_stairs_without_a_lane_go_up_ahead():
    stairs = TerrainOptions(kind="steps", height=0.1, size=0.5, length=2.0)
    x = START + 0.5 * np.arange(5) - 0.25
    found = heights(stairs, 0, [*x, 6.0], [-1.9, 0.0])[:, 1]
    np.testing.assert_allclose(found, [0.0, 0.1, 0.2, 0.3, 0.4, 0.4], atol=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_mixed_ground_has_facets_boxes_and_flights(seed):
    parts = heights_around(SCENES["mixed"], seed)
    everything = np.concatenate([part.ravel() for part in parts])
    facets = everything <= 0.07
    assert 0.0 < everything.min() and everything.max() <= 0.35 + 1e-9
    assert 0.6 < facets.mean() < 0.95
    assert everything[~facets].min() >= 0.07 + 0.06 - 1e-9, "obstacles stand out of the facets"
    # Steps of a flight divide the height above the facets in three.
    for step in (1, 2, 3):
        assert np.isclose(everything, 0.07 + 0.28 * step / 3, atol=1e-9).mean() > 0.003


@pytest.mark.parametrize("kind", ["rough", "boxes", "mixed"])
def test_without_a_lane_the_scene_is_ahead_of_the_start(kind):
    options = TerrainOptions(kind=kind, height=0.1, size=0.4)
    y = np.linspace(-0.5, 0.5, 11)
    assert not heights(options, 0, np.linspace(-1.0, START - 0.05, 10), y).any()
    assert heights(options, 0, np.linspace(START + 0.02, END, 50), y).any()


@pytest.mark.parametrize("kind", ["rough", "boxes", "mixed"])
def test_a_scene_depends_on_its_seed_alone(kind):
    first, _ = ground_alone(SCENES[kind], 1)
    ground_alone.cache_clear()
    again, other = (ground_alone(SCENES[kind], seed)[0] for seed in (1, 2))
    for name in ("geom_pos", "geom_size", "geom_quat"):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.geom_pos, other.geom_pos)


@pytest.mark.parametrize("kind", SCENES)
def test_a_scene_is_of_few_boxes(kind):
    """A depth image takes the longer the more there are."""
    for seed in range(3):
        model, _ = ground_alone(SCENES[kind], seed)
        assert 10 < model.ngeom <= 200


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lane": 4.1}, "terrain lane is 4.1, it must be 0 to 4"),
        ({"kind": "boxes", "approach": 0.5}, "approach is 0.5, .* length of 8.0 .* 0.8 to 7.8"),
        ({"kind": "steps", "approach": 7.9}, "approach is 7.9, .* 0.8 to 7.8"),
        ({"kind": "boxes", "length": 0.5}, "terrain length is 0.5, .* 1 or more"),
        ({"kind": "rough", "size": 0.1}, "terrain size is 0.1, .* 0.2 to 0.8"),
        ({"kind": "rough", "size": 0.4, "height": 0.21}, "terrain height is 0.21, .* 0 to 0.2"),
        ({"kind": "mixed", "size": 0.9}, "terrain size is 0.9, .* 0.2 to 0.8"),
        ({"kind": "mixed", "size": 0.3, "height": 0.8}, "terrain height is 0.8, .* 0 to 0.75"),
    ],
)
def test_a_scene_that_cannot_be_built_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        TerrainOptions(**{"lane": 1.0} | options)
