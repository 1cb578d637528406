"""The clock of a node: simulated where there is a simulation, and one for all that it stamps."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

import rclpy
from rcl_interfaces.msg import Log
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.diagnostics import OK, Diagnostics
from husky_runtime.nodes.executor import WaitSetExecutor
from husky_runtime.nodes.one_clock import ROSOUT, OneClock


class Plain(OneClock, Node):
    """A node."""


class WithLifeCycle(OneClock, LifecycleNode):
    """One with a life cycle."""


@contextlib.contextmanager
def started(kind: type, domain: int, *parameters: str) -> Iterator[Any]:
    """A node with parameters of the command line."""
    arguments = [word for each in parameters for word in ("-p", each)]
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", *arguments], context=context, domain_id=domain)
    before = rclpy.get_default_context
    rclpy.node.get_default_context = lambda: context
    try:
        made = kind("tested")
        yield made
        made.destroy_node()
    finally:
        rclpy.node.get_default_context = before
        rclpy.shutdown(context=context)


@pytest.mark.parametrize(
    ("parameters", "simulated"),
    [
        ([], True),
        (["time:=lockstep"], True),
        (["time:=realtime", "clock:=device"], True),
        (["time:=hardware"], False),
        (["clock:=host"], False),
        (["time:=hardware", "use_sim_time:=true"], True),
        (["time:=realtime", "use_sim_time:=false"], False),
    ],
)
@pytest.mark.parametrize("kind", [Plain, WithLifeCycle])
def test_time_is_simulated_unless_the_node_runs_on_the_robot(
    domain: int, kind: type, parameters: list[str], simulated: bool
) -> None:
    with started(kind, domain, *parameters) as tested:
        assert tested.get_parameter("use_sim_time").value is simulated
        now = tested.get_clock().now().nanoseconds
        assert (now == 0) is simulated, "before a simulation has told the time it is 0"
        assert simulated or abs(now - time.time_ns()) < 60_000_000_000


class Bench:
    """A served node beside a simulation that tells the time."""

    def __init__(self, tested: Any):
        self.tested = tested
        self.node = Node("simulation", context=tested.context)
        self.clock = self.node.create_publisher(Clock, graph.CLOCK, qos.CLOCK)
        self.served = WaitSetExecutor(tested)
        self.until(lambda: self.clock.get_subscription_count() > 0)

    def until(self, predicate: Callable[[], bool]) -> None:
        while not predicate():  # the test's timeout is the only limit
            with contextlib.suppress(ExternalShutdownException):
                self.served.spin_once()

    def now(self) -> float:
        return float(self.tested.get_clock().now().nanoseconds) / 1e9

    def tell(self, now: float) -> None:
        message = Clock()
        stamps.fill(message.clock, round(now * 1e9))
        self.clock.publish(message)
        self.until(lambda: self.now() == now)

    def close(self) -> None:
        self.served.close()
        self.node.destroy_node()


@pytest.fixture
def bench(domain: int) -> Iterator[Bench]:
    with started(Plain, domain) as tested:
        bench = Bench(tested)
        yield bench
        bench.close()


def test_what_is_logged_and_reported_is_stamped_alike(bench: Bench) -> None:
    heard: list[Log] = []
    ear = bench.node.create_subscription(Log, "/rosout", heard.append, ROSOUT)
    Diagnostics(bench.tested, "nothing", lambda: (OK, "well", {})).publish()
    bench.tell(12.5)
    bench.tested.get_logger().warning("something is wrong")

    def told() -> bool:
        with ear.handle:
            if (taken := ear.handle.take_message(Log, False)) is not None:
                heard.append(taken[0])
        return bool(heard)

    bench.until(told)
    (line,) = heard
    assert stamps.to_ns(line.stamp) == 12_500_000_000
    assert (line.name, line.level, line.msg) == ("tested", 30, "something is wrong")
    assert line.file == __file__ and line.function.startswith("test_what_is_logged")
    assert bench.node.count_publishers("/rosout") == 2, "rcl does not tell the same beside it"


def test_time_may_start_again_and_none_before_it_is_refused(bench: Bench) -> None:
    bench.tell(12.5)
    bad = Clock()
    bad.clock.sec = -1
    bench.clock.publish(bad)
    bench.until(lambda: bench.served.guard.refused["/clock"] == 1)
    assert bench.now() == 12.5
    bench.tell(0.25)


def test_timers_go_on_while_the_world_stands_still(bench: Bench) -> None:
    called: list[float] = []
    bench.tested.create_timer(0.01, lambda: called.append(bench.now()))
    bench.tell(1.0)
    called.clear()
    bench.until(lambda: len(called) >= 3)
    assert set(called) == {1.0}


def test_nobody_wakes_up_for_the_time(bench: Bench) -> None:
    """What is waited for ends the wait; a message of /clock does not."""
    waits: list[float] = []
    wait = bench.served._look_at_rest().wait

    def timed(timeout_ns: int) -> None:
        begun = time.monotonic()
        wait(timeout_ns)
        waits.append(time.monotonic() - begun)

    bench.served._look_at_rest().wait = timed  # type: ignore[method-assign]
    for tick in range(20):
        message = Clock()
        stamps.fill(message.clock, tick * 10_000_000)
        bench.clock.publish(message)
        bench.served.spin_once()
    assert sorted(waits)[10] > 0.03, "the wait on everything is 50 ms long"


def test_the_first_line_of_a_log_looks_up_no_module(domain: int) -> None:
    """rclpy finds who logs among all modules, which takes many ticks the first time."""
    node = Path(__file__).with_name("fixtures") / "logging_node.py"
    done = subprocess.run([sys.executable, str(node)], capture_output=True, text=True, timeout=120)
    looked_up, modules = map(int, done.stdout.split(" of "))
    assert looked_up < modules / 10, f"{looked_up} of {modules}; {done.stderr}"
