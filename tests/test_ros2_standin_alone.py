"""What the stand-in `ros2` command does without a graph, and where it is alone in what it does."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from ros2_command import ROOT, STAND_IN, Ros2, ros2_environment

pytest.importorskip("rclpy")
pytestmark = [pytest.mark.graph, pytest.mark.usefixtures("domain")]

stand_in = Ros2(str(STAND_IN))


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """An install prefix with the package `demo` and its executable `say`."""
    marker = tmp_path / "share/ament_index/resource_index/packages/demo"
    marker.parent.mkdir(parents=True)
    marker.touch()
    say = tmp_path / "lib/demo/say"
    say.parent.mkdir(parents=True)
    say.write_text('#!/bin/sh\necho "$$" "$@"\n[ "$1" != wait ] || exec sleep 60\nexit 7\n')
    say.chmod(0o755)
    return tmp_path


def test_run_passes_arguments_and_exit_code(prefix: Path) -> None:
    arguments = ("--ros-args", "-p", "name:=a b", "-h")
    result = stand_in("run", "demo", "say", *arguments, AMENT_PREFIX_PATH=f"/none:{prefix}")
    assert result.stdout.split(" ", 1)[1] == " ".join(arguments) + "\n"
    assert result.returncode == 7


def test_run_puts_a_prefix_before_the_executable(prefix: Path) -> None:
    result = stand_in("run", "--prefix", "echo -n", "demo", "say", AMENT_PREFIX_PATH=str(prefix))
    assert result.stdout == str(prefix / "lib/demo/say")


def test_run_becomes_the_node_so_that_signals_reach_it(prefix: Path) -> None:
    process = subprocess.Popen(
        [STAND_IN, "run", "demo", "say", "wait"],
        env={**ros2_environment(), "AMENT_PREFIX_PATH": str(prefix)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == f"{process.pid} wait\n"
    process.terminate()
    assert process.wait(timeout=10) == -signal.SIGTERM


def test_run_refuses_to_choose_between_two(prefix: Path) -> None:
    other = prefix / "lib/demo/more/say"
    other.parent.mkdir()
    shutil.copy(prefix / "lib/demo/say", other)
    result = stand_in("run", "demo", "say", AMENT_PREFIX_PATH=str(prefix))
    assert result.returncode == 1
    assert result.stderr.startswith("Multiple executables found:\n- ")


@pytest.mark.parametrize(
    ("line", "package", "has"),
    [
        ("bag record -a", "ros2bag", "action, daemon, doctor, interface, "),
        ("pkg create mine", "ros2pkg", "executables, list, prefix, xml"),
        ("doctor hello", "ros2doctor", ""),
        ("component list", "ros2component", "action, "),
    ],
)
def test_what_the_stand_in_lacks_is_said(line: str, package: str, has: str) -> None:
    result = stand_in(*line.split())
    assert (result.returncode, result.stdout) == (2, "")
    assert "is not in this stand-in for the ros2 command" in result.stderr
    assert f"ros-jazzy-{package} " in result.stderr
    assert has in result.stderr


INTERRUPTED = """
import argparse
import rclpy
from std_srvs.srv import Trigger
from standin import cli
from standin.graph import graph_node

def verb(args):
    with graph_node(args) as node:
        rclpy.shutdown()  # as the handler of a signal does
        node.create_client(Trigger, "any")

print(cli.run_guarded(argparse.Namespace(main=verb)))
"""


def test_a_signal_between_two_waits_is_no_error() -> None:
    """It is the next use of the node then that finds ROS shut down."""
    told = subprocess.run(
        [sys.executable, "-c", INTERRUPTED],
        cwd=STAND_IN.parents[1],  # where the package is
        env=ros2_environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert (told.stdout, told.stderr) == (f"{signal.SIGTERM:d}\n", "")


def test_a_verb_that_there_is_nowhere_is_an_error() -> None:
    result = stand_in("topic", "nonsense")
    assert result.returncode == 2
    assert "invalid choice: 'nonsense' (choose from " in result.stderr
    assert stand_in("topic").stdout.startswith("usage: ros2 topic [-h]")


def test_there_is_no_daemon() -> None:
    assert stand_in("daemon", "status").stdout == "The daemon is not running\n"
    started = stand_in("daemon", "start")
    assert (started.returncode, started.stderr) == (0, "")
    assert "needs no daemon" in started.stdout


# ------------------------------------------------------------------ interfaces and packages
def definition(name: str) -> list[str]:
    """Lines of a message as it is written in the sources."""
    return (ROOT / f"ros2_ws/src/husky_msgs/msg/{name}.msg").read_text().splitlines()


def test_fields_are_shown_with_their_units_and_nested_ones_on_demand() -> None:
    array = "husky_msgs/msg/DriveStatusArray"
    shown = stand_in("interface", "show", "--all-comments", array).stdout.splitlines()
    outer, inner = definition("DriveStatusArray"), definition("DriveStatus")
    assert [line for line in outer if line not in shown] == []
    assert [f"\t{line}" for line in inner if line and f"\t{line}" not in shown] == []
    assert any(line.startswith("\tfloat64 ") and line.endswith("[rad]") for line in shown)
    short = stand_in("interface", "show", array).stdout.splitlines()
    assert [line for line in outer if line not in short] == []
    assert not [line for line in short if line.startswith("\t") and "[rad]" in line]


def test_the_type_to_show_comes_from_a_pipe() -> None:
    shown = subprocess.run(
        [STAND_IN, "interface", "show", "-"],
        env=ros2_environment(),
        input="std_msgs/msg/Bool\n",
        capture_output=True,
        text=True,
    )
    assert shown.stdout.endswith("\nbool data\n")


def test_all_interfaces_are_listed() -> None:
    titles = {"msg": "Messages", "srv": "Services", "action": "Actions"}
    sources = sorted((ROOT / "ros2_ws/src/husky_msgs").glob("*/*.*"))
    listed = stand_in("interface", "list").stdout
    for title in titles.values():
        assert f"{title}:\n    " in listed
    names = [f"husky_msgs/{path.parent.name}/{path.stem}" for path in sources]
    assert [name for name in names if f"    {name}\n" not in listed] == []
    of_package = stand_in("interface", "package", "husky_msgs").stdout.splitlines()
    assert sorted(of_package) == sorted(names)
    only = stand_in("interface", "list", "-a").stdout
    assert only.startswith("Actions:\n    ") and "Messages" not in only


def test_packages_are_found_through_the_prefixes_in_order(prefix: Path, tmp_path: Path) -> None:
    search = f"/none:{prefix}:{os.environ['AMENT_PREFIX_PATH']}"
    assert "demo\n" in stand_in("pkg", "list", AMENT_PREFIX_PATH=search).stdout
    where = stand_in("pkg", "prefix", "--share", "demo", AMENT_PREFIX_PATH=search).stdout
    assert where == f"{prefix}/share/demo\n"
    found = stand_in("pkg", "executables", "demo", AMENT_PREFIX_PATH=search).stdout
    assert found == "demo say\n"
    no_manifest = stand_in("pkg", "xml", "demo", AMENT_PREFIX_PATH=search)
    assert (no_manifest.stderr, no_manifest.returncode) == ("Package XML manifest not found\n", 1)


# ------------------------------------------------------------------ beyond the original
@pytest.mark.parametrize("text", [None, "", "3", "[1", "a: 1", "a: {ros__parameters: 1}"])
def test_what_is_no_parameter_file_is_refused_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, text: str | None
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts/ros2"))
    from standin.param import file_parameters

    path = tmp_path / "parameters.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(RuntimeError, match=r"No such file|not a.* (ROS )?parameter file"):
        file_parameters(str(path), wildcard=True)


def test_bad_yaml_is_refused_in_a_sentence() -> None:
    result = stand_in("topic", "pub", "-1", "-w", "0", "/nobody", "std_msgs/String", "{data: [")
    assert result.returncode == 1
    assert result.stderr.startswith("The passed values are not valid YAML: ")
    assert "Traceback" not in result.stderr


def test_now_and_auto_become_the_time_of_sending() -> None:
    before = time.time()
    result = stand_in(
        "topic", "pub", "-1", "-w", "0", "/nobody", "geometry_msgs/PointStamped", "{header: auto}"
    )
    stamp = re.search(r"Time\(sec=(\d+), nanosec=(\d+)\)", result.stdout)
    assert stamp is not None
    assert before - 1 <= int(stamp[1]) + int(stamp[2]) * 1e-9 <= time.time()
