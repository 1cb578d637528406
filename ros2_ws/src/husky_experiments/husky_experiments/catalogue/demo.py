"""The whole robot in a minute: stand up, trot 5 m, sit down."""

from __future__ import annotations

import argparse

from husky_experiments.metrics import walking as metrics
from husky_experiments.run import Run
from husky_experiments.scripts import finish, stand_up, walk

_SPEED = 0.5
"""Forward speed [m/s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare distance and seed."""
    parser.add_argument("--distance", type=float, default=5.0, help="how far to trot [m]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No fall, and the distance walked."""
    options = run.options
    duration = options.distance / _SPEED + 0.6
    with run.session({"plant": {"seed": options.seed}}, expected=duration + 9) as session:
        run.say("standing up")
        stand_up(session)
        run.say(f"trotting {options.distance:g} m at {_SPEED:g} m/s")
        session.set_gait("trot")
        start = session.time
        walk(session, duration, (_SPEED, 0.0, 0.0))
        end = session.time
        run.say("sitting down")
        falls = finish(session)
    run.metrics |= metrics.summary(run.recording(), run.robot(), start, end)
    run.require("falls", falls, upper=0)
    run.require("distance_m", lower=0.9 * options.distance)
    run.illustrate()
    shown = [f"{run.results}/figures/*.png"]
    if (run.output / "video.mp4").exists():
        shown.insert(0, f"{run.results}/video.mp4")
    run.hint(
        f"look:  {' and '.join(shown)}",
        f"open:  {run.results}/bag in Foxglove or PlotJuggler",
        "next:  scripts/experiment.sh                (all experiments)",
        "       scripts/bringup.sh                   (the robot in real time; in a second shell:)",
        "       . scripts/env.sh && ros2 topic list && ros2 run husky_bringup teleop",
    )
