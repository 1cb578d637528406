"""The two mountings of the fans: what each makes of a force in any direction."""

import numpy as np
import pytest

from husky_description import graph

pytestmark = pytest.mark.graph


def test_a_force_up_a_wall_and_back(new_graph, commanding, held_unit):
    with new_graph(**held_unit(mounting="vectoring", seed=1)) as robot:
        companion = commanding(robot)
        companion.arm()
        companion.pushes((25.6, 0.0, -19.2))
        assert robot.session.propulsion.tilt[0] == pytest.approx(np.radians(126.87), abs=0.02)
        # Held in the air with a force at the centre of mass: nothing turns it.
        assert abs(robot.session.truth.pose.pose.orientation.w) > 0.9999
        made = companion.pushes((0.0, 6.0, 20.0))
        assert np.linalg.norm(made, axis=1).max() < 33.0
        companion.ask((0, 0, 0), 1.0)
        assert np.linalg.norm(companion.made()[1][-1]) < 0.5


def test_vectored_in_realtime(new_graph, commanding, held_unit):
    with new_graph(clock="realtime", **held_unit(mounting="vectoring")) as robot:
        companion = commanding(robot)
        companion.arm()
        force = (24.0, 0.0, -16.0)
        for _ in range(6):
            # A machine that is late by 20 ms makes a gap in the pulses, and then the speed
            # controllers want to see another second of low ones.
            _, made = companion.ask(force, 0.5)
            if np.linalg.norm(made[-1]) > 10.0:
                break
            companion.ask((0.0, 0.0, 0.0), 2.0)
        companion.pushes(force, 3.0)


def test_fixed_fans_push_along_z_and_the_bridge_says_so(new_graph, commanding, held_unit):
    with new_graph(**held_unit()) as robot:
        companion = commanding(robot)
        companion.arm()
        _, made = companion.ask((20.0, 0.0, 15.0), 2.0)
        np.testing.assert_allclose(made[-1], (0.0, 0.0, 15.0), atol=0.5)
        assert robot.told(graph.PIXHAWK_BRIDGE, "projected_commands") > 100
