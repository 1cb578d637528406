"""Who is started by a script ends with it, whatever lies between and however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from husky_runtime import starter

STARTED = """
import signal, sys, time
from husky_runtime import starter
starter.END_PERIOD = 0.2
if "busy" in sys.argv:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
starter.end_with_starter()
print("watching", flush=True)
time.sleep(600)
"""
STARTER = """
import os, subprocess, sys, time
from husky_runtime import starter
os.environ[starter.VARIABLE] = starter.identity()
# Something between that hands no signals on, with its own session, and descriptors closed.
between = "import subprocess, sys; subprocess.run([sys.executable, '-c', *sys.argv[1:]])"
subprocess.Popen([sys.executable, "-c", between, *sys.argv[1:]], start_new_session=True)
time.sleep(600)
"""


def environment(**more: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **more}


@pytest.mark.parametrize("kind", ["idle", "busy"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_it_ends_with_its_starter(number: int, kind: str) -> None:
    """One that does not listen too; the end of its output tells."""
    process = subprocess.Popen(
        [sys.executable, "-c", STARTER, STARTED, kind],
        env=environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "watching\n"
    process.send_signal(number)
    assert process.stdout.read() == ""  # until the last of them has gone
    assert process.wait() == -number


def gone() -> str:
    """A process that has ended."""
    process = subprocess.Popen(["sleep", "600"])
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    process.kill()
    process.wait()
    return f"{process.pid}:{fields[19]}"


def another_of_that_number() -> str:
    return f"{os.getpid()}:1"


@pytest.mark.parametrize("named", [gone, another_of_that_number])
def test_a_starter_that_is_gone_already(named) -> None:
    started = subprocess.run(
        [sys.executable, "-c", STARTED], env=environment(**{starter.VARIABLE: named()})
    )
    assert started.returncode == -signal.SIGTERM


@pytest.mark.parametrize("text", ["", "x:y", "1"])
def test_without_a_starter_nothing_ends_it(text: str) -> None:
    started = subprocess.Popen(
        [sys.executable, "-c", STARTED],
        env=environment(**{starter.VARIABLE: text}),
        stdout=subprocess.PIPE,
        text=True,
    )
    assert started.stdout is not None
    assert started.stdout.readline() == "watching\n"
    time.sleep(0.1)
    assert started.poll() is None
    started.kill()
    started.communicate()


def test_a_process_is_not_its_own_starter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(starter.VARIABLE, starter.identity())
    before = len(os.listdir("/proc/self/task"))
    starter.end_with_starter()
    assert len(os.listdir("/proc/self/task")) == before


@pytest.mark.parametrize("words", [[], ["nohup"]])
def test_nohup_holds_off_the_hang_up(words: list[str]) -> None:
    told = "import signal; from husky_runtime import starter; print(*starter.ending_signals())"
    listed = subprocess.run(
        # This run may itself be below nohup.
        ["env", "--default-signal=HUP", *words, sys.executable, "-c", told],
        env=environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    numbers = [signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM]
    assert listed.stdout.split() == [str(int(n)) for n in numbers if not words or n != 1]
