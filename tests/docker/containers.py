"""The robot's containers as the tests use them."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from docker_engine import ROOT, Engine, run

from husky_bringup.system import NodeSpec

COMPOSE_FILE = ROOT / "docker/compose.yaml"
END_PERIOD = 3.0
"""Wall time in which `docker stop` must have ended a node [s]."""


class Containers:
    """The nodes of a composition, as a session needs them (`husky_bringup.processes.Nodes`)."""

    def __init__(self, engine: Engine, project: str, environment: dict[str, str]):
        """Prepare; nothing is started yet.

        Args:
            engine: where.
            project: name of the composition.
            environment: what compose.yaml is told.
        """
        self.engine = engine
        self._project = project
        self._environment = {**engine.environment, **environment}
        self._started: dict[str, int] = {}  # with the time [ns]
        self._events: subprocess.Popen[bytes] | None = None
        self._heard = b""

    def compose(self, *command: str, timeout: float = 300.0, check: bool = True) -> str:
        """Run a command of docker compose; return what it prints."""
        base = ["docker-compose", "-f", str(COMPOSE_FILE), "-p", self._project]
        return run([*base, *command], self._environment, timeout, check)

    def container(self, name: str) -> str:
        """Return the name of a node's container."""
        return f"{self._project}-{name}-1"

    def state(self, name: str) -> dict[str, object]:
        """Return what the engine says of a node's container."""
        text = self.engine.run("inspect", "--format", "{{json .State}}", self.container(name))
        state: dict[str, object] = json.loads(text)
        return state

    def signal_node(self, name: str, executable: str, number: str) -> None:
        """Send a signal to the node in a container: not to its process 1.

        Raises:
            RuntimeError: no such process is there.
        """
        pattern = f"lib/{executable[:-1]}[{executable[-1]}]"  # which is not in our own command line
        self._started.pop(name, None)
        script = (
            f"code=1; for p in /proc/[0-9]*; do if grep -qs '{pattern}' $p/cmdline; "
            f"then kill -{number} ${{p#/proc/}} && code=0; fi; done; exit $code"
        )
        self.engine.run("exec", self.container(name), "sh", "-c", script)

    def health(self, name: str) -> str:
        """Return healthy, unhealthy or starting."""
        health = self.state(name)["Health"]
        assert isinstance(health, dict)
        return str(health["Status"])

    def log(self, name: str) -> str:
        """Return everything that a node has printed."""
        return self.engine.run("logs", self.container(name))

    # As a session needs them ------------------------------------------------------------------
    def start(self, spec: NodeSpec) -> object:
        """Start the container of a node again."""
        self._started[spec.name] = time.time_ns()
        self.engine.run("start", self.container(spec.name))
        return None

    def start_all(self, specs: Sequence[NodeSpec]) -> None:
        """Create and start the containers, in the order of compose.yaml."""
        names = [spec.name for spec in specs]
        self._started.update(dict.fromkeys(names, time.time_ns()))
        self.compose("up", "--no-build", "--detach", *names)

    def ended(self) -> dict[str, int]:
        """Return the exit codes of containers that have ended by themselves, and forget them.

        Also of one that the restart policy has started again since.
        """
        codes = {}
        for line in self._deaths():
            name, code, when = line.split()
            if int(when) > self._started.get(name, math.inf):
                codes[name] = int(code)
                del self._started[name]
        return codes

    def _deaths(self) -> list[str]:
        """Return what the engine has told since the last call: service, exit code, time [ns]."""
        if self._events is None:
            attributes = ".Actor.Attributes"
            self._events = subprocess.Popen(
                [
                    self.engine.client,
                    "events",
                    "--filter=event=die",
                    f"--filter=label=com.docker.compose.project={self._project}",
                    f'--format={{{{index {attributes} "com.docker.compose.service"}}}} '
                    f"{{{{{attributes}.exitCode}}}} {{{{.TimeNano}}}}",
                ],
                env={**os.environ, **self._environment},
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            assert self._events.stdout is not None
            os.set_blocking(self._events.stdout.fileno(), False)
        assert self._events.stdout is not None
        self._heard += self._events.stdout.read() or b""
        *lines, self._heard = self._heard.split(b"\n")
        return [line.decode() for line in lines]

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to a container; SIGSTOP and SIGCONT reach all of its processes."""
        if number in (signal.SIGSTOP, signal.SIGCONT):
            word = "pause" if number == signal.SIGSTOP else "unpause"
            self.engine.run(word, self.container(name))
            return
        self._started.pop(name, None)
        self.engine.run("kill", "--signal", str(int(number)), self.container(name))

    def reap(self, name: str) -> int:
        """Wait for the end of a container that has been killed; return its exit code."""
        return int(self.engine.run("wait", self.container(name)))

    def running(self, name: str) -> bool:
        """Return whether a container has been started and has not ended."""
        return name in self._started and bool(self.state(name)["Running"])

    def stop(self, name: str) -> tuple[int, float]:
        """`docker stop`; return the exit code and how long it took by the engine's clock [s]."""
        self._started.pop(name, None)
        begun = time.time()
        self.engine.run("stop", "--time", "10", self.container(name))
        finished = run(
            ["date", "+%s.%N", "--date", str(self.state(name)["FinishedAt"])], {}, timeout=10.0
        )
        return int(str(self.state(name)["ExitCode"])), float(finished) - begun

    def end(self) -> dict[str, int]:
        """Stop all, one after the other; return exit codes."""
        return {name: self.stop(name)[0] for name in sorted(self._started)}

    # Faults of containers ---------------------------------------------------------------------
    def plug(self, name: str, plugged: bool) -> None:
        """Pull the cable of a container's network interface, or plug it in.

        Skips the test where this process may not: it takes root beside the engine.
        """
        if os.geteuid() != 0:
            pytest.skip("only root can pull the cable of a container")
        index = self.engine.run(
            "exec", self.container(name), "cat", "/sys/class/net/eth0/iflink"
        ).strip()
        for interface in Path("/sys/class/net").glob("veth*"):
            if (interface / "ifindex").read_text().strip() == index:
                state = "up" if plugged else "down"
                run(["ip", "link", "set", "dev", interface.name, state], {}, timeout=10.0)
                return
        pytest.skip("the engine runs on another machine: its cables are out of reach")

    def cut_off(self, name: str) -> None:
        """Take a container off the robot's network."""
        self.engine.run("network", "disconnect", f"{self._project}_robot", self.container(name))

    def connect(self, name: str) -> None:
        """Bring it back to the network."""
        self.engine.run("network", "connect", f"{self._project}_robot", self.container(name))

    def remove(self) -> None:
        """Remove containers, network and volumes."""
        if self._events is not None:
            self._events.kill()
            self._events.wait()
            self._events = None
        self.compose("--profile", "*", "down", "--volumes", "--timeout", "5", check=False)
