"""The robot's image, the graph across containers."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

sys.path.insert(0, str(Path(__file__).parent))  # which import mode importlib does not

from containers import Containers
from docker_engine import ROOT, Engine
from seen_robot import SETTINGS, Robot

from husky_bringup.system import simulated_robot
from husky_experiments.session import Session
from husky_runtime import graph

BODY = "robot_with_unit"
DOMAIN = 101
"""Of no other test: the containers have a network of their own, but this process is in both."""
_IMAGE = "husky:test"
_PROJECT = "husky-test"


@pytest.fixture(scope="session")
def image(engine: Engine) -> str:
    """The name of the image of this tree."""
    engine.build(_IMAGE)
    return _IMAGE


@pytest.fixture(scope="session")
def containers(engine: Engine, image: str) -> Iterator[Containers]:
    """The composition; no container runs yet."""
    settings = {name: dict(values) for name, values in SETTINGS.items()}
    settings[graph.PLANT] |= {"body": BODY, "start_paused": True}
    containers = Containers(
        engine,
        _PROJECT,
        {
            "HUSKY_BASE": engine.base,
            "HUSKY_IMAGE": image,
            "ROS_DOMAIN_ID": str(DOMAIN),
            "HUSKY_TIME": "lockstep",
            "HUSKY_SETTINGS": " ".join(
                f"{node}.{name}={str(value).lower()}"
                for node, values in settings.items()
                for name, value in values.items()
            ),
        },
    )
    containers.remove()  # what a run that was killed has left
    try:
        yield containers
    finally:
        containers.remove()


@pytest.fixture(scope="session")
def graph_in_containers(
    containers: Containers, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Robot]:
    """The graph, and this process as one more node on its network: the host's end of the bridge."""
    ours = {
        "ROS_DOMAIN_ID": str(DOMAIN),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(ROOT / "scripts/fastdds.xml"),
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }
    before = {name: os.environ.get(name) for name in ours}
    os.environ.update(ours)
    try:
        # Fast DDS looks for network interfaces when it joins: the bridge must be there before.
        containers.start_all(
            simulated_robot("lockstep", {graph.PLANT: {"body": BODY, "start_paused": True}})
        )
        session = Session(
            tmp_path_factory.mktemp("docker"),
            {graph.PLANT: {"body": BODY}},
            record=False,
            nodes=containers,
        )
        robot = Robot(session)
        yield robot
        robot.close()
        session.close()
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@pytest.fixture
def robot(graph_in_containers: Robot) -> Robot:
    """A sitting robot in a fresh world."""
    graph_in_containers.start_again()
    return graph_in_containers


@pytest.fixture
def trotting(graph_in_containers: Robot) -> Robot:
    """A trotting robot, all well."""
    robot = graph_in_containers
    if not robot.stands:
        robot.start_again()
        robot.stand()
    robot.trot()
    return robot
