"""Measure time and electrical energy of every way of moving: the costs that the navigator plans by.

`costs.csv` of a run is `travel_costs.csv` of husky_navigation; copy it there when the body changes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from husky_bringup.system import ParameterValue
from husky_control.parameters import table_of
from husky_description.robot import load_robot
from husky_experiments.climb_scripts import climb_onto, go, turn_on_top, walk_down
from husky_experiments.incline_course import climbing_settings, course_for
from husky_experiments.metrics.cycle import energy_over
from husky_experiments.metrics.propulsion import Span
from husky_experiments.metrics.walking import has_fallen, lowest_upright
from husky_experiments.morph_scripts import (
    become_legged,
    become_perched,
    become_splayed,
    beta_settings,
    land,
    take_off,
)
from husky_experiments.recordings.recording import Recording
from husky_experiments.run import Run
from husky_experiments.scripts import assist, ready_fans, stand_up, stop_walking
from husky_experiments.session import Session, SessionError
from husky_navigation.planning.travel_costs import (
    METRE,
    ONCE,
    RADIAN,
    SECOND,
    TravelCost,
    write_costs,
)
from husky_runtime import graph

_PARTS = ("carbon_flat", "carbon_climb", "beta_legs", "beta_flight")
"""Sessions, each on its own course."""
_SETTLING, _MEASURED = 3.0, 5.0
"""Time to reach a speed, and the time that is measured then [s]."""
_SPEEDS = {"carbon": (0.1, 0.2, 0.3, 0.4, 0.5), "beta": (0.1, 0.2, 0.3, 0.4)}
"""Speeds of the trot on the flat [m/s]."""
_SHARES, _ASSISTED_SPEED = (0.2, 0.4), 0.3
"""Shares of the weight on the fans, and the speed at which they are measured [m/s]."""
_TURN_RATE = 0.5
"""Of a turn on the spot [rad/s]."""
_CLIMB_SPEED, _FRICTION = 0.25, 0.7
"""Speed along a slope [m/s], and the ground's friction there."""
_FLIGHT_SPEEDS = (0.2, 0.35, 0.48)
"""[m/s]"""
_RISEN, _RISING = 0.05, 15.0
"""Distance below the height of flight at which the take-off is over [m], and its longest time [s].
"""
_OFF_SPEED = 0.15
"""Greatest deviation of a measured speed from the commanded one, as a share of it."""


@dataclass(frozen=True)
class Passage:
    """A part of a session that was measured."""

    mode: str
    unit: str
    span: Span  # [s]
    speed: float = 0.0
    slope_deg: float = 0.0
    thrust_share: float = 0.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare parts, slopes and seed."""
    parser.add_argument(
        "--parts", nargs="+", choices=_PARTS, default=list(_PARTS), help="sessions to measure"
    )
    parser.add_argument(
        "--slopes",
        type=float,
        nargs="+",
        default=[0.0, 20.0, 30.0, 45.0],
        help="that Carbon climbs [deg]",
    )
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No fall, speeds as commanded; a cost of every way of moving."""
    options = run.options
    costs: list[TravelCost] = []
    carbon = {graph.PLANT: {"seed": options.seed, "body": "robot_with_unit"}}
    beta = beta_settings(options.seed)
    if "carbon_flat" in options.parts:
        costs += _session(run, "carbon", "carbon_flat", carbon, _on_flat)
    if "carbon_climb" in options.parts:
        for slope in options.slopes:
            costs += _climb(run, slope)
    if "beta_legs" in options.parts:
        costs += _session(run, "beta", "beta_legs", beta, _on_flat)
    if "beta_flight" in options.parts:
        costs += _session(run, "beta", "beta_flight", beta, _in_flight)
    parts, slopes = " ".join(options.parts), " ".join(f"{slope:g}" for slope in options.slopes)
    chosen = f"--parts {parts} --slopes {slopes} --seed {options.seed}"
    units = "Speeds in m/s and rad/s, time in s, energy in J."
    with (run.output / "costs.csv").open("w", encoding="utf-8", newline="") as file:
        write_costs(file, costs, f"scripts/experiment.sh energy {chosen}\n{units}")
    moving = [cost for cost in costs if cost.unit == METRE]
    errors = [abs(1.0 / (cost.time * cost.speed) - 1.0) for cost in moving]
    run.require("speed_error_max", max(errors), upper=_OFF_SPEED)
    run.metrics["costs"] = len(costs)
    if not options.no_figures:
        from husky_experiments.figures.energy import draw_costs

        draw_costs(costs, run.output)


def _session(
    run: Run,
    robot: str,
    label: str,
    settings: dict[str, dict[str, ParameterValue]],
    script: Callable[[Session, str], list[Passage]],
) -> list[TravelCost]:
    """Run a script in a session of its own; return the costs of its passages."""
    with run.session(settings, label=label, expected=60.0) as session:
        passages = script(session, robot)
        fallen = has_fallen(session.truth, lowest_upright(run.robot()))
    run.require(f"falls_{label}", int(fallen), upper=0)
    recording = run.recording(label)
    return [cost_of(robot, passage, recording) for passage in passages]


def cost_of(robot: str, passage: Passage, recording: Recording) -> TravelCost:
    """Return the cost of a passage for one of its units."""
    start, end = passage.span
    base = recording.base.between(start, end)
    amount = {
        METRE: float(np.linalg.norm(base.position[-1] - base.position[0])),
        RADIAN: float(abs(base.rpy[-1, 2] - base.rpy[0, 2])),
        SECOND: end - start,
        ONCE: 1.0,
    }[passage.unit]
    return TravelCost(
        robot=robot,
        mode=passage.mode,
        slope_deg=passage.slope_deg,
        thrust_share=passage.thrust_share,
        speed=passage.speed,
        unit=passage.unit,
        time=(end - start) / amount,
        energy=energy_over(recording, start, end) / amount,
    )


def _measured(session: Session) -> Span:
    """Let the robot go on for the time that is measured; return when."""
    start = session.time
    session.advance(_MEASURED)
    return start, session.time


# Legs on the flat ---------------------------------------------------------------------------
def _on_flat(session: Session, robot: str) -> list[Passage]:
    """Stand, trot at several speeds, turn; Carbon trots with its fans as well."""
    stand_up(session)
    session.advance(1.0)
    passages = [Passage("stand", SECOND, _measured(session))]
    session.set_gait("trot")
    session.set_velocity(0.0)
    session.set_mode("walk")
    for speed in _SPEEDS[robot]:
        passages.append(_trot(session, speed))
    session.set_velocity(0.0, 0.0, _TURN_RATE)
    session.advance(_SETTLING)
    passages.append(Passage("walk", RADIAN, _measured(session), _TURN_RATE))
    stop_walking(session)
    if robot == "carbon":
        ready_fans(session)
        for share in _SHARES:
            assist(session, share)
            session.set_mode("walk")
            passages.append(_trot(session, _ASSISTED_SPEED, share))
            stop_walking(session)
    return passages


def _trot(session: Session, speed: float, share: float = 0.0) -> Passage:
    """Trot straight ahead at a speed [m/s], a share of the weight on the fans."""
    session.set_velocity(speed)
    session.advance(_SETTLING)
    return Passage("walk", METRE, _measured(session), speed, 0.0, share)


# Climbing -------------------------------------------------------------------------------------
def _climb(run: Run, slope: float) -> list[TravelCost]:
    """Return the costs of a slope up and, nose ahead, down; of standing there; of getting ready."""
    course = course_for(slope, _CLIMB_SPEED * (_SETTLING + _MEASURED), _FRICTION)

    def script(session: Session, _: str) -> list[Passage]:
        stand_up(session)
        start = session.time
        ready_fans(session)
        session.set_mode("wair", reached="wair", within=1.0)
        passages = [Passage("to_climb", ONCE, (start, session.time))]

        def need(stands: bool) -> None:
            if not stands:
                raise SessionError(f"it does not stay upright on a slope of {slope:g} deg")

        def measure(unit: str, speed: float, steepness: float) -> None:
            need(go(session, course, _SETTLING, speed))
            start = session.time
            need(go(session, course, _MEASURED, speed))
            passages.append(Passage("climb", unit, (start, session.time), speed, steepness))

        need(climb_onto(session, course, _CLIMB_SPEED))
        measure(METRE, _CLIMB_SPEED, slope)
        measure(SECOND, 0.0, slope)
        if slope:
            need(turn_on_top(session, course, _CLIMB_SPEED))
            measure(METRE, _CLIMB_SPEED, -slope)
            need(walk_down(session, course, _CLIMB_SPEED))
        need(go(session, course, 2.0, 0.0))
        start = session.time
        session.set_mode("stand", reached="stand", within=3.0, patience=2.0)
        passages.append(Passage("from_climb", ONCE, (start, session.time)))
        session.release_velocity()
        return passages

    settings = climbing_settings(course, run.options.seed)
    found = _session(run, "carbon", f"carbon_{slope:g}_deg", settings, script)
    # Getting ready is measured where it is done, on the flat, and once.
    return [cost for cost in found if cost.unit != ONCE or slope == max(run.options.slopes)]


# Flight ---------------------------------------------------------------------------------------
def _in_flight(session: Session, _: str) -> list[Passage]:
    """Make arms of the legs, take off, hover, fly at several speeds, land, make legs again."""
    stand_up(session)
    session.advance(1.0)
    passages = []

    def passed(mode: str, start: float) -> None:
        passages.append(Passage(mode, ONCE, (start, session.time)))

    start = session.time
    become_perched(session)
    become_splayed(session)
    passed("to_arms", start)
    start, ground = session.time, _height(session)
    take_off(session)
    height = table_of(load_robot("beta"))["quadrotor.height"].default
    if not session.advance(_RISING, lambda: _height(session) > ground + height - _RISEN):
        raise SessionError(f"it is not {height:g} m up within {_RISING:g} s")
    passed("take_off", start)
    session.advance(_SETTLING)
    passages.append(Passage("hover", SECOND, _measured(session)))
    for speed in _FLIGHT_SPEEDS:
        session.set_velocity(speed)
        session.advance(_SETTLING)
        passages.append(Passage("fly", METRE, _measured(session), speed))
    session.set_velocity(0.0)
    session.advance(_SETTLING)
    session.release_velocity()
    start = session.time
    land(session)
    passed("land", start)
    start = session.time
    become_legged(session)
    passed("to_legs", start)
    return passages


def _height(session: Session) -> float:
    """Return the height of the base by the robot's own estimate [m]."""
    return float(session.state.position[2]) if session.state is not None else 0.0
