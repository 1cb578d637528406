"""Topics to follow: those of the graph's table, and whatever else is found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from husky_runtime import graph

EVERYTHING = "*"
"""Pattern of every topic."""
OF_ALL = ("/rosout", "/parameter_events")
"""Topics of ROS that are in no namespace."""
MOST = 500
"""Topics that are followed; each has a queue."""


class TopicSearch:
    """Looks for topics that match, and tells each once.

    Attributes:
        skipped: topics that cannot be followed, and why.
    """

    def __init__(self, node: Node, patterns: Sequence[str]):
        """Know no topic yet.

        Args:
            node: in whose namespace the robot is.
            patterns: full names; those in which * stands for any text match below the namespace.

        Raises:
            ValueError: one that cannot be a name.
        """
        for pattern in patterns:
            if not pattern.startswith(("/", EVERYTHING)):
                raise ValueError(f"topics has {pattern!r}, a name begins with / or *")
        self.skipped: dict[str, str] = {}
        self._node, self._patterns = node, patterns
        self._told: set[str] = set()

    def rows(self) -> list[graph.Topic]:
        """Return the rows of the graph's table that match."""
        below = (
            replace(row, relative=self._node.resolve_topic_name(row.relative))
            for row in graph.TOPICS
        )
        rows = [row for row in below if self._is_wanted(row.name)]
        self._told.update(row.name for row in rows)
        return rows

    def fresh(self) -> Iterator[tuple[graph.Topic, QoSProfile]]:
        """Yield topics that match and have been told by nobody yet, and how to subscribe to them.

        One that nobody publishes yet is left for later: only its publishers say how.
        """
        for name, types in self._node.get_topic_names_and_types():
            if name in self._told or not self._is_wanted(name):
                continue
            profile = self._profile(name)
            if profile is None:
                continue
            self._told.add(name)
            if len(types) > 1:
                self.skipped[name] = f"it has several types: {', '.join(types)}"
            elif len(self._told) > MOST:
                self.skipped[name] = f"there are more than {MOST} topics"
            else:
                yield graph.Topic(name, types[0], (), "", 0.0), profile

    def begin(self, topic: graph.Topic, follow: Callable[[], None]) -> None:
        """Begin to follow a topic, or note why that cannot be done."""
        try:
            follow()
        except Exception as error:  # of whatever its package does when it is imported
            self.skipped[topic.name] = f"{type(error).__name__}: {error}"
            self._node.get_logger().warning(f"{topic.name} is left out: {self.skipped[topic.name]}")

    def _is_wanted(self, name: str) -> bool:
        return is_wanted(name, self._patterns, self._node.get_namespace())

    def _profile(self, name: str) -> QoSProfile | None:
        """Return what receives all that its publishers offer, None while there are none."""
        offered = [p.qos_profile for p in self._node.get_publishers_info_by_topic(name)]
        if not offered:
            return None
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in offered)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered)
        return QoSProfile(
            depth=1,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )


def is_wanted(name: str, patterns: Sequence[str], namespace: str) -> bool:
    """Return whether a topic or a service matches.

    Those that are hidden, with a part that begins with _, are of actions.

    Args:
        name: in full.
        patterns: full names; those in which * stands for any text match below the namespace.
        namespace: of the robot.
    """
    if name in patterns:
        return True
    if any(part.startswith("_") for part in name.split("/")):
        return False
    below = namespace.rstrip("/") + "/"
    return any(
        fnmatchcase(name, pattern) and (name.startswith(below) or name in OF_ALL)
        for pattern in patterns
    )
