"""Starts the graph's processes and ends them all, leaving none behind."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Protocol

from husky_bringup import fork_server, shared_memory
from husky_bringup.neighbours import refuse_neighbours
from husky_bringup.system import NodeSpec
from husky_runtime import starter
from husky_runtime.domain_locks import Claims

END_PERIOD = 3.0
"""Wall time that nodes get between SIGTERM and SIGKILL [s]."""

_HURRIED_PERIOD = 2.5
"""The same for all of them together when a signal has asked this process to end [s]."""

_TURN = 0.3
"""Wall time that the next node waits for the one before it to end [s]."""


Process = subprocess.Popen[bytes] | fork_server.Forked
"""Of a node."""


class Nodes(Protocol):
    """The nodes of a graph as whoever works with it needs them: processes, containers."""

    def start(self, spec: NodeSpec) -> object:
        """Start a node; one of the same name that has ended may be started again."""

    def start_all(self, specs: Sequence[NodeSpec]) -> None:
        """Start every node."""

    def ended(self) -> dict[str, int]:
        """Return the exit codes of nodes that have ended by themselves, and forget them."""

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to a node."""

    def reap(self, name: str) -> int:
        """Wait for the end of a node that has been killed; forget it and return its exit code."""

    def running(self, name: str) -> bool:
        """Return whether a node has been started and has not ended."""

    def end(self) -> dict[str, int]:
        """End all; return exit codes."""


class Strangers:
    """Nodes that somebody else has started and will end; they can only be spoken to."""

    def start(self, spec: NodeSpec) -> object:
        """It runs already."""
        return None

    def start_all(self, specs: Sequence[NodeSpec]) -> None:
        """They run already."""

    def ended(self) -> dict[str, int]:
        """Nobody tells us."""
        return {}

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        """Refuse.

        Raises:
            PermissionError: always.
        """
        raise PermissionError(f"{name} is not ours to kill")

    def reap(self, name: str) -> int:
        """Refuse, as `kill`."""
        raise PermissionError(f"{name} is not ours to kill")

    def running(self, name: str) -> bool:
        """They run, as far as we know."""
        return True

    def end(self) -> dict[str, int]:
        """They run on."""
        return {}


class Processes:
    """The running nodes, each in a process group of its own.

    Use it as a context: at its end every process is gone. Where this process does not get that far,
    nodes end themselves when it is gone (`husky_runtime.starter`). From its start to its end a
    node's name in the ROS domain is ours (`husky_runtime.domain_locks`).
    """

    def __init__(
        self,
        logs: Path | None = None,
        environment: Mapping[str, str] | None = None,
        params_file: str | None = None,
        namespace: str = "/",
    ):
        """Prepare; nothing is started yet.

        Args:
            logs: directory for one log file a node, or None to let them print.
            environment: added to this process's.
            params_file: a ROS parameter file given to every node.
            namespace: of every node.

        Raises:
            ValueError: ROS_DOMAIN_ID is no domain.
        """
        self._logs = logs
        self._environment = {
            **os.environ,
            **(environment or {}),
            starter.VARIABLE: starter.identity(),
        }
        self._claims = Claims(self._environment, namespace)
        self._params_file = params_file
        self._running: dict[str, Process] = {}

    def __enter__(self) -> Processes:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End every process."""
        self.end()

    def start(self, spec: NodeSpec) -> Process:
        """Start a node; one of the same name that has ended may be started again.

        Raises:
            RuntimeError: it runs already, and we have started it.
            OccupiedError: it runs already, and somebody else has.
            ValueError: it is not installed.
        """
        if spec.name in self._running and self._running[spec.name].poll() is None:
            raise RuntimeError(f"{spec.name} is running already")
        self._claims.claim([spec.name])
        output = None
        if self._logs is not None:
            self._logs.mkdir(parents=True, exist_ok=True)
            output = (self._logs / f"{spec.name}.log").open("ab")
        try:
            process = self._start(spec, output)
        finally:
            if output is not None:
                output.close()
        self._running[spec.name] = process
        return process

    def _start(self, spec: NodeSpec, output: IO[bytes] | None) -> Process:
        command = spec.command(params_file=self._params_file, namespace=self._claims.namespace)
        if server := fork_server.address(self._environment):
            return fork_server.fork(server, spec.name, command[1:], self._environment, output)
        return subprocess.Popen(
            command,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT if output is not None else None,
            start_new_session=True,
        )

    def start_all(self, specs: Sequence[NodeSpec]) -> None:
        """Start every node, or none where a graph of this robot is already there.

        Raises:
            OccupiedError: it is; says which nodes.
            ValueError: a node is not installed.
        """
        names = [spec.name for spec in specs]
        self._claims.claim(names)
        try:
            claims = self._claims
            refuse_neighbours(names, claims.domain, self._environment, claims.namespace)
            for spec in specs:
                self.start(spec)
        except BaseException:
            self.end()
            raise

    def ended(self) -> dict[str, int]:
        """Return the exit codes of nodes that have ended by themselves, and forget them."""
        polled = {name: process.poll() for name, process in self._running.items()}
        codes = {name: code for name, code in polled.items() if code is not None}
        for name in codes:
            # What it has started itself goes with it.
            _signal_group(self._running.pop(name), signal.SIGKILL)
        if any(codes.values()):
            shared_memory.sweep()
        self._claims.give_up(codes)
        return codes

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to a node and whatever it started."""
        _signal_group(self._running[name], number)

    def reap(self, name: str) -> int:
        """Wait for the end of a node that has been killed; forget it and return its exit code."""
        process = self._running.pop(name)
        _signal_group(process, signal.SIGKILL)
        code = process.wait()
        shared_memory.sweep()
        self._claims.give_up([name])
        return code

    def running(self, name: str) -> bool:
        """Return whether a node has been started and has not ended."""
        return name in self._running and self._running[name].poll() is None

    def process_group(self, name: str) -> int:
        """Return the process group of a node."""
        return self._running[name].pid

    def end(self, name: str | None = None) -> dict[str, int]:
        """End one node or all: SIGTERM, a while to shut down, then SIGKILL; return exit codes.

        One after the other, if they are quick: Fast DDS may crash where a participant leaves while
        it hears of others that leave.
        """
        chosen = [name] if name is not None else list(self._running)
        hurried_deadline = time.monotonic() + _HURRIED_PERIOD
        for each in chosen:
            _signal_group(self._running[each], signal.SIGTERM)
            patience = time.monotonic() + _TURN
            while _group_alive(self._running[each]) and time.monotonic() < patience:
                time.sleep(0.01)
        deadline = time.monotonic() + END_PERIOD
        if starter.asked_to_end:
            deadline = hurried_deadline
        codes: dict[str, int] = {}
        for each in chosen:
            process = self._running.pop(each)
            while _group_alive(process) and time.monotonic() < deadline:
                process.poll()
                time.sleep(0.01)
            _signal_group(process, signal.SIGKILL)
            codes[each] = process.wait()
        shared_memory.sweep()
        self._claims.give_up(codes if name is not None else None)
        return codes


def _signal_group(process: Process, number: int) -> None:
    try:
        os.killpg(process.pid, number)
    except ProcessLookupError:
        process.poll()


def _group_alive(process: Process) -> bool:
    process.poll()
    try:
        os.killpg(process.pid, 0)
    except ProcessLookupError:
        return False
    return True
