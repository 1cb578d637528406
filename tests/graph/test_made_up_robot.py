"""A robot of a user's own file in the graph: every node reads it, and six fans push."""

import pytest
from made_up_robot import FANS, write
from seen_robot import running

from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_runtime import graph

# In one process: the same robot in closed_loop; every node is told its file by husky_bringup's
# test_system; a robot that is not the default one, over processes: test_beta.
pytestmark = [pytest.mark.graph, pytest.mark.slow]

GRACE = 5.0
"""Wall time after which nodes give each other up [s]: no test of a busy machine."""
SHARE = 0.4
"""Of the weight that the fans carry."""


@pytest.fixture(scope="module")
def session(domain, tmp_path_factory, graphs):
    graphs.end()
    directory = tmp_path_factory.mktemp("made_up")
    plant = {"robot": str(write(directory / "made_up.yaml")), "body": "robot_with_unit"}
    settings = {node: {"grace": GRACE} for node in (graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER)}
    settings |= {node: {"grace": GRACE} for node in (graph.FLIGHT_CONTROLLER, graph.PIXHAWK_BRIDGE)}
    settings[graph.LOW_LEVEL_CONTROLLER]["stand.duration"] = 0.9  # [s]; 0.858 is the least
    settings[graph.PLANT] = {**plant, "grace": GRACE, "seed": 1}
    with running(directory, settings, record=False) as session:
        yield session


def test_it_stands_on_its_legs_with_the_help_of_six_fans(session):
    robot = load_robot(session.specs[0].parameters["robot"])
    session.enable_drives()
    session.advance(0.2)
    session.set_mode("stand_up", "stand", within=3.0)
    session.advance(0.5)
    height = session.truth.pose.pose.position.z - robot.foot_radius
    assert height == pytest.approx(robot.stand_height, abs=0.02)

    session.set_flight_mode("OFFBOARD")
    session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.share", SHARE)
    session.arm()
    assert session.advance(4.0, lambda: sum(session.fans.thrust) > 0.95 * SHARE * _weight(robot))
    assert len(session.fans.thrust) == len(session.propulsion.pwm) == len(FANS)
    assert min(session.fans.thrust) > 0.1 * SHARE * _weight(robot)

    session.inject(graph.PLANT_INJECT_FAULT, "hind_left_fan", "fail")
    assert session.advance(3.0, lambda: not all(session.propulsion.fan_ok))
    assert session.propulsion.reason == "Fan hind_left lost"
    session.advance(1.0)
    left = [name for name, ok in zip(FANS, session.propulsion.fan_ok, strict=True) if ok]
    assert left == [name for name in FANS if name != "hind_left"]
    assert sum(session.fans.thrust) == pytest.approx(SHARE * _weight(robot), rel=0.1)
    assert session.propulsion.armed and session.state.mode == "stand"


def _weight(robot):
    return robot.mass * GRAVITY
