"""Twelve simulated drives at the end of a virtual cable, in a process of their own.

As a script it answers frames on ecat1 and does what lines on its standard input ask for; each is
answered by a line of JSON. As a module it starts that in the caller's network.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from husky_description.robot import load_robot
from husky_runtime.numba_cache import seal_numba_cache
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.cable import TARGET, Cable
from husky_sim.devices.ethercat.raw_port import RawPort
from husky_sim.devices.ethercat.wired_segment import WiredSegment


class FarSide:
    """The drives' end, as the process has it."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.segment = SimulatedSegment(load_robot())
        self.wired = WiredSegment(self.segment, time.monotonic_ns, [10.0 * i for i in range(12)])
        self.frames = 0
        self.cable = Cable(self.wired)
        self.port = RawPort("ecat1", self.on_frame)

    def on_frame(self, frame: bytearray) -> list[bytearray]:
        with self.lock:
            self.frames += 1
            return self.cable.pass_frame(frame)[0]

    def do(self, what: str, *words: str) -> Any:
        """Do what a line asks for: tick N, inject JOINT FAULT, clear, or tell."""
        with self.lock:
            if what == "tick":
                still = np.zeros(12, np.int32)
                for _ in range(int(words[0])):
                    self.segment.set_servo_state(still, still, np.zeros(12), 22.2)
            elif what == "inject" and words[0] == TARGET:
                self.cable.inject(words[1])
            elif what == "inject":
                self.segment.inject(*words)
            elif what == "clear":
                self.cable.clear()
                self.segment.clear()
            return {
                "frames": self.frames,
                "al": [list(al) for al in self.segment.al_states()],
                "states": [state.name for state in self.segment.states()],
                "torque": int((self.segment.servo_command()["kind"] != 0).sum()),
            }


class Drives:
    """The same as the test has it."""

    def __init__(self, process: subprocess.Popen[str]):
        self._process = process

    def ask(self, *words: object) -> dict[str, Any]:
        """Ask for something; return what the drives are like then."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(" ".join(map(str, words)) + "\n")
        self._process.stdin.flush()
        told: dict[str, Any] = json.loads(self._process.stdout.readline())
        return told


@contextlib.contextmanager
def far_side() -> Iterator[Drives]:
    """Start the drives in the network of the calling thread; return when they answer frames."""
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).resolve())],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    drives = Drives(process)
    try:
        drives.ask("tell")
        yield drives
    finally:
        process.kill()
        process.communicate()


if __name__ == "__main__":
    seal_numba_cache()
    far = FarSide()
    for line in sys.stdin:
        print(json.dumps(far.do(*line.split())), flush=True)
