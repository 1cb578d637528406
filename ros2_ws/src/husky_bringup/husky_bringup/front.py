"""`python -m husky_bringup.front [-m MODULE | FILE] ...`: a program as the scripts run it.

A signal ends it with one line and exit code 128 + n, from its first import on, and what it has
started ends with it: by `with` and `finally`, and where it is killed because it is gone. It ends
itself when the script that has started it is gone.
"""

from __future__ import annotations

import os
import runpy
import select
import signal
import sys
from types import FrameType

from husky_runtime import starter


def end_by_signals() -> None:
    """From now on SIGHUP, SIGINT, SIGQUIT and SIGTERM raise SystemExit with 128 + n in the main
    thread, after one line; and this process ends with its starter, as its own children with it.

    Every such signal raises, not only the first: where an exception cannot get out, the next does.
    Where none comes, `end_if_asked` does.
    """
    for number in starter.ending_signals():
        signal.signal(number, _end)
    starter.end_with_starter()
    os.environ[starter.VARIABLE] = starter.identity()


def _end(number: int, frame: FrameType | None) -> None:
    starter.asked_to_end.append(number)
    name = signal.Signals(number).name
    # Not by `print`: the signal may have come in the middle of one.
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, f"ended by {name}\n".encode())
    raise SystemExit(128 + number)


def end_if_asked() -> None:
    """Raise SystemExit if a signal has come: its exception may have got lost in an extension that
    calls back into Python, or in a destructor.
    """
    if starter.asked_to_end:
        raise SystemExit(128 + starter.asked_to_end[-1])


def _is_read(pipe: int) -> bool:
    """Return whether a pipe still has a reader; before `| head` standard output soon has none."""
    poller = select.poll()
    poller.register(pipe, 0)
    return not any(event & select.POLLERR for _, event in poller.poll(0))


def main() -> None:
    """Run the module or file that the command line names."""
    arguments = sys.argv[1:]
    end_by_signals()
    try:
        if arguments[0] == "-m":
            sys.argv = arguments[1:]
            runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
        else:
            sys.argv = arguments
            if not sys.flags.safe_path:
                del sys.path[0]
            sys.path.insert(0, os.path.dirname(os.path.abspath(arguments[0])))
            runpy.run_path(arguments[0], run_name="__main__")
        sys.stdout.flush()
    except BrokenPipeError:
        if not _is_read(sys.stdout.fileno()):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise SystemExit(128 + signal.SIGPIPE) from None
        raise
    finally:
        end_if_asked()


if __name__ == "__main__":
    main()
