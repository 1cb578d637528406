"""Trot straight ahead with sensor noise and lateral pushes."""

from __future__ import annotations

import argparse

from husky_experiments.metrics import walking as metrics
from husky_experiments.run import Run
from husky_experiments.scripts import finish, stand_up, walk, walk_with_pushes

_SETTLING = 3.0
"""Time to reach the speed, not measured [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare speed, duration, seed and pushes."""
    parser.add_argument("--speed", type=float, default=0.5, help="forward speed [m/s]")
    parser.add_argument("--duration", type=float, default=60.0, help="measured time [s]")
    parser.add_argument("--seed", type=int, default=0, help="of sensor noise and pushes")
    parser.add_argument(
        "--push-impulse",
        type=float,
        help="lateral push [N s]; by default 3, and 0 above 1 m/s",
    )
    parser.add_argument("--push-period", type=float, default=4.0, help="time between pushes [s]")


def run(run: Run) -> None:
    """No fall, speed within 5 %, roll and pitch small."""
    options = run.options
    impulse = options.push_impulse
    if impulse is None:
        impulse = 3.0 if options.speed <= 1.0 else 0.0
    velocity = (options.speed, 0.0, 0.0)
    with run.session(
        {"plant": {"seed": options.seed}}, expected=options.duration + _SETTLING + 10
    ) as session:
        stand_up(session)
        session.set_gait("trot")
        walk(session, _SETTLING, velocity)
        start = session.time
        walk_with_pushes(
            session, options.duration, velocity, impulse, options.push_period, options.seed
        )
        end = session.time
        falls = finish(session)
    run.metrics |= {"push_impulse_ns": impulse}
    run.metrics |= metrics.summary(run.recording(), run.robot(), start, end)
    run.require("falls", falls, upper=0)
    if options.speed > 0.0:
        run.require("mean_speed", lower=0.95 * options.speed, upper=1.05 * options.speed)
    run.require("roll_rms_deg", upper=2.0)
    run.require("pitch_rms_deg", upper=1.5)
    run.illustrate()
