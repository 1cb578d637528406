"""The message class of a topic, from the graph."""

import time
from typing import Any

import rclpy
from rclpy.node import Node

from standin.graph import discover, expanded_name, topics
from standin.messages import interface_class

_PATIENCE = 5.0
"""How much longer than for the graph it is looked for a topic that nothing is possible without.

The original's daemon knows the graph already; on a busy machine its discovery takes seconds.
"""


def published_class(
    node: Node, topic: str, spin_time: float, wait: bool = False, quiet: bool = False
) -> Any:
    """The class of a topic's messages; None when nobody has the topic in time.

    That is within spin_time seconds when the caller does without (quiet), or waits until somebody
    has it (wait); else the command ends without it, and some more patience is worth it. Unless
    quiet, say that nobody has.
    """
    patience = 1.0 if quiet or wait else _PATIENCE
    discover(node, patience * spin_time, lambda: is_published(node, topic))
    found = class_in_graph(node, topic)
    if found is None and not quiet:
        print(f"WARNING: topic [{topic}] does not appear to be published yet")
    while found is None and wait and rclpy.ok():
        time.sleep(0.1)
        found = class_in_graph(node, topic)
    return found


def is_published(node: Node, topic: str) -> bool:
    """Whether a publisher of the topic is known; its subscribers alone also make it known.

    Raises RuntimeError as class_in_graph does.
    """
    return class_in_graph(node, topic) is not None and node.count_publishers(topic) > 0


def class_in_graph(node: Node, topic: str) -> Any:
    """The class of a topic's messages, None when nobody has the topic.

    Raises RuntimeError when the name is not valid or the topic has no usable type.
    """
    types = dict(topics(node, hidden=True)).get(expanded_name(node, topic))
    if types is None:
        return None
    if len(types) > 1:
        raise RuntimeError(
            f"Cannot echo topic '{topic}', as it contains more than one type: [{', '.join(types)}]"
        )
    try:
        return interface_class(types[0], "msg")
    except ValueError:
        raise RuntimeError(f"The message type '{types[0]}' is invalid") from None
