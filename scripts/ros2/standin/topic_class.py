"""The message class of a topic, from the graph."""

import time
from typing import Any

import rclpy
from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name

from standin.graph import discover, topics
from standin.messages import interface_class


def published_class(
    node: Node, topic: str, spin_time: float, wait: bool = False, quiet: bool = False
) -> Any:
    """The class of a topic's messages; None when nobody has the topic within spin_time seconds.

    With wait, wait until somebody has; unless quiet, say that nobody has.
    """
    discover(node, spin_time, lambda: is_published(node, topic))
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
    try:
        name = expand_topic_name(topic, node.get_name(), node.get_namespace())
        validate_full_topic_name(name)
    except (ValueError, InvalidTopicNameException) as error:
        raise RuntimeError(error) from None
    types = dict(topics(node, hidden=True)).get(name)
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
