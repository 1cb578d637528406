"""The propulsion unit alone under its gantry, flown by radio: steps in attitude, rope and battery.

Thesis T39. Two ropes hang from the gantry's beam, short enough to keep the unit off the ground: it
begins and ends hanging in them, and they hold it when its operator goes too far. The operator is a
person who sees the unit and has a joystick; sticks go through the radio's SBUS to the autopilot in
STABILIZED, so the ROS side only watches.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from husky_bringup.system import ParameterValue
from husky_description.gantry import GantryOptions
from husky_description.robot import Robot
from husky_experiments.metrics.propulsion import attitude_summary, battery_summary
from husky_experiments.pilot import Pilot, Wish
from husky_experiments.radio_flight import Flight, hanging_height, weight_share
from husky_experiments.run import Run

GANTRY = GantryOptions(height=2.6, rope=1.6)
"""Beam and ropes: the unit hangs with its base 0.89 m above the ground, and has 0.6 m of air to
either side before a rope is taut when it flies 0.3 m higher."""
_FLYING = 0.3
"""Height of flight above hanging [m]."""
_STEP = math.radians(3.5)
_STEP_TIME = 0.7
"""Of a step in roll or pitch [rad, s]; three of them, 1, -2, 1, come back to where they began. They
lead 0.3 m to a side: half of the air before a rope is left to an autopilot whose level is wrong."""
_TURN = math.radians(45.0)
_TURN_RATE = math.radians(25.0)
_TOO_FAR = math.radians(2.5)
"""Roll that the operator holds until a rope is taut, and after that [rad]."""
_TOO_FAR_TIME = 4.0
_AGAINST_ROPE = 0.5


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the length of the holds and the seed."""
    parser.add_argument("--hold", type=float, default=4.0, help="hovering between passages [s]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """Attitude within 1.5 deg, worse at a taut rope; battery as its resistance says."""
    options, robot = run.options, run.robot()
    flight, disarmed = fly(run, options.hold, options.seed)
    for name, (start, end) in flight.passages.items():
        run.say(f"{name}: {start:.2f} s to {end:.2f} s")
    recording, passages = run.recording(), flight.passages
    start, end = flown(flight)
    run.metrics |= attitude_summary(recording, start, end)
    hold = passages["hold"]
    run.metrics |= battery_summary(recording, robot, (start - 2.0, start), (hold[1] - 2.0, hold[1]))
    metrics = run.metrics
    run.require("disarmed_at_the_end", int(disarmed), lower=1)
    run.require("attitude_rms_deg", upper=1.5)
    run.require("attitude_measured_rms_deg", upper=1.5)
    run.require(
        "attitude_rms_taut_deg",
        metrics.get("attitude_rms_taut_deg", math.nan),
        lower=metrics["attitude_rms_deg"],
    )
    run.require("current_rise_a", lower=metrics["current_rise_least_a"])
    run.require("voltage_drop_ratio", lower=0.95, upper=1.05)
    run.require(
        "resistance_ratio",
        metrics["resistance_measured_mohm"] / metrics["resistance_mohm"],
        lower=0.95,
        upper=1.05,
    )
    run.illustrate()


def fly(run: Run, hold: float, seed: int, label: str = "") -> tuple[Flight, bool]:
    """Fly the script, hovering for a while [s] between passages.

    Returns:
        What was flown, and whether the unit was disarmed at the end.
    """
    robot = run.robot()
    settings: dict[str, dict[str, ParameterValue]] = {
        "plant": {
            "seed": seed,
            "body": "unit",
            "keyframe": "stand",
            "gantry": True,
            "gantry_height": GANTRY.height,
            "rope_length": GANTRY.rope,
            "start_height": hanging_height(GANTRY) - standing_height(robot),
        },
        "flight_controller": {"seed": seed},
    }
    expected = 34.0 + 2 * hold
    with run.session(settings, label=label, expected=expected, remote=True) as session:
        flight = Flight(session, Pilot(weight_share(robot)))
        fly_script(flight, hold)
        run.metrics["failsafe"] = session.propulsion.failsafe if session.propulsion else "silent"
        disarmed = session.propulsion is not None and not session.propulsion.armed
    return flight, disarmed


def flown(flight: Flight) -> tuple[float, float]:
    """Return from when to when the unit was armed [s]."""
    return flight.passages["armed"][0], flight.passages["spool_down"][1]


def standing_height(robot: Robot) -> float:
    """Return the height of the unit's base above the ground when it stands on it [m]."""
    return robot.fans.height / 2 - robot.fans.z


def fly_script(flight: Flight, hold: float) -> None:
    """Spool up, hover, steps in roll, pitch and yaw, too far, spool down; hold [s] between them."""
    pilot, none = flight.pilot, Wish(roll=0.0, pitch=0.0, throttle=0.0)
    hanging = hanging_height(GANTRY)
    pilot.place = np.array((0.0, 0.0, hanging + _FLYING))
    flight.fly(3.0, none, name="before")
    pilot.armed = True
    flight.fly(2.0, none, name="armed")
    flight.fly(4.0, name="spool_up")
    flight.fly(hold, name="hold")
    flight.fly(4 * _STEP_TIME, lambda past: Wish(roll=steps(past)), name="roll")
    flight.fly(hold / 2)
    flight.fly(4 * _STEP_TIME, lambda past: Wish(pitch=steps(past)), name="pitch")
    flight.fly(hold / 2)
    for name, side in (("yaw_left", 1.0), ("yaw_right", -1.0)):
        flight.fly(_TURN / _TURN_RATE, Wish(yaw_rate=side * _TURN_RATE), name=name)
        flight.fly(hold / 2)
    too_far = Wish(roll=_TOO_FAR)
    flight.fly(_TOO_FAR_TIME, too_far, name="too_far", until=flight.rope_taut)
    flight.fly(_AGAINST_ROPE, too_far, name="against_rope")
    flight.fly(hold, name="back")
    pilot.place = np.array((0.0, 0.0, hanging - 0.03))
    flight.fly(4.0, name="descent", until=flight.rope_taut)
    flight.fly(2.0, none, name="spool_down")
    pilot.armed = False
    flight.fly(1.0, none, name="disarmed")


def steps(past: float) -> float:
    """Return the tilt of the steps [rad] so long after their beginning [s]: there, twice back,
    there.
    """
    return (1.0, -1.0, -1.0, 1.0)[min(int(past / _STEP_TIME + 1e-6), 3)] * _STEP
