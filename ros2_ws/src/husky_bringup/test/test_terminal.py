"""The terminal gives single keys, and is left as it was found however the process ends."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from husky_bringup.terminal import Terminal

SOURCES = Path(__file__).resolve().parents[1]
CHILD = """
import signal, sys, time
from husky_bringup.terminal import Terminal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
terminal = Terminal.open()
print("ready" if terminal else "none", flush=True)
while terminal:
    for key in terminal.read():
        if key == "!":
            raise RuntimeError("a bug")
        if key == ".":
            sys.exit(0)
        print(f"<{key}>", flush=True)
    time.sleep(0.01)
"""


class Child:
    """A process with a terminal of its own."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        self.before = termios.tcgetattr(self.slave)
        self.seen = ""
        self.process = subprocess.Popen(
            [sys.executable, "-c", CHILD],
            stdin=self.slave,
            stdout=self.slave,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": f"{SOURCES}:{os.environ.get('PYTHONPATH', '')}"},
            start_new_session=True,
            preexec_fn=lambda: os.close(os.open(os.ttyname(0), os.O_RDWR)),
        )
        self.until("ready")

    def until(self, text: str) -> None:
        deadline = time.monotonic() + 30.0
        while text not in self.seen:
            assert time.monotonic() < deadline, f"waited for {text!r}, saw {self.seen!r}"
            if select.select([self.master], [], [], 0.1)[0]:
                self.seen += os.read(self.master, 1024).decode()

    def type(self, text: str) -> None:
        os.write(self.master, text.encode())

    @property
    def line_mode(self) -> bool:
        return bool(termios.tcgetattr(self.slave)[3] & termios.ICANON)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def child() -> Iterator[Child]:
    child = Child()
    yield child
    child.close()


def test_keys_come_one_by_one(child: Child) -> None:
    assert not child.line_mode
    child.type("w")
    child.until("<w>")
    child.type("ab")
    child.until("<a>\r\n<b>")
    assert "\nw" not in child.seen, "no echo"


@pytest.mark.parametrize(("key", "code"), [(".", 0), ("!", 1)])
def test_it_is_restored_when_the_process_ends(child: Child, key: str, code: int) -> None:
    child.type(key)
    assert child.process.wait(30.0) == code
    assert termios.tcgetattr(child.slave) == child.before


def test_ctrl_c_still_interrupts_and_restores(child: Child) -> None:
    for _ in range(3):  # Python may swallow an interrupt that comes amid a destructor
        child.type("\x03")
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.process.wait(10.0)
            break
    assert child.process.poll() in (1, 130, -signal.SIGINT)
    assert termios.tcgetattr(child.slave) == child.before


def test_ctrl_z_gives_the_terminal_back_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = pty.openpty()
    stops = []

    def line_mode() -> bool:
        return bool(termios.tcgetattr(slave)[3] & termios.ICANON)

    def stop(process: int, number: int) -> None:
        stops.append((process, number, line_mode(), signal.getsignal(number)))

    handler = signal.getsignal(signal.SIGTSTP)
    terminal = Terminal(slave)
    try:
        assert not line_mode()
        with monkeypatch.context() as patched:
            patched.setattr(os, "kill", stop)
            signal.raise_signal(signal.SIGTSTP)
        assert stops == [(os.getpid(), signal.SIGTSTP, True, signal.SIG_DFL)]
        assert not line_mode()
    finally:
        terminal.restore()
    assert line_mode()
    assert signal.getsignal(signal.SIGTSTP) == handler
    terminal.restore()
    os.close(master)
    os.close(slave)


def test_no_terminal_no_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path("/dev/null").open() as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        assert Terminal.open() is None
