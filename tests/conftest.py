"""Shared by tests of processes, whose helpers it makes importable under import mode importlib."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

_HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(_HERE), str(_HERE.parent / "ros2_ws/src/husky_pu/test")]


@pytest.fixture(scope="module")
def domain(request: pytest.FixtureRequest) -> Iterator[int]:
    """A ROS domain of the module's own, in the environment too."""
    from ros_domain import own_domain

    with own_domain(request.node.nodeid) as number:
        yield number
