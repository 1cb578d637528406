"""`scripts/experiment.sh NAME [--option value ...]`."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from pathlib import Path

from husky_bringup.bringup import add_bus_option
from husky_bringup.front import end_by_signals
from husky_bringup.settings import HelpFormatter, add_set_option, collect
from husky_experiments import catalogue as experiments
from husky_experiments.run import Run, frame_frequency
from husky_experiments.session import SessionError
from husky_runtime import graph
from husky_runtime.domain_locks import domain_of, occupants, occupied
from husky_runtime.numba_cache import seal_numba_cache

_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
"""Errors of a disk that takes no more: an experiment without its data cannot judge."""


def main(arguments: list[str]) -> int:
    """Run one experiment; return 0 only when its criteria hold."""
    if not arguments or arguments[0] in ("-h", "--help", "list"):
        print("usage: scripts/experiment.sh NAME [--option value ...]\n")
        for name in experiments.names():
            summary = (experiments.find(name).__doc__ or "").partition("\n")[0]
            print(f"  {name:<14} {summary}")
        return 0
    name = arguments[0]
    try:
        experiment = experiments.find(name)
    except LookupError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    seal_numba_cache()
    parser = argparse.ArgumentParser(
        prog=f"scripts/experiment.sh {name}",
        description=experiment.__doc__,
        formatter_class=HelpFormatter,
        conflict_handler="resolve",  # an experiment may take other values of an option
    )
    parser.add_argument("--output", type=Path, default=Path("out") / name, help="result directory")
    parser.add_argument("--no-video", action="store_true", help="do not render a video")
    parser.add_argument("--no-figures", action="store_true", help="do not draw figures")
    parser.add_argument(
        "--compliance",
        type=frame_frequency,
        metavar="HZ",
        help="eigenfrequency of the frame, 10 to 40, 0 for stiff (default: the robot's file)",
    )
    add_bus_option(parser)
    add_set_option(parser, "after the experiment's own parameters; may be given many times")
    experiment.add_options(parser)
    options = parser.parse_args(arguments[1:])
    plant = collect(options.set).get(graph.PLANT, {})
    if options.compliance is not None and "frame_frequency" in plant:
        parser.error("argument --compliance: --set plant.frame_frequency is given too")
    try:
        # Before the results of an earlier run are cleared away: it may still be running.
        domain = domain_of(os.environ)
        if running := occupants(graph.NODES, domain, os.environ):
            raise occupied(domain, running)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    try:
        run = Run(name, options)
    except OSError as error:
        print(f"error: --output: {error}", file=sys.stderr)
        return 2
    with run:
        try:
            experiment.run(run)
        except SessionError as error:
            run.fail(str(error))
        except OSError as error:
            if error.errno not in _DISK:
                raise
            run.fail(f"{error.filename or run.output}: {error.strerror}")
        return run.finish()


if __name__ == "__main__":
    end_by_signals()
    sys.exit(main(sys.argv[1:]))
