"""Node `foxglove_gateway`: the graph for Foxglove and whoever else speaks its protocol.

The server is foxglove-sdk's own. Messages go to it as they come off the wire: nothing is decoded,
and a topic is subscribed to only while somebody listens. One that is faster than `rate` is thinned
out in the middleware's queue, which then holds only the newest message: 500 messages a second cost
as much as 30. A client that does not keep up loses its oldest messages; nobody waits for it.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from queue import Empty, SimpleQueue

from foxglove import Context, Parameter, StatusLevel, start_server
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    ClientChannel,
    ServerListener,
    WebSocketServer,
)
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.qos import qos_profile_parameter_events
from rclpy.subscription import Subscription

from husky_bringup.definitions import Definitions
from husky_bringup.node_parameter import to_python
from husky_bringup.nodes.gateway.client_topics import ClientTopics
from husky_bringup.nodes.gateway.services import ServiceOffers
from husky_bringup.nodes.gateway.topics import TopicFeeds
from husky_bringup.nodes.open_gate import open_gate
from husky_bringup.nodes.remote_parameters import RemoteParameters
from husky_bringup.nodes.service_calls import ServiceCalls
from husky_bringup.nodes.topic_search import EVERYTHING, TopicSearch
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos
from husky_runtime.nodes.executor import wake
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.run import run

_PORT, _PAGES = 8765, ("https://app.foxglove.dev", "file://")
_SEARCH_PERIOD = 0.5
"""Wall time between two looks for new topics and services [s]."""
_PATIENCE = 30.0
"""Wall time that a client waits for the answer of a service [s]."""
_CAPABILITIES = [
    Capability.ClientPublish,
    Capability.Parameters,
    Capability.Services,
    Capability.Time,
]


class FoxgloveGateway(OneClock, Node):
    """Serves topics, services and parameters over a websocket.

    The server calls back from threads of its own. What touches the graph is handed over to the
    node's thread, which is woken for it.
    """

    def __init__(self) -> None:
        """Declare parameters, open the server and the gate before it."""
        super().__init__(graph.FOXGLOVE_GATEWAY)
        rate = declare(self, "rate", 30.0, "messages of a topic in a second [Hz]", 1.0, 200.0)
        topics, services, publish = self._declare_names()
        self._tasks: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._search = TopicSearch(self, topics)
        self._calls = ServiceCalls(self, partial(wake, self), _PATIENCE)
        self.parameters = RemoteParameters(self, self._calls)
        definitions, context = Definitions(), Context()
        self.feeds = TopicFeeds(self, context, definitions, rate)
        self.client_topics = ClientTopics(self, publish)
        self.watched: set[str] = set()
        self._refused = 0
        self._server = self._open_server(context)
        self._offers = ServiceOffers(self, self._server, definitions, self._calls, services)
        for row in self._search.rows():
            self.feeds.add(row, qos.PROFILES[row.qos])
        self.create_subscription(
            ParameterEvent, "/parameter_events", self._on_event, qos_profile_parameter_events
        )
        self.hot: Sequence[Subscription] = []
        self.hot_wires = [self._do_tasks, self._calls.serve]
        self.create_timer(1.0 / rate, self._turn)
        self.create_timer(_SEARCH_PERIOD, self._find)
        self._gate = open_gate(self, self._server.port, _PORT, _PAGES)
        self._diagnostics = diagnostics.Diagnostics(self, "foxglove", self._report)
        print(f"serving {self._gate.address('ws')}", flush=True)  # the token is not for /rosout

    def _declare_names(self) -> tuple[list[str], list[str], list[str]]:
        """Declare which topics and services there are for clients."""
        what = "that clients see, also later ones; * stands for any text"
        topics = declare(self, "topics", [EVERYTHING], f"topics {what}")
        services = declare(self, "services", [EVERYTHING], f"services {what}")
        commands = [self.resolve_topic_name(graph.CMD_VEL)]
        publish = declare(self, "publish", commands, "topics on which clients may publish")
        return topics, services, publish

    def _open_server(self, context: Context) -> WebSocketServer:
        what = "messages that wait for a client which does not keep up"
        backlog = declare(self, "backlog", 256, what, 16, 100_000)
        return start_server(
            name=self.get_fully_qualified_name(),
            host="127.0.0.1",
            port=0,
            context=context,
            capabilities=_CAPABILITIES,
            supported_encodings=["cdr"],
            server_listener=_Listener(self),
            message_backlog_size=backlog,
        )

    # The node's thread ----------------------------------------------------------------------
    def _do_tasks(self) -> bool:
        """Do what has been handed over; return whether there was something."""
        did = False
        with contextlib.suppress(Empty):
            while True:
                self._tasks.get_nowait()()
                did = True
        return did

    def _turn(self) -> None:
        """Pass on what has come."""
        now = self.get_clock().now().nanoseconds or time.time_ns()
        self.feeds.forward(now)
        self._server.broadcast_time(now)

    def _find(self) -> None:
        for topic, offered in self._search.fresh():
            self._search.begin(topic, partial(self.feeds.add, topic, offered))
        self._offers.find()

    def _on_event(self, event: ParameterEvent) -> None:
        """Tell clients of parameters that have changed."""
        changed = [*event.new_parameters, *event.changed_parameters]
        named = {f"{event.node}.{each.name}": each.value for each in changed}
        told = [
            Parameter(name, value=to_python(value))
            for name, value in named.items()
            if name in self.watched
        ]
        if told:
            self._server.publish_parameter_values(told)

    def _report(self) -> diagnostics.Report:
        skipped = {**self._search.skipped, **self._offers.skipped}
        values = {
            "address": self._gate.address("ws").partition("?")[0],
            "connections": self._gate.connections,
            "refused_connections": self._gate.refused,
            "refused_from_clients": self._refused,
            "topics": len(self.feeds),
            "topics_listened": self.feeds.listened,
            "services": len(self._offers),
            "forwarded": self.feeds.forwarded,
            "skipped": "; ".join(f"{name}: {why}" for name, why in skipped.items()),
        }
        return diagnostics.OK, "serving", values

    # Threads of the server --------------------------------------------------------------------
    def hand_over(self, task: Callable[[], None]) -> None:
        """Let the node's thread do something, which clients are told of when it is refused."""

        def attempt() -> None:
            try:
                task()
            except (ValueError, RuntimeError) as error:  # the latter rclpy's, of a second type
                self._refused += 1
                self._server.publish_status(str(error), StatusLevel.Error)

        self._tasks.put(attempt)
        wake(self)

    def read_parameters(self, names: Sequence[str]) -> list[Parameter]:
        """Return parameters as they are now, all of them for no name."""
        return [Parameter(name, value=value) for name, value in self.parameters.read(names).items()]

    def write_parameters(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Set parameters, tell what was refused; return them as they are then."""
        wanted = {parameter.name: parameter.get_value() for parameter in parameters}
        for why in self.parameters.write(wanted):
            self._server.publish_status(why, StatusLevel.Error)
        return self.read_parameters(list(wanted)) if wanted else []

    # The end ----------------------------------------------------------------------------------
    def quiet(self) -> None:
        """Nothing to do: there are no hot subscriptions."""

    def close(self) -> None:
        """Let clients go."""
        self._gate.close()
        self._calls.close()
        self._server.stop()
        self.feeds.close()


class _Listener(ServerListener):
    """Hands on what the server calls, in threads of its own."""

    def __init__(self, gateway: FoxgloveGateway):
        self._gateway = gateway

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._gateway.hand_over(partial(self._gateway.feeds.listen, channel.id))

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        self._gateway.hand_over(partial(self._gateway.feeds.leave, channel.id))

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        topics = self._gateway.client_topics
        self._gateway.hand_over(partial(topics.advertise, client.id, channel))

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        topics = self._gateway.client_topics
        self._gateway.hand_over(partial(topics.unadvertise, client.id, client_channel_id))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        topics = self._gateway.client_topics
        self._gateway.hand_over(partial(topics.publish, client.id, client_channel_id, data))

    def on_get_parameters(
        self, client: Client, param_names: list[str], request_id: str | None = None
    ) -> list[Parameter]:
        return self._gateway.read_parameters(param_names)

    def on_set_parameters(
        self, client: Client, parameters: list[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        return self._gateway.write_parameters(parameters)

    def on_parameters_subscribe(self, param_names: list[str]) -> None:
        self._gateway.hand_over(partial(self._gateway.watched.update, param_names))

    def on_parameters_unsubscribe(self, param_names: list[str]) -> None:
        watched = self._gateway.watched
        self._gateway.hand_over(partial(watched.difference_update, param_names))


def main() -> int:
    """Run the node."""
    return run(FoxgloveGateway)


if __name__ == "__main__":
    sys.exit(main())
