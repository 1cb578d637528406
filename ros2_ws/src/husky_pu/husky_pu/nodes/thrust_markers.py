"""The drawing of the thrust: of each fan or propeller, and of all of them."""

from __future__ import annotations

import numpy as np
from rclpy.node import Node
from visualization_msgs.msg import Marker

from husky_description.gimbal import axis
from husky_description.robot import Robot
from husky_pu.companion.propulsion_force import Force
from husky_runtime import graph
from husky_runtime.nodes.markers import BLUE, MarkerTeller, make_marker

_ABOVE = (0.0, 0.0, 0.25)
"""Where the arrow of all fans begins, in base, so that the robot does not hide it [m]."""


class ThrustMarkers:
    """Draws what the flight controller's report says of the fans, in base."""

    def __init__(self, node: Node, robot: Robot):
        """Make the markers of the bridge's node."""
        if robot.legs_carry_propellers:
            # Each in its own frame, which the leg moves, z along the thrust.
            frames = [f"{leg}_propeller" for leg in robot.legs]
            places = np.zeros((len(frames), 3))
        else:
            places = robot.fan_position
            frames = [graph.FRAME_BASE] * len(places)
        self._places = [tuple(map(float, place)) for place in places]
        markers = [
            make_marker(Marker.ARROW, frame, "fan_thrust", fan, BLUE, 2)
            for fan, frame in enumerate(frames)
        ]
        markers.append(make_marker(Marker.ARROW, graph.FRAME_BASE, "thrust", 0, BLUE, 2))
        self._teller = MarkerTeller(node, markers)

    def tell(self, time_ns: int, force: Force) -> None:
        """Publish the force that follows from a report of a time [ns], if it is time to."""
        if time_ns < 0 or not self._teller.due(time_ns):
            return
        x, y, z = axis(force.tilt)
        for fan, (place, thrust) in enumerate(zip(self._places, force.thrust, strict=True)):
            self._teller.arrow(fan, place, (thrust * x, thrust * y, thrust * z))
        self._teller.arrow(len(self._places), _ABOVE, force.force)
        self._teller.tell(time_ns)
