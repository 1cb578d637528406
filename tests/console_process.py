"""The console with a robot that is a box, for tests of its process."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

from geometry_msgs.msg import TransformStamped
from operator_client import OperatorClient
from page_client import PageClient
from served_bench import ServedBench
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from husky_bringup.console.operator_server import VIEW
from husky_runtime import graph
from husky_runtime.nodes import qos

MODULE = "husky_bringup.nodes.console"
URDF = """<robot name="tested_robot"><link name="body"><visual><geometry>
<box size="1 1 1"/></geometry></visual></link></robot>"""


class ConsoleBench(ServedBench):
    """A console whose robot is a box that the test's own node tells of."""

    def __init__(self, domain: int, directory: Path):
        """Make the robot."""
        super().__init__(domain, directory, MODULE)
        make = self.node.create_publisher
        self.description = make(String, graph.ROBOT_DESCRIPTION, qos.LATCHED)
        self.transforms = make(TFMessage, graph.TF, qos.TF)
        self.markers = make(MarkerArray, graph.MARKERS, qos.STATUS)
        self.description.publish(String(data=URDF))
        self.places = itertools.count(1)

    def client(self, **options: Any) -> PageClient:
        """Open the page."""
        client = PageClient(self.address + VIEW, **options)
        self.clients.append(client)
        return client

    def operator(self, **options: Any) -> OperatorClient:
        """Open the operator's part of the page, and wait until it is told how things stand."""
        client = OperatorClient(self.address, **options)
        self.clients.append(client)
        self.wait(lambda: client.state or client.closed, "a word to an operator")
        return client

    def move(self, x: float, frame: str = "body", parent: str = graph.FRAME_ODOM) -> None:
        """Move the robot, or have another frame."""
        moved = TransformStamped(child_frame_id=frame)
        moved.header.frame_id = parent
        moved.transform.translation.x = x
        self.transforms.publish(TFMessage(transforms=[moved]))

    def shows(self, client: PageClient, x: float) -> None:
        """A page shows where the robot is."""
        self.wait(
            lambda: (
                client.positions.get("/scene/body", (None,))[0] == x
                and "/scene/body/look" in client.nodes
            ),
            f"the robot at {x}",
            lambda: self.move(x),
        )

    def is_served(self) -> None:
        """Whoever comes now is served."""
        self.shows(self.client(), float(next(self.places)))
