"""What nobody should send, sent to every topic and service of a walking robot: it walks on.

Each message is a genuine one of now with one thing wrong, so its stamp says that it belongs here.
"""

import math

import pytest
from geometry_msgs.msg import Wrench
from hostile_stranger import Stranger
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)

from husky_msgs.srv import (
    ApplyWrench,
    InjectFault,
    PlanCycle,
    ResetWorld,
    SetFlightMode,
    SetGait,
    SetMode,
)
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow]

LONG = "x" * 100_000


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


def bad_parameter(kind=200, **value):
    return Parameter(name="stand.duration", value=ParameterValue(type=kind, **value))


def test_parameter_services(stranger):
    """An answer that says no, or an empty one; every node has them."""
    for spec in stranger.session.specs:
        name = f"/{spec.name}"
        for bad in (bad_parameter(), bad_parameter(4, string_value=LONG), bad_parameter(3)):
            answer = stranger.robot.ask(SetParameters, f"{name}/set_parameters", parameters=[bad])
            assert len(answer.results) == 1 and not answer.results[0].successful, spec.name
            answer = stranger.robot.ask(
                SetParametersAtomically, f"{name}/set_parameters_atomically", parameters=[bad]
            )
            assert not answer.result.successful and answer.result.reason, spec.name
        many = ["nothing"] * 5000
        stranger.robot.ask(GetParameters, f"{name}/get_parameters", names=many)
        stranger.robot.ask(DescribeParameters, f"{name}/describe_parameters", names=[LONG])
        stranger.robot.ask(ListParameters, f"{name}/list_parameters", depth=2**64 - 1)
    stranger.session.advance(0.2)
    stranger.check("parameter services")


def test_transitions_that_are_not_there(stranger):
    for name in (graph.DRIVE_BRIDGE, graph.VN200_DRIVER, graph.T265_DRIVER, graph.PIXHAWK_BRIDGE):
        for wrong in (Transition(id=250), Transition(label=LONG), Transition(id=1, label="")):
            answer = stranger.robot.ask(ChangeState, f"/{name}/change_state", transition=wrong)
            assert not answer.success, (name, wrong.id)
    stranger.session.advance(0.2)
    stranger.check("transitions")


def wrench(force):
    made = Wrench()
    made.force.x = force
    return made


REQUESTS = [
    (SetMode, graph.SET_MODE, {"mode": LONG}),
    (SetMode, graph.SET_MODE, {"mode": ""}),
    (SetGait, graph.SET_GAIT, {"gait": LONG}),
    (SetFlightMode, graph.PROPULSION_SET_MODE, {"mode": LONG}),
    (InjectFault, graph.DRIVES_INJECT_FAULT, {"target": LONG, "fault": "x"}),
    (InjectFault, graph.DRIVES_INJECT_FAULT, {"target": "front_left_knee", "fault": LONG}),
    (InjectFault, graph.PLANT_INJECT_FAULT, {"target": "imu", "fault": LONG}),
    (InjectFault, graph.PLANT_INJECT_FAULT, {"target": "battery", "fault": "nan"}),
    (InjectFault, graph.PLANT_INJECT_FAULT, {"target": "battery", "fault": "-1e300"}),
    (ResetWorld, graph.PLANT_RESET, {"keyframe": LONG}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"body": LONG, "duration": 0.1}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(math.nan), "duration": 0.1}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(1e300), "duration": 0.1}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(1.0), "duration": math.inf}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(1.0), "duration": -1.0}),
    (PlanCycle, graph.PLAN_CYCLE, {"slope": math.nan}),
    (PlanCycle, graph.PLAN_CYCLE, {"slope": 1e300, "thrust_mode": LONG}),
]


@pytest.mark.parametrize("case", REQUESTS, ids=lambda case: f"{case[1]}{[*case[2]]}")
def test_requests(stranger, case):
    """A no with a reason that can be read."""
    kind, name, fields = case
    answer = stranger.robot.ask(kind, name, **fields)
    assert not answer.success and 0 < len(answer.message) < 1000, answer.message[:200]
    stranger.session.advance(0.04)
    stranger.check(name)


def test_a_text_of_50_megabytes(stranger):
    """It is told how many characters are allowed, and gets none of its own back."""
    answer = stranger.robot.ask(SetMode, graph.SET_MODE, mode="walk" * 12_500_000)
    assert not answer.success and "50000000 characters" in answer.message
    stranger.session.advance(0.2)
    stranger.check("50 MB")
