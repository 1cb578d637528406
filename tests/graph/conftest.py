"""A running robot to break: a graph for many tests, a fresh world for each."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from node_bench import fork_server
from own_network import own_network
from ros_domain import held_domain, own_domain
from seen_robot import SETTINGS, Robot, running

from husky_bringup.fork_server import sharing
from husky_bringup.system import simulated_robot
from husky_runtime import graph
from husky_runtime.nodes.diagnostics import PERIOD

NewGraph = Callable[..., contextlib.AbstractContextManager["Robot"]]
SHARED = {"graph_of_module", "seeing_of_module", "fans_of_module", "vectoring_of_module"}
"""Fixtures whose graphs go on from module to module."""

REPORTING = {PERIOD: 0.2}
"""Of every node: tests wait for reports."""
WIRED_AND_SEEING = {
    **SETTINGS,
    graph.PLANT: {**SETTINGS[graph.PLANT], "bus": "soem", "camera": True},
}
"""Parameters of a graph with EtherCAT frames on a wire and with the depth camera."""


class Graphs:
    """Starts graphs, one at a time; one that suits the next test module too is left running.

    Modules that want the same settings follow one another (`tests/conftest.py`) and share one.
    """

    def __init__(self, new_directory: Callable[[str], Path]):
        """Prepare; nothing is started yet."""
        self._new_directory = new_directory
        self._end = contextlib.ExitStack()
        self._options: dict[str, Any] = {}
        self._robot: Robot | None = None

    def shared(self, **options: Any) -> Robot:
        """Return the robot of the running graph if it is of these settings, else of a new one."""
        if self._robot is None or options != self._options:
            self.end()
            self._options = options
            self._robot = self._end.enter_context(self._graph(**options))
        self._robot.close_taps()
        return self._robot

    def end(self) -> None:
        """End the graph that runs, if one does."""
        self._robot = None
        self._end.close()

    @contextlib.contextmanager
    def new(self, **options: Any) -> Iterator[Robot]:
        """Start a graph that nobody else gets."""
        self.end()
        with self._graph(**options) as robot:
            yield robot

    @contextlib.contextmanager
    def _graph(
        self, clock: str = "lockstep", remote: bool = False, **settings: Any
    ) -> Iterator[Robot]:
        """Start a graph, by other settings if need be; EtherCAT frames get a network to be on."""
        settings = settings or SETTINGS
        wired = settings.get(graph.PLANT, {}).get("bus") == "soem"
        names = [spec.name for spec in simulated_robot(clock, settings, remote=remote)]
        settings = {name: {**REPORTING, **settings.get(name, {})} for name in names}
        options = {"record": False, "clock": clock, "remote": remote}
        with (
            # The server is in this network, as its nodes would be.
            own_network() if wired else sharing(fork_server()),
            running(self._new_directory("graph"), settings, **options) as session,
        ):
            robot = Robot(session)
            yield robot
            robot.close()


@pytest.fixture(scope="package")
def domain() -> Iterator[int]:
    """The ROS domain of this worker's graphs."""
    with held_domain("tests/graph") as number:
        yield number


@pytest.fixture
def alone(request: pytest.FixtureRequest) -> Iterator[int]:
    """A domain in which nobody else is seen: README says which nodes there are."""
    with own_domain(request.node.nodeid) as number:
        yield number


@pytest.fixture(scope="package")
def graphs(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graphs]:
    """Who starts this worker's graphs."""
    graphs = Graphs(tmp_path_factory.mktemp)
    yield graphs
    graphs.end()


@pytest.fixture(scope="module", autouse=True)
def in_own_domain(graphs: Graphs, domain: int, request: pytest.FixtureRequest) -> Iterator[None]:
    """What a module starts is in the domain, alone if it shares no graph.

    A graph with which a test has failed goes to no other module.
    """
    here = (item for item in request.session.items if item.path == request.path)
    if not any(SHARED.intersection(item.fixturenames) for item in here):
        graphs.end()
    failed = request.session.testsfailed
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        yield
    if request.session.testsfailed > failed:
        graphs.end()


@pytest.fixture(scope="module")
def new_graph(graphs: Graphs) -> NewGraph:
    """Starts a graph for a test or a module alone."""
    return graphs.new


@pytest.fixture(scope="module")
def graph_of_module(graphs: Graphs) -> Robot:
    """The walking robot's graph in lockstep."""
    return graphs.shared()


@pytest.fixture(scope="module")
def seeing_of_module(graphs: Graphs) -> Robot:
    """The walking robot's graph in lockstep with EtherCAT frames, depth camera and navigation."""
    return graphs.shared(**WIRED_AND_SEEING)


@pytest.fixture
def robot(graph_of_module: Robot) -> Robot:
    """A sitting robot in a fresh world."""
    graph_of_module.start_again()
    return graph_of_module


@pytest.fixture
def standing(graph_of_module: Robot) -> Robot:
    """A standing robot, all well."""
    if not graph_of_module.stands:
        graph_of_module.start_again()
        graph_of_module.stand()
    return graph_of_module


@pytest.fixture
def trotting(graph_of_module: Robot) -> Robot:
    """A trotting robot, all well."""
    robot = graph_of_module
    if not (robot.stands or robot.trots):
        robot.start_again()
        robot.stand()
    robot.trot()
    return robot
