"""A running robot to break: one graph a test module, a fresh world for each test."""

from __future__ import annotations

import contextlib
import fcntl
import os
import sys
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

sys.path.insert(0, str(Path(__file__).parent))  # which import mode importlib does not

from seen_robot import SETTINGS, Robot

from husky_bringup.session import Session
from husky_description import graph

_DOMAINS = range(20, 100)


NewGraph = Callable[..., contextlib.AbstractContextManager["Robot"]]


@pytest.fixture(scope="module", autouse=True)
def domain(request: pytest.FixtureRequest) -> Iterator[int]:
    """A ROS domain of the module's own: the same each time, unless somebody else is in it."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    first = zlib.crc32(f"{worker}{request.node.nodeid}".encode()) % len(_DOMAINS)
    before = os.environ.get("ROS_DOMAIN_ID")
    for offset in range(len(_DOMAINS)):
        number = _DOMAINS[(first + offset) % len(_DOMAINS)]
        directory = Path(graph.serial_port("tests", number)).parent
        directory.mkdir(parents=True, exist_ok=True)
        locks = [(directory / name).open("a") for name in ("tests.lock", "vn200.lock")]
        try:
            for lock in locks:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            for lock in locks:
                lock.close()
            continue
        locks[1].close()  # the plant's
        os.environ["ROS_DOMAIN_ID"] = str(number)
        yield number
        locks[0].close()
        os.environ.pop("ROS_DOMAIN_ID")
        if before is not None:
            os.environ["ROS_DOMAIN_ID"] = before
        return
    pytest.fail(f"ROS domains {_DOMAINS} are all in use")


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
            # Faulthandler tells where: the node has closed, and then Fast DDS failed to leave.
            leaving = code < 0 and ("in destroy_node" in text or "in try_shutdown" in text)
            if leaving:
                warnings.warn(f"{name}: exit code {code} in the middleware's end", stacklevel=1)
            assert code == 0 or leaving, f"{codes}, {name} says:\n{text[-5000:]}"
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
