"""Start of a graph: a process of each node's executable, or a fork of the fork server."""

from __future__ import annotations

import argparse
import contextlib
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

from husky_bringup.fork_server import ForkServer, sharing
from husky_bringup.settings import HelpFormatter
from husky_experiments.session import Session
from husky_runtime.processor_time import processor_time


def bench(arguments: list[str]) -> dict[str, Any]:
    """Wall and processor time until a graph is complete, its nodes executed or forked."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh start", formatter_class=HelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="starts of each kind, in turn")
    options = parser.parse_args(arguments)
    wall: dict[str, list[float]] = {"executed": [], "forked": []}
    worked: dict[str, list[float]] = {"executed": [], "forked": []}
    with ForkServer() as server:
        for number in range(-1, options.rounds):  # the first of each is for files to be read
            for kind in wall:
                with contextlib.nullcontext() if kind == "executed" else sharing(server):
                    begun = time.perf_counter()
                    with _graph() as session:
                        took, work = time.perf_counter() - begun, _worked(session)
                if number >= 0:
                    wall[kind].append(took)
                    worked[kind].append(work)
                    print(f"  {kind}: {took:.1f} s, {work:.1f} s of processor time", flush=True)
    return {
        **{f"{kind}_wall_s": median(times) for kind, times in wall.items()},
        **{f"{kind}_processor_s": median(times) for kind, times in worked.items()},
    }


@contextlib.contextmanager
def _graph() -> Iterator[Session]:
    """A graph of the robot that walks."""
    with (
        tempfile.TemporaryDirectory() as directory,
        Session(Path(directory), record=False) as session,
    ):
        yield session


def _worked(session: Session) -> float:
    """Return the processor time of all nodes so far [s]."""
    groups = (session.processes.process_group(spec.name) for spec in session.specs)
    return sum(processor_time(group).worked for group in groups)
