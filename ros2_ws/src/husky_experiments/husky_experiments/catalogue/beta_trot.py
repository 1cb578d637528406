"""Husky-beta trots straight ahead on elastic ground (T18): 12 joints, body, servos (T22)."""

from __future__ import annotations

import argparse

from husky_description.robot import load_robot
from husky_experiments.metrics import walking as metrics
from husky_experiments.metrics.measures import peak, share_above
from husky_experiments.run import Run
from husky_experiments.scripts import finish, stand_up, walk
from husky_sim.scene import CONTACT_PRESETS

_AT_LIMIT = 0.98
"""Share of a servo's torque limit from which on it counts as at its limit: more it cannot give."""
_SHARE_AT_LIMIT = 1e-3
"""Most of the time for which any one servo may be there [-]."""
_SETTLING = 2.0
"""Time to reach the speed, not measured [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare speed, duration, seed, ground and what leads the feet."""
    parser.add_argument(
        "--mode",
        choices=("walk", "position_trot"),
        default="walk",
        help="steps led by what the feet feel, or by positions alone (T18)",
    )
    parser.add_argument("--speed", type=float, default=0.3, help="forward speed [m/s]")
    parser.add_argument("--duration", type=float, default=20.0, help="measured time [s]")
    parser.add_argument("--seed", type=int, default=1, help="of all sensor noise")
    parser.add_argument(
        "--contact", choices=CONTACT_PRESETS, default="stiff", help="the ground (T27)"
    )


def run(run: Run) -> None:
    """No fall, level, speed within 10 % (blind steps: 20 %), servos hardly ever at their limit."""
    options, robot = run.options, load_robot("beta")
    plant = {
        "robot": "beta",
        "body": "robot",
        "contact": options.contact,
        "seed": options.seed,
    }
    with run.session({"plant": plant}, expected=options.duration + _SETTLING + 10) as session:
        stand_up(session)
        session.set_gait("trot")
        velocity = (options.speed, 0.0, 0.0)
        walk(session, _SETTLING, velocity, mode=options.mode)
        start = session.time
        walk(session, options.duration, velocity, mode=options.mode)
        end = session.time
        falls = finish(session, metrics.lowest_upright(robot))
    recording = run.recording()
    run.metrics |= metrics.summary(recording, robot, start, end)
    torque, limit = recording.joints.between(start, end).torque, robot.bus_servo.torque_limit
    run.metrics["torque_peak_Nm"] = peak(torque)
    at_limit = max(share_above(of_joint, _AT_LIMIT * limit) for of_joint in torque.T)
    run.require("falls", falls, upper=0)
    slack = 0.1 if options.mode == "walk" else 0.2  # nothing makes up for what blind feet slip
    run.require(
        "mean_speed", lower=(1.0 - slack) * options.speed, upper=(1.0 + slack) * options.speed
    )
    run.require("roll_rms_deg", upper=3.0)
    run.require("pitch_rms_deg", upper=3.0)
    run.require("torque_at_limit_share", at_limit, upper=_SHARE_AT_LIMIT)
    run.illustrate()
