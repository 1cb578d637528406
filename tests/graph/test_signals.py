"""Scripts that are ended by a signal, or killed, leave nothing behind.

All at once, each in a domain of its own; the environment tells which process belongs to which.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from ros_domain import own_domain

from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[2]
_MARK = "HUSKY_TEST_MARK"
_PATIENCE = 240.0
"""Wall time after which nothing more is expected, even of a slow machine [s]."""
_A_TEST = "tests/graph/test_start_and_end.py -k test_end_of_the_graph"


@dataclass
class Script:
    """A script that runs, the signal that it gets, and what came of it.

    Attributes:
        command: of the script; {} stands for a directory of its own.
        number: of the signal.
        code: exit code that it should have.
        ready: whether the time for the signal has come, by the command lines of its processes.
        victim: what the command line of the process that gets the signal holds; the script itself
            when this is empty.
    """

    command: str
    number: int
    code: int
    ready: Callable[[Script], bool]
    victim: str = ""
    directory: Path = Path()
    domain: int = 0
    process: subprocess.Popen[bytes] | None = None
    processes: dict[int, str] = field(default_factory=dict)
    sent: float = 0.0
    took: float = 0.0

    def start(self) -> None:
        """Start it."""
        self.directory.mkdir()
        with (self.directory / "output").open("wb") as output:
            self.process = subprocess.Popen(
                self.command.format(self.directory).split(),
                env={
                    **os.environ,
                    "ROS_DOMAIN_ID": str(self.domain),
                    _MARK: str(self.directory),
                    "PYTHONDONTWRITEBYTECODE": "1",
                },
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

    def look(self) -> bool:
        """Send the signal when the time has come; return whether nothing is left to look at."""
        assert self.process is not None
        code = self.process.poll()
        if not self.sent:
            chosen = [n for n, c in self.processes.items() if self.victim and self.victim in c]
            there = bool(chosen) or not self.victim
            if code is None and there and self.ready(self):
                self.sent = time.monotonic()
                os.kill(chosen[0] if chosen else self.process.pid, self.number)
        elif code is not None and not self.processes and not self.took:
            self.took = time.monotonic() - self.sent
        return code is not None and (self.took > 0.0 or not self.sent)


def nodes_start(script: Script) -> bool:
    """Its last node has been started, and is about to import what it needs."""
    return script.runs(f"lib/husky_control/{graph.LOW_LEVEL_CONTROLLER}")


def maps_casadi(script: Script) -> bool:
    """It has come as far as the optimiser."""
    with contextlib.suppress(OSError):
        return any("casadi" in Path(f"/proc/{n}/maps").read_text() for n in script.processes)
    return False


SCRIPTS = {
    "set_up": Script(
        "scripts/experiment.sh", signal.SIGINT, 130, lambda script: script.runs("scripts/setup.sh")
    ),
    "demo": Script("scripts/demo.sh --output {}/out", signal.SIGTERM, 143, nodes_start),
    "experiment": Script(
        "scripts/experiment.sh stand --output {}/out",
        signal.SIGHUP,
        129,
        lambda script: "s simulated" in script.said,
    ),
    "bringup": Script("scripts/bringup.sh", signal.SIGINT, 130, nodes_start),
    "bringup_killed": Script(
        "scripts/bringup.sh --time lockstep --record {}/bag",
        signal.SIGKILL,
        -9,
        lambda script: "recording" in script.said,
    ),
    "bringup_loses_a_node": Script(
        "scripts/bringup.sh",
        signal.SIGKILL,
        1,
        nodes_start,
        f"lib/husky_drivers/{graph.VN200_DRIVER}",
    ),
    "bench": Script(
        "scripts/bench.sh loop --rounds 1",
        signal.SIGQUIT,
        131,
        lambda script: script.runs(f"relay.py {graph.PLANT}"),
    ),
    "test": Script(
        f"scripts/test.sh {_A_TEST}",
        signal.SIGHUP,
        129,
        lambda script: script.runs("lib/husky_sim/plant"),
    ),
    "test_killed": Script(
        f"scripts/test.sh {_A_TEST}",
        signal.SIGKILL,
        -9,
        lambda script: script.runs("lib/husky_sim/plant"),
    ),
    "all_tests_killed": Script(
        "scripts/test.sh", signal.SIGKILL, -9, lambda script: script.runs("-m pytest -n")
    ),
    "plan_incline": Script(
        f"{sys.executable} scripts/plan_incline.py", signal.SIGINT, 130, maps_casadi
    ),
}


def find(directory: Path) -> dict[str, dict[int, str]]:
    """Return the command lines of all processes that are marked, by mark and process."""
    found: dict[str, dict[int, str]] = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        with contextlib.suppress(OSError):
            for item in (entry / "environ").read_bytes().split(b"\0"):
                name, _, value = item.decode(errors="replace").partition("=")
                if name == _MARK and Path(value).parent == directory:
                    command = (entry / "cmdline").read_bytes().replace(b"\0", b" ")
                    found.setdefault(value, {})[int(entry.name)] = command.decode(errors="replace")
    return found


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Script]:
    """Every script, some time after its signal."""
    directory = tmp_path_factory.mktemp("scripts")
    with contextlib.ExitStack() as stack:
        for name, script in SCRIPTS.items():
            script.domain = stack.enter_context(own_domain(f"{__name__}.{name}"))
            script.directory = directory / f"{name}-{uuid.uuid4().hex[:8]}"
            script.start()
        deadline = time.monotonic() + _PATIENCE
        looking = True
        while looking and time.monotonic() < deadline:
            time.sleep(0.02)
            found = find(directory)
            for script in SCRIPTS.values():
                script.processes = found.get(str(script.directory), {})
            looking = not all([script.look() for script in SCRIPTS.values()])
        for script in SCRIPTS.values():
            for number in script.processes:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)
            assert script.process is not None
            script.process.wait()
    return SCRIPTS


@pytest.mark.parametrize("name", SCRIPTS)
def test_no_signal_leaves_a_process_behind(ended, name) -> None:
    """None is left, a line says what it was, and the exit code too."""
    script = ended[name]
    assert script.sent, f"never got so far:\n{script.said}"
    assert not script.processes, f"left behind: {script.processes}\n{script.said}"
    print(f"{name}: ended after {script.took:.2f} s")
    assert script.process.returncode == script.code, script.said
    assert "Traceback" not in script.said
    if script.code > 128:
        line = f"ended by {signal.Signals(script.number).name}"
        assert sum(line in each for each in script.said.splitlines()) == 1, script.said


def test_bag_of_a_killed_bringup(ended) -> None:
    """The recorder is told, and closes it."""
    directory = ended["bringup_killed"].directory
    assert (directory / "bag/metadata.yaml").is_file()
    assert Recording(directory / "bag").counts is not None


def test_bringup_ends_with_a_node(ended) -> None:
    """It says which one, and how."""
    said = ended["bringup_loses_a_node"].said
    assert f"{graph.VN200_DRIVER} has ended with code -9 (SIGKILL)" in said
