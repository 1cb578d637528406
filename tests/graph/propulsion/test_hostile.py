"""What nobody should send to a robot that trots with its fans' help, a radio and a planner.

To the legs' nodes alone, and their services: `test_hostile_legs`.
"""

import math

import pytest
from hostile_stranger import LONG, Stranger
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from husky_msgs.srv import InjectFault, PlanCycle, SetFlightMode
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow]


@pytest.fixture(scope="module")
def stranger(new_graph, trotting_fans):
    """A stranger to a robot that trots with its fans' help, with a radio and a planner."""
    settings = {
        graph.PLANT: {"grace": 5.0, "seed": 1, "body": "robot_with_unit"},
        graph.DRIVE_BRIDGE: {"grace": 5.0},
        graph.LOW_LEVEL_CONTROLLER: {"grace": 5.0, "stand.joint_speed": 3.0, "planner": True},
        graph.FLIGHT_CONTROLLER: {"grace": 5.0},
    }
    with new_graph(remote=True, **settings) as robot:
        trotting_fans(robot)
        one = Stranger(robot)
        yield one
        one.close()


def test_every_topic(stranger):
    said = stranger.say_everything(
        {
            *(graph.JOINT_STATES, graph.IMU, graph.ODOMETRY, graph.FLIGHT_SENSORS),
            *(graph.CLOCK, graph.JOY, graph.PROPULSION_COMMAND, graph.INCLINE_PLAN),
        }
    )
    assert said > 500, f"only {said} messages: the mutations are gone"


def test_parameter_services(stranger):
    stranger.misuse_parameters()


def test_transitions_that_are_not_there(stranger):
    for name in (graph.DRIVE_BRIDGE, graph.VN200_DRIVER, graph.T265_DRIVER, graph.PIXHAWK_BRIDGE):
        for wrong in (Transition(id=250), Transition(label=LONG), Transition(id=1, label="")):
            answer = stranger.robot.ask(ChangeState, f"/{name}/change_state", transition=wrong)
            assert not answer.success, (name, wrong.id)
    stranger.session.advance(0.2)
    stranger.check("transitions")


REQUESTS = [
    (SetFlightMode, graph.PROPULSION_SET_MODE, {"mode": LONG}),
    (InjectFault, graph.PLANT_INJECT_FAULT, {"target": "battery", "fault": "nan"}),
    (InjectFault, graph.PLANT_INJECT_FAULT, {"target": "battery", "fault": "-1e300"}),
    (PlanCycle, graph.PLAN_CYCLE, {"slope": math.nan}),
    (PlanCycle, graph.PLAN_CYCLE, {"slope": 1e300, "thrust_mode": LONG}),
]


@pytest.mark.parametrize("case", REQUESTS, ids=lambda case: f"{case[1]}{[*case[2]]}")
def test_requests(stranger, case):
    stranger.ask_in_vain(*case)
