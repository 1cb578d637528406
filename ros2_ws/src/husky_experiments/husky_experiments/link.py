"""Our side of a running graph: starts its processes, finds them, talks to them, waits for them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

import rclpy
from rclpy.action.client import ActionClient
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.subscription import Subscription
from rclpy.task import Future

from husky_bringup.processes import Nodes, Processes
from husky_bringup.system import NodeSpec
from husky_experiments.discovery import processes_of, servers, subscribers
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.patient_clock import PatientClock

_START_PERIOD = 900.0
"""Wall time that the graph may take to come up [s]: the first time nodes compile, for which a
machine that had much else to do took more than 180 s. A node that ends is told at once."""
_PATIENCE = 180.0
"""Wall time that anything else may take that is awaited without a time of its own [s]."""
_PROBE_PERIOD = 0.25
"""Wall time after which a first request is made again [s]."""
ANSWER_PERIOD = 45.0
"""Wall time that a service may take to answer [s]."""
_LONGEST_LOOK = 1.0
"""Most that the time between two looks counts of these [s]: looks come every 0.5 s at least."""


_PATHS = (
    (graph.SERVO_STATE, graph.PLANT, graph.DRIVE_BRIDGE),
    (graph.SERVO_COMMAND, graph.DRIVE_BRIDGE, graph.PLANT),
    *((graph.JOINT_STATES, name, graph.LOW_LEVEL_CONTROLLER) for name in graph.JOINT_BRIDGES),
    *((graph.JOINT_COMMAND, graph.LOW_LEVEL_CONTROLLER, name) for name in graph.JOINT_BRIDGES),
    (graph.IMU, graph.VN200_DRIVER, graph.LOW_LEVEL_CONTROLLER),
    *((graph.DRIVES_STATUS, name, graph.LOW_LEVEL_CONTROLLER) for name in graph.JOINT_BRIDGES),
    (graph.ODOMETRY, graph.LOW_LEVEL_CONTROLLER, graph.PLANT),
    (graph.ODOMETRY, graph.LOW_LEVEL_CONTROLLER, graph.ELEVATION_MAPPER),
    (graph.ODOMETRY, graph.LOW_LEVEL_CONTROLLER, graph.LOCALIZER),
    (graph.T265_ODOMETRY, graph.T265_DRIVER, graph.LOCALIZER),
    (graph.DEPTH_IMAGE, graph.D435_DRIVER, graph.ELEVATION_MAPPER),
    (graph.FLIGHT_SENSORS, graph.PLANT, graph.FLIGHT_CONTROLLER),
    (graph.FAN_COMMAND, graph.FLIGHT_CONTROLLER, graph.PLANT),
    (graph.PROPULSION_COMMAND, graph.LOW_LEVEL_CONTROLLER, graph.PIXHAWK_BRIDGE),
    (graph.PROPULSION_STATE, graph.PIXHAWK_BRIDGE, graph.LOW_LEVEL_CONTROLLER),
)
"""Topics that must have met both ends before a run: from whom to whom."""


class SessionError(RuntimeError):
    """The graph did not do what the script needs."""


class GraphLink:
    """The graph's processes and a node beside them.

    Attributes:
        processes: the graph's processes, or who else keeps its nodes (`Nodes`).
        specs: the nodes.
        context: the ROS context of this side.
    """

    def __init__(
        self,
        name: str,
        specs: tuple[NodeSpec, ...],
        output: Path,
        services: Mapping[str, type],
        probes: Mapping[str, Any],
        nodes: Nodes | None = None,
    ):
        """Start every node and wait until the graph is complete.

        Args:
            name: of the node beside them.
            specs: the nodes.
            output: directory for `logs`.
            services: types of the services that will be called, by name.
            probes: for the last service of each node, a request that changes nothing.
            nodes: who starts, kills and ends them; by default they are processes of ours.

        Raises:
            SessionError: a node ended, is not installed or did not come up, or a graph is there.
        """
        self.specs = specs
        self._probes = probes
        self.processes: Any = Processes(logs=output / "logs") if nodes is None else nodes
        self._output = output
        self._clock = PatientClock(_LONGEST_LOOK)
        self._owners: dict[str, str] = {}  # node by service
        try:
            # First: where a graph is there already, not even our own node joins it.
            self.processes.start_all(specs)
        except (OSError, ValueError) as error:
            raise SessionError(str(error)) from error
        self._join(name)
        self._services: dict[str, Client] = {
            name: self._node.create_client(kind, name) for name, kind in services.items()
        }
        self._or_close(self._find_everybody)
        self._listen()

    def _listen(self) -> None:
        """Subscribe to what the nodes report."""

    def _or_close(self, act: Callable[[], None]) -> None:
        """Do something; end all nodes if it fails."""
        try:
            act()
        except BaseException:
            self.close()
            raise

    def _join(self, name: str) -> None:
        """Make a node of our own beside the graph's."""
        self.context = Context()
        rclpy.init(context=self.context)
        self._node = rclpy.create_node(name, context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self._node)

    def _find_everybody(self) -> None:
        """Wait until services and the topics between the nodes have both ends."""
        node = self._node
        self.wait_for(
            lambda: all(client.service_is_ready() for client in self._services.values()),
            "the services of the nodes",
            _START_PERIOD,
        )
        recorders = sum(spec.name == graph.RECORDER for spec in self.specs)
        names = {spec.name for spec in self.specs}
        # A service is there before the name of its node is known.
        self.wait_for(lambda: self._find_owners(names), "the names of the nodes of the services")
        for service in self._probes:
            self._probe(service)
        listeners = Counter(
            name for name, publisher, subscriber in _PATHS if {publisher, subscriber} <= names
        )
        for name, count in listeners.items():
            self.wait_for(
                lambda name=name, count=count: (  # type: ignore[misc]
                    node.count_publishers(name) >= 1
                    and node.count_subscribers(name) >= count + recorders
                ),
                f"publisher and subscribers of {name}",
                _START_PERIOD,
            )
        if graph.LOW_LEVEL_CONTROLLER not in names:
            return
        self.wait_for(
            lambda: len(subscribers(node, graph.CMD_VEL)) >= 1 + recorders,
            f"subscribers of {graph.absolute(graph.CMD_VEL)}",
        )

    def _find_owners(self, names: set[str]) -> bool:
        """Note which node offers which service; return whether all are known."""
        for service in self._services:
            found = {name for name, _ in servers(self._node, service)} & names
            if found:
                self._owners[service] = found.pop()
        return self._owners.keys() == self._services.keys()

    def _probe(self, service: str) -> None:
        """Ask again and again until a service answers for the first time.

        A server may hear a client's request before it has discovered where the answer goes, and
        then the answer is lost. Discovery keeps the order in which the clients were made: who can
        answer the last one can answer all.
        """
        if service not in self._services:
            return
        answers: list[Future] = []
        last = 0.0

        def answered() -> bool:
            nonlocal last
            if time.monotonic() - last > _PROBE_PERIOD:
                last = time.monotonic()
                answers.append(self._services[service].call_async(self._probes[service]))
            return any(answer.done() for answer in answers)

        self.wait_for(answered, f"an answer of {service}")

    def now(self) -> float:
        """Return the wall time without that in which this process was stopped [s]."""
        return self._clock.read(time.monotonic())

    # Waiting --------------------------------------------------------------------------------
    def serve(self, patience: float) -> None:
        """Serve a callback of what comes within a while of wall time [s]."""
        self._executor.spin_once(timeout_sec=patience)

    def wait_for(
        self, predicate: Callable[[], bool], what: str, patience: float = _PATIENCE
    ) -> None:
        """Serve callbacks, without advancing the world, until a predicate holds.

        Args:
            predicate: what is awaited.
            what: the same in words.
            patience: wall time [s].

        Raises:
            SessionError: saying what was awaited, when a node ends or it takes too long.
        """
        deadline = self.now() + patience
        while not predicate():
            self._check_processes()
            if self.now() > deadline:
                raise SessionError(f"waited {patience:.0f} s of wall time in vain for {what}")
            self.serve(0.02)

    def _check_processes(self) -> None:
        for name, code in self.processes.ended().items():
            log = self._output / "logs" / f"{name}.log"
            text = log.read_text("utf-8", "replace") if log.exists() else "no log"
            lines = text.splitlines()
            if lines and lines[-1].startswith("error: "):  # it has said why
                raise SessionError(f"{name} has ended with code {code}: {lines[-1][7:]}")
            tail = "\n".join(lines[-12:])
            raise SessionError(f"{name} has ended with code {code}; the end of {log}:\n{tail}")

    def call(self, service: str, request: Any) -> Any:
        """Call a service of the graph by its name and return the response.

        Raises:
            SessionError: no answer.
        """
        future = self.ask(service, request)
        deadline = self.now() + ANSWER_PERIOD
        while not future.done():
            self._check_processes()
            if self.now() > deadline:
                service = graph.absolute(service)
                raise SessionError(f"{service} has not answered for {ANSWER_PERIOD:.0f} s")
            self.serve(0.5)
        return future.result()

    def ask(self, service: str, request: Any) -> Future:
        """Call a service of the graph and go on; the answer comes while something else waits."""
        return self._services[service].call_async(request)

    def _expect(self, service: str, request: Any) -> None:
        response = self.call(service, request)
        if not response.success:
            service = graph.absolute(service)
            raise SessionError(f"{service} refused {request}: {response.message}")

    def subscribe(
        self,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        group: CallbackGroup | None = None,
    ) -> Subscription:
        """Listen to one more topic of the graph."""
        profile = qos.PROFILES[graph.topic(topic).qos]
        return self._node.create_subscription(kind, topic, callback, profile, callback_group=group)

    def add_service(self, kind: type, service: str) -> None:
        """Make one more service of the graph callable, once it is there.

        Raises:
            SessionError: it does not come up.
        """
        self._services[service] = self._node.create_client(kind, service)
        self.wait_for(self._services[service].service_is_ready, service)

    def add_action(self, kind: Any, name: str) -> ActionClient:
        """Return a client of an action of the graph, once the action is there.

        Raises:
            SessionError: it does not come up.
        """
        client = ActionClient(self._node, kind, name)
        self.wait_for(client.server_is_ready, f"action {graph.absolute(name)}")
        return client

    def count_publishers(self, topic: str) -> int:
        """Return how many nodes publish a topic, as far as is known here."""
        return int(self._node.count_publishers(topic))

    # Breaking -------------------------------------------------------------------------------
    def kill(self, node: str) -> None:
        """Kill a node (SIGKILL); the others must do without it."""
        self.processes.kill(node)
        self.processes.reap(node)

    def start(self, node: str) -> None:
        """Start a node that has been killed or ended, and wait until it can be spoken to.

        Raises:
            SessionError: it ended or did not come up.
        """
        spec = next(spec for spec in self.specs if spec.name == node)
        owned = [service for service, owner in self._owners.items() if owner == node]
        listens = processes_of(subscribers(self._node, graph.CMD_VEL))
        offered = {service: processes_of(servers(self._node, service)) for service in owned}
        self.processes.start(spec)
        for service in owned:
            self.wait_for(
                lambda service=service: any(  # type: ignore[misc]
                    name == node and process not in offered[service]
                    for name, process in servers(self._node, service)
                ),
                f"{service} of the new {node}",
            )
        for service in self._probes:
            if service in owned:
                self._probe(service)
        if node == graph.LOW_LEVEL_CONTROLLER:
            self.wait_for(
                lambda: bool(processes_of(subscribers(self._node, graph.CMD_VEL)) - listens),
                f"the new {node} at {graph.absolute(graph.CMD_VEL)}",
            )

    # The end --------------------------------------------------------------------------------
    def close(self) -> dict[str, int]:
        """End every node; return their exit codes."""
        codes: dict[str, int] = self.processes.end()
        self._executor.shutdown()
        self._node.destroy_node()
        if self.context.ok():
            rclpy.shutdown(context=self.context)
        return codes

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End every node."""
        self.close()
