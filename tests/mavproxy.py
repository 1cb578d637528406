"""MAVProxy, somebody else's ground station on the flight controller's UDP port."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path


class MavProxy:
    """Its process: told what to do, and read, as on a terminal."""

    def __init__(self, port: int, directory: Path, modules: str = "link"):
        """Start it.

        Args:
            port: of the flight controller, on this machine.
            directory: for its files and its output.
            modules: of its own, to be loaded.
        """
        self._log = directory / "mavproxy"
        command = [sys.executable, "-m", "MAVProxy.mavproxy", f"--master=udpout:127.0.0.1:{port}"]
        command += [f"--state-basedir={directory}", f"--default-modules={modules}"]
        with self._log.open("w") as output:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=output, stderr=output, text=True,
                cwd=directory, env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )  # fmt: skip

    def say(self, text: str) -> None:
        """Type a line."""
        assert self._process.stdin is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()

    def heard(self, pattern: str) -> re.Match[str] | None:
        """Return the first match in all that it has said."""
        return re.search(pattern, self._log.read_text())

    def ask(self, message: str) -> dict[str, int]:
        """Ask for the newest message of a kind; return the integers of the last answer so far."""
        self.say(f"status {message}")
        answers = re.findall(rf"{message} \{{(.*?)\}}", self._log.read_text())
        pairs = re.findall(r"(\w+) : (-?\d+)", answers[-1]) if answers else ()
        return {name: int(value) for name, value in pairs}

    def close(self) -> None:
        """End it; a failure shows what it said."""
        self._process.kill()
        self._process.wait()
        print(self._log.read_text())
