"""A Docker engine for tests: the one that is there, else one of their own."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BUILD_PERIOD = 1500.0
"""Wall time that an image may take on a busy machine [s]."""
_SCRIPT = ROOT / "tests/docker/engine.sh"


@dataclass(frozen=True)
class Engine:
    """A Docker engine.

    Attributes:
        environment: of clients.
        client: the `docker` command that builds.
        base: the image that the robot's stands on.
    """

    environment: dict[str, str]
    client: str
    base: str

    def build(self, tag: str, *options: str) -> None:
        """Build an image of this tree; the one that had its name before does not stay behind.

        Raises:
            RuntimeError: it failed; says what it printed.
        """
        before = self._image(tag)
        base = ("--file", "docker/Dockerfile", "--build-arg", f"BASE={self.base}")
        self.run("build", *base, *options, "--tag", tag, ".", timeout=BUILD_PERIOD)
        if before not in ("", self._image(tag)):
            self.run("image", "rm", before, check=False)  # not if something else still needs it

    def _image(self, tag: str) -> str:
        found = self.run("image", "ls", "--no-trunc", "--format", "{{.ID}}", tag).split()
        return found[0] if found else ""

    def run(self, *command: str, timeout: float = 120.0, check: bool = True) -> str:
        """Run a command of the client; return what it prints.

        Raises:
            RuntimeError: it failed; says what it printed.
        """
        return run([self.client, *command], self.environment, timeout, check)


def run(
    command: Sequence[str], environment: dict[str, str], timeout: float, check: bool = True
) -> str:
    """Run a command; return its output, errors included.

    Raises:
        RuntimeError: it failed.
    """
    result = subprocess.run(
        command,
        env={**os.environ, **environment},
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
        check=False,
    )
    if check and result.returncode != 0:
        told = f"code {result.returncode}\n{result.stdout[-6000:]}"
        raise RuntimeError(f"{' '.join(command)}: {told}")
    return result.stdout


@contextlib.contextmanager
def engine() -> Iterator[Engine]:
    """An engine, left as it is found; the test is skipped where there can be none."""
    # Images outlast a run, so that the next one finds its layers.
    directory = os.environ.get("HUSKY_DOCKER_DIRECTORY", "/var/tmp/husky-docker")
    up = subprocess.run([_SCRIPT, "up", directory], capture_output=True, text=True, check=False)
    if up.returncode == 3:
        pytest.skip(up.stderr.strip().splitlines()[-1])
    assert up.returncode == 0, up.stderr
    told = dict(line.split("=", 1) for line in up.stdout.splitlines())
    environment = {"DOCKER_BUILDKIT": "1"}
    if told["DOCKER_HOST"]:
        environment["DOCKER_HOST"] = told["DOCKER_HOST"]
    try:
        yield Engine(environment, told["DOCKER"], told["BASE"])
    finally:
        run([str(_SCRIPT), "down", directory], {}, timeout=120.0)
