"""Husky-beta's legs become arms while others stand: one, two; and all four in a leap."""

from __future__ import annotations

import argparse
import math

from husky_control.modes.balance_steps import legs_of
from husky_description.robot import LEG_NAMES, load_robot
from husky_experiments.figures.dynamic_morph import dynamic_morph_figure
from husky_experiments.metrics.dynamic_morph import balancing
from husky_experiments.metrics.leap import leap_of
from husky_experiments.metrics.propulsion import Span
from husky_experiments.morph_scripts import beta_settings, land
from husky_experiments.run import Run
from husky_experiments.scripts import ready_fans, stand_up
from husky_experiments.session import Session

_CONTROLLER = "low_level_controller"
_ONE, _TWO = 8.0, 14.0
"""Time until one leg is an arm, and two are, and the body has leaned [s]."""
_BACK = 20.0
"""Within which all feet must be down again [s]."""
_AT_REST = 3.0
"""Longest time that the body may sway before it begins [s]."""
_LEAP, _HOLD = 5.0, 5.0
"""Within which the leap must have become a flight, and time of the hold [s]."""
_FOUR = 6


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare legs, time of the hold and seed."""
    parser.add_argument(
        "--legs",
        type=int,
        nargs="+",
        choices=range(_FOUR + 1),
        default=[0, 1, 2, 3, 4, _FOUR],
        help="one after the other: 0 to 3 one leg, 4 and 5 a diagonal, 6 the leap, which ends it",
    )
    parser.add_argument("--hold", type=float, default=3.0, help="time of legs as arms [s]")
    parser.add_argument("--seed", type=int, default=1, help="of all sensor noise")


def run(run: Run) -> None:
    """Each leg an arm and a leg again, the body level, other propellers off; the leap flies on."""
    options, robot = run.options, load_robot("beta")
    settings = beta_settings(options.seed)
    spans: list[tuple[int, Span]] = []
    leapt: Span | None = None
    with run.session(settings, expected=10.0 + 16.0 * len(options.legs)) as session:
        stand_up(session)
        session.advance(1.0)
        for choice in options.legs:
            ready_fans(session)
            if choice == _FOUR:
                leapt = leap(session)
                break
            spans.append((choice, there_and_back(session, choice, options.hold)))
    recording = run.recording()
    run.metrics["morphs"] = len(spans)
    morphs = []
    for choice, (start, end) in spans:
        legs = legs_of(choice)
        morph = balancing(recording, robot, legs, start, end)
        morphs.append(morph)
        name = "_".join(LEG_NAMES[leg] for leg in legs)
        off = [leg for leg in range(4) if leg not in legs]
        run.require(f"{name}_arms_s", morph.arms(legs), lower=options.hold)
        run.require(f"{name}_tilt_max_deg", math.degrees(morph.tilt.max()), upper=4.0)
        run.require(f"{name}_yaw_max_deg", math.degrees(abs(morph.yaw).max()), upper=3.0)
        run.require(f"{name}_others_thrust_max_n", float(morph.thrust[:, off].max()), upper=0.3)
        run.metrics[f"{name}_thrust_max_n"] = float(morph.thrust.max())
        run.metrics[f"{name}_least_inside_m"] = float(morph.inside.min())
        run.metrics[f"{name}_arm_rate_degps"] = math.degrees(min(map(morph.rate, legs)))
    if leapt is not None:
        run.metrics |= leap_of(recording, robot, *leapt).metrics
        run.require("leap_perch_lowest_m", lower=0.02)
        run.require("leap_landing_tilt_deg", upper=10.0)
    run.illustrate()
    if not options.no_figures and morphs:
        dynamic_morph_figure(morphs, recording, run.output / "figures")


def there_and_back(session: Session, choice: int, hold: float) -> Span:
    """Make arms of some legs, hold, stand again, propellers off; return when."""
    session.set_parameter(_CONTROLLER, "balance.legs", float(choice))
    start = session.time
    session.set_mode("balance", patience=_AT_REST)
    session.advance((_ONE if choice < 4 else _TWO) + hold)
    session.set_mode("stand", within=_BACK)
    session.advance(0.5)
    end = session.time
    session.arm(False)
    return start, end


def leap(session: Session) -> Span:
    """Leap, hold, land on the perch; return when it was asked to leap, and when to land."""
    start = session.time
    session.set_mode("leap", reached="quadrotor", within=_LEAP, patience=_AT_REST)
    session.advance(_HOLD)
    end = session.time
    land(session)
    return start, end
