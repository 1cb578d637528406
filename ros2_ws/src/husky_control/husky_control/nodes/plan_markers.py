"""The planner's drawing: one cycle of the newest plan, under the robot."""

from __future__ import annotations

import numpy as np
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

from husky_control.planning.plan import Plan
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.markers import (
    BLUE,
    FORCE_SCALE,
    GREEN,
    ORANGE,
    VIOLET,
    Colour,
    Place,
    make_marker,
)

_PERIOD = 1.0
"""Wall time between two drawings, for viewers that come later [s]."""
_EVERY = 4
"""Points of the plan from one drawn force to the next."""


class PlanMarkers:
    """Draws way, footholds, thrust and ground forces of a plan.

    A plan is of any cycle on its slope, so it is drawn where the robot is: the robot is the body at
    the start of the cycle.
    """

    def __init__(self, node: Node):
        """Make the publisher of the planner's node."""
        self._publisher = node.create_publisher(MarkerArray, graph.MARKERS, qos.STATUS)
        self._message: MarkerArray | None = None
        node.create_timer(_PERIOD, self._tell)

    def show(self, plan: Plan) -> None:
        """Draw another plan from now on."""
        lines = [
            _marker(plan, Marker.LINE_STRIP, "plan_way", VIOLET, plan.position.tolist()),
            _marker(plan, Marker.SPHERE_LIST, "plan_foothold", GREEN, plan.foothold.tolist()),
            _marker(plan, Marker.LINE_LIST, "plan_thrust", BLUE, _thrusts(plan)),
            _marker(plan, Marker.LINE_LIST, "plan_force", ORANGE, _forces(plan)),
        ]
        self._message = MarkerArray(markers=[marker for marker in lines if marker.points])
        self._tell()

    def _tell(self) -> None:
        if self._message is not None:
            self._publisher.publish(self._message)


def _marker(
    plan: Plan, kind: int, namespace: str, colour: Colour, points: list[Place]
) -> Marker:
    """Return a marker of points in the plan's slope frame, seen from base at any time."""
    marker = make_marker(kind, graph.FRAME_BASE, namespace, 0, colour, len(points))
    for point, (x, y, z) in zip(marker.points, points, strict=True):
        point.x, point.y, point.z = float(x), float(y), float(z)
    marker.frame_locked = True
    marker.lifetime.sec, marker.lifetime.nanosec = 3, 0
    slope_to_base = plan.rotation[0].T
    place = plan.center_of_mass - slope_to_base @ plan.position[0]
    turn = Rotation.from_matrix(slope_to_base).as_quat()
    position, orientation = marker.pose.position, marker.pose.orientation
    position.x, position.y, position.z = place.tolist()
    orientation.x, orientation.y, orientation.z, orientation.w = turn.tolist()
    return marker


def _thrusts(plan: Plan) -> list[Place]:
    """Return both ends of the thrust at some points."""
    ends = np.stack((plan.position, plan.position + FORCE_SCALE * plan.thrust), axis=1)
    return list(ends[::_EVERY].reshape(-1, 3).tolist())


def _forces(plan: Plan) -> list[Place]:
    """Return both ends of the ground's force on each standing foot at some points."""
    ends: list[Place] = []
    for k in range(0, len(plan.time) - 1, _EVERY):
        feet = plan.foothold_at(float(plan.time[k]))
        for leg in np.flatnonzero(plan.stance[k]):
            tip = feet[leg] + FORCE_SCALE * plan.foot_force[k, leg]
            ends += [feet[leg].tolist(), tip.tolist()]
    return ends
