"""The two mountings of the fans: what each makes of a force in any direction."""

from contextlib import closing

import numpy as np
import pytest

from husky_runtime import graph

pytestmark = pytest.mark.graph


def test_a_force_up_a_wall_and_back(vectoring_of_module):
    companion, session = vectoring_of_module, vectoring_of_module.session
    companion.arm()
    companion.pushes((25.6, 0.0, -19.2))
    assert session.propulsion.tilt[0] == pytest.approx(np.radians(126.87), abs=0.02)
    # Held in the air with a force at the centre of mass: nothing turns it.
    assert abs(session.truth.pose.pose.orientation.w) > 0.9999
    made = companion.pushes((0.0, 6.0, 20.0))
    assert np.linalg.norm(made, axis=1).max() < 33.0
    companion.ask((0, 0, 0), 1.0)
    assert np.linalg.norm(companion.made()[1][-1]) < 0.5


@pytest.mark.slow  # in one process: `test_fixed_fans_take_the_part_along_z_and_say_so`
def test_fixed_fans_push_along_z_and_the_bridge_says_so(new_graph, commanding, held_unit):
    with new_graph(**held_unit()) as robot, closing(commanding(robot)) as companion:
        companion.arm()
        _, made = companion.ask((20.0, 0.0, 15.0), 2.0)
        np.testing.assert_allclose(made[-1], (0.0, 0.0, 15.0), atol=0.5)
        assert robot.told(graph.PIXHAWK_BRIDGE, "projected_commands") > 100
