"""The same seed twice over the full process graph gives the same trajectory, bit for bit."""

from __future__ import annotations

import argparse

from husky_experiments.run import Run
from husky_experiments.scripts import sit_down, stand_up, stop_walking, walk_with_pushes


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare duration, repetitions and seed."""
    parser.add_argument("--duration", type=float, default=8.0, help="time to trot [s]")
    parser.add_argument("--repeat", type=int, default=2, help="runs with the same seed")
    parser.add_argument("--seed", type=int, default=0, help="of sensor noise and pushes")


def run(run: Run) -> None:
    """Equal digests for one seed, another digest for another seed."""
    options = run.options
    seeds = [options.seed] * options.repeat + [options.seed + 1]
    digests = []
    for number, seed in enumerate(seeds):
        with run.session(
            {"plant": {"seed": seed}}, label=f"run_{number}", expected=options.duration + 10
        ) as session:
            stand_up(session)
            session.set_gait("trot")
            walk_with_pushes(session, options.duration, (0.5, 0.0, 0.0), 3.0, 4.0, seed)
            stop_walking(session)
            sit_down(session)
            digests.append(session.trajectory_sha256)
    run.metrics["trajectory_sha256"] = digests[0]
    run.metrics["all_sha256"] = digests
    run.require("different_digests_of_one_seed", len(set(digests[:-1])), lower=1, upper=1)
    run.require("other_seed_differs", int(digests[-1] != digests[0]), lower=1)
