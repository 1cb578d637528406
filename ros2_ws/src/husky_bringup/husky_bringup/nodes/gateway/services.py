"""Services of the graph as services of a Foxglove server."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

from foxglove import MessageSchema, Schema, Service, ServiceRequest, ServiceSchema
from foxglove.websocket import WebSocketServer
from rclpy.node import Node
from rclpy.serialization import serialize_message

from husky_bringup.definitions import Definitions
from husky_bringup.nodes.incoming import decode
from husky_bringup.nodes.service_calls import ServiceCalls
from husky_bringup.nodes.topic_search import is_wanted

_OF_EVERY_NODE = ("rcl_interfaces/", "type_description_interfaces/", "lifecycle_msgs/")
"""Types of services that each node has; those of parameters are reached as parameters."""


class ServiceOffers:
    """Offers services while they are there, and calls them for clients; for the node's thread.

    Attributes:
        skipped: services that cannot be offered, and why.
    """

    def __init__(
        self,
        node: Node,
        server: WebSocketServer,
        definitions: Definitions,
        calls: ServiceCalls,
        patterns: Sequence[str],
    ):
        """Offer none yet.

        Args:
            node: that looks for them.
            server: to offer them at.
            definitions: of messages, for the schemas.
            calls: that are made for clients.
            patterns: names to offer; * stands for any text.
        """
        self._node, self._server, self._definitions = node, server, definitions
        self._calls, self._patterns = calls, patterns
        self._offered: dict[str, str] = {}
        self.skipped: dict[str, str] = {}

    def __len__(self) -> int:
        """Return how many services are offered."""
        return len(self._offered)

    def find(self) -> None:
        """Offer what has come into the graph, and no longer what has left it."""
        there = {
            name: types[0]
            for name, types in self._node.get_service_names_and_types()
            if len(types) == 1
            and not types[0].startswith(_OF_EVERY_NODE)
            and is_wanted(name, self._patterns, self._node.get_namespace())
            and self._node.count_services(name) > 0  # not clients alone, of which one is ours
        }
        gone = [name for name, kind in self._offered.items() if there.get(name) != kind]
        if gone:
            self._server.remove_services(gone)
            for name in gone:
                del self._offered[name]
                self._calls.part(name)
        for name, kind in there.items():
            if name not in self._offered and name not in self.skipped:
                self._offer(name, kind)

    def _offer(self, name: str, kind: str) -> None:
        try:
            service = self._service(name, kind)
        except Exception as error:  # of whatever its package does when it is imported
            self.skipped[name] = f"{type(error).__name__}: {error}"
            self._node.get_logger().warning(f"{name} is left out: {self.skipped[name]}")
            return
        self._server.add_services([service])
        self._offered[name] = kind

    def _service(self, name: str, kind: str) -> Service:
        package, _, word = kind.split("/")
        found: Any = getattr(importlib.import_module(f"{package}.srv"), word)
        self._calls.meet(name, found)
        schema = ServiceSchema(
            kind,
            request=self._schema(f"{kind}_Request"),
            response=self._schema(f"{kind}_Response"),
        )

        def call(asked: ServiceRequest) -> bytes:
            """Answer a client, in a thread of the server's; it gets what is raised as a failure."""
            request = decode(asked.payload, found.Request, asked.encoding)
            return bytes(serialize_message(self._calls.call(name, found, request).result()))

        return Service(name, schema=schema, handler=call)

    def _schema(self, kind: str) -> MessageSchema:
        text = self._definitions.text(kind)
        schema = Schema(name=kind, encoding="ros2msg", data=text.encode())
        return MessageSchema(encoding="cdr", schema=schema)
