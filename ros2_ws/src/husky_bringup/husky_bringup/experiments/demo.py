"""The whole robot in a minute: stand up, trot 5 m, sit down."""

from __future__ import annotations

import argparse

from husky_bringup import metrics
from husky_bringup.run import Run
from husky_bringup.scripts import finish, stand_up, walk

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
        run.metrics["trajectory_sha256"] = session.trajectory_sha256
    recording = run.recording()
    run.metrics |= metrics.summary(recording, run.robot(), start, end)
    run.metrics["distance_m"] = metrics.distance(recording, start, end)
    run.require("falls", falls, upper=0)
    run.require("distance_m", run.metrics["distance_m"], lower=0.9 * options.distance)
    run.illustrate()
    run.hint(
        f"look:  {run.output}/video.mp4 and {run.output}/figures/*.png",
        f"open:  {run.output}/bag in Foxglove or PlotJuggler",
        "next:  scripts/experiment.sh                (all experiments)",
        "       scripts/bringup.sh                   (the robot in real time; in a second shell:)",
        "       . scripts/env.sh && ros2 topic list && ros2 run husky_bringup teleop",
    )
