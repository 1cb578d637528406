"""A running robot to break: one graph a test module, a fresh world for each test."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from seen_robot import SETTINGS, Robot

from husky_bringup.session import Session

NewGraph = Callable[..., contextlib.AbstractContextManager["Robot"]]


@pytest.fixture(scope="module", autouse=True)
def in_own_domain(domain: int) -> None:
    """Whatever a module of these tests starts is in its own domain."""


@pytest.fixture(scope="module")
def new_graph(domain: int, tmp_path_factory: pytest.TempPathFactory) -> NewGraph:
    """Starts a graph, by other settings if need be; at its end each node ends as it should."""

    @contextlib.contextmanager
    def start(clock: str = "lockstep", remote: bool = False, **settings: Any) -> Iterator[Robot]:
        directory = tmp_path_factory.mktemp("graph")
        session = Session(
            directory, settings or SETTINGS, record=False, clock=clock, remote=remote
        )
        try:
            robot = Robot(session)
            yield robot
            robot.close()
        finally:
            codes = session.close()
        for name, code in codes.items():
            text = (directory / f"logs/{name}.log").read_text(errors="replace")
            # What a node that crashed or hung at its end did last, faulthandler has written there.
            assert code == 0, f"{codes}, {name} says:\n{text[-5000:]}"
        for log in directory.glob("logs/*.log"):
            text = log.read_text(errors="replace")
            assert "Traceback" not in text, f"{log}:\n{text[-3000:]}"

    return start


@pytest.fixture(scope="module")
def graph_of_module(new_graph: NewGraph) -> Iterator[Robot]:
    """The graph that the tests of a module share, in lockstep."""
    with new_graph() as robot:
        yield robot


@pytest.fixture
def robot(graph_of_module: Robot) -> Robot:
    """A sitting robot in a fresh world."""
    graph_of_module.start_again()
    return graph_of_module


@pytest.fixture
def trotting(graph_of_module: Robot) -> Robot:
    """A trotting robot, all well."""
    robot = graph_of_module
    if not robot.stands:
        robot.start_again()
        robot.stand()
    robot.trot()
    return robot
