"""A gap with a step behind it: what is built is what its measures say."""

import mujoco
import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_sim.gap import BEHIND, DEPTH, Gap
from husky_sim.scene import WorldOptions
from husky_sim.terrain import TerrainOptions
from husky_sim.world import World

GROUND = TerrainOptions(kind="gap", approach=2.0, size=0.8, height=0.5, top=3.0)


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


def test_the_edge_belongs_to_the_ground():
    gap = Gap(approach=1.0, width=0.5, step=0.2, top=1.0)
    assert gap.height(1.0) == 0.0 and gap.height(1.5) == 0.2
