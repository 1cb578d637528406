"""Fixed point and eigenvalues of the closed loop's return map, on the flat or on a slope (T14)."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from husky_control.gait.stability import fit_return_map
from husky_control.gait.table import GAITS
from husky_experiments.climb_scripts import climb_onto, get_ready, go, has_fallen
from husky_experiments.incline_course import Course, climbing_settings, course_for
from husky_experiments.metrics import walking as metrics
from husky_experiments.metrics.incline import climb_summary
from husky_experiments.metrics.poincare_section import (
    STATE,
    crossings,
    section_states,
    undisturbed_pairs,
    upper_modulus,
)
from husky_experiments.run import Run
from husky_experiments.scripts import finish, push, stand_up, walk

_PUSH = 0.1
"""Duration of a push [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare speed, duration, perturbations and seed."""
    parser.add_argument("--slope", type=float, default=0.0, help="of the ground [deg]")
    parser.add_argument("--speed", type=float, default=0.3, help="forward speed [m/s]")
    parser.add_argument("--duration", type=float, default=150.0, help="time to trot [s]")
    parser.add_argument("--impulse", type=float, default=2.0, help="greatest perturbation [N s]")
    parser.add_argument("--period", type=float, default=1.6, help="between perturbations [s]")
    parser.add_argument("--seed", type=int, default=0, help="of sensor noise and perturbations")


def run(run: Run) -> None:
    """Every eigenvalue surely inside the unit circle, from steps that follow random pushes."""
    options = run.options
    if options.slope == 0.0:
        falls, start, end, pushes = _on_the_flat(run)
        course = None
    else:
        course = course_for(options.slope, 1.3 * options.speed * options.duration, 0.7)
        falls, start, end, pushes = _on_a_slope(run, course)
    recording = run.recording()
    times = crossings(recording, start, end)
    follow = GAITS["trot" if course is None else "climb"].velocity_follow
    states = section_states(recording, times, follow, np.radians(options.slope))
    pairs = undisturbed_pairs(times, np.array(pushes), _PUSH)
    result = fit_return_map(states[pairs], states[pairs + 1])
    upper = upper_modulus(states[pairs], states[pairs + 1])
    moduli = np.abs(result.eigenvalues)
    if course is None:
        run.metrics |= metrics.summary(recording, run.robot(), start, end)
    else:
        run.metrics |= climb_summary(recording, run.robot(), course, start, end)
    run.metrics["steps_used"] = len(pairs)
    run.metrics["fixed_point"] = dict(zip(STATE, result.fixed_point.tolist(), strict=True))
    run.metrics["residual_rms"] = dict(zip(STATE, result.residual.tolist(), strict=True))
    run.metrics["eigenvalue_moduli"] = moduli.tolist()
    run.metrics["eigenvalues"] = [[z.real, z.imag] for z in result.eigenvalues.tolist()]
    run.require("falls", falls, upper=0)
    run.metrics["largest_eigenvalue_modulus"] = float(moduli[0])
    run.require("largest_eigenvalue_modulus_upper", upper, upper=0.999)
    run.illustrate()


def _on_the_flat(run: Run) -> tuple[int, float, float, list[float]]:
    """Trot and push; return falls, first and last time [s], and when it was pushed [s]."""
    options = run.options
    velocity = (options.speed, 0.0, 0.0)
    pushes = []
    with run.session({"plant": {"seed": options.seed}}, expected=options.duration + 12) as session:
        stand_up(session)
        session.set_gait("trot")
        walk(session, 3.0, velocity)
        start = session.time
        for x, y in _impulses(run):
            pushes.append(session.time)
            push(session, (x, y), _PUSH)
            walk(session, options.period, velocity)
            if session.time >= start + options.duration:
                break
        end = session.time
        falls = finish(session)
    return falls, start, end, pushes


def _on_a_slope(run: Run, course: Course) -> tuple[int, float, float, list[float]]:
    """Climb and push along the slope; as `_on_the_flat`."""
    options = run.options
    pushes: list[float] = []
    settings = climbing_settings(course, options.seed)
    with run.session(settings, expected=options.duration + 40) as session:
        get_ready(session)
        stands = climb_onto(session, course, options.speed)
        start = session.time
        for along, y in _impulses(run):
            if not stands or session.time >= start + options.duration:
                break
            pushes.append(session.time)
            force = along / _PUSH * course.uphill
            session.push((float(force[0]), y / _PUSH, float(force[2])), _PUSH)
            stands = go(session, course, options.period, options.speed)
        end = session.time
        falls = int(has_fallen(session, course) or not stands)
    return falls, start, end, pushes


def _impulses(run: Run) -> Iterator[tuple[float, float]]:
    """Yield random pushes, along x (or uphill) and to the left [N s]."""
    random = np.random.default_rng(run.options.seed)
    while True:
        angle, size = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.3, 1.0)
        impulse = size * run.options.impulse
        yield impulse * float(np.cos(angle)), impulse * float(np.sin(angle))
