"""Something fails on Husky-beta, at a random moment of its whole way: it ends safe every time."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import NoReturn

import numpy as np

from husky_description.robot import LEG_NAMES, load_robot
from husky_experiments.metrics.endings import SINK_BOUND, Ending, ending
from husky_experiments.morph_scripts import (
    become_legged,
    become_perched,
    become_splayed,
    beta_settings,
    land,
    take_off,
)
from husky_experiments.run import Run
from husky_experiments.scripts import stand_up
from husky_experiments.session import Session
from husky_experiments.steering import FLYING, go_to, place, trot_to
from husky_msgs.srv import SetMode
from husky_runtime import graph

_TROT, _FLIGHT = 0.9, 1.6
"""Ways to trot, each time, and to fly [m]."""
_WITHIN = 20.0
"""Longest time that each way may take [s]."""
_WHOLE = 41.0
"""Within this time from the first step on something fails [s]; the way takes a little less."""
_HELD = 3.0
"""Time for which an operator who has seen nothing goes on steering [s]."""
_REST = 30.0
"""Within which it must have come to rest, then, its propellers off [s]."""
_AFTER = 1.0
"""Time of rest that is recorded [s]."""
_ALONE = 14.0
"""Time after which servos without a controller have held, given way and let go [s]."""
_EMPTY = 0.05
"""Charge of a battery that is critical."""

Random = np.random.Generator
Fail = Callable[[Session, Random], str]
"""Makes something fail; returns what."""

_NODES = (
    graph.LOW_LEVEL_CONTROLLER,
    graph.SERVO_BRIDGE,
    graph.PIXHAWK_BRIDGE,
    graph.VN200_DRIVER,
    graph.T265_DRIVER,
)
"""On the robot's computer, and needed on the way."""
_MODES = ("damping", "emergency_stop")


def _servo(fault: str) -> Fail:
    def fail(session: Session, random: Random) -> str:
        names = load_robot("beta").joint_names
        joint = str(names[random.integers(len(names))])
        session.inject(graph.PLANT_INJECT_FAULT, f"servo:{joint}", fault)
        return joint

    return fail


def _lose_rotor(session: Session, random: Random) -> str:
    rotor = f"{LEG_NAMES[random.integers(len(LEG_NAMES))]}_fan"
    session.inject(graph.PLANT_INJECT_FAULT, rotor, "fail")
    return rotor


def _lose_camera(session: Session, random: Random) -> str:
    fault = str(random.choice(("freeze", "lost")))
    session.inject(graph.PLANT_INJECT_FAULT, "t265", fault)
    return fault


def _empty_battery(session: Session, random: Random) -> str:
    session.inject(graph.PLANT_INJECT_FAULT, "battery", str(_EMPTY))
    return f"{100 * _EMPTY:g} %"


def _kill_node(session: Session, random: Random) -> str:
    node = str(random.choice(_NODES))
    session.kill(node)
    return node


def _abort(session: Session, random: Random) -> str:
    what = str(random.choice((*_MODES, graph.DRIVES_EMERGENCY_STOP)))
    if what in _MODES:
        session.call(graph.SET_MODE, SetMode.Request(mode=what))
    else:
        session.stop_drives()
    return what


FAULTS: dict[str, Fail] = {
    "servo_silent": _servo("unplug"),
    "servo_hot": _servo("overheat"),
    "servo_overloaded": _servo("overload"),
    "rotor": _lose_rotor,
    "t265": _lose_camera,
    "battery": _empty_battery,
    "node": _kill_node,
    "abort": _abort,
}
"""What fails, by name."""


class _FailedError(Exception):
    """Something has failed on purpose: the passage that was under way is over."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare faults, number of runs and seed."""
    what = "what fails, in turn"
    parser.add_argument("--faults", nargs="+", choices=tuple(FAULTS), default=None, help=what)
    parser.add_argument("--runs", type=int, default=20, help="ways, each with one fault")
    parser.add_argument("--seed", type=int, default=1, help="of the first; each has the next")


def run(run: Run) -> None:
    """No way ends unsafe: at rest, upright, propellers off, nothing met hard or by a blade."""
    options = run.options
    kinds = options.faults or list(FAULTS)
    ends = []
    for number in range(options.runs):
        kind = kinds[number % len(kinds)]
        end = _go(run, f"run_{number}_{kind}", kind, options.seed + number)
        ends.append(end)
    run.require("unsafe", sum(not end.safe for end in ends), upper=0)
    run.require("touch_sink_max_m_s", max(end.sink for end in ends), upper=SINK_BOUND)


def _go(run: Run, label: str, kind: str, seed: int) -> Ending:
    """Go until something fails at a random time; return the end."""
    random = np.random.default_rng(seed)
    wait = float(random.uniform(0.0, _WHOLE))
    settings = beta_settings(seed)
    told: dict[str, object] = {}
    with run.session(settings, label=label, expected=50.0) as session:

        def fail() -> NoReturn:
            told["at_s"] = session.time
            told["mode"] = session.state.mode if session.state is not None else ""
            told["what"] = FAULTS[kind](session, random)
            raise _FailedError

        stand_up(session)
        session.at(session.time + wait, fail)
        try:
            _whole_way(session)
            session.advance(_WHOLE)
        except _FailedError:
            run.say(f"{label}: {told['what']} at {told['at_s']:.2f} s, in {told['mode']}")
        session.advance(_HELD)
        session.release_velocity()
        session.advance(_REST, lambda: _at_rest(session))
        session.advance(_ALONE if kind == "node" else _AFTER)
    fault = float(str(told["at_s"]))
    end = ending(run.recording(label), load_robot("beta"), fault)
    run.metrics[label] = {**told, **end.as_metrics()}
    return end


def _whole_way(session: Session) -> None:
    """Trot, fly, land, trot on."""
    _trot(session)
    session.advance(1.0)
    become_perched(session)
    become_splayed(session)
    take_off(session)
    session.advance(4.0)
    x, y = place(session)
    go_to(session, (x + _FLIGHT, y), FLYING, _WITHIN)
    session.advance(1.0)
    session.release_velocity()
    land(session)
    become_legged(session)
    session.advance(1.0)
    _trot(session)


def _trot(session: Session) -> None:
    x, y = place(session)
    trot_to(session, (x + _TROT, y), _WITHIN)


def _at_rest(session: Session) -> bool:
    """Whether body and propellers do nothing any more, in truth."""
    if session.truth is None or session.fans is None:
        return False
    twist = session.truth.twist.twist
    linear, turning = twist.linear, twist.angular
    parts = linear.x, linear.y, linear.z, turning.x, turning.y, turning.z
    return math.hypot(*parts) < 0.01 and max(session.fans.speed) < 1.0
