"""README's shell blocks, and a shell into which they are pasted line by line."""

import contextlib
import os
import re
import select
import signal
import subprocess
import time
import uuid
from pathlib import Path

from husky_runtime import graph

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = {"lockstep": 120.0, "realtime": 40.0}
"""Wall time for a command, on any machine, and on one that keeps real time [s]."""


def blocks(heading):
    """The fenced blocks of a section."""
    text = (ROOT / "README.md").read_text()
    section = re.search(rf"^## {heading}$(.*?)^## ", text, re.MULTILINE | re.DOTALL)
    assert section, heading
    return re.findall(r"^```\n(.*?)^```", section[1], re.MULTILINE | re.DOTALL)


def transcript(block):
    """Commands and what they print, [(command, [line])]."""
    steps = []
    for line in filter(None, block.splitlines()):
        if line.startswith("$ "):
            steps.append((line[2:], []))
        else:
            steps[-1][1].append(line)
    return steps


def alike(lines):
    """What must be the same in each run: not numbers, nor whether a service was there already.

    Nor what a tool says of messages that it was too slow for.
    """
    passing = ("waiting for service", "A message was lost", "total count change", "total count:")
    kept = [line.rstrip() for line in lines if line.strip()]
    kept = [line for line in kept if not any(words in line for words in passing)]
    return [re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", line) for line in kept]


@contextlib.contextmanager
def shell(clock):
    """A shell in which lines are typed; bringups that it starts have this clock."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "80"}
    process = subprocess.Popen(
        ["bash"],
        cwd=ROOT,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        bufsize=1,
        start_new_session=True,
    )

    def paste(command):
        """Type a command; return what it printed, and its exit code."""
        mark = uuid.uuid4().hex
        timed = re.sub(r"^(scripts/bringup\.sh) --time \w+", rf"\1 --time {clock}", command)
        process.stdin.write(f"{timed}\necho; echo {mark} $?\n")
        process.stdin.flush()
        printed, end = "", time.monotonic() + PATIENCE[clock]
        while (found := re.search(rf"{mark} (\d+)\n", printed)) is None:
            ready, _, _ = select.select([process.stdout], [], [], 1.0)
            part = os.read(process.stdout.fileno(), 65536) if ready else b""
            printed += part.decode()
            assert time.monotonic() < end, f"{command}: goes on and on, and says {printed!r}"
        return printed[: found.start()], int(found[1])

    try:
        yield paste
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def look_inside(clock, log):
    """Start the robot as the section says, its output into a file, and do what it does."""
    bringup, told = blocks("Look inside")
    command = re.sub(r"#.*|--time \w+", "", bringup).split()
    steps = transcript(told)
    with log.open("wb") as output:
        robot = subprocess.Popen(
            [*command, "--time", clock], cwd=ROOT, stdout=output, stderr=output
        )
    try:
        with shell(clock) as paste:
            (line, wanted), *others = steps
            end = time.monotonic() + PATIENCE[clock]
            while alike(paste(line)[0].splitlines()) != alike(wanted):  # the nodes come up
                assert time.monotonic() < end, line
            for line, wanted in others:
                printed, _ = paste(line)
                assert alike(printed.splitlines()) == alike(wanted), f"{line} printed {printed!r}"
    except AssertionError as failure:
        raise AssertionError(f"{failure}; {log.read_text()}") from failure
    finally:
        robot.send_signal(signal.SIGINT)
        assert robot.wait(timeout=60.0) == 128 + signal.SIGINT
    assert "Traceback" not in log.read_text()


def with_the_propulsion_unit(clock):
    """Do what the section does."""
    (block,) = blocks("With the propulsion unit")
    with shell(clock) as paste:
        for line in block.splitlines():
            printed, code = paste(line)
            assert code == 0 and "success=False" not in printed, (line, printed)
            if line.startswith("ros2 service call"):
                assert "success=True" in printed, (line, printed)
            if line.endswith(graph.PROPULSION_STATE):
                assert "armed: true" in printed, printed
