"""Nodes in our ROS domain, as DDS discovery tells: ours, and the same robot's on another machine.

On this machine the locks of `husky_runtime.domain_locks` tell of another robot at once and for
certain, so nobody listens where discovery does not reach further.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from husky_runtime.domain_locks import SHARED, occupied
from husky_runtime.rcl_error import said_by_rcl

_LISTENING = 1.0
"""Wall time for which nodes elsewhere are listened for [s]: they answer a newcomer's announcements,
of which `scripts/fastdds.xml` sends ten within half a second."""
_GATHERING = 0.2
"""How long the rest is waited for once one has been heard [s]."""


def reaches_other_machines(environment: Mapping[str, str]) -> bool:
    """Return whether DDS discovery looks beyond this machine (ROS 2 Jazzy, Improved Discovery)."""
    if environment.get("ROS_LOCALHOST_ONLY") == "1":
        return False
    if environment.get("ROS_STATIC_PEERS"):
        return True
    return environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") not in ("LOCALHOST", "OFF")


def refuse_neighbours(
    names: Sequence[str], domain: int, environment: Mapping[str, str], namespace: str = "/"
) -> None:
    """See to it that no node of these names, in this namespace, is there on another machine.

    Raises:
        OccupiedError: some are; names them.
    """
    if not reaches_other_machines(environment):
        return
    heard = set(names) & _listen(set(names) - set(SHARED), domain, namespace)
    if heard:
        raise occupied(domain, dict.fromkeys(heard, "on another machine"), namespace)


@contextmanager
def discovery(domain: int, namespace: str = "/") -> Iterator[Callable[[], set[str]]]:
    """Join a domain; give a function that returns the names of the nodes in a namespace.

    Raises:
        OSError: ROS does not let a node in, e.g. because a peer's address is none; says why.
    """
    import rclpy
    from rclpy._rclpy_pybind11 import RCLError
    from rclpy.context import Context
    from rclpy.node import Node

    context = Context()
    try:
        try:
            rclpy.init(context=context, domain_id=domain)
            node = Node(f"newcomer_{os.getpid()}", context=context, start_parameter_services=False)
        except RCLError as error:
            raise OSError(said_by_rcl(error)) from error

        def names() -> set[str]:
            return {
                name for name, where in node.get_node_names_and_namespaces() if where == namespace
            }

        yield names
        node.destroy_node()
    finally:
        context.try_shutdown()


def _listen(awaited: set[str], domain: int, namespace: str) -> set[str]:
    """Return which of the nodes awaited are heard, as soon as one of them is."""
    with discovery(domain, namespace) as names:
        end = time.monotonic() + _LISTENING
        while time.monotonic() < end:
            if awaited & names():
                time.sleep(_GATHERING)
                break
            time.sleep(0.02)
        return awaited & names()
