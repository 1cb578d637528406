"""A ROS domain that nobody else on this machine is in."""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Iterator

import pytest

from husky_runtime.domain_locks import free_domain

_DOMAINS = range(20, 100)


@contextlib.contextmanager
def own_domain(name: str) -> Iterator[int]:
    """Hold a domain, and have it in the environment."""
    with held_domain(name) as number, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(number))
        yield number


def held_domain(name: str) -> contextlib.AbstractContextManager[int]:
    """Hold a domain: the same each time, unless it is taken.

    Args:
        name: who wants it.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    return free_domain(zlib.crc32(f"{worker}{name}".encode()), _DOMAINS)
