"""A terminal that gives single keys, and is always left as it was found."""

from __future__ import annotations

import atexit
import contextlib
import os
import select
import signal
import sys
import termios
import tty
from types import FrameType
from typing import Any


class Terminal:
    """Single keys from standard input, not lines. Ctrl-C and Ctrl-Z keep their meaning."""

    def __init__(self, descriptor: int):
        """Switch a terminal to single keys until `restore`, or the end of the process."""
        self._descriptor = descriptor
        self._found: list[Any] | None = termios.tcgetattr(descriptor)
        atexit.register(self.restore)
        self._suspend_handler = signal.signal(signal.SIGTSTP, self._suspend)
        tty.setcbreak(descriptor, termios.TCSADRAIN)

    @staticmethod
    def open() -> Terminal | None:
        """Return the terminal of standard input, None when there is none that we may read."""
        if not sys.stdin.isatty() or os.tcgetpgrp(sys.stdin.fileno()) != os.getpgrp():
            return None
        return Terminal(sys.stdin.fileno())

    def read(self) -> str:
        """Return what has been typed since the last call, at once; nothing when it has gone."""
        ready, _, _ = select.select([self._descriptor], [], [], 0.0)
        try:
            return os.read(self._descriptor, 256).decode("utf-8", "ignore") if ready else ""
        except OSError:
            return ""

    def restore(self) -> None:
        """Leave the terminal as it was found; a second call does nothing."""
        if self._found is None:
            return
        found, self._found = self._found, None
        with contextlib.suppress(termios.error):  # the terminal has been closed
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, found)
        signal.signal(signal.SIGTSTP, self._suspend_handler)
        atexit.unregister(self.restore)

    def _suspend(self, number: int, frame: FrameType | None) -> None:
        """Ctrl-Z: hand the shell a sane terminal, and take it again on return."""
        if self._found is None:
            return
        termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._found)
        signal.signal(signal.SIGTSTP, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTSTP)
        signal.signal(signal.SIGTSTP, self._suspend)
        tty.setcbreak(self._descriptor, termios.TCSADRAIN)
