"""One node's process on a bench: started, listened to, asked and ended as it is on the robot."""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from husky_bringup.fork_server import Forked, ForkServer
from husky_runtime import domain_locks as occupancy
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.ports.pty_port import PtyPort
from husky_runtime.ports.socket_port import SocketPort

_PATIENCE = 150.0
"""Wall time after which nothing more is expected, even of a slow machine [s]."""
_LOG_END = 5000
"""Characters of the process's output that a failure shows."""


class NodeBench:
    """A node's process, and a node of the test's own in the same domain.

    Attributes:
        node: publishes and subscribes for the test.
        reports: what has come on `/diagnostics` since `wait_for_report` was called.
        process: the node's.
    """

    def __init__(self, domain: int, directory: Path, module: str):
        """Join the domain; the process is started by `start`.

        Args:
            domain: to be in.
            directory: for the process's output.
            module: of the node, whose last part is the node's name.
        """
        self.domain = domain
        self.name = module.rpartition(".")[2]
        self._log = directory / f"{self.name}.log"
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("bench", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.reports: list[DiagnosticStatus] = []
        self.node.create_subscription(
            DiagnosticArray,
            graph.DIAGNOSTICS,
            lambda message: self.reports.append(message.status[0]),
            qos.STATUS,
        )
        self.process: Forked | None = None

    # The process --------------------------------------------------------------------------------
    def start(self, **parameters: Any) -> None:
        """Start the process."""
        with self._log.open("ab") as log:
            self.process = fork_server().fork(
                self.name,
                _arguments(parameters),
                os.environ | {"ROS_DOMAIN_ID": str(self.domain)},
                log,
            )

    def said(self) -> str:
        """Return the end of what the process has put out, for failures."""
        text = self._log.read_text(errors="replace") if self._log.exists() else ""
        return f"{self.name} says:\n{text[-_LOG_END:]}"

    def end(self, number: int = signal.SIGTERM) -> None:
        """End the process by a signal; it ends well, or has already."""
        process = self.process
        if process is None:
            return
        if process.poll() is None:
            process.send_signal(number)
        try:
            code = process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            pytest.fail(f"signal {number} does not end it; {self.said()}")
        assert code == 0, f"exit code {code}; {self.said()}"

    def close(self) -> None:
        """End the process, which must end well, and give everything back."""
        try:
            self.end()
        finally:
            self._give_back()

    def _give_back(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    # What is seen and asked ---------------------------------------------------------------------
    def wait(
        self,
        condition: Callable[[], Any],
        what: str,
        each: Callable[[], object] = lambda: None,
        timeout: float = 0.02,
    ) -> None:
        """Spin until something is true, as long as it takes on a slow machine.

        Args:
            condition: is to be true.
            what: is awaited, for the failure.
            each: called before each look.
            timeout: between two looks when no message comes [s].
        """
        end = time.monotonic() + _PATIENCE
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f"waited in vain: {what}; last {self.reports[-1:]}; {self.said()}")
            if self.process is not None and self.process.poll() is not None:
                code = self.process.returncode
                pytest.fail(f"ended with {code} before {what}; {self.said()}")
            each()
            self.executor.spin_once(timeout_sec=timeout)

    def wait_for_report(
        self,
        condition: Callable[[DiagnosticStatus], Any],
        what: str,
        each: Callable[[], object] = lambda: None,
    ) -> dict[str, str]:
        """Wait for a fresh report on `/diagnostics`; return its values."""
        self.reports.clear()
        self.wait(lambda: self.reports and condition(self.reports[-1]), what, each)
        return values_of(self.reports[-1])

    def call(self, service_type: Any, name: str, **request: Any) -> Any:
        """Call a service and return its answer."""
        client = self.node.create_client(service_type, name)
        self.wait(client.service_is_ready, f"service {name}")
        future = client.call_async(service_type.Request(**request))
        self.wait(future.done, f"answer of {name}")
        self.node.destroy_client(client)
        return future.result()

    def change_state(self, transition: int) -> bool:
        """Ask a lifecycle node for a transition; return whether it was made."""
        request = Transition(id=transition)
        name = f"/{self.name}/change_state"
        return bool(self.call(ChangeState, name, transition=request).success)

    def lifecycle_state(self) -> int:
        """Return the state of a lifecycle node."""
        return int(self.call(GetState, f"/{self.name}/get_state").current_state.id)


class DeviceThread(threading.Thread):
    """Something that goes on at about its own pace while a test waits.

    Attributes:
        lock: held during each tick.
    """

    def __init__(self, period: float, tick: Callable[[int], None]):
        """Prepare.

        Args:
            period: from the end of a tick to the next [s].
            tick: called with 0, 1, 2...
        """
        super().__init__(daemon=True)
        self.lock = threading.Lock()
        self._period = period
        self._tick = tick
        self._ended = threading.Event()

    def run(self) -> None:
        """Tick until it is ended."""
        for number in itertools.count():
            with self.lock:
                self._tick(number)
            if self._ended.wait(self._period):
                return

    def end(self) -> None:
        """End it and wait for that."""
        self._ended.set()
        self.join()


class DeviceBench(NodeBench):
    """A bench with a device at the far end of the node's serial line, or its socket.

    Attributes:
        port: the device's end of the line.
        port_kind: of the port.
        thread: serves the device.
    """

    port_kind: type[PtyPort] | type[SocketPort] = PtyPort

    def __init__(
        self,
        domain: int,
        directory: Path,
        module: str,
        period: float,
        tick: Callable[[int], None],
    ):
        """Make the line and serve the device.

        Args:
            domain: to be in.
            directory: for the line and the process's output.
            module: of the node.
            period: between two ticks of the device [s].
            tick: what the device does at each, carrying the bytes of `port`.
        """
        super().__init__(domain, directory, module)
        self.port = self.port_kind(directory / "line")
        self.thread = DeviceThread(period, tick)
        self.thread.start()

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Hold the device still, to look at it or to change it."""
        with self.thread.lock:
            yield

    def _give_back(self) -> None:
        self.thread.end()
        self.port.close()
        super()._give_back()


def shared_bench(kind: Callable[..., NodeBench], **parameters: Any) -> Any:
    """Return a fixture: one bench for tests of a module that come last, when no other node runs.

    Args:
        kind: of the bench, made of a domain, a directory and these parameters.
        parameters: of the node.
    """

    @pytest.fixture(scope="module")
    def bench(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[NodeBench]:
        bench = kind(domain, tmp_path_factory.mktemp("bench"), **parameters)
        yield bench
        bench.close()

    return bench


def every(period: float, act: Callable[[], object]) -> Callable[[], None]:
    """Return what acts when it is called, but only once in a period of wall time [s]."""
    last = -math.inf

    def act_if_due() -> None:
        nonlocal last
        if time.monotonic() - last >= period:
            last = time.monotonic()
            act()

    return act_if_due


class SensorBench(DeviceBench):
    """A bench with a sensor and its driver.

    Attributes:
        samples: what has been published since `wait_for_samples` was called.
    """

    def __init__(
        self,
        domain: int,
        directory: Path,
        module: str,
        period: float,
        tick: Callable[[int], None],
        kind: type,
        topic: str,
    ):
        """As a `DeviceBench`; listens to a topic of this kind."""
        super().__init__(domain, directory, module, period, tick)
        self.samples: list[Any] = []
        self.node.create_subscription(kind, topic, self.samples.append, qos.CONTROL)

    def wait_for_samples(self, count: int = 100) -> None:
        """Wait for so many fresh samples."""
        self.samples.clear()
        self.wait(lambda: len(self.samples) >= count, f"{count} samples")

    def wait_for_good_report(self) -> dict[str, str]:
        """Wait for a report that all is well; return its values."""
        return self.wait_for_report(lambda s: s.level == DiagnosticStatus.OK, "a good report")

    def check_the_plug(self) -> None:
        """A pulled plug is reported, and the samples come back with it."""
        self.wait_for_samples()
        with self.held():
            self.port.unplug()
        self.wait_for_report(lambda s: s.level == DiagnosticStatus.ERROR, "the lost port")
        with self.held():
            self.port.replug()
        self.wait_for_samples()

    def check_deactivation(self) -> None:
        """A deactivated driver gives the port back, an activated one opens it again."""
        self.wait_for_samples()
        assert self.lifecycle_state() == State.PRIMARY_STATE_ACTIVE
        assert self.change_state(Transition.TRANSITION_DEACTIVATE)
        self.wait(lambda: not self.port.connected, "the port to be closed")
        assert self.lifecycle_state() == State.PRIMARY_STATE_INACTIVE
        assert self.change_state(Transition.TRANSITION_ACTIVATE)
        self.wait_for_samples()


def assert_refused(module: str, words: str, **parameters: Any) -> None:
    """Check that a node's process ends with a sentence on its bad parameters."""
    with tempfile.TemporaryDirectory() as locks, tempfile.TemporaryFile() as log:
        process = fork_server().fork(
            module.rpartition(".")[2],
            _arguments(parameters),
            os.environ | {occupancy.VARIABLE: locks},  # whoever else runs such a node
            log,
        )
        code = process.wait(_PATIENCE)
        log.seek(0)
        said = log.read().decode()
    assert (code, words in said) == (1, True), said


def _arguments(parameters: dict[str, Any]) -> list[str]:
    settings = [word for item in parameters.items() for word in ("-p", "{}:={}".format(*item))]
    return ["--ros-args", *settings]


@functools.cache
def fork_server() -> ForkServer:
    """Return the server of this worker's nodes: most of a node's start is imports."""
    return ForkServer()


def end_fork_server() -> None:
    """End the server of this worker's nodes, if there is one."""
    if fork_server.cache_info().currsize:
        fork_server().close()
        fork_server.cache_clear()


def values_of(report: DiagnosticStatus) -> dict[str, str]:
    """Return the values of a report by their keys."""
    return {pair.key: pair.value for pair in report.values}
