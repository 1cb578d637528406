"""Trot with and without a share of the weight on the fans, pushed from the side (T40)."""

from __future__ import annotations

import argparse
from typing import Any

from husky_experiments.metrics import walking as metrics
from husky_experiments.run import Run
from husky_experiments.scripts import finish_assisted, stand_assisted, walk, walk_with_pushes

_SETTLING = 3.0
"""Time to reach the speed, not measured [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare thrust, speed, duration, seed and pushes."""
    parser.add_argument("--thrust", type=float, default=0.4, help="share of the weight on the fans")
    parser.add_argument("--speed", type=float, default=0.3, help="forward speed [m/s]")
    parser.add_argument("--duration", type=float, default=20.0, help="measured time of each [s]")
    parser.add_argument("--seed", type=int, default=0, help="of sensor noise and pushes")
    parser.add_argument("--push-impulse", type=float, default=6.0, help="lateral push [N s]")
    parser.add_argument("--push-period", type=float, default=4.0, help="time between pushes [s]")


def run(run: Run) -> None:
    """Knees relieved by a quarter, no fall, roll not worse."""
    bare = _trot(run, "without", 0.0)
    assisted = _trot(run, "assisted", run.options.thrust)
    for name, result in (("without", bare), ("assisted", assisted)):
        run.metrics[name] = result
    knee, before = assisted["torque_rms_knee_Nm"], bare["torque_rms_knee_Nm"]
    run.metrics["knee_torque_saved"] = 1.0 - knee / before
    run.require("falls", bare["falls"] + assisted["falls"], upper=0)
    if run.options.thrust >= 0.4:
        run.require("knee_torque_saved", lower=0.25)
    run.require("roll_rms_ratio", assisted["roll_rms_deg"] / bare["roll_rms_deg"], upper=1.0)
    run.illustrate("assisted")


def _trot(run: Run, label: str, thrust: float) -> dict[str, Any]:
    options = run.options
    velocity = (options.speed, 0.0, 0.0)
    run.say(f"the fans carry {100 * thrust:.0f} % of the weight")
    with run.session(
        {"plant": {"seed": options.seed, "body": "robot_with_unit"}},
        label=label,
        expected=options.duration + _SETTLING + 20,
    ) as session:
        stand_assisted(session, thrust)
        walk(session, _SETTLING, velocity)
        start = session.time
        walk_with_pushes(
            session,
            options.duration,
            velocity,
            options.push_impulse,
            options.push_period,
            options.seed,
        )
        end = session.time
        falls = finish_assisted(session)
        digest = session.trajectory_sha256
    result = metrics.summary(run.recording(label), run.robot(), start, end)
    return {**result, "falls": falls, "thrust": thrust, "trajectory_sha256": digest}
