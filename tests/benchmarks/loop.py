"""The full walking graph against a bare relay of as many processes, hops and bytes.

The relay passes a tick on from the plant to the bridge, the controller, the bridge and back to the
plant, as a message takes the four hops. The graph sends the same messages but has the bridge answer
the plant while the controller computes, so a relay in that order is measured too, as
`pipelined_relay`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import relay
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist

from husky_bringup.processes import Processes
from husky_bringup.settings import HelpFormatter
from husky_bringup.system import ParameterValue, simulated_robot
from husky_experiments.scripts import assist, ready_fans, stand_up, walk
from husky_experiments.session import Session
from husky_runtime import graph
from husky_runtime.domain_locks import Claims
from husky_runtime.nodes import qos

_RELAY = Path(__file__).with_name("relay.py")
_RELAY_TICKS = 4000
_ROLES = (graph.PLANT, graph.VN200_DRIVER, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER)
_REALTIME = ("imu_to_target_ms_p50", "imu_to_target_ms_p99", "overruns")
"""Of the plant's reports on `/diagnostics`."""
_START = 60.0
"""Wall time that a graph has for its start in real time [s]."""
_COMMAND_PERIOD = 0.08
"""Wall time between two velocity commands [s]; the graph gives up after 0.5 s of its own time."""


def bench(arguments: list[str]) -> dict[str, Any]:
    """Walking graph in lockstep: real-time factor, tick over bare relay, CPU, latency."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh loop", formatter_class=HelpFormatter)
    parser.add_argument("--seconds", type=float, default=8.0, help="wall time measured a round [s]")
    parser.add_argument("--rounds", type=int, default=5, help="relay and graph in turn")
    parser.add_argument(
        "--pu", action="store_true", help="with the propulsion unit, which carries 40 %%, and T265"
    )
    options = parser.parse_args(arguments)
    relays, pipelined, graphs = [], [], []
    for number in range(options.rounds):
        print(f"round {number + 1}: relay", flush=True)
        relays.append(relay_tick_us(pipelined=False))
        pipelined.append(relay_tick_us(pipelined=True))
        print(f"round {number + 1}: walking graph", flush=True)
        graphs.append(lockstep(options.seconds, with_unit=options.pu))
    print("realtime", flush=True)
    metrics: dict[str, Any] = {key: float(np.median([g[key] for g in graphs])) for key in graphs[0]}
    # Over the relay just before: the machine's own speed changes from minute to minute.
    ticks = np.array([g["tick_us_p50"] for g in graphs])
    for name, times in (("relay", relays), ("pipelined_relay", pipelined)):
        metrics[f"{name}_us_p50"] = float(np.median(times))
        metrics[f"tick_over_{name}"] = float(np.median(ticks / np.array(times)))
    return metrics if options.pu else {**metrics, **realtime(options.seconds)}


def relay_tick_us(*, pipelined: bool) -> float:
    """Return the median tick of the bare relay [us].

    Args:
        pipelined: who waits for whom as in the graph, where the frame of tick k carries the command
            of k - 1; otherwise four hops one after the other.
    """
    environment = {**os.environ, "HUSKY_RELAY_PIPELINED": str(int(pipelined))}
    line = Path(relay.LINE)
    claims = Claims(environment)
    with contextlib.ExitStack() as stack:
        # The relay's topics are the robot's own.
        claims.claim(_ROLES)
        stack.callback(claims.give_up)
        line.unlink(missing_ok=True)
        stack.callback(line.unlink, missing_ok=True)
        for role in _ROLES[1:]:
            process = subprocess.Popen([sys.executable, _RELAY, role], env=environment)
            stack.callback(process.wait)
            stack.callback(process.terminate)
        result = subprocess.run(
            [sys.executable, _RELAY, _ROLES[0], str(_RELAY_TICKS)],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
    return float(np.median(json.loads(result.stdout.splitlines()[-1])["tick_us"]))


def lockstep(seconds: float, *, with_unit: bool = False) -> dict[str, float]:
    """Trot in lockstep as fast as it goes; return what was measured."""
    with (
        tempfile.TemporaryDirectory() as directory,
        free_run(Path(directory), with_unit=with_unit) as session,
    ):
        return measure(session, Probe(session), seconds)


def measure(
    session: Session, probe: Probe, seconds: float, until: Callable[[], bool] = lambda: False
) -> dict[str, float]:
    """Let a free run walk for a while of wall time [s], or `until`; return what was measured."""
    start, start_simulated = time.monotonic(), probe.simulated()
    start_cpu = cpu_seconds(session.processes, session.specs)
    probe.walk_for(seconds, until)
    wall = time.monotonic() - start
    simulated = probe.simulated() - start_simulated
    cpu = cpu_seconds(session.processes, session.specs)
    periods = probe.values(graph.PLANT, "period_ms_p50")
    return {
        "rtf": simulated / wall,
        "tick_us_p50": 1e3 * float(np.median(periods)),
        "tick_us_p99": 1e3 * float(np.median(probe.values(graph.PLANT, "period_ms_p99"))),
        **{f"cpu_s_per_sim_s_{n}": (cpu[n] - start_cpu[n]) / simulated for n in cpu},
    }


@contextlib.contextmanager
def free_run(
    directory: Path,
    *,
    with_unit: bool = False,
    plant: Mapping[str, ParameterValue] | None = None,
) -> Iterator[Session]:
    """A trotting robot whose world is not paused, and which wants a command every 0.5 s.

    Args:
        directory: for logs.
        with_unit: True for the robot with its propulsion unit.
        plant: further parameters of the plant.
    """
    body = "robot_with_unit" if with_unit else "robot"
    settings = {graph.PLANT: {"body": body, **(plant or {})}}
    with Session(directory, settings, record=False) as session:
        stand_up(session)
        if with_unit:
            ready_fans(session)
            assist(session, 0.4)
        session.set_gait("trot")
        walk(session, 2.0, (0.4, 0.0, 0.0))
        session.pause(False)
        yield session


class Probe:
    """Keeps the robot walking and listens to `/diagnostics`."""

    def __init__(self, session: Session):
        self._session = session
        self._seen: dict[tuple[str, str], list[float]] = {}
        session._node.create_subscription(
            DiagnosticArray, graph.DIAGNOSTICS, self._on_diagnostics, qos.STATUS
        )

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            for pair in status.values:
                with contextlib.suppress(ValueError):
                    self._seen.setdefault((status.name, pair.key), []).append(float(pair.value))

    def forget(self) -> None:
        """Drop what has been reported so far."""
        self._take(qos.STATUS.depth)
        self._seen.clear()

    def values(self, node: str, key: str) -> list[float]:
        """What a node reported, without the first report, which may be of the time before."""
        return self._seen[(node, key)][1:]

    def simulated(self) -> float:
        """Newest simulated time [s]."""
        self._take(qos.STATUS.depth)
        stamp = self._session.truth.header.stamp
        return stamp.sec + 1e-9 * stamp.nanosec

    def walk_for(
        self, seconds: float, until: Callable[[], bool] = lambda: False, speed: float = 0.4
    ) -> None:
        """Command a velocity ahead [m/s] for a while of wall time [s], or `until`.

        Asleep otherwise: whoever takes every message here has a fifth of a processor, and it is the
        graph's time that is measured. Reports come once a second and stay in their queue.
        """
        twist = Twist()
        twist.linear.x = speed
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self._session.publish_twist(twist)
            self._take(1)
            time.sleep(_COMMAND_PERIOD)

    def _take(self, count: int) -> None:
        """Take up to so many of the messages that wait in each queue."""
        for _ in range(count * len(list(self._session._node.subscriptions))):
            self._session.serve(0.0)


def cpu_seconds(processes: Processes, specs: Any) -> dict[str, float]:
    """Return the CPU time that each node has used [s]."""
    tick = os.sysconf("SC_CLK_TCK")
    used = {}
    for spec in specs:
        group = processes.process_group(spec.name)
        total = 0
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                with contextlib.suppress(OSError, IndexError):
                    fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
                    if int(fields[2]) == group:
                        total += int(fields[11]) + int(fields[12])
        used[spec.name] = total / tick
    return used


def realtime(seconds: float) -> dict[str, float]:
    """Latency from an IMU sample's first byte to the drive target that stands on it, realtime."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    seen: dict[str, float] = {}

    def on_diagnostics(array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name == graph.PLANT:
                for pair in status.values:
                    # Latencies are nan until the first target has come.
                    if pair.key in _REALTIME and math.isfinite(value := float(pair.value)):
                        seen[pair.key] = value

    context = rclpy.Context()
    rclpy.init(context=context)
    with tempfile.TemporaryDirectory() as directory, Processes(logs=Path(directory)) as processes:
        processes.start_all(simulated_robot("realtime"))
        node = rclpy.create_node("bench", context=context)
        node.create_subscription(DiagnosticArray, graph.DIAGNOSTICS, on_diagnostics, qos.STATUS)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        give_up = time.monotonic() + _START
        while len(seen) < len(_REALTIME):
            executor.spin_once(timeout_sec=0.1)
            if time.monotonic() > give_up:
                raise TimeoutError(f"{graph.PLANT} did not report {_REALTIME} within {_START} s")
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
        node.destroy_node()
    rclpy.shutdown(context=context)
    return {f"realtime_{key}": seen[key] for key in _REALTIME}
