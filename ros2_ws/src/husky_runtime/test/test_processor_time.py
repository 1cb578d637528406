"""A process that works, one that waits for a processor, one that does nothing."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from husky_runtime.processor_time import processor_time

HERE = Path("/proc/self/schedstat")
pytestmark = pytest.mark.skipif(not HERE.exists(), reason="this kernel does not count")


@pytest.fixture
def busy_loop() -> Iterator[int]:
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    yield process.pid
    process.kill()
    process.wait()


def test_a_loop_works_or_waits_all_the_time(busy_loop):
    """It cannot have had more than the time that has passed, whatever else the machine does."""
    first, before, second = time.monotonic(), processor_time(busy_loop), time.monotonic()
    time.sleep(0.5)
    third, after, fourth = time.monotonic(), processor_time(busy_loop), time.monotonic()
    spent = sum(after) - sum(before)
    # The kernel counts a wait when it ends, and work at its next tick of some milliseconds.
    assert 0.5 * (third - second) < spent < fourth - first + 0.05
    assert after.worked > before.worked


def test_what_it_has_started_works_for_it():
    """Also when that has ended, as far as it was on a processor."""
    child = "import time\nwhile time.thread_time() < 0.2: pass\ninput()"
    code = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {child!r}])\ninput()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE) as process:
        main = Path(f"/proc/{process.pid}/task/{process.pid}")

        def of_child() -> float:
            own = int((main / "schedstat").read_text().split()[0]) / 1e9
            return processor_time(process.pid).worked - own

        while of_child() < 0.18:  # it goes on working, and waits for a line then
            time.sleep(0.01)
        assert (main / "children").read_text()
        process.stdin.write(b"\n")
        process.stdin.flush()
        while (main / "children").read_text():
            time.sleep(0.01)
        assert of_child() > 0.18
        process.communicate(b"\n")


def test_one_that_is_stopped_or_gone_spends_nothing(busy_loop):
    os.kill(busy_loop, signal.SIGSTOP)
    while "T (stopped)" not in Path(f"/proc/{busy_loop}/status").read_text():
        time.sleep(0.01)
    before = processor_time(busy_loop)
    time.sleep(0.2)
    assert processor_time(busy_loop) == before
    os.kill(busy_loop, signal.SIGKILL)
    os.waitpid(busy_loop, 0)
    assert processor_time(busy_loop) == (0.0, 0.0)
