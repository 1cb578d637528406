"""Whose node it is: its name, held before it is made so that nobody joins a graph by mistake, the
wires of its robot, and the robot's other nodes.
"""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.utilities import get_default_context

from husky_runtime import domain_locks as occupancy
from husky_runtime import graph
from husky_runtime.lockstep import START_GRACE, Peer
from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.processor_time import processor_time

_NAMESPACE = re.compile(r"((?P<node>\w+):)?__ns:=(?P<namespace>.+)")


def hold_name(make_node: Callable[[], Any], arguments: Sequence[str]) -> None:
    """Hold the name of the module that makes a node, which is the node's, in the domain in use and
    in the namespace that the arguments give to it.

    A node that is given another name by `__node` has the same topics, and so the same lock.

    Raises:
        OccupiedError: such a node runs already.
        OSError: there can be no lock.
    """
    name = Path(inspect.getfile(make_node)).stem
    domain = get_default_context().get_domain_id()
    occupancy.hold(name, domain, namespace_of(arguments, name))


def namespace_of(arguments: Sequence[str], name: str) -> str:
    """Return the namespace that a command line gives to a node.

    Args:
        arguments: `-r __ns:=NAMESPACE`, `-r NODE:__ns:=NAMESPACE`; of several the first counts.
            rcl has checked them, and takes them without `--ros-args -r` too.
        name: of the node.
    """
    for word in arguments:
        rule = _NAMESPACE.fullmatch(word)
        if rule is not None and rule["node"] in (None, name):
            return rule["namespace"]
    return "/"


def default_serial_port(node: Node, device: str) -> str:
    """Return where a simulated serial device of a node's robot appears, e.g. "vn200"."""
    return graph.serial_port(device, node.context.get_domain_id(), node.get_namespace())


def runs(node: Node, name: str) -> bool:
    """Return whether another node of a node's robot is seen to run on this machine."""
    try:
        return _holder(node, name) is not None
    except OSError:  # a lock that is not for us to read
        return False


def _holder(node: Node, name: str) -> int | None:
    """Return the process of another node of a node's robot, as `domain_locks.holder` does."""
    domain, namespace = node.context.get_domain_id(), node.get_namespace()
    return occupancy.holder(name, domain, os.environ, namespace)


def make_peer(node: Node, name: str, grace: float, start_grace: float | None = START_GRACE) -> Peer:
    """Return another node of a node's robot, as lockstep waits for it: `Peer` has the arguments.

    How busy its process is, and that it has ended, is seen on this machine, through the lock on its
    name: where nobody has held that yet, or where locks are not shared, nothing is known.
    """
    seen = False

    def busy() -> float | None:
        nonlocal seen
        try:
            process = _holder(node, name)
        except OSError:  # a lock that is not for us to read
            return 0.0
        if process is None:
            return None if seen else 0.0
        seen = True
        return sum(processor_time(process))

    return Peer(name, grace, start_grace, busy, longest_look(node))
