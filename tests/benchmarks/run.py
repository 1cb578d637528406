"""`scripts/bench.sh NAME`: one benchmark, its baseline in the same run; the last line is JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import campaign
import console
import control
import drives
import ethercat
import loop
import mapping
import mavlink
import plan
import plant
import route
import start

from husky_experiments.session import SessionError
from husky_runtime.domain_locks import OccupiedError

BENCHES: dict[str, Callable[[list[str]], dict[str, Any]]] = {
    "loop": loop.bench,
    "start": start.bench,
    "campaign": campaign.bench,
    "mapping": mapping.bench,
    "plan": plan.bench,
    "route": route.bench,
    "plant": plant.bench,
    "control": control.bench,
    "drives": drives.bench,
    "ethercat": ethercat.bench,
    "mavlink": mavlink.bench,
    "console": console.bench,
}


def main(arguments: list[str]) -> int:
    """Run the benchmark that is named first."""
    if not arguments or arguments[0] in ("-h", "--help", "list"):
        print("usage: scripts/bench.sh NAME [--option value ...]\n")
        for name, bench in BENCHES.items():
            print(f"  {name:<8} {(bench.__doc__ or '').partition(chr(10))[0]}")
        return 0
    if arguments[0] not in BENCHES:
        print(f"error: no benchmark {arguments[0]!r}: {', '.join(BENCHES)}", file=sys.stderr)
        return 2
    try:
        metrics = BENCHES[arguments[0]](arguments[1:])
    except (OccupiedError, SessionError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    for key, value in metrics.items():
        print(f"  {key} = {value:.4g}" if isinstance(value, float) else f"  {key} = {value}")
    print(json.dumps({"bench": arguments[0], "metrics": metrics}, allow_nan=False))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
