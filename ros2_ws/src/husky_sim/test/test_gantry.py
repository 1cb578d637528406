import math

import numpy as np
import pytest

from husky_description.gantry import GantryOptions
from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_sim.gantry import RAIL
from husky_sim.world import World, WorldOptions

OPTIONS = GantryOptions(height=2.6, span=0.9, rope=1.6)


def hung(body="unit", options=OPTIONS, start_height=0.9):
    world = World(
        load_robot(),
        WorldOptions(body=body, keyframe="stand", gantry=options, start_height=start_height),
    )
    return world


def run(world, seconds):
    for _ in range(round(seconds / 0.002)):
        world.step_tick()


def test_it_hangs_where_the_ropes_end():
    """Pythagoras: the ropes come together towards the unit."""
    world = hung()
    run(world, 4.0)
    y, z = OPTIONS.attachment
    drop = math.sqrt(OPTIONS.rope**2 - (OPTIONS.span / 2 - y) ** 2)
    assert world.gantry.taut() == (True, True)
    assert world.base_position[2] == pytest.approx(OPTIONS.height - drop - z, abs=0.01)
    assert np.abs(world.data.qvel).max() < 0.02


def test_ropes_pull_and_never_push():
    world = hung(start_height=0.9)
    run(world, 3.0)
    world.data.qpos[2] += 0.3  # lifted: the ropes go slack
    before = world.data.qvel[2]
    run(world, 0.01)
    assert world.gantry.taut() == (False, False)
    assert world.data.qvel[2] - before == pytest.approx(-GRAVITY * 0.01, rel=1e-3), "free fall"


def test_the_trolley_takes_the_unit_along():
    world = hung()
    run(world, 1.0)
    world.gantry.move_to(0.5)
    run(world, 12.0)
    trolley = world.model.joint("trolley").qposadr[0]
    assert world.data.qpos[trolley] == pytest.approx(0.5, abs=0.01)
    assert world.base_position[0] == pytest.approx(0.5, abs=0.25)  # it swings


@pytest.mark.parametrize("position", [RAIL + 0.1, -RAIL - 0.1, math.nan])
def test_the_trolley_stays_on_the_rail(position):
    with pytest.raises(ValueError, match="trolley"):
        hung().gantry.move_to(position)


def test_the_robot_s_joints_keep_their_places():
    world = hung("robot_with_unit", GantryOptions(rope=2.4), 0.0)
    robot = world.robot
    assert world.model.joint("trolley").qposadr[0] == 19
    assert world.joint_position == pytest.approx(robot.stand_joint_position)


@pytest.mark.parametrize(
    ("option", "value"), [("height", 0.1), ("span", 9.0), ("rope", 0.0), ("rope", math.nan)]
)
def test_bad_options(option, value):
    with pytest.raises(ValueError, match="must be within"):
        GantryOptions(**{option: value})
