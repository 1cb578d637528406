"""Air that moves: drag of bodies, side force of propellers; and nothing of it in still air."""

import mujoco
import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture
from husky_sim.world import AIR_DENSITY, World, WorldOptions

BETA = load_robot("beta")
WIND = (0.0, 2.0, 0.0)


def splayed(start_held=True):
    """Arms level, held in the air."""
    options = WorldOptions(body="robot_with_unit", start_height=2.0, start_held=start_held)
    world = World(BETA, options)
    world.joint_position[:] = flight_posture(BETA)
    mujoco.mj_forward(world.model, world.data)
    return world


def test_upright_propellers_are_pushed_along_by_the_share_of_their_thrust():
    """Closed form of what stands still: force = coefficient * thrust * wind, at each propeller."""
    world = splayed()
    world.fans.unit.fans["thrust"] = 6.5
    world.fans.unit.step = lambda *arguments: None  # the thrust stays as it is
    world.fans.step()
    still = world.fans.wrench_in_base.copy()
    world.blow(WIND)
    world.data.qvel[:] = 0.0
    world.fans.step()
    change = world.fans.wrench_in_base - still
    force = BETA.propellers.side_force * 4 * 6.5 * 2.0
    np.testing.assert_allclose(change[:3], (0.0, force, 0.0), atol=1e-3)


def test_a_falling_robot_is_carried_along():
    """Momentum per time of what has no propulsion: at most the drag of its whole outline."""
    world = splayed(start_held=False)
    world.blow(WIND)
    for _ in range(50):
        world.step_tick()
    force = BETA.mass * world.base_velocity[1] / 0.1
    outline = 0.5 * AIR_DENSITY * 2.0**2 * 0.1  # of 0.1 m^2 with a drag coefficient of 1
    assert 0.01 * outline < force < outline


def test_still_air_is_left_out():
    blown, calm = splayed(), splayed()
    blown.blow(WIND)
    blown.blow((0.0, 0.0, 0.0))
    for world in (blown, calm):
        for _ in range(20):
            world.step_tick()
    assert blown.trajectory_sha256 == calm.trajectory_sha256


@pytest.mark.parametrize("wind", [(1.0, 2.0), (0.0, np.nan, 0.0), (0.0, 0.0, 21.0)])
def test_wind_that_cannot_blow_is_refused(wind):
    with pytest.raises(ValueError, match=r"wind is .*3 numbers of at most 20 m/s"):
        splayed().blow(wind)
