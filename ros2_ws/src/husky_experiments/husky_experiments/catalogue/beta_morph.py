"""Husky-beta becomes a quadrotor on its perch, flies, lands, stands again (T19, T20, T22)."""

from __future__ import annotations

import argparse
import math

from husky_control.parameters import table_of
from husky_description.robot import load_robot
from husky_experiments.figures.perch import perch_figure
from husky_experiments.metrics import walking as metrics
from husky_experiments.metrics.hovering import place_above, stray_from, sweep_summary
from husky_experiments.metrics.morph import as_metrics, morph_times, perch_stability
from husky_experiments.metrics.propulsion import Span
from husky_experiments.morph_scripts import (
    become_legged,
    become_perched,
    become_splayed,
    beta_settings,
    land,
    sweep_arms,
    take_off,
)
from husky_experiments.run import Run
from husky_experiments.scripts import stand_up

_STANDING = 1.0
"""Time to stand before the crouch and at the end [s]."""
_TAKE_OFF = 5.0
"""Time that the take-off may take [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare seed, time of the hold and sensing."""
    parser.add_argument("--seed", type=int, default=1, help="of all sensor noise")
    parser.add_argument(
        "--sensing",
        choices=("noisy", "ideal"),
        default="noisy",
        help="ideal: IMU, camera and autopilot err in nothing, and the arms move in the air",
    )
    parser.add_argument("--hold", type=float, default=2.0, help="time in the air [s]")


def run(run: Run) -> None:
    """Perch felt in time, body level and balanced on it, lift-off within 10 s, each way in 6 s."""
    options, robot = run.options, load_robot("beta")
    settings = beta_settings(options.seed, options.sensing)
    swept: Span | None = None
    with run.session(settings, expected=_TAKE_OFF + options.hold + 30.0) as session:
        stand_up(session)
        session.advance(_STANDING)
        become_perched(session)
        become_splayed(session)
        take_off(session)
        took_off = session.time
        session.advance(_TAKE_OFF + options.hold)
        if options.sensing == "ideal":
            swept = sweep_arms(session)
        land(session)
        become_legged(session)
        session.advance(_STANDING)
        falls = int(metrics.has_fallen(session.truth, metrics.lowest_upright(robot)))
    recording = run.recording()
    times = morph_times(recording, robot)
    run.metrics |= as_metrics(times)
    stability = perch_stability(recording, robot, times.crouch, times.stand)
    margin, tilt = stability.while_resting(times.crouch, times.stand)
    run.require("falls", falls, upper=0)
    run.require("perch_touched_s", lower=1.5, upper=2.5)
    run.require("perch_felt_s", lower=1.5, upper=2.5)
    run.require("perch_tilt_max_deg", math.degrees(tilt), upper=3.0)
    run.require("perch_margin_min_m", margin, lower=1e-6)
    run.require("morph_to_arms_s", upper=6.0)
    run.require("legs_to_lift_off_s", upper=10.0)
    run.require("morph_to_legs_s", upper=6.0)
    if swept is not None:  # SPIDAR in simulation: 0.10 m
        height = table_of(robot)["quadrotor.height"].default
        place = place_above(recording.base, took_off, height)
        run.metrics |= sweep_summary(stray_from(recording.base, place, swept))
        run.require("sweep_position_error_max_m", upper=0.08)
    run.illustrate()
    if not options.no_figures:
        perch_figure(stability, times, recording, run.output / "figures")
