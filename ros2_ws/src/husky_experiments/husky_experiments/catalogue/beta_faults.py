"""Something of Husky-beta fails in the air, at a random moment: it comes down safe every time."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from husky_bringup.system import ParameterValue
from husky_description.robot import LEG_NAMES, load_robot
from husky_experiments.metrics.air_faults import SINK_BOUND, TILT_BOUND, ComingDown, coming_down
from husky_experiments.morph_scripts import become_perched, become_splayed, take_off
from husky_experiments.run import Run
from husky_experiments.scripts import stand_up
from husky_experiments.session import Session
from husky_msgs.srv import SetMode
from husky_runtime import graph

_FIRST, _LAST = 4.0, 12.0
"""Between these times after the take-off something fails [s]."""
_PATIENCE = 15.0
"""Within which the flight must have ended [s]."""
_AFTER = 2.0
"""Time for what follows the landing [s]."""
_FASTEST = 0.4
"""Of the way that is flown meanwhile, ahead and to the side [m/s]."""
_EMPTY = 0.05
"""Charge of a battery that is critical."""

Fail = Callable[[Session, int], None]


def _lose_rotor(session: Session, leg: int) -> None:
    session.inject(graph.PLANT_INJECT_FAULT, f"{LEG_NAMES[leg]}_fan", "fail")


def _lose_servo(session: Session, leg: int) -> None:
    target = f"servo:{LEG_NAMES[leg]}_hip_frontal"
    session.inject(graph.PLANT_INJECT_FAULT, target, "overload")


def _empty_battery(session: Session, leg: int) -> None:
    session.inject(graph.PLANT_INJECT_FAULT, "battery", str(_EMPTY))


def _lose_companion(session: Session, leg: int) -> None:
    session.kill(graph.PIXHAWK_BRIDGE)


def _stop(session: Session, leg: int) -> None:
    session.call(graph.SET_MODE, SetMode.Request(mode="emergency_stop"))


FAULTS: dict[str, Fail] = {
    "rotor": _lose_rotor,
    "servo": _lose_servo,
    "battery": _empty_battery,
    "companion": _lose_companion,
    "emergency_stop": _stop,
}
"""What fails, by name."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare faults, number of runs and seed."""
    what = "what fails, in turn"
    parser.add_argument("--faults", nargs="+", choices=tuple(FAULTS), default=None, help=what)
    parser.add_argument("--runs", type=int, default=len(FAULTS), help="flights")
    parser.add_argument("--seed", type=int, default=1, help="of the first; each has the next")


def run(run: Run) -> None:
    """No flight ends unsafe: on its perch, propellers off, sink rate and tilt within bounds."""
    options = run.options
    kinds = options.faults or list(FAULTS)
    ends = []
    for number in range(options.runs):
        kind = kinds[number % len(kinds)]
        end = _fly(run, f"run_{number}_{kind}", kind, options.seed + number)
        run.metrics[f"run_{number}_{kind}"] = {**end.as_metrics(), "safe": int(end.safe)}
        ends.append(end)
    run.require("unsafe", sum(not end.safe for end in ends), upper=0)
    run.require("touch_sink_max_m_s", max(end.sink for end in ends), upper=SINK_BOUND)
    tilts = [float(np.degrees(end.rest_tilt)) for end in ends]
    run.require("rest_tilt_max_deg", max(tilts), upper=float(np.degrees(TILT_BOUND)))


def _fly(run: Run, label: str, kind: str, seed: int) -> ComingDown:
    """Fly until something fails at a random time and on a random leg; return the end."""
    random = np.random.default_rng(seed)
    leg = int(random.integers(4))
    vx, vy = (float(v) for v in random.uniform(-_FASTEST, _FASTEST, 2))
    wait = float(random.uniform(_FIRST, _LAST))
    settings: dict[str, dict[str, ParameterValue]] = {
        "plant": {"robot": "beta", "body": "robot_with_unit", "seed": seed},
        "flight_controller": {"seed": seed},
    }
    run.say(f"{label}: {LEG_NAMES[leg]}, {wait:.2f} s after the take-off")
    with run.session(settings, label=label, expected=50.0) as session:
        stand_up(session)
        session.advance(1.0)
        become_perched(session)
        become_splayed(session)
        take_off(session)
        session.advance(min(wait, _FIRST))
        session.set_velocity(vx, vy, 0.0)
        session.advance(wait - min(wait, _FIRST))
        fault = session.time
        FAULTS[kind](session, leg)
        session.advance(_PATIENCE, lambda: session.state.mode != "quadrotor")  # type: ignore[union-attr]
        session.release_velocity()
        session.advance(_AFTER)
    return coming_down(run.recording(label), load_robot("beta"), fault)
