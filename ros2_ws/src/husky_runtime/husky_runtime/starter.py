"""The process that has started this one: who is started by a script ends with it, however it ends.

A starter names itself in the environment, by number and start time. That reaches a process through
whatever lies between, `ros2 run` say, which neither hands signals on nor keeps descriptors open.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import threading
from pathlib import Path

VARIABLE = "HUSKY_STARTER"
"""Environment variable that holds `identity()` of the starter."""
END_PERIOD = 2.5
"""Wall time that a process takes at most to end when its starter is gone [s]."""

asked_to_end: list[int] = []
"""Signals that have asked this process to end: what it has started is ended sooner then."""


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that ask a program to end: without SIGHUP under `nohup`."""
    asked = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM)
    held_off = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return asked[1:] if held_off else asked


def identity() -> str:
    """Return what tells this process from every other one, also from one of its number later."""
    return f"{os.getpid()}:{_start_time(os.getpid())}"


def end_with_starter() -> None:
    """From now on end this process when the one that the environment names is gone: by SIGTERM,
    and if that takes too long by SIGALRM.

    A starter that is this process itself, or that is not named, or that cannot be watched because
    it lives in another container, is none.
    """
    number, _, start = os.environ.get(VARIABLE, "").partition(":")
    if not (number.isdecimal() and start.isdecimal()) or int(number) == os.getpid():
        return
    try:
        watched = os.pidfd_open(int(number))
    except ProcessLookupError:
        _end()
        return
    except OSError:
        return
    if _start_time(int(number)) != start:
        os.close(watched)
        _end()
        return
    threading.Thread(target=_wait, args=(watched,), name="starter", daemon=True).start()


def _wait(watched: int) -> None:
    poll = select.poll()
    poll.register(watched, select.POLLIN)
    poll.poll()
    os.close(watched)
    _end()


def _end() -> None:
    """End this process, and what it has started itself if it leads a group."""
    # By the kernel, not by Python: whatever this process is busy with.
    signal.setitimer(signal.ITIMER_REAL, END_PERIOD)
    if os.getpgrp() == os.getpid():
        os.killpg(os.getpid(), signal.SIGTERM)
    else:
        os.kill(os.getpid(), signal.SIGTERM)


def _start_time(process: int) -> str:
    """Return when a process was started, in ticks since boot; nothing when it is gone (proc(5))."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[19]
    return ""
