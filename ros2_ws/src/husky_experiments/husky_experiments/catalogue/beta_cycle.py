"""Husky-beta's whole way: trots, takes off, flies over a gap, lands on a step, trots on."""

from __future__ import annotations

import argparse
import math

import numpy as np

from husky_description.robot import Robot, load_robot
from husky_experiments.figures import video
from husky_experiments.figures.cycle import cycle_figure
from husky_experiments.figures.perch import perch_figure
from husky_experiments.figures.stroboscope import Moment, stroboscope
from husky_experiments.gap_course import GapCourse
from husky_experiments.metrics import cycle
from husky_experiments.metrics.morph import MorphTimes, as_metrics, morph_times, perch_stability
from husky_experiments.metrics.walking import lowest_upright
from husky_experiments.morph_scripts import (
    become_legged,
    become_perched,
    become_splayed,
    beta_settings,
    land,
    take_off,
)
from husky_experiments.recordings.recording import Recording
from husky_experiments.run import SCENE_FILE, Run
from husky_experiments.scripts import stand_up
from husky_experiments.session import Session, SessionError
from husky_experiments.steering import FLYING, TROTTING, go_to, place, trot_to
from husky_runtime import graph

_TROT, _FLIGHT = 2.0, 5.0
"""Ways to trot, each time, and to fly [m]."""
_OVER = 0.4
"""Height of the perch over the step in flight [m]."""
_BEHIND_EDGE = 1.0
"""Way behind the step's edge from which on it may land, by its own estimate [m]."""
_CLIMB = 10.0
"""Longest time from the take-off to the height of the flight [s]."""
_NEAR_TOP = 0.05
"""Below the height of the flight at which it sets out [m]."""
_WITHIN = 20.0
"""Longest time that each way may take beyond what its speed asks for [s]."""
_FLIGHT_SHOWN = (0.25, 0.52)
"""Parts of the way through the air at which the picture of all shows the robot."""
_RISING, _SINKING = 1.6, 2.5
"""Times after the lift-off and before the landing at which it does so too [s]."""
_STANDING = 1.0
"""Time to stand before the crouch and at the end [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the seed and the course."""
    course = GapCourse()
    parser.add_argument("--seed", type=int, default=1, help="of all sensor noise")
    parser.add_argument("--gap", type=float, default=course.width, help="its width [m]")
    parser.add_argument("--step", type=float, default=course.step, help="its height [m]")


def run(run: Run) -> None:
    """The whole given way by its own estimate, no fall; morphs in 6 s; landing, time, energy."""
    options, robot = run.options, load_robot("beta")
    course = GapCourse(width=options.gap, step=options.step)
    settings = beta_settings(options.seed, plant=course.plant())
    with run.session(settings, expected=75.0) as session:
        stand_up(session)
        _trot(session)
        session.advance(_STANDING)
        become_perched(session)
        become_splayed(session)
        _fly(session, course)
        become_legged(session)
        session.advance(_STANDING)
        _trot(session)
        session.advance(_STANDING)
    _judge(run, robot, course)


def _trot(session: Session) -> None:
    """Trot ahead, and stand."""
    x, _ = place(session)
    trot_to(session, (x + _TROT, 0.0), _TROT / TROTTING.speed + _WITHIN)


def _fly(session: Session, course: GapCourse) -> None:
    """Take off, cross the gap at a height that clears the step, land behind its edge.

    Raises:
        SessionError: it believes itself not far enough behind the edge to land.
    """
    height = course.step + _OVER
    session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "quadrotor.height", height)
    x, _ = place(session)
    ground = _height(session)
    take_off(session)
    if not session.advance(_CLIMB, lambda: _height(session) > ground + height - _NEAR_TOP):
        raise SessionError(f"it is not {height:g} m up within {_CLIMB:g} s")
    go_to(session, (x + _FLIGHT, 0.0), FLYING, _FLIGHT / FLYING.speed + _WITHIN)
    session.advance(_STANDING)
    here, _ = place(session)
    if here < course.far_edge + _BEHIND_EDGE:
        raise SessionError(f"it must not land at x = {here:.2f} m by its estimate: the gap is near")
    session.release_velocity()
    land(session)


def _height(session: Session) -> float:
    """Return the height of the base by the robot's own estimate [m]."""
    return float(session.state.position[2]) if session.state is not None else math.nan


def _judge(run: Run, robot: Robot, course: GapCourse) -> None:
    """Fill the metrics, state the criteria, draw."""
    recording = run.recording()
    times = morph_times(recording, robot, course.height)
    legs = {leg.name: leg for leg in cycle.legs_of(recording, times)}
    run.metrics |= as_metrics(times)
    for leg in legs.values():
        run.metrics |= cycle.leg_metrics(recording, robot, leg)
    stability = perch_stability(recording, robot, times.crouch, times.stand, course.height)
    margin, tilt = stability.while_resting(times.crouch, times.stand)
    base = recording.base
    trots = legs["trot_out"], legs["trot_on"]
    fallen = cycle.fallen(recording, course.height, trots, lowest_upright(robot))
    run.metrics["estimate_height_error_max_m"] = max(
        cycle.height_error_of_estimate(recording, leg) for leg in trots
    )
    run.require("falls", fallen, upper=0)
    run.require("trot_out_m", lower=0.9 * _TROT, upper=1.1 * _TROT)
    run.require("trot_on_m", lower=0.9 * _TROT, upper=1.1 * _TROT)
    run.require("flight_m", lower=0.95 * _FLIGHT, upper=1.05 * _FLIGHT)
    over = cycle.clearance_at_edge(robot, base, course.far_edge, course.step)
    run.require("clearance_at_step_m", over, lower=0.1)
    run.require("landed_behind_edge_m", _x_at(run, times) - course.far_edge, lower=0.5)
    run.require("sink_speed_mps", cycle.sink_speed(base, times.landed), upper=0.4)
    run.require("perch_tilt_max_deg", math.degrees(tilt), upper=3.0)
    run.require("perch_margin_min_m", margin, lower=1e-6)
    run.require("morph_to_arms_s", upper=6.0)
    run.require("morph_to_legs_s", upper=6.0)
    run.require("estimate_height_error_max_m", upper=0.1)
    run.illustrate()
    if not run.options.no_figures:
        perch_figure(stability, times, recording, run.output / "figures")
        cycle_figure(recording, course, list(legs.values()), run.output / "figures")
    if not run.options.no_video:
        moments = _moments(recording, times, legs)
        model = video.load_scene(run.output / SCENE_FILE)
        stroboscope(recording, model, run.output / "way.png", moments)


def _moments(recording: Recording, times: MorphTimes, legs: dict[str, cycle.Leg]) -> list[Moment]:
    """Return when to show the robot: as it trots, as arms are made and legs again, in flight."""
    out, on = legs["trot_out"], legs["trot_on"]
    crossing = recording.base.between(times.lift_off, times.landed)
    ahead = crossing.position[:, 0]
    flight = [
        float(np.interp(ahead[0] + part * np.ptp(ahead), ahead, crossing.time))
        for part in _FLIGHT_SHOWN
    ]
    return [
        Moment(out.start, "stands"),
        Moment(out.start + 0.5 * out.duration, "trots"),
        Moment(times.armed),
        Moment(times.lift_off + _RISING, "legs are arms"),
        Moment(flight[0]),
        Moment(flight[1], "flies over the gap"),
        Moment(times.landed - _SINKING, "comes down on its perch"),
        Moment(times.landed),
        Moment(on.start + 0.5 * on.duration, "trots on"),
        Moment(on.end, "stands"),
    ]


def _x_at(run: Run, times: MorphTimes) -> float:
    """Return where the robot truly landed, x in world [m]."""
    base = run.recording().base
    return float(np.interp(times.landed, base.time, base.position[:, 0]))
