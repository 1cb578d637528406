"""Campaigns: the engine's time beside the same commands by hand, two workers beside one."""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from husky_bringup.settings import HelpFormatter
from husky_experiments import campaign
from husky_experiments.campaign.campaign_file import read_campaign
from husky_experiments.campaign.engine import local_cluster
from husky_experiments.campaign.execution import read_result, start_experiment
from husky_runtime.domain_locks import free_domain


def bench(arguments: list[str]) -> dict[str, Any]:
    """Overhead of a run in a campaign over the command by hand; runs an hour of two workers.

    The ways take turns, and each round is judged by itself: the machine's speed changes.
    """
    parser = argparse.ArgumentParser(
        prog="scripts/bench.sh campaign", formatter_class=HelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5, help="2 runs by hand, 2, and 4 at a time")
    parser.add_argument("--duration", type=float, default=2.0, help="of the trot of each run [s]")
    options = parser.parse_args(arguments)
    seconds: dict[str, list[float]] = {"by_hand": [], "one": [], "two": []}
    digests: list[list[str]] = []
    with (
        tempfile.TemporaryDirectory() as scratch,
        local_cluster(1) as one,
        local_cluster(2) as two,
    ):
        ways: dict[str, tuple[int, Callable[[dict[str, Any], Path], list[str]]]] = {
            "by_hand": (2, _by_hand),
            "one": (2, partial(_campaign, one)),
            "two": (4, partial(_campaign, two)),
        }
        for number in range(options.rounds):
            for way, (runs, carry_out) in ways.items():
                matrix = {"duration": options.duration, "seed": list(range(runs))}
                content = {"experiment": "trot", "matrix": matrix, "retry": "never", "keep": "none"}
                begun = time.perf_counter()
                digests.append(carry_out(content, Path(scratch) / f"{way}_{number}"))
                seconds[way].append((time.perf_counter() - begun) / runs)
                print(f"  {way}: {seconds[way][-1]:.1f} s a run", flush=True)
    by_hand, one_s, two_s = seconds.values()
    return {
        "overhead_s_per_run": median(b - a for a, b in zip(by_hand, one_s, strict=True)),
        "two_workers_over_one": median(a / b for a, b in zip(one_s, two_s, strict=True)),
        **{f"runs_per_hour_{way}": 3600.0 / median(times) for way, times in seconds.items()},
        "different_results": sum(each != digests[-1][: len(each)] for each in digests),
    }


def _by_hand(content: dict[str, Any], directory: Path) -> list[str]:
    """Run the commands one after the other; return the digest of each trajectory."""
    digests = []
    for run in read_campaign(content).runs:
        output = directory / str(run.row)
        with free_domain() as domain:
            start_experiment(
                run, output, domain, illustrated=False, stdout=subprocess.DEVNULL
            ).wait()
        digests.append(read_result(output)["metrics"]["trajectory_sha256"])
    return digests


def _campaign(cluster: Any, content: dict[str, Any], directory: Path) -> list[str]:
    """Run them as a campaign; return the digest of each trajectory."""
    table = campaign.run(content, output=directory, scheduler=cluster, quiet=True)
    return [str(digest) for digest in table["trajectory_sha256"]]
