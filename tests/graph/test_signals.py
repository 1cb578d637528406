"""Scripts that are ended by a signal, or killed, leave nothing behind.

A mark in the environment tells which processes are a script's.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from ros_domain import own_domain

from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[2]
_MARK = "HUSKY_TEST_MARK"
_PATIENCE = 400.0
"""Wall time after which nothing more is expected, even of a slow machine [s]."""
_A_TEST = "tests/graph/test_start_and_end.py -k test_end_of_the_graph"


@dataclass(frozen=True)
class Script:
    """A script, the signal that it gets, and what has to come of it.

    Attributes:
        command: of the script; {} stands for a directory of its own.
        number: of the signal.
        code: exit code that it should have.
        ready: whether the time for the signal has come.
        victim: what the command line of the process that gets the signal holds; the script itself
            when this is empty.
        after: checks what it leaves.
    """

    command: str
    number: int
    code: int
    ready: Callable[[Run], bool]
    victim: str = ""
    after: Callable[[Run], None] = lambda run: None


class Run:
    """A script that runs.

    Attributes:
        directory: of its own.
        process: of the script itself.
        processes: command lines of what runs of it, by process.
    """

    def __init__(self, command: str, directory: Path):
        """Start it."""
        self.directory = directory
        self.processes: dict[int, str] = {}
        with (directory / "output").open("wb") as output:
            self.process = subprocess.Popen(
                # As from a terminal, also if this run is below nohup.
                ["env", "--default-signal=HUP", *command.format(directory).split()],
                env={**os.environ, _MARK: str(directory), "PYTHONDONTWRITEBYTECODE": "1"},
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def said(self) -> str:
        """What it has printed."""
        return (self.directory / "output").read_text(errors="replace")

    def runs(self, text: str) -> bool:
        """Whether one of its processes has this in its command line."""
        return any(text in command for command in self.processes.values())

    def until(self, done: Callable[[], bool], what: str) -> None:
        """Look at its processes until something is so."""
        deadline = time.monotonic() + _PATIENCE
        while True:
            self.processes = marked(self.directory)
            if done():
                return
            assert time.monotonic() < deadline, f"{what}; runs: {self.processes}\n{self.said}"
            time.sleep(0.02)

    def end(self) -> None:
        """Kill what is left of it."""
        while left := marked(self.directory):
            for number in left:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)
            self.process.poll()
            time.sleep(0.02)


def nodes_start(run: Run) -> bool:
    """Its last node has been started, and is about to import what it needs."""
    return run.runs(f"lib/husky_control/{graph.LOW_LEVEL_CONTROLLER}")


def maps_casadi(run: Run) -> bool:
    """It has come as far as the optimiser."""
    with contextlib.suppress(OSError):
        return any("casadi" in Path(f"/proc/{n}/maps").read_text() for n in run.processes)
    return False


def bag_is_closed(run: Run) -> None:
    """The recorder is told, and closes it."""
    assert (run.directory / "bag/metadata.yaml").is_file()
    assert Recording(run.directory / "bag").counts is not None


def node_is_named(run: Run) -> None:
    """It says which one has ended, and how."""
    assert f"{graph.VN200_DRIVER} has ended with code -9 (SIGKILL)" in run.said


SCRIPTS = {
    "set_up": Script(
        "scripts/experiment.sh", signal.SIGINT, 130, lambda run: run.runs("scripts/setup.sh")
    ),
    "demo": Script("scripts/demo.sh --output {}/out", signal.SIGTERM, 143, nodes_start),
    "experiment": Script(
        "scripts/experiment.sh stand --output {}/out",
        signal.SIGHUP,
        129,
        lambda run: "s simulated" in run.said,
    ),
    "bringup": Script("scripts/bringup.sh", signal.SIGINT, 130, nodes_start),
    "bringup_killed": Script(
        "scripts/bringup.sh --time lockstep --record {}/bag",
        signal.SIGKILL,
        -9,
        lambda run: "recording" in run.said,
        after=bag_is_closed,
    ),
    "bringup_loses_a_node": Script(
        "scripts/bringup.sh",
        signal.SIGKILL,
        1,
        nodes_start,
        f"lib/husky_drivers/{graph.VN200_DRIVER}",
        after=node_is_named,
    ),
    "console": Script(
        "scripts/console.sh --port 0", signal.SIGINT, 0, lambda run: "the robot is at" in run.said
    ),
    "bench": Script(
        "scripts/bench.sh loop --rounds 1",
        signal.SIGQUIT,
        131,
        lambda run: run.runs(f"relay.py {graph.PLANT}"),
    ),
    "test": Script(
        f"scripts/test.sh {_A_TEST}",
        signal.SIGHUP,
        129,
        lambda run: run.runs("lib/husky_sim/plant"),
    ),
    "test_killed": Script(
        f"scripts/test.sh {_A_TEST}",
        signal.SIGKILL,
        -9,
        lambda run: run.runs("lib/husky_sim/plant"),
    ),
    "all_tests_killed": Script(
        "scripts/test.sh", signal.SIGKILL, -9, lambda run: run.runs("-m pytest -n")
    ),
    "plan_incline": Script(
        f"{sys.executable} scripts/plan_incline.py", signal.SIGINT, 130, maps_casadi
    ),
}


def marked(directory: Path) -> dict[int, str]:
    """Return the command lines of all processes that are marked with a directory, by process."""
    mark = f"{_MARK}={directory}".encode()
    found: dict[int, str] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                if mark in (entry / "environ").read_bytes().split(b"\0"):
                    command = (entry / "cmdline").read_bytes().replace(b"\0", b" ")
                    found[int(entry.name)] = command.decode(errors="replace")
    return found


@pytest.fixture
def run(name: str, tmp_path: Path) -> Iterator[Run]:
    """A script that runs in a domain of its own."""
    with own_domain(f"{__name__}.{name}"):
        run = Run(SCRIPTS[name].command, tmp_path)
        yield run
        run.end()


@pytest.mark.timeout(3 * _PATIENCE)
@pytest.mark.parametrize("name", SCRIPTS)
def test_no_signal_leaves_a_process_behind(name, run) -> None:
    """None is left, a line says what it was, and the exit code too."""
    script = SCRIPTS[name]

    def is_ready() -> bool:
        assert run.process.poll() is None, f"has ended before its signal:\n{run.said}"
        return script.ready(run) and run.runs(script.victim)

    run.until(is_ready, "never got so far")
    victims = [n for n, command in run.processes.items() if script.victim in command]
    os.kill(victims[0] if script.victim else run.process.pid, script.number)
    sent = time.monotonic()
    run.until(lambda: run.process.poll() is not None and not run.processes, "left behind")
    print(f"{name}: ended after {time.monotonic() - sent:.2f} s")
    assert run.process.returncode == script.code, run.said
    assert "Traceback" not in run.said
    if script.code > 128:
        line = f"ended by {signal.Signals(script.number).name}"
        assert sum(line in each for each in run.said.splitlines()) == 1, run.said
    script.after(run)
