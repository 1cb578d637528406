"""`scripts/experiment.sh NAME [--option value ...]`."""

from __future__ import annotations

import errno
import os
import sys

from husky_bringup.front import end_by_signals
from husky_experiments import catalogue as experiments
from husky_experiments.options import parse_options
from husky_experiments.run import Run
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
    options = parse_options(name, arguments[1:])
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
