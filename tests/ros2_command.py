"""A `ros2` command under test: the stand-in, and the genuine one where there is one."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STAND_IN = ROOT / "scripts/ros2/bin/ros2"
_HUNG = 180.0
"""Wall time after which a command will not end any more [s]."""


def ros2_environment() -> dict[str, str]:
    """This process's environment, output as it comes."""
    return {**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "80"}


class Ros2:
    """A `ros2` command, the stand-in or the genuine one."""

    def __init__(self, command: str) -> None:
        self.command = command
        self.is_genuine = not Path(command).samefile(STAND_IN)

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start a command that goes on until it is interrupted."""
        return subprocess.Popen(
            [self.command, *arguments], env=ros2_environment(), stdout=subprocess.PIPE, text=True
        )

    def __call__(self, *arguments: str, **env: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end."""
        return subprocess.run(
            [self.command, *arguments],
            env={**ros2_environment(), **env},
            capture_output=True,
            text=True,
            timeout=_HUNG,
            check=False,
        )


def commands() -> list[str]:
    """The stand-in, and the genuine command where there is one."""
    other = shutil.which("ros2")
    genuine = [other] if other is not None and not Path(other).samefile(STAND_IN) else []
    return [str(STAND_IN), *genuine]


def words(line: str) -> list[str]:
    """A command line's words; braces hold one word together."""
    return re.findall(r"\{.*\}|\S+", line)
