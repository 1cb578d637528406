"""How nodes start, refuse to start, and end."""

import contextlib
import os
import signal
import subprocess
from pathlib import Path

import pytest

from husky_bringup.processes import Processes
from husky_bringup.system import NodeSpec
from husky_experiments.session import Session
from husky_runtime import domain_locks as occupancy
from husky_runtime import graph

pytestmark = pytest.mark.graph

CONTROLLER = NodeSpec("husky_control", graph.LOW_LEVEL_CONTROLLER)
BAD = {
    "timestep": (NodeSpec("husky_sim", graph.PLANT, {"timestep": 0.0007}), "0.0007", "2 ms"),
    "friction": (NodeSpec("husky_sim", graph.PLANT, {"friction": 7.0}), "friction", "5.0"),
    "terrain": (NodeSpec("husky_sim", graph.PLANT, {"terrain": "lava"}), "lava", "flat"),
    "seed": (NodeSpec("husky_sim", graph.PLANT, {"seed": "abc"}), "seed", "INTEGER"),
    "bus": (NodeSpec("husky_drivers", graph.DRIVE_BRIDGE, {"bus": "wire"}), "wire", "sim"),
    "gain": (
        NodeSpec("husky_control", graph.LOW_LEVEL_CONTROLLER, {"safety.max_tilt": 9.0}),
        "safety.max_tilt",
        "1.5",
    ),
    "pair": (
        NodeSpec(
            "husky_control",
            graph.LOW_LEVEL_CONTROLLER,
            {"gait.trot.period": 0.24, "gait.trot.duty": 0.65},
        ),
        "gait.trot.period (0.24 s)",
        "0.1 to 0.25 s",
    ),
}


@pytest.fixture(scope="module")
def refusals(domain, tmp_path_factory) -> dict[str, tuple[int, str]]:
    """Exit code and output of each node of `BAD`."""
    locks = tmp_path_factory.mktemp("locks")  # one each: three of them are plants
    running = {
        name: subprocess.Popen(
            spec.command(),
            env={**os.environ, occupancy.VARIABLE: str(locks / name)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for name, (spec, *_) in BAD.items()
    }
    found = {}
    for name, process in running.items():
        try:
            output, _ = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            output, _ = process.communicate()
        found[name] = (process.returncode, output)
    return found


@pytest.mark.parametrize("name", BAD)
def test_bad_parameter(refusals, name):
    """One line that names the value or the parameter, and what is allowed; exit code 1."""
    code, output = refusals[name]
    assert code == 1, output
    lines = [line for line in output.splitlines() if line.strip()]
    assert len(lines) == 1, output
    assert all(word in lines[0] for word in BAD[name][1:]), output


def test_end_of_the_graph(tmp_path, monkeypatch):
    """SIGTERM ends every node with exit code 0 in the 3 s it is given; nothing is left behind.

    Nodes are started themselves: the genuine `ros2 run` stays as their parent, and its code is -15.
    """
    (tmp_path / "bin").mkdir()
    tool = tmp_path / "bin" / "ros2"
    tool.write_text("#!/bin/sh\nexit 3\n")
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", str(tool.parent), prepend=os.pathsep)
    session = Session(tmp_path, record=False)
    groups = {spec.name: session.processes.process_group(spec.name) for spec in session.specs}
    session.advance(0.1)
    assert session.close() == dict.fromkeys(groups, 0)
    left = {name: _members(group) for name, group in groups.items()}
    assert not any(left.values()), f"left behind: {left}"
    for log in (tmp_path / "logs").iterdir():
        assert "Traceback" not in log.read_text(), log.read_text()


def test_end_while_starting(tmp_path):
    """A node that is not up yet ends too."""
    with Processes(logs=tmp_path) as processes:
        processes.start(CONTROLLER)
        processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGTERM)
        group = processes.process_group(graph.LOW_LEVEL_CONTROLLER)
        processes.end()
    assert not _members(group)


def _members(group: int) -> list[str]:
    """Processes of a group, zombies too."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text()
            except OSError:
                continue
            fields = stat.rpartition(")")[2].split()
            if int(fields[2]) == group:
                found.append(stat)
    return found


def test_no_zombies():
    """None of the processes that this test process has started is left unreaped."""
    with contextlib.suppress(ChildProcessError):  # there are none; else there is the fork server
        assert os.waitpid(-1, os.WNOHANG) == (0, 0)
