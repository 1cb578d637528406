"""What tests of `foxglove_gateway` share: the process, its clients, and a small robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from foxglove_client import FoxgloveClient, Received
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from served_bench import ServedBench
from std_msgs.msg import String
from std_srvs.srv import SetBool

from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

MODULE = "husky_bringup.nodes.foxglove_gateway"
JOINTS = graph.absolute(graph.JOINT_STATES)
DESCRIPTION = graph.absolute(graph.ROBOT_DESCRIPTION)
CMD_VEL = graph.absolute(graph.CMD_VEL)
SPEED = "/bench.speed"
NOW_NS = 7_000_000_000


class GatewayBench(ServedBench):
    """The process and clients of it."""

    def __init__(self, domain: int, directory: Path):
        """Join the domain; the process is started by `serve`."""
        super().__init__(domain, directory, MODULE)

    def client(self, *services: str) -> FoxgloveClient:
        """Connect a client, and wait until it has seen services."""
        client = FoxgloveClient(self.address)
        self.clients.append(client)
        self.wait(lambda: set(services) <= set(client.services), f"{services}")
        return client


class AloneBench(GatewayBench):
    """A gateway whose robot is the test's own node.

    Attributes:
        velocities: what has come on `/cmd_vel`.
        enabled: what the service `/enable` has been asked.
    """

    def __init__(self, domain: int, directory: Path):
        """Make the robot."""
        super().__init__(domain, directory)
        self.velocities: list[Twist] = []
        make = self.node.create_publisher
        self.clock = make(Clock, graph.CLOCK, qos.CLOCK)
        self.joints = make(JointState, graph.JOINT_STATES, qos.CONTROL)
        self.description = make(String, graph.ROBOT_DESCRIPTION, qos.LATCHED)
        self.words = make(String, "words", 100)
        self.node.create_subscription(Twist, graph.CMD_VEL, self.velocities.append, qos.COMMAND)
        self.enabled: list[bool] = []
        self.node.create_service(SetBool, "enable", self._on_enable)
        within = FloatingPointRange(from_value=0.0, to_value=1.0)
        self.node.declare_parameter(
            "speed", 0.5, ParameterDescriptor(floating_point_range=[within])
        )
        self.node.declare_parameter("names", ["a", "b"])
        self.node.declare_parameter("bytes", [b"\1", b"\2"])
        self.node.declare_parameter("sizes", [1.0, 2.5])
        self.node.declare_parameter("none", [])

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.enabled.append(request.data)
        response.success, response.message = True, "it is done"
        return response

    def client(self, *services: str) -> FoxgloveClient:
        """Connect a client, which has seen what there is."""
        client = super().client("/enable", *services)
        self.wait(lambda: {JOINTS, "/words"} <= set(client.channels), "the topics")
        return client

    def hear(self, client: FoxgloveClient, topic: str, publisher: Any) -> list[Received]:
        """Let a client listen to a topic, until its publisher knows."""
        count = publisher.get_subscription_count()
        heard = client.subscribe(topic)
        self.wait(lambda: publisher.get_subscription_count() > count, f"the ear for {topic}")
        return heard

    def tell_time(self, time_ns: int) -> None:
        """Tell the gateway what time it is on the robot."""
        message = Clock()
        stamps.fill(message.clock, time_ns)
        client = self.clients[0]
        self.wait(lambda: client.time == time_ns, "the time", lambda: self.clock.publish(message))

    def is_served(self) -> None:
        """Whoever comes now is served."""
        client = self.client()
        call = client.call("/enable", serialize_message(SetBool.Request(data=True)))
        self.wait(lambda: call in client.answers, "an answer")
        assert isinstance(client.answers[call], bytes)

    def begin_anew(self) -> None:
        """Let the clients go; the process serves on, as if none had been there."""
        self.velocities.clear()
        self.enabled.clear()
        self.node.set_parameters([Parameter("speed", value=0.5)])
        super().begin_anew()


def joint_state(time_ns: int, position: float) -> JointState:
    message = JointState(name=["knee"], position=[position])
    stamps.fill(message.header.stamp, time_ns)
    return message
