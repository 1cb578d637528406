"""The controller's drawing: what it feels under the feet, where it steps, where it goes."""

from __future__ import annotations

import math

import numpy as np
from rclpy.node import Node
from visualization_msgs.msg import Marker

from husky_control.controller import Controller
from husky_description.arrays import Array
from husky_description.kinematics import LEGS
from husky_runtime import graph
from husky_runtime.nodes.markers import GREEN, ORANGE, VIOLET, MarkerTeller, make_marker

_AHEAD = 1.0
"""How far ahead the way is drawn [s]."""
_POINTS = 11
_PATH = 2 * LEGS


class WalkMarkers:
    """Draws estimated ground forces, the footholds that are aimed at, and the way of the body."""

    def __init__(self, node: Node):
        """Make the markers of the controller's node, all in the odometry frame."""
        frame = graph.FRAME_ODOM
        markers = [
            make_marker(Marker.ARROW, frame, "foot_force", leg, ORANGE, 2) for leg in range(LEGS)
        ]
        markers += [
            make_marker(Marker.SPHERE_LIST, frame, "foothold", leg, GREEN, 1) for leg in range(LEGS)
        ]
        markers.append(make_marker(Marker.LINE_STRIP, frame, "way", 0, VIOLET, _POINTS))
        self._teller = MarkerTeller(node, markers)

    def tell(self, time_ns: int, controller: Controller) -> None:
        """Publish the estimate of a time [ns], if it is time to."""
        teller = self._teller
        if time_ns < 0 or not teller.due(time_ns):
            return
        context, body = controller.context, controller.body
        contacts, plane = body.contacts, context.climbing.plane
        feet = body.estimator.position + body.foot_in_base @ body.rotation.T
        forces = (contacts.foot_force @ plane) * np.asarray(contacts.contact)[:, None]
        aims, aimed = controller.walking.foothold @ plane, controller.present.aims
        for leg in range(LEGS):
            teller.arrow(leg, feet[leg].tolist(), forces[leg].tolist())
            teller.draw(LEGS + leg, [aims[leg].tolist()], seen=bool(aimed[leg]))
        way = _way_ahead(
            context.desired_position,
            context.desired_velocity,
            float(controller.walking.reference.ramped[2]),
        )
        moves = float(np.ptp(way, axis=0).max()) > 0.01
        teller.draw(_PATH, way.tolist(), seen=moves)
        teller.tell(time_ns)


def _way_ahead(position: Array, velocity: Array, yaw_rate: float) -> Array:
    """Return the way of a body that keeps its speed and its turn (n, 3) [m]."""
    step = _AHEAD / (_POINTS - 1)
    way = np.tile(position, (_POINTS, 1))
    x, y, z = velocity.tolist()
    for index in range(1, _POINTS):
        angle = yaw_rate * step * (index - 0.5)
        c, s = math.cos(angle), math.sin(angle)
        way[index] = way[index - 1] + step * np.array((c * x - s * y, s * x + c * y, z))
    return way
