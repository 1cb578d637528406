"""Trot in place: what drifts, and whether it falls."""

from __future__ import annotations

import argparse

from husky_experiments.metrics import walking as metrics
from husky_experiments.run import Run
from husky_experiments.scripts import finish, stand_up, walk


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare duration and seed."""
    parser.add_argument("--duration", type=float, default=60.0, help="time to trot [s]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No fall, drift at most 0.2 m."""
    options = run.options
    with run.session({"plant": {"seed": options.seed}}, expected=options.duration + 10) as session:
        stand_up(session)
        session.set_gait("trot")
        start = session.time
        walk(session, options.duration, (0.0, 0.0, 0.0))
        end = session.time
        falls = finish(session)
    run.metrics |= metrics.summary(run.recording(), run.robot(), start, end)
    run.require("falls", falls, upper=0)
    run.require("drift_m", upper=0.2)
    run.illustrate()
