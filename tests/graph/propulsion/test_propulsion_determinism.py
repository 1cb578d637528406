"""The same seed gives the same trajectory with the flight controller on the far end of MAVLink."""

import pytest
from seen_robot import QUICKLY

from husky_experiments.scripts import push, ready_fans, stand_up, walk
from husky_experiments.session import Session
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow]

SETTINGS = {
    graph.PLANT: {"body": "robot_with_unit", "seed": 3},
    graph.LOW_LEVEL_CONTROLLER: {**QUICKLY, "assist.slew": 1.0},
}


def script(directory) -> tuple[str, float]:
    """Stand up, let the fans carry, trot, be pushed; return digest and thrust."""
    with Session(directory, SETTINGS, record=False) as session:
        stand_up(session)
        ready_fans(session)
        session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.share", 0.3)
        session.advance(1.0)
        session.set_gait("trot")
        walk(session, 0.6, (0.2, 0.0, 0.0))
        push(session, (0.0, 2.0))
        walk(session, 0.6, (0.2, 0.0, 0.0))
        assert session.fans is not None and session.state.mode == "walk"
        return session.trajectory_sha256, sum(session.fans.thrust)


def test_in_new_processes(tmp_path):
    first, thrust = script(tmp_path / "first")
    second, _ = script(tmp_path / "second")
    assert thrust > 15.0
    assert first == second
