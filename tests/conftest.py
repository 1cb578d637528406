"""Shared by tests of processes, whose helpers it makes importable under import mode importlib."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(_HERE), str(_HERE.parent / "ros2_ws/src/husky_pu/test")]


@pytest.fixture(scope="module")
def domain(request: pytest.FixtureRequest) -> Iterator[int]:
    """A ROS domain of the module's own, in the environment too."""
    from ros_domain import own_domain

    with own_domain(request.node.nodeid) as number:
        yield number


@pytest.fixture
def node(domain: int) -> Iterator[Any]:
    """A node of rclpy in a context and a domain of its own."""
    rclpy = pytest.importorskip("rclpy")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("tested", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)
