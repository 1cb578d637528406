"""A graph of this robot on another machine is found by DDS discovery, where that reaches it."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.context import Context

from husky_bringup.neighbours import discovery, reaches_other_machines, refuse_neighbours
from husky_runtime import graph
from husky_runtime.domain_locks import OccupiedError

DOMAIN = 1 + os.getpid() % 19  # of no graph: tests/ros_domain.py
SUBNET = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}


@pytest.fixture
def planner() -> Iterator[None]:
    """A node that holds no lock here, as one on another machine."""
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = rclpy.create_node(graph.PLANNER, context=context)
    yield
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_a_node_elsewhere_is_found(planner) -> None:
    with pytest.raises(OccupiedError, match=rf"domain {DOMAIN}: planner \(on another machine\)"):
        refuse_neighbours([graph.PLANT, graph.PLANNER], DOMAIN, SUBNET)


def test_other_nodes_do_not_matter(planner) -> None:
    refuse_neighbours([graph.PLANT, graph.RECORDER], DOMAIN, SUBNET)


def test_nobody_listens_where_discovery_is_local(planner) -> None:
    local = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    refuse_neighbours([graph.PLANT, graph.PLANNER], DOMAIN, local)


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({}, True),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, False),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, False),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.2"}, True),
        ({"ROS_LOCALHOST_ONLY": "1"}, False),
        (SUBNET, True),
    ],
)
def test_how_far_discovery_reaches(environment: dict[str, str], expected: bool) -> None:
    assert reaches_other_machines(environment) is expected


@pytest.mark.filterwarnings("ignore:Failed to fini rosout publisher:RuntimeWarning")  # of rcl
def test_an_environment_in_which_ros_makes_no_node_is_told_in_one_line(monkeypatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_STATIC_PEERS", "no such peer")
    with pytest.raises(OSError, match=r"^[^\n]*no such peer[^\n]*$"), discovery(DOMAIN):
        pass
