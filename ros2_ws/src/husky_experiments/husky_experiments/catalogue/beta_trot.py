"""Husky-beta trots straight ahead on elastic ground (T18): 12 joints, body, servos (T22)."""

from __future__ import annotations

import argparse

from husky_description.bus_servo import BusServoSection
from husky_description.robot import load_robot
from husky_experiments.metrics import walking as metrics
from husky_experiments.metrics.measures import peak
from husky_experiments.run import Run
from husky_experiments.scripts import finish, stand_up, walk
from husky_sim.scene import CONTACT_PRESETS

_CURRENT_STEP = 0.004
"""Of torque by one count of measured current [N m]."""
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
    """No fall, level, speed within 10 % (blind steps: 20 %), servos within their limit."""
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
    torque = peak(recording.joints.between(start, end).torque)
    run.require("falls", falls, upper=0)
    slack = 0.1 if options.mode == "walk" else 0.2  # nothing makes up for what blind feet slip
    run.require(
        "mean_speed", lower=(1.0 - slack) * options.speed, upper=(1.0 + slack) * options.speed
    )
    run.require("roll_rms_deg", upper=3.0)
    run.require("pitch_rms_deg", upper=3.0)
    run.require("torque_peak_Nm", torque, upper=_torque_bound(robot.bus_servo))
    run.illustrate()


def _torque_bound(servo: BusServoSection) -> float:
    """Return the most torque at the horn of a servo within its current limit [N m].

    Friction adds to what the current makes where the load drives the horn against it.
    """
    # Stall is what the current beyond that without load gives: the rest overcomes friction.
    per_ampere = servo.stall_torque / (servo.stall_current - servo.no_load_current)
    friction = per_ampere * servo.no_load_current
    return servo.torque_limit + friction + _CURRENT_STEP
