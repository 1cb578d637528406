"""What nobody should send, sent to every topic and service of a walking robot: it walks on.

Each message is a genuine one of now with one thing wrong, so its stamp says that it belongs here.
"""

import importlib
import math
import re

import pytest
from geometry_msgs.msg import Wrench
from hostile import broken_bytes, mutations
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
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from husky_msgs.srv import (
    ApplyWrench,
    InjectFault,
    PlanCycle,
    ResetWorld,
    SetFlightMode,
    SetGait,
    SetMode,
)
from husky_runtime import graph, qos

pytestmark = pytest.mark.graph

STRANGERS_STOP = {graph.absolute(graph.JOINT_COMMAND)}
"""Where a message out of turn stops the drives: `test_stranger`."""
LONG = "x" * 100_000


class Stranger:
    """Somebody in the robot's domain who publishes and calls what he likes."""

    def __init__(self, robot):
        self.robot, self.session = robot, robot.session
        self.node = Node("stranger", context=self.session.context)
        self._executor = SingleThreadedExecutor(context=self.session.context)
        self._executor.add_node(self.node)

    def close(self):
        """Leave."""
        self._executor.shutdown()
        self.node.destroy_node()

    def subscriptions(self):
        """Return the topics that the robot's nodes listen to, with who does."""
        found = {}
        for spec in self.session.specs:
            if spec.name == graph.RECORDER:
                continue
            for topic, kinds in self.node.get_subscriber_names_and_types_by_node(spec.name, "/"):
                found.setdefault((topic, kinds[0]), set()).add(spec.name)
        return found

    def genuine(self, topic, message_type):
        """Return a message of now, or an empty one where nobody says anything."""
        heard = []
        profile = QoSProfile(depth=1, reliability=qos.CONTROL.reliability)
        ear = self.node.create_subscription(message_type, topic, heard.append, profile)
        for _ in range(3):
            self.session.advance(0.1)
            self._executor.spin_once(timeout_sec=0.05)
            if heard:
                break
        self.node.destroy_subscription(ear)
        return heard[-1] if heard else message_type()

    def say(self, topic, message_type):
        """Publish everything that is wrong with a message of this topic; return how many."""
        profile = qos.PROFILES[graph.topic(topic).qos]
        publisher = self.node.create_publisher(message_type, topic, profile)
        while publisher.get_subscription_count() < 1:
            self._executor.spin_once(timeout_sec=0.05)
        genuine, said = self.genuine(topic, message_type), 0
        for label, wrong in [*mutations(genuine), *broken_bytes(genuine)]:
            publisher.publish(wrong)
            said += 1
            if said % 8 == 0:
                self.session.advance(0.02)
                self.check(f"{topic}, about {label}")
        self.session.advance(0.1)
        self.check(topic)
        self.node.destroy_publisher(publisher)
        return said

    def check(self, what):
        """The robot walks on."""
        robot = self.robot
        assert robot.mode == "walk" and robot.height > 0.5, f"{what}; {robot.seen}"


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


def message_class(kind):
    """Return the class of a type as the graph names it."""
    package, _, name = re.fullmatch(r"(\w+)/(msg)/(\w+)", kind).groups()
    return getattr(importlib.import_module(f"{package}.msg"), name)


def test_every_topic(stranger):
    """Counted, dropped, told on /diagnostics; nothing else follows."""
    topics = stranger.subscriptions()
    named = {topic for topic, _ in topics}
    awaited = {graph.JOINT_STATES, graph.IMU, graph.ODOMETRY, graph.FLIGHT_SENSORS}
    awaited |= {graph.CLOCK, graph.JOY, graph.PROPULSION_COMMAND, graph.INCLINE_PLAN}
    assert set(map(graph.absolute, awaited)) <= named
    said = 0
    for (topic, kind), _ in sorted(topics.items()):
        if topic not in STRANGERS_STOP:
            said += stranger.say(topic, message_class(kind))
    assert said > 500, f"only {said} messages: the mutations are gone"
    # Of /clock only the newest is looked at, now and then: what is wrong may go by unseen.
    listeners = [who for (topic, _), who in topics.items() if topic != graph.absolute(graph.CLOCK)]
    for name in sorted(set().union(*listeners) - {graph.PIXHAWK_BRIDGE}):
        assert stranger.robot.told(name, "refused_messages") > 0, name
        assert stranger.robot.told(name, "failed_callbacks") == 0, name


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
