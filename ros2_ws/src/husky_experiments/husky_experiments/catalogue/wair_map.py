"""Which slopes are climbed on which ground: a map of slope over friction, several seeds each."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from husky_experiments.catalogue.wair import load_slope
from husky_experiments.climb_scripts import climb_onto, get_ready, go
from husky_experiments.figures.incline import friction_map
from husky_experiments.incline_course import climbing_settings, course_for
from husky_experiments.run import Run
from husky_experiments.session import SessionError

_ASKED = 45.0
"""Slope up to which every seed is to climb on any ground [deg]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the grid."""
    parser.add_argument(
        "--frictions", type=float, nargs="+", default=[0.4, 0.7, 1.2, 1.8], help="sliding [-]"
    )
    parser.add_argument(
        "--slopes", type=float, nargs="+", default=[30.0, 45.0, 60.0, 75.0, 90.0], help="[deg]"
    )
    parser.add_argument("--seeds", type=int, default=3, help="how many, from 0")
    parser.add_argument("--speed", type=float, default=0.25, help="along the slope [m/s]")
    parser.add_argument("--duration", type=float, default=5.0, help="on the straight part [s]")
    parser.add_argument("--blend", type=float, default=3.0, help="radius of the slope's foot [m]")


def run(run: Run) -> None:
    """Climb every cell with every seed; beyond a slope that no seed climbs, no steeper one."""
    options = run.options
    frictions, slopes = sorted(options.frictions), sorted(options.slopes)
    climbed: dict[tuple[float, float], int | None] = {}
    for friction in frictions:
        some = True
        for slope in slopes:
            cell = (friction, slope)
            climbed[cell] = None
            if some:
                seeds = range(options.seeds)
                climbed[cell] = sum(_climbs(run, friction, slope, seed) for seed in seeds)
                run.say(f"friction {friction:g}, {slope:g} deg: {climbed[cell]}/{options.seeds}")
            some = bool(climbed[cell])
    run.metrics["climbed"] = {
        f"{friction:g}": {f"{slope:g}": climbed[friction, slope] for slope in slopes}
        for friction in frictions
    }
    asked = max((slope for slope in slopes if slope <= _ASKED), default=slopes[0])
    for friction in frictions:
        reached = climbed_to(climbed, friction, options.seeds)
        run.require(f"climbed_to_deg_friction_{friction:g}", reached, lower=asked)
    if not options.no_figures:
        friction_map(climbed, options.seeds, run.output / "figures")


def climbed_to(
    climbed: Mapping[tuple[float, float], int | None], friction: float, seeds: int
) -> float:
    """Return the slope up to which every seed climbs each slope of one ground [deg], 0 for none.

    Args:
        climbed: seeds that do, by friction and slope [deg]; None where none was tried.
        friction: of the ground.
        seeds: tried on each slope.
    """
    reached = 0.0
    for slope in sorted(slope for ground, slope in climbed if ground == friction):
        if climbed[friction, slope] != seeds:
            break
        reached = slope
    return reached


def _climbs(run: Run, friction: float, slope: float, seed: int) -> bool:
    """Return whether the robot gets onto a slope and walks there."""
    options = run.options
    course = course_for(slope, 1.5 * options.speed * options.duration, friction, options.blend)
    feet = {"wair.load_slope": load_slope("vector", friction)}
    settings = climbing_settings(course, seed, controller=feet)
    label = f"friction_{friction:g}_slope_{slope:g}_seed_{seed}"
    expected = options.duration + 50.0
    with run.session(settings, label=label, expected=expected, record=False) as session:
        try:
            get_ready(session)
        except SessionError as error:  # A robot that does not even stand up does not climb.
            run.say(f"not ready to climb: {error}")
            return False
        reached = climb_onto(session, course, options.speed)
        return reached and go(session, course, options.duration, options.speed)
