"""The console beside the walking graph: what it costs the robot, and what a page gets.

A round is a bare relay, then one graph in three states in turn and back again: without a console,
with one at which nobody looks, with one that serves a page and an operator. There and back, because
the machine's own speed changes meanwhile. The page's reader (`looker.py`) does not draw: a browser
runs on the operator's machine. It keeps what comes, in a process of its own.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import loop
import numpy as np

from husky_bringup.settings import HelpFormatter
from husky_bringup.system import NodeSpec
from husky_experiments.session import Session, SessionError
from husky_runtime import graph

_CONSOLE = NodeSpec("husky_bringup", graph.CONSOLE, {"port": 0})
_LOOKER = Path(__file__).with_name("looker.py")
_WITHOUT, _UNSEEN, _SEEN = "without", "unseen", "with"
_STATES = (_WITHOUT, _UNSEEN, _SEEN)
_SETTLING = 1.0
"""Wall time after a change before the next measurement [s]."""
_START = 60.0
"""Wall time that the console has for its start [s]."""
_GLANCE = 0.1
"""Wall time between two looks whether something is done [s]."""

Measured = dict[str, dict[str, float]]
"""What was measured, by state and name."""
_Result = TypeVar("_Result")


def bench(arguments: list[str]) -> dict[str, Any]:
    """Console beside the walking graph: tick with over without, CPU, drawings to a page.

    `with` is a console with one page and one operator, `unseen` one at which nobody looks,
    `without` none; the graph walks in lockstep, and takes all the processors it can get:

    - `tick_over_relay_<state>`: median tick over that of the bare relay before;
    - `tick_with_over_without`, `tick_unseen_over_without`: median tick of the same graph in the
      same round, the median of the rounds;
    - `time_with_over_without`, `time_unseen_over_without`: likewise wall time for simulated time,
      to which ticks that are slow now and then add, as the median does not show;
    - `rate_hz`, `bandwidth_kB_per_s`: drawings and bytes that come to the page, of wall time;
    - `cpu_share`, `cpu_share_unseen`: processors that the console takes.
    """
    parser = argparse.ArgumentParser(prog="scripts/bench.sh console", formatter_class=HelpFormatter)
    parser.add_argument("--seconds", type=float, default=4.0, help="wall time measured at once [s]")
    parser.add_argument("--rounds", type=int, default=5, help="relay and graph in turn")
    options = parser.parse_args(arguments)
    relays, rounds = [], []
    for number in range(options.rounds):
        print(f"round {number + 1}: relay", flush=True)
        relays.append(loop.relay_tick_us(pipelined=False))
        print(f"round {number + 1}: walking graph", flush=True)
        rounds.append(_there_and_back(options.seconds))
    return _summary(np.array(relays), rounds)


def _summary(relays: Any, rounds: Sequence[Measured]) -> dict[str, float]:
    """Return medians of the rounds, given the relay's tick in each [us]."""

    def of(key: str, state: str) -> Any:
        return np.array([each[state][key] for each in rounds])

    metrics = {"relay_us_p50": float(np.median(relays))}
    for state in _STATES:
        metrics[f"tick_over_relay_{state}"] = float(np.median(of("tick_us", state) / relays))
    for state in (_SEEN, _UNSEEN):
        for what in ("tick", "time"):
            ratio = of(f"{what}_us", state) / of(f"{what}_us", _WITHOUT)
            metrics[f"{what}_{state}_over_without"] = float(np.median(ratio))
    for key in ("rate_hz", "bandwidth_kB_per_s", "cpu_share"):
        metrics[key] = float(np.median(of(key, _SEEN)))
    metrics["cpu_share_unseen"] = float(np.median(of("cpu_share", _UNSEEN)))
    return metrics


def _there_and_back(seconds: float) -> Measured:
    """Let one graph walk in each state, twice; return the means of what was measured."""
    found: dict[str, list[dict[str, float]]] = {state: [] for state in _STATES}
    with (
        tempfile.TemporaryDirectory() as directory,
        ThreadPoolExecutor(1) as pool,
        loop.free_run(Path(directory)) as session,
    ):
        log = Path(directory) / "logs" / f"{graph.CONSOLE}.log"
        with contextlib.closing(_Walk(session, log, pool)) as walk:
            for state in (*_STATES, *reversed(_STATES)):
                found[state].append(walk.measure(state, seconds))
    return {
        state: {key: float(np.mean([each[key] for each in twice])) for key in twice[0]}
        for state, twice in found.items()
    }


class _Walk:
    """A robot that walks on while the console beside it comes and goes."""

    def __init__(self, session: Session, log: Path, pool: ThreadPoolExecutor):
        self._session, self._log, self._pool = session, log, pool
        self._probe = loop.Probe(session)
        self._looker: _Looker | None = None

    def close(self) -> None:
        """Let the page's reader go."""
        if self._looker is not None:
            self._looker.close()
            self._looker = None

    def measure(self, state: str, seconds: float) -> dict[str, float]:
        """Bring a state about, and measure for a while of wall time [s]."""
        self._meanwhile(lambda: self._become(state))
        self._probe.walk_for(_SETTLING)
        self._probe.forget()
        start, simulated, cpu = time.monotonic(), self._probe.simulated(), self._cpu()
        self._tell_looker("begin")
        self._probe.walk_for(seconds)
        self._tell_looker("end")
        wall, cpu = time.monotonic() - start, self._cpu() - cpu
        simulated = self._probe.simulated() - simulated
        told = self._session.state
        if told is None or told.mode != "walk":
            raise SessionError(f"the robot walks no longer: {told}")
        measured = {
            "tick_us": 1e3 * float(np.median(self._probe.values(graph.PLANT, "period_ms_p50"))),
            "time_us": 1e6 * wall / simulated,
            "cpu_share": cpu / wall,
        }
        return measured if self._looker is None else measured | self._meanwhile(self._looker.told)

    def _meanwhile(self, act: Callable[[], _Result]) -> _Result:
        """Do something that takes a while."""
        future = self._pool.submit(act)
        while not future.done():
            self._probe.walk_for(_GLANCE)
        return future.result()

    def _become(self, state: str) -> None:
        """Have a console or none, and somebody who looks at it or nobody."""
        self.close()
        processes = self._session.processes
        if state == _WITHOUT:
            if processes.running(graph.CONSOLE):
                processes.end(graph.CONSOLE)
            return
        if not processes.running(graph.CONSOLE):
            processes.start(_CONSOLE)
        address = self._address()
        if state == _SEEN:
            self._looker = _Looker(address)

    def _address(self) -> str:
        """Return where the console serves, once it does; raises SessionError if it does not."""
        give_up = time.monotonic() + _START
        while not (told := re.search(r"the robot is at (\S+)\n", self._log.read_text())):
            if time.monotonic() > give_up or not self._session.processes.running(graph.CONSOLE):
                raise SessionError(f"the console does not serve:\n{self._log.read_text()}")
            time.sleep(_GLANCE)
        return told[1]

    def _tell_looker(self, word: str) -> None:
        if self._looker is not None:
            self._looker.tell(word)

    def _cpu(self) -> float:
        """Return the CPU time that the console has used [s]."""
        processes = self._session.processes
        if not processes.running(graph.CONSOLE):
            return 0.0
        return loop.cpu_seconds(processes, [_CONSOLE])[graph.CONSOLE]


class _Looker:
    """The page's reader, a process that looks when it is made."""

    def __init__(self, address: str):
        self._process = subprocess.Popen(
            [sys.executable, _LOOKER, address],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        if self._hear() != "looks":
            raise SessionError(f"nobody can look at the console: {address}")

    def tell(self, word: str) -> None:
        """Say `begin` or `end`."""
        assert self._process.stdin is not None
        print(word, file=self._process.stdin, flush=True)

    def told(self) -> dict[str, float]:
        """Return what it says after `end`."""
        figures: dict[str, float] = json.loads(self._hear())
        return figures

    def _hear(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def close(self) -> None:
        """Look no longer."""
        self._process.communicate()
