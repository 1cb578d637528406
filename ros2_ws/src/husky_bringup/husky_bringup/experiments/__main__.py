"""`scripts/experiment.sh NAME [--option value ...]`."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from husky_bringup import experiments
from husky_bringup.bringup import add_set_option
from husky_bringup.run import Run
from husky_bringup.session import SessionError


def main(arguments: list[str]) -> int:
    """Run one experiment; return 0 only when its criteria hold."""
    if not arguments or arguments[0] in ("-h", "--help", "list"):
        print("usage: scripts/experiment.sh NAME [--option value ...]\n")
        for name in experiments.names():
            summary = (experiments.find(name).__doc__ or "").splitlines()[0]
            print(f"  {name:<14} {summary}")
        return 0 if arguments else 2
    name = arguments[0]
    try:
        experiment = experiments.find(name)
    except LookupError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    parser = argparse.ArgumentParser(
        prog=f"scripts/experiment.sh {name}", description=experiment.__doc__
    )
    # A run that is ended from outside ends its nodes too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    parser.add_argument("--output", type=Path, default=Path("out") / name, help="result directory")
    parser.add_argument("--no-video", action="store_true", help="do not render a video")
    parser.add_argument("--no-figures", action="store_true", help="do not draw figures")
    add_set_option(parser, "after the experiment's own parameters; may be given many times")
    experiment.add_options(parser)
    try:
        run = Run(name, parser.parse_args(arguments[1:]))
    except OSError as error:
        print(f"error: --output: {error}", file=sys.stderr)
        return 2
    try:
        experiment.run(run)
    except SessionError as error:
        run.fail(str(error))
    return run.finish()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
