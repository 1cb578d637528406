"""A world that waits for a process beside the graph waits for its work, and for nothing else."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator

import pytest
from starvation import Beside

from husky_runtime.processor_time import processor_time

WORK = 0.2
"""Of a processor, in answer to a line [s]."""
WORKS = f"""
import sys, time
for line in sys.stdin:
    until = time.thread_time() + {WORK}
    while time.thread_time() < until:
        pass
    print("done", flush=True)
"""
IDLES = "print(input())"
NEVER_RESTS = """
import threading, time
threading.Thread(target=time.sleep, args=(3600.0,), daemon=True).start()
while True:
    pass
"""


class World:
    """As a session's: it goes on at once."""

    def __init__(self) -> None:
        self.time = 0.0

    def advance(self, duration: float) -> None:
        self.time += duration


@contextlib.contextmanager
def running(code: str) -> Iterator[subprocess.Popen[str]]:
    """A process that does this."""
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def busy_machine() -> Iterator[None]:
    """More processes that work than there are processors."""
    with contextlib.ExitStack() as stack:
        for _ in range(4):
            stack.enter_context(running(NEVER_RESTS))
        yield


def test_it_waits_while_the_process_does_what_it_has_been_asked(busy_machine: None) -> None:
    world = World()
    with running(WORKS) as process:
        assert process.stdin is not None and process.stdout is not None
        beside = Beside(process.pid)
        beside.advance(world, 1.0)  # what it needs to start
        worked = processor_time(process.pid).worked
        process.stdin.write("work\n")
        process.stdin.flush()
        beside.advance(world, WORK + 0.1)
        assert processor_time(process.pid).worked > worked + 0.9 * WORK
        assert process.stdout.readline() == "done\n"


def test_it_goes_on_beside_a_process_that_never_rests(busy_machine: None) -> None:
    """As soon as that has worked for as long as the world went on."""
    world = World()
    with running(NEVER_RESTS) as process:
        before = processor_time(process.pid).worked
        Beside(process.pid).advance(world, 0.3)
        assert processor_time(process.pid).worked - before >= 0.29
    assert world.time == pytest.approx(0.3)


def test_it_does_not_wait_for_a_process_that_waits_itself() -> None:
    """Be it for a client that does not read, or for nothing any more."""
    world = World()
    with running(IDLES) as process:
        beside = Beside(process.pid)
        beside.advance(world, 1.0)
        worked = processor_time(process.pid).worked
        beside.advance(world, 60.0)
        assert processor_time(process.pid).worked == worked
    beside.advance(world, 60.0)
    assert world.time == pytest.approx(121.0)
