"""A ROS domain that nobody else on this machine is in."""

from __future__ import annotations

import contextlib
import fcntl
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from husky_runtime import graph
from husky_runtime.domain_locks import occupants

_DOMAINS = range(20, 100)


@contextlib.contextmanager
def own_domain(name: str) -> Iterator[int]:
    """Hold a domain, and have it in the environment."""
    with held_domain(name) as number, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(number))
        yield number


@contextlib.contextmanager
def held_domain(name: str) -> Iterator[int]:
    """Hold a domain: the same each time, unless it is taken.

    Args:
        name: who wants it.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    first = zlib.crc32(f"{worker}{name}".encode()) % len(_DOMAINS)
    for offset in range(len(_DOMAINS)):
        number = _DOMAINS[(first + offset) % len(_DOMAINS)]
        directory = Path(graph.serial_port("tests", number)).parent
        directory.mkdir(parents=True, exist_ok=True)
        with (directory / "tests.lock").open("a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            if occupants(graph.NODES, number, {}):
                continue
            yield number
        return
    pytest.fail(f"ROS domains {_DOMAINS} are all in use")
