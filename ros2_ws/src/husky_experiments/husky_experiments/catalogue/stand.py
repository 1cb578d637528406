"""Stand up from sitting, stand for 10 s, sit down."""

from __future__ import annotations

import argparse

from husky_experiments.metrics import walking as metrics
from husky_experiments.run import Run
from husky_experiments.scripts import sit_down, stand_up


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare duration and seed."""
    parser.add_argument("--duration", type=float, default=10.0, help="time to stand [s]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """Height within 1 cm of what the controller wants, drift below 1 cm."""
    duration = run.options.duration
    with run.session({"plant": {"seed": run.options.seed}}, expected=duration + 9) as session:
        stand_up(session)
        start = session.time
        session.advance(duration)
        end = session.time
        sit_down(session)
        session.advance(0.5)
        run.metrics["simulated_s"] = session.time
    recording = run.recording()
    run.metrics |= metrics.summary(recording, run.robot(), start, end)
    run.require("height_error_m", metrics.height_error(recording, start, end), upper=0.01)
    run.require("drift_m", upper=0.01)
    run.illustrate()
