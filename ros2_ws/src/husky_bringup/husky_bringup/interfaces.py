"""What a running graph offers: nodes, topics, services, parameters, as any tool can see them."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from rclpy.task import Future

from husky_bringup.node_parameter import NodeParameter, is_of_every_node, make_node_parameter
from husky_bringup.processes import Processes
from husky_bringup.system import NodeSpec, ParameterValue, simulated_robot
from husky_runtime import graph

_EVERY_NODE = ("rcl_interfaces", "type_description_interfaces")
"""Packages of the topics and services that every node of rclpy has."""
_LIFECYCLE = "lifecycle_msgs/"
"""Begins the types of those that every lifecycle node has."""
_ACTION = "/_action/"
"""In the names of the topics and services that an action consists of."""
_SEND_GOAL = f"{_ACTION}send_goal"
_STEADY_PERIOD = 1.0
"""Discovery is over when nothing has changed for so long [s]."""
_PATIENCE = 60.0
"""Wall time that nodes may take to come up and to answer [s]."""

_FITTED: dict[str, dict[str, tuple[ParameterValue, ParameterValue]]] = {
    graph.PLANT: {"body": ("robot_with_unit", "robot"), "camera": (True, False)},
    graph.LOW_LEVEL_CONTROLLER: {"propulsion": (True, False)},
    graph.FOXGLOVE_GATEWAY: {"port": (0, 8765)},
    graph.CONSOLE: {"port": (0, 8080)},
}
"""Parameters with which a node is looked at, to see all that it offers, and their defaults."""

Result = TypeVar("Result")


@dataclass(frozen=True)
class Interface:
    """What one node offers. Topics and services are pairs of name and type, sorted.

    An action stands among the services, under its own type.

    Parameters are in the order of their declaration.
    Left out is what every node has (parameter services, `/rosout`, an ear for `/clock`) and every
    lifecycle node has.
    """

    name: str
    package: str
    lifecycle: bool
    publishes: tuple[tuple[str, str], ...]
    subscribes: tuple[tuple[str, str], ...]
    offers: tuple[tuple[str, str], ...]
    calls: tuple[tuple[str, str], ...]
    parameters: tuple[NodeParameter, ...] = ()


def all_nodes() -> tuple[NodeSpec, ...]:
    """Return every node there is; each has its defaults, but with fans and camera fitted."""
    fitted: dict[str, ParameterValue] = {"body": "robot_with_unit", "camera": True}
    specs = simulated_robot(settings={graph.PLANT: fitted}, record="-", remote=True)
    others = (
        NodeSpec("husky_control", graph.PLANNER),
        NodeSpec("husky_bringup", graph.TELEOP),
        NodeSpec("husky_bringup", graph.FOXGLOVE_GATEWAY),
        NodeSpec("husky_bringup", graph.CONSOLE),
    )
    return tuple(
        NodeSpec(
            spec.package,
            spec.executable,
            {name: value for name, (value, _) in _FITTED.get(spec.name, {}).items()},
        )
        for spec in (*specs, *others)
    )


@contextlib.contextmanager
def running(specs: Sequence[NodeSpec], logs: Path | None = None) -> Iterator[Reader]:
    """Run nodes in a directory that is thrown away, and look at them.

    Raises:
        OccupiedError: nodes of these names run already in this ROS domain.
    """
    with (
        Reader() as reader,
        tempfile.TemporaryDirectory() as directory,
        Processes(logs=logs or Path(directory) / "logs") as processes,
    ):
        with contextlib.chdir(directory):
            processes.start_all(specs)
        yield reader


class Reader:
    """Asks a running graph what it is.

    Attributes:
        node: this side's node.
    """

    def __init__(self) -> None:
        """Join the graph."""
        self._context = Context()
        rclpy.init(context=self._context)
        self.node = Node("reader", context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __enter__(self) -> Reader:
        """Return itself, when those who are there have been discovered."""
        self.wait(_STEADY_PERIOD)
        return self

    def __exit__(self, *exception: object) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait(self, duration: float) -> None:
        """Serve callbacks for a while of wall time [s]."""
        self.wait_until(lambda: False, "", duration)

    def wait_until(
        self, predicate: Callable[[], bool], what: str, patience: float = _PATIENCE
    ) -> None:
        """Serve callbacks until a predicate holds.

        Args:
            predicate: looked at again and again.
            what: is awaited, for the error; empty when it need not come true.
            patience: wall time to wait [s].

        Raises:
            TimeoutError: it did not come true.
        """
        deadline = time.monotonic() + patience
        while not predicate():
            left = deadline - time.monotonic()
            if left <= 0.0:
                if what:
                    raise TimeoutError(f"waited {patience:.0f} s in vain for {what}")
                return
            self._executor.spin_once(timeout_sec=min(left, 0.1))

    def result(self, future: Future, what: str) -> Any:
        """Return the answer of a service.

        Raises:
            TimeoutError: there is none.
        """
        self.wait_until(future.done, what)
        return future.result()

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service, once it is there, and return the response."""
        client = self.node.create_client(kind, service)
        self.wait_until(client.service_is_ready, service)
        response = self.result(client.call_async(request), service)
        self.node.destroy_client(client)
        return response

    def node_names(self) -> list[str]:
        """Return the names of the nodes that have been discovered, but for hidden ones."""
        names = self.node.get_node_names()
        return [n for n in names if n != self.node.get_name() and not n.startswith("_")]

    def read(self, specs: Sequence[NodeSpec]) -> dict[str, Interface]:
        """Return what nodes offer, by name, once they are up and discovered.

        Raises:
            TimeoutError: a node does not come up.
        """
        names = [spec.name for spec in specs]
        self.wait_until(lambda: set(names) <= set(self.node_names()), f"nodes {', '.join(names)}")
        # A node answers when its constructor has ended: then it has everything that it will have.
        parameters = {name: self._parameters(name) for name in names}
        return self._steady(
            lambda: {spec.name: self._interface(spec, parameters[spec.name]) for spec in specs}
        )

    def _steady(self, look: Callable[[], Result]) -> Result:
        """Return what is seen as soon as it does not change any more."""
        seen, since = look(), time.monotonic()
        while time.monotonic() - since < _STEADY_PERIOD:
            self.wait(0.2)
            now = look()
            if now != seen:
                seen, since = now, time.monotonic()
        return seen

    def _interface(self, spec: NodeSpec, parameters: tuple[NodeParameter, ...]) -> Interface:
        def own(found: list[tuple[str, list[str]]]) -> tuple[tuple[str, str], ...]:
            """Leave out what every node has; an action is one thing, known by its goals."""
            return tuple(
                sorted(
                    (name.removesuffix(_SEND_GOAL), types[0].removesuffix("_SendGoal"))
                    for name, types in found
                    if types[0].split("/")[0] not in _EVERY_NODE
                    and (not types[0].startswith(_LIFECYCLE) or name in in_the_name_of_others)
                    and (_ACTION not in name or name.endswith(_SEND_GOAL))
                )
            )

        node, where = self.node, (spec.name, "/")
        services = node.get_service_names_and_types_by_node(*where)
        states = {name for name, types in services if types[0].startswith(_LIFECYCLE)}
        in_the_name_of_others = {n for n in states if not n.startswith(f"/{spec.name}/")}
        heard = node.get_subscriber_names_and_types_by_node(*where)
        clock = graph.absolute(graph.CLOCK)
        clocks = [info.node_name for info in node.get_subscriptions_info_by_topic(clock)]
        if clocks.count(spec.name) == 1:  # that of its time source
            heard = [(name, types) for name, types in heard if name != clock]
        return Interface(
            name=spec.name,
            package=spec.package,
            lifecycle=bool(states - in_the_name_of_others),
            publishes=own(node.get_publisher_names_and_types_by_node(*where)),
            subscribes=own(heard),
            offers=own(services),
            calls=own(node.get_client_names_and_types_by_node(*where)),
            parameters=parameters,
        )

    def _parameters(self, name: str) -> tuple[NodeParameter, ...]:
        client = AsyncParameterClient(self.node, name)
        self.wait_until(client.services_are_ready, f"parameter services of {name}")
        listed = self.result(client.list_parameters(), f"parameters of {name}").result.names
        names = [n for n in listed if not is_of_every_node(n)]
        described = self.result(client.describe_parameters(names), f"parameters of {name}")
        values = self.result(client.get_parameters(names), f"parameters of {name}")
        fitted = _FITTED.get(name, {})
        return tuple(
            make_node_parameter(
                descriptor,
                fitted.get(descriptor.name, (None, parameter_value_to_python(value)))[1],
            )
            for descriptor, value in zip(described.descriptors, values.values, strict=True)
        )

    def publisher_qos(self, topic: str) -> list[QoSProfile]:
        """Return the profiles that the publishers of a topic offer."""
        return [info.qos_profile for info in self.node.get_publishers_info_by_topic(topic)]
