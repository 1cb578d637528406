"""Nodes that are forks of one process."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from husky_bringup.fork_server import VARIABLE, ForkServer, fork
from husky_bringup.processes import Processes
from husky_bringup.system import NodeSpec
from husky_runtime import graph, starter
from husky_runtime.domain_locks import holder

pytestmark = pytest.mark.graph

RADIO = NodeSpec("husky_pu", graph.RC_TRANSMITTER, {"time": "lockstep"})
PATIENCE = 150.0
"""Wall time that anything may take [s]."""


@pytest.fixture(scope="module")
def server():
    with ForkServer() as server:
        yield server


@pytest.fixture
def processes(domain, server, tmp_path):
    with Processes(logs=tmp_path, environment={VARIABLE: server.address}) as processes:
        yield processes


def until(condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def of_process(pid, name):
    return Path(f"/proc/{pid}/{name}").read_bytes()


def start_radio(processes, domain):
    """Start the radio; return its process, which by now ends as it should by a signal."""
    process = processes.start(RADIO)
    until(lambda: holder(RADIO.name, domain, os.environ) == process.pid)
    return process


def test_a_node_is_a_process_like_any_other(processes, domain, tmp_path):
    process = start_radio(processes, domain)
    assert os.getpgid(process.pid) == os.getsid(process.pid) == process.pid
    assert of_process(process.pid, "comm").strip() == RADIO.name.encode()
    files = [os.readlink(f"/proc/{process.pid}/fd/{number}") for number in range(3)]
    assert files == ["/dev/null", *[str(tmp_path / f"{RADIO.name}.log")] * 2]
    assert process.poll() is None and processes.ended() == {}
    assert processes.end() == {RADIO.name: 0}


def test_exit_codes(server, processes, domain, tmp_path):
    processes.start(NodeSpec(RADIO.package, RADIO.name, {"time": "tea"}))
    ended = {}
    until(lambda: ended.update(processes.ended()) or ended)
    assert ended == {RADIO.name: 1}
    assert "parameter time is 'tea'" in (tmp_path / f"{RADIO.name}.log").read_text()
    with (tmp_path / "unknown.log").open("wb") as log:
        unknown = fork(server.address, "toaster", [], os.environ, log)
    assert unknown.wait(PATIENCE) == 1
    assert "no node 'toaster'; there are " in (tmp_path / "unknown.log").read_text()
    processes.start(RADIO)
    processes.kill(RADIO.name)
    assert processes.reap(RADIO.name) == -signal.SIGKILL
    start_radio(processes, domain)
    processes.kill(RADIO.name, signal.SIGSTOP)
    assert processes.running(RADIO.name)
    processes.kill(RADIO.name, signal.SIGCONT)
    assert processes.end(RADIO.name) == {RADIO.name: 0}


def test_a_server_that_is_killed_leaves_its_nodes(domain, tmp_path):
    server = ForkServer()
    with Processes(logs=tmp_path, environment={VARIABLE: server.address}) as processes:
        process = processes.start(RADIO)
        server._process.kill()
        until(lambda: not server.running)
        assert process.poll() is None
        processes.kill(RADIO.name)
        assert process.wait(PATIENCE) == -signal.SIGKILL
        with pytest.raises(OSError):
            fork(server.address, RADIO.name, [], os.environ)
    server.close()
    assert not Path(server.address).exists()


def test_a_server_ends_with_the_process_that_has_started_it(domain):
    program = (
        "import sys, time; from husky_bringup.fork_server import ForkServer; "
        "server = ForkServer(); print(server._process.pid, server.address, flush=True); "
        "time.sleep(1e3)"
    )
    with subprocess.Popen((sys.executable, "-c", program), stdout=subprocess.PIPE) as owner:
        pid, address = owner.stdout.readline().split()
        environment = os.environ | {starter.VARIABLE: starter.identity()}
        node = fork(
            address.decode(), RADIO.name, ["--ros-args", "-p", "time:=lockstep"], environment
        )
        owner.kill()
        until(
            lambda: (
                not Path(f"/proc/{int(pid)}/cmdline").exists()
                or not of_process(int(pid), "cmdline")
            )
        )
        assert not Path(address.decode()).parent.exists()
        assert node.poll() is None, "a node ends with its own starter"
        node.send_signal(signal.SIGTERM)
        node.wait(PATIENCE)
