"""Somebody in the robot's domain who sends what nobody should, to every topic of the graph.

Each message is a genuine one of now with one thing wrong, so its stamp says that it belongs here.
"""

import importlib
import re

from hostile import broken_bytes, mutations
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

from husky_runtime import graph
from husky_runtime.nodes import qos

STRANGERS_STOP = {graph.absolute(graph.JOINT_COMMAND)}
"""Where a message out of turn stops the drives: `test_stranger`."""
LONG = "x" * 100_000
_DISCOVERY_LOOKS = 600
"""At who listens to which topic, 0.05 s apart at most: a new node finds out by and by."""


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

    def say_everything(self, awaited):
        """Publish everything wrong on every topic of the nodes, some of which are known; return
        how many messages.

        Counted, dropped, told on /diagnostics; nothing else follows.
        """
        topics, missing = {}, set(awaited)
        for _ in range(_DISCOVERY_LOOKS):
            topics = self.subscriptions()
            missing = set(map(graph.absolute, awaited)) - {topic for topic, _ in topics}
            if not missing:
                break
            self._executor.spin_once(timeout_sec=0.05)
        assert not missing, f"nobody listens to {missing}"
        said = 0
        for (topic, kind), _ in sorted(topics.items()):
            if topic not in STRANGERS_STOP:
                said += self.say(topic, _message_class(kind))
        # Of /clock only the newest is looked at, now and then: what is wrong may go by unseen.
        listeners = [
            who for (topic, _), who in topics.items() if topic != graph.absolute(graph.CLOCK)
        ]
        for name in sorted(set().union(*listeners) - {graph.PIXHAWK_BRIDGE}):
            assert self.robot.told(name, "refused_messages") > 0, name
            assert self.robot.told(name, "failed_callbacks") == 0, name
        return said

    def ask_in_vain(self, kind, service, fields):
        """Make a request that cannot be met: the answer is a no with a reason that can be read."""
        answer = self.robot.ask(kind, service, **fields)
        assert not answer.success and 0 < len(answer.message) < 1000, answer.message[:200]
        self.session.advance(0.04)
        self.check(service)

    def misuse_parameters(self):
        """Every node has parameter services; they say no, or give an empty answer."""
        for spec in self.session.specs:
            name = f"/{spec.name}"
            for bad in (_bad_parameter(), _bad_parameter(4, string_value=LONG), _bad_parameter(3)):
                answer = self.robot.ask(SetParameters, f"{name}/set_parameters", parameters=[bad])
                assert len(answer.results) == 1 and not answer.results[0].successful, spec.name
                answer = self.robot.ask(
                    SetParametersAtomically, f"{name}/set_parameters_atomically", parameters=[bad]
                )
                assert not answer.result.successful and answer.result.reason, spec.name
            many = ["nothing"] * 5000
            self.robot.ask(GetParameters, f"{name}/get_parameters", names=many)
            self.robot.ask(DescribeParameters, f"{name}/describe_parameters", names=[LONG])
            self.robot.ask(ListParameters, f"{name}/list_parameters", depth=2**64 - 1)
        self.session.advance(0.2)
        self.check("parameter services")


def _bad_parameter(kind=200, **value):
    return Parameter(name="stand.duration", value=ParameterValue(type=kind, **value))


def _message_class(kind):
    """Return the class of a type as the graph names it."""
    package, _, name = re.fullmatch(r"(\w+)/(msg)/(\w+)", kind).groups()
    return getattr(importlib.import_module(f"{package}.msg"), name)
