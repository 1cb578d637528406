"""Campaigns: the engine's time beside the same commands by hand, two workers beside one."""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from husky_bringup.settings import HelpFormatter
from husky_experiments import campaign
from husky_experiments.campaign.campaign_file import read_campaign
from husky_experiments.campaign.execution import read_result, start_experiment
from husky_runtime.domain_locks import free_domain


def bench(arguments: list[str]) -> dict[str, Any]:
    """Overhead of a run in a campaign over the command by hand; runs an hour of two workers."""
    parser = argparse.ArgumentParser(
        prog="scripts/bench.sh campaign", formatter_class=HelpFormatter
    )
    parser.add_argument("--runs", type=int, default=6, help="of each campaign")
    parser.add_argument("--rounds", type=int, default=2, help="by hand, one worker, two workers")
    parser.add_argument("--duration", type=float, default=2.0, help="of the trot of each run [s]")
    options = parser.parse_args(arguments)
    matrix = {"duration": options.duration, "seed": {"from": 0, "to": options.runs - 1}}
    content = {"experiment": "trot", "matrix": matrix, "retry": "never", "keep": "none"}
    ways: dict[str, Callable[[Path], list[str]]] = {
        "by_hand": lambda directory: _by_hand(content, directory),
        "one": lambda directory: _campaign(content, directory, 1),
        "two": lambda directory: _campaign(content, directory, 2),
    }
    seconds: dict[str, list[float]] = {way: [] for way in ways}
    digests: list[list[str]] = []
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(options.rounds):
            for way, carry_out in ways.items():
                begun = time.perf_counter()
                digests.append(carry_out(Path(scratch) / f"{way}_{number}"))
                seconds[way].append((time.perf_counter() - begun) / options.runs)
                print(f"  {way}: {seconds[way][-1]:.1f} s a run", flush=True)
    by_hand, one, two = (median(seconds[way]) for way in ways)
    return {
        "overhead_s_per_run": one - by_hand,
        "two_workers_over_one": one / two,
        **{f"runs_per_hour_{way}": 3600.0 / median(times) for way, times in seconds.items()},
        "different_results": sum(each != digests[0] for each in digests),
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


def _campaign(content: dict[str, Any], directory: Path, workers: int) -> list[str]:
    """Run them as a campaign; return the digest of each trajectory."""
    table = campaign.run(content, output=directory, workers=workers, quiet=True)
    return [str(digest) for digest in table["trajectory_sha256"]]
