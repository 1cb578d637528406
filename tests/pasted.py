"""Shell blocks of documents, and a shell into which they are pasted line by line."""

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
FIRST_DAY, OPERATOR = "docs/first_day.md", "docs/operator.md"
SIT_AGAIN = """
ros2 service call /plant/reset husky_msgs/srv/ResetWorld "{seed: -1}"
ros2 service call /drives/reset_faults std_srvs/srv/Trigger
ros2 topic echo --once --field mode --filter "m == 'passive'" /controller/state
""".lstrip()
STAND_AGAIN = """
ros2 topic echo --once --field mode --filter "m == 'damping'" /controller/state
ros2 service call /controller/set_mode husky_msgs/srv/SetMode "{mode: passive}"
ros2 service call /drives/enable std_srvs/srv/Trigger
ros2 service call /controller/set_mode husky_msgs/srv/SetMode "{mode: stand_up}"
ros2 topic echo --once --field mode --filter "m == 'stand'" /controller/state
""".lstrip()
"""After the drives have been disabled."""
PATIENCE = {"lockstep": 120.0, "realtime": 40.0}
"""Wall time for a command, on any machine, and on one that keeps real time [s]."""


def blocks(heading, document="README.md", language=""):
    """Return the fenced blocks of a section in a language, "" for what is typed into a shell."""
    text = (ROOT / document).read_text()
    section = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert section, heading
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", section[1], re.MULTILINE | re.DOTALL)
    return [block for name, block in fenced if name == language]


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


def paste_block(paste, block):
    """Paste a block; what it shows must be printed, and no request may fail that is not shown."""
    if block.startswith("$ "):
        for line, wanted in transcript(block):
            printed, _ = paste(line)
            assert alike(printed.splitlines()) == alike(wanted), f"{line} printed {printed!r}"
        return
    for line in block.splitlines():
        printed, code = paste(line)
        assert code == 0 and "success=False" not in printed, (line, printed)
        if line.startswith("ros2 service call"):
            assert "success=True" in printed, (line, printed)
        if line.endswith(graph.PROPULSION_STATE):
            assert "armed: true" in printed, printed


@contextlib.contextmanager
def started(bringup, clock, log):
    """Start the robot as a block says, its output into a file; yield a shell's `paste`."""
    command = re.sub(r"#.*|--time \w+|--console", "", bringup).split()
    with log.open("wb") as output:
        robot = subprocess.Popen(
            [*command, "--time", clock], cwd=ROOT, stdout=output, stderr=output
        )
    try:
        with shell(clock) as paste:
            yield paste
    except AssertionError as failure:
        raise AssertionError(f"{failure}; {log.read_text()}") from failure
    finally:
        robot.send_signal(signal.SIGINT)
        assert robot.wait(timeout=60.0) == 128 + signal.SIGINT
    assert "Traceback" not in log.read_text()


def wait_for_the_nodes(paste, block, clock):
    """Paste a block's first command until it prints what it shows."""
    (line, wanted), *_ = transcript(block)
    end = time.monotonic() + PATIENCE[clock]
    while alike(paste(line)[0].splitlines()) != alike(wanted):
        assert time.monotonic() < end, line


def look_inside(clock, log, *others):
    """Do what the README's section does; then let others paste, each to a robot that sits."""
    bringup, told = blocks("Look inside")
    with started(bringup, clock, log) as paste:
        wait_for_the_nodes(paste, told, clock)
        paste_block(paste, told)
        for other in others:
            paste_block(paste, SIT_AGAIN)
            other(paste)


def with_the_propulsion_unit(clock):
    """Do what the README's section does."""
    (block,) = blocks("With the propulsion unit")
    with shell(clock) as paste:
        paste_block(paste, block)


def first_day(paste, directory):
    """Do what a student does with a running robot; a program is saved in a directory."""
    bringup, commands = blocks("Look inside", FIRST_DAY)
    assert bringup == "scripts/bringup.sh --time lockstep\n", bringup
    paste_block(paste, commands)
    (program,) = blocks("Write a node", FIRST_DAY, "python")
    (run,) = blocks("Write a node", FIRST_DAY)
    (directory / run.split()[-1]).write_text(program)
    paste_block(paste, f"cd {directory}\n{run}cd {ROOT}\n")


def operator(paste):
    """Do what an operator does with a running robot that walks, stops and falls."""
    _, *walking = blocks("The first five minutes", OPERATOR)
    for block in walking:
        paste_block(paste, block)
    paste_block(paste, STAND_AGAIN)
    for heading in ("After a stop", "After a fall"):
        for block in blocks(heading, OPERATOR):
            paste_block(paste, block)


def hand_flight(clock, log):
    """Do what an operator does who flies by hand."""
    bringup, *flight = blocks("Hand flight", OPERATOR)
    with started(bringup, clock, log) as paste:
        wait_for_the_nodes(paste, flight[0], clock)
        for block in flight:
            paste_block(paste, block)
