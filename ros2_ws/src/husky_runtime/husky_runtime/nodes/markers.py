"""Drawings for RViz and Foxglove: what a node knows as markers, ten times a second."""

from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.patched_message import PatchedMessage
from husky_runtime.pace import Pace

FORCE_SCALE = 0.008
"""Length of the arrow of a force [m/N], as in the films."""
ORANGE, BLUE, GREEN, VIOLET = (
    (0.90, 0.33, 0.10),
    (0.15, 0.45, 0.85),
    (0.20, 0.65, 0.30),
    (0.55, 0.35, 0.80),
)
MARKER_PERIOD_NS = 100_000_000
"""Between two drawings of a node [ns]."""
_LIFETIME_NS = 500_000_000
"""A drawing that is not renewed goes after so long [ns]."""
_SLACK_NS = 5_000_000
"""By how much a drawing may come early [ns]."""

Colour = tuple[float, float, float]
Place = Sequence[float]


def make_marker(
    kind: int, frame: str, namespace: str, number: int, colour: Colour, points: int
) -> Marker:
    """Return a marker of a kind that has points.

    Args:
        kind: a constant of Marker.
        frame: that the points are in.
        namespace: what is drawn; viewers switch it on and off as one.
        number: of the marker in its namespace.
        colour: red, green, blue.
        points: how many.
    """
    marker = Marker(type=kind, ns=namespace, id=number, action=Marker.ADD)
    marker.header.frame_id = frame
    marker.pose.orientation.w = 1.0
    marker.lifetime = Duration(sec=0, nanosec=_LIFETIME_NS)
    marker.color = ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=1.0)
    marker.points = [Point() for _ in range(points)]
    if kind == Marker.ARROW:
        marker.scale.x, marker.scale.y = 0.012, 0.03  # m, of the shaft and of the head
    elif kind == Marker.SPHERE_LIST:
        marker.scale.x = marker.scale.y = marker.scale.z = 0.03
    else:
        marker.scale.x = 0.01
    return marker


class MarkerTeller:
    """Tells some markers, each of points that change, in one message."""

    def __init__(self, node: Node, markers: Sequence[Marker]):
        """Make the publisher of markers that `make_marker` has made."""
        self._first: list[int] = []
        self._colours = [(m.color.r, m.color.g, m.color.b) for m in markers]
        places: list[object] = []
        for marker in markers:
            self._first.append(len(places))
            places += [marker.header.stamp, marker.color, *marker.points]
        self._message = PatchedMessage(MarkerArray(markers=markers), places)
        self._publisher = node.create_publisher(MarkerArray, graph.MARKERS, qos.STATUS)
        self._pace = Pace(MARKER_PERIOD_NS, _SLACK_NS)

    def due(self, time_ns: int) -> bool:
        """Return whether it is time to draw again; then it counts as told."""
        return self._pace.due(time_ns)

    def draw(self, index: int, points: Sequence[Place], *, seen: bool = True) -> None:
        """Move a marker.

        Args:
            index: of the marker.
            points: all of them, in its frame [m].
            seen: False draws nothing.
        """
        first = self._first[index]
        self._message.write(first + 1, *self._colours[index], 1.0 if seen else 0.0)
        for number, point in enumerate(points):
            self._message.write(first + 2 + number, *point)

    def arrow(self, index: int, start: Place, force: Place) -> None:
        """Draw a force [N] as an arrow; one below a newton is none."""
        x, y, z = (float(a) + FORCE_SCALE * float(f) for a, f in zip(start, force, strict=True))
        length = sum(float(f) ** 2 for f in force) ** 0.5
        self.draw(index, (start, (x, y, z + (1e-3 if length < 1.0 else 0.0))), seen=length >= 1.0)

    def tell(self, time_ns: int) -> None:
        """Publish the markers as they were drawn last, with this stamp [ns]."""
        for first in self._first:
            self._message.write(first, *divmod(time_ns, 1_000_000_000))
        self._publisher.publish(self._message.encode())
