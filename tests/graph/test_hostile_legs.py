"""What nobody should send, sent to every topic and service of a trotting robot: it trots on.

The same to one with its fans, a radio and a planner: `propulsion/test_hostile`.
"""

import math

import pytest
from geometry_msgs.msg import Wrench
from hostile_stranger import LONG, Stranger

from husky_msgs.srv import ApplyWrench, InjectFault, ResetWorld, SetGait, SetMode
from husky_runtime import graph

pytestmark = pytest.mark.graph


@pytest.fixture
def stranger(trotting):
    one = Stranger(trotting)
    yield one
    one.close()


def test_every_topic(stranger):
    said = stranger.say_everything(
        {graph.JOINT_STATES, graph.IMU, graph.ODOMETRY, graph.CLOCK, graph.CMD_VEL}
    )
    assert said > 200, f"only {said} messages: the mutations are gone"


def test_parameter_services(stranger):
    stranger.misuse_parameters()


def wrench(force):
    made = Wrench()
    made.force.x = force
    return made


REQUESTS = [
    (SetMode, graph.SET_MODE, {"mode": LONG}),
    (SetMode, graph.SET_MODE, {"mode": ""}),
    (SetGait, graph.SET_GAIT, {"gait": LONG}),
    (InjectFault, graph.DRIVES_INJECT_FAULT, {"target": LONG, "fault": "x"}),
    (InjectFault, graph.DRIVES_INJECT_FAULT, {"target": "front_left_knee", "fault": LONG}),
    (InjectFault, graph.PLANT_INJECT_FAULT, {"target": "imu", "fault": LONG}),
    (ResetWorld, graph.PLANT_RESET, {"keyframe": LONG}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"body": LONG, "duration": 0.1}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(math.nan), "duration": 0.1}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(1e300), "duration": 0.1}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(1.0), "duration": math.inf}),
    (ApplyWrench, graph.PLANT_APPLY_WRENCH, {"wrench": wrench(1.0), "duration": -1.0}),
]


@pytest.mark.parametrize("case", REQUESTS, ids=lambda case: f"{case[1]}{[*case[2]]}")
def test_requests(stranger, case):
    stranger.ask_in_vain(*case)


def test_a_text_of_50_megabytes(stranger):
    """It is told how many characters are allowed, and gets none of its own back."""
    answer = stranger.robot.ask(SetMode, graph.SET_MODE, mode="walk" * 12_500_000)
    assert not answer.success and "50000000 characters" in answer.message
    stranger.session.advance(0.2)
    stranger.check("50 MB")
