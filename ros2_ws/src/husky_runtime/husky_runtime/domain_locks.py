"""Who is in a ROS domain on this machine, told by locks: certain, and without asking anybody.

Robots in namespaces of a domain are apart from each other.

A node of the robot locks `<node>.node` for as long as it lives (`hold`), whoever has started it.
Who starts nodes claims their names before the first of them (`Claims`), so that of two that start
at once one gets all and the other nothing. The kernel gives both up with the process.

On its `.node` file a node has a POSIX record lock: others see it without touching it, and with it
the number of the process.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from husky_runtime import graph, record_lock

VARIABLE = "HUSKY_LOCKS"
"""Environment variable that names another directory for the locks, of a robot apart."""
SHARED = (graph.RECORDER,)
"""Nodes that only listen: any number of them may run."""
_PATIENCE = 1.0
"""Wall time that a node of before gets to be gone [s]: a killed one takes a moment."""
_ORPHANS_PATIENCE = 3.0
"""The same for nodes whose starter is gone, and which end by themselves [s]."""
_LARGEST_DOMAIN = 232
"""Beyond it DDS has no ports left (RTPS 2.2, 9.6.1.1)."""


FREE_DOMAINS = range(1, 101)
"""Domains to choose from: above 101 the ports of DDS are those that Linux gives to any program."""


class OccupiedError(OSError):
    """A node of that name is in the domain already; says which and what can be done."""


def domain_of(environment: Mapping[str, str]) -> int:
    """Return the ROS domain of an environment; raises ValueError for no such number."""
    text = environment.get("ROS_DOMAIN_ID", "") or "0"
    if not (text.isascii() and text.isdecimal() and int(text) <= _LARGEST_DOMAIN):
        raise ValueError(f"ROS_DOMAIN_ID is {text!r}, it must be 0 to {_LARGEST_DOMAIN}")
    return int(text)


def occupied(domain: int, who: Mapping[str, str], namespace: str = "/") -> OccupiedError:
    """Return the error that names nodes, each with what is known of it, and the way out."""
    nodes = ", ".join(f"{name} ({what})" for name, what in sorted(who.items()))
    where = f", namespace {namespace}" if namespace != "/" else ""
    return OccupiedError(
        f"this robot runs already in ROS domain {domain}{where}: {nodes}; end it, or choose "
        f"another domain with ROS_DOMAIN_ID"
    )


@contextlib.contextmanager
def free_domain(first: int = 0, domains: range = FREE_DOMAINS) -> Iterator[int]:
    """Hold a ROS domain in which no robot on this machine is, and which nobody else holds.

    Args:
        first: index of the domain to try first, modulo their number.
        domains: to choose from.

    Raises:
        OccupiedError: all are in use.
        OSError: there can be no lock.
    """
    for offset in range(len(domains)):
        number = domains[(first + offset) % len(domains)]
        with _held_lock(_directory(number, {}, "/") / "domain.lock") as held:
            if held and not occupants(graph.NODES, number, {}):
                yield number
                return
    raise OccupiedError(f"ROS domains {domains[0]} to {domains[-1]} are all in use")


@contextlib.contextmanager
def _held_lock(path: Path) -> Iterator[bool]:
    """Hold a lock, unless somebody else does or has its directory; give whether it is held."""
    try:
        descriptor = record_lock.open_file(path)
    except PermissionError:
        yield False
        return
    try:
        yield record_lock.try_take(descriptor)
    finally:
        os.close(descriptor)


def hold(name: str, domain: int, namespace: str = "/") -> None:
    """Hold a node's name for as long as this process lives.

    Raises:
        OccupiedError: another process holds it.
        OSError: there can be no lock.
    """
    if name in SHARED:
        return
    descriptor = record_lock.open_file(_directory(domain, os.environ, namespace) / f"{name}.node")
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return  # and never closed: a closed descriptor gives the lock up
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EAGAIN):
                raise
        if time.monotonic() > deadline:
            owner = holder(name, domain, os.environ, namespace)
            os.close(descriptor)
            raise occupied(domain, {name: _process(owner or 0)}, namespace)
        time.sleep(0.02)


def holder(
    name: str, domain: int, environment: Mapping[str, str], namespace: str = "/"
) -> int | None:
    """Return the process that holds a node's name, 0 for one in another container, or None."""
    path = _directory(domain, environment, namespace) / f"{name}.node"
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    except PermissionError as error:
        raise record_lock.left_by_another(path) from error
    try:
        return record_lock.owner(descriptor)
    finally:
        os.close(descriptor)


class Claims:
    """The names of nodes that a process starts, in one domain and namespace.

    Attributes:
        domain: the ROS domain.
        namespace: of the robot.
    """

    def __init__(self, environment: Mapping[str, str], namespace: str = "/"):
        """Claim nothing yet.

        Args:
            environment: of the nodes.
            namespace: of the robot.

        Raises:
            ValueError: it chooses no domain.
        """
        self.domain = domain_of(environment)
        self.namespace = namespace
        self._environment = environment
        self._held: dict[str, int] = {}

    def claim(self, names: Iterable[str]) -> None:
        """Claim all of these names, or none.

        Raises:
            OccupiedError: nodes of that name run, or another process is about to start them.
            OSError: there can be no lock.
        """
        fresh = [name for name in names if name not in self._held and name not in SHARED]
        try:
            claimed = {name: owner for name in fresh if (owner := self._claim(name))}
            if claimed:
                raise occupied(self.domain, claimed, self.namespace)
            deadline = time.monotonic() + _ORPHANS_PATIENCE
            while running := occupants(fresh, self.domain, self._environment, self.namespace):
                if time.monotonic() > deadline:
                    raise occupied(self.domain, running, self.namespace)
                time.sleep(0.02)
        except BaseException:
            self.give_up(fresh)
            raise

    def give_up(self, names: Iterable[str] | None = None) -> None:
        """Give up these names, or all."""
        for name in list(self._held if names is None else names):
            if name in self._held:
                os.close(self._held.pop(name))

    def _claim(self, name: str) -> str:
        """Claim one name; return who else has it, or nothing."""
        directory = _directory(self.domain, self._environment, self.namespace)
        descriptor = record_lock.open_file(directory / f"{name}.starter")
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(descriptor, 32).decode(errors="replace")
            os.close(descriptor)
            running = holder(name, self.domain, self._environment, self.namespace)
            started = f"started by process {owner.strip() or 'unknown'}"
            return started if running is None else f"{_process(running)}, {started}"
        self._held[name] = descriptor
        os.truncate(descriptor, 0)
        os.write(descriptor, f"{os.getpid()}\n".encode())
        return ""


def occupants(
    names: Iterable[str], domain: int, environment: Mapping[str, str], namespace: str = "/"
) -> dict[str, str]:
    """Return which of these nodes run in a domain on this machine, and as which process."""
    holders = {name: holder(name, domain, environment, namespace) for name in names}
    return {name: _process(process) for name, process in holders.items() if process is not None}


def _process(number: int) -> str:
    return f"process {number}" if number else "in another container"


def _directory(domain: int, environment: Mapping[str, str], namespace: str) -> Path:
    """Where the locks of a robot are: beside its simulated wires."""
    chosen = environment.get(VARIABLE, "")
    if chosen:
        return Path(chosen + graph.dotted(namespace))
    return Path(graph.serial_port("x", domain, namespace)).parent
