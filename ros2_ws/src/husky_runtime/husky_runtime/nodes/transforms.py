"""Transforms on `/tf` and `/tf_static`: each node tells of the frames that it knows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from tf2_msgs.msg import TFMessage

from husky_description.link_frames import Edge, inverse
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.patched_message import PatchedMessage
from husky_runtime.pace import Pace

TRANSFORM_PERIOD_NS = 20_000_000
"""Between two messages of a node on `/tf` [ns]: 50 Hz, as `/odom`."""
_SLACK_NS = 1_000_000
"""By how much a message of `SeenFrom` may come early [ns]."""


def declare_transforms(node: Node, what: str) -> bool:
    """Declare whether a node tells its transforms; False leaves them to somebody else.

    Args:
        node: the node that gets the parameter.
        what: the frames, for the description.
    """
    topic = graph.absolute(graph.TF)
    return bool(declare(node, "publish_tf", True, f"tell the transforms of {what} on {topic}"))


class TransformTeller:
    """Tells some transforms of one time in one message on `/tf`."""

    def __init__(self, node: Node, edges: Sequence[Edge]):
        """Make the publisher; edges are parent and child frame of each transform."""
        message = TFMessage(transforms=[_transform(edge) for edge in edges])
        places = [
            part
            for each in message.transforms
            for part in (each.header.stamp, each.transform.translation, each.transform.rotation)
        ]
        self._message = PatchedMessage(message, places)
        self._publisher: Publisher = node.create_publisher(TFMessage, graph.TF, qos.TF)

    def tell(self, time_ns: int, transforms: Iterable[Sequence[float]]) -> None:
        """Publish.

        Args:
            time_ns: their stamp [ns], 0 or more.
            transforms: for each edge the child's pose in its parent: position [m], quaternion
                (x, y, z, w).
        """
        stamp = divmod(time_ns, 1_000_000_000)
        write = self._message.write
        for index, values in enumerate(transforms):
            write(3 * index, *stamp)
            write(3 * index + 1, *values[:3])
            write(3 * index + 2, *values[3:])
        self._publisher.publish(self._message.encode())


class SeenFrom:
    """Tells where a frame is, 50 times a second, by the poses of a link in it.

    A frame has one parent (REP-105), and the robot's links have theirs already. So the world that a
    sensor or the simulation sees the robot in hangs on the link that it sees: the tree is one, the
    estimates do not mix, and at the stamps of a message the pose is that message's, exactly.
    """

    def __init__(self, node: Node, link: str, frame: str):
        """Make the publisher of a frame that a link of the robot is seen in."""
        self._teller = TransformTeller(node, [(link, frame)])
        self._pace = Pace(TRANSFORM_PERIOD_NS, _SLACK_NS)

    def tell(self, time_ns: int, pose: Sequence[float]) -> None:
        """Publish, if it is time to, by the link's pose in the frame [m], (x, y, z, w); at [ns]."""
        if self._pace.due(time_ns):
            self._teller.tell(time_ns, [inverse(pose)])


def tell_fixed(node: Node, edges: Sequence[Edge], transforms: Iterable[Sequence[float]]) -> None:
    """Tell transforms that never change on `/tf_static`, to whoever comes, once for all.

    Args:
        node: that knows the frames.
        edges: parent and child frame of each transform.
        transforms: for each edge the child's pose in its parent: position [m], quaternion
            (x, y, z, w).
    """
    message = TFMessage(transforms=[_transform(edge) for edge in edges])
    for each, values in zip(message.transforms, transforms, strict=True):
        place, turn = each.transform.translation, each.transform.rotation
        place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = map(float, values)
    node.create_publisher(TFMessage, graph.TF_STATIC, qos.LATCHED).publish(message)


def _transform(edge: Edge) -> TransformStamped:
    message = TransformStamped(child_frame_id=edge[1])
    message.header.frame_id = edge[0]
    stamps.fill(message.header.stamp, 0)
    return message
