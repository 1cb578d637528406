"""Who offers a service and who listens to a topic, as DDS discovery knows it.

`service_is_ready` cannot tell a node that has been restarted from its dead predecessor, which stays
listed until its lease is over. Endpoints can: each has an identifier of its own.
"""

from __future__ import annotations

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from husky_runtime import graph

Endpoints = set[tuple[str, bytes]]
"""Node name and identifier of the process's DDS participant."""

_PREFIX = 12
"""Bytes of an endpoint's identifier that name its participant (RTPS 2.2, 9.3.1)."""


def servers(node: Node, service: str) -> Endpoints:
    """Return who offers a service: takes requests and sends replies."""
    service = node.resolve_service_name(service)
    takers = node.get_subscriptions_info_by_topic(f"rq{service}Request", no_mangle=True)
    repliers = node.get_publishers_info_by_topic(f"rr{service}Reply", no_mangle=True)
    return _participants(takers) & _participants(repliers)


def subscribers(node: Node, topic: str) -> Endpoints:
    """Return who listens to a topic of the graph, with the type that the graph says."""
    found = node.get_subscriptions_info_by_topic(topic)
    kind = graph.topic(topic).type
    return _participants([info for info in found if info.topic_type == kind])


def processes_of(endpoints: Endpoints) -> set[bytes]:
    """Return the processes alone: a node's name may become known later than its endpoint."""
    return {process for _, process in endpoints}


def _participants(endpoints: list[TopicEndpointInfo]) -> Endpoints:
    return {(info.node_name, bytes(info.endpoint_gid)[:_PREFIX]) for info in endpoints}
