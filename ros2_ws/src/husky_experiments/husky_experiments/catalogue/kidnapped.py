"""Navigation in which something goes wrong: each time it ends well, or with a reason and safe."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from std_srvs.srv import Trigger

from husky_experiments.journey import Traveller, journey_settings, off_goal, planner_of
from husky_experiments.metrics.walking import has_fallen, lowest_upright
from husky_experiments.run import Run
from husky_experiments.scripts import stand_up
from husky_experiments.session import Session
from husky_navigation.planning.route import PlanePose, RouteError
from husky_navigation.planning.route_planner import Limits
from husky_navigation.planning.route_search import WALK
from husky_runtime import graph
from husky_sim.obstacle_world import ObstacleWorld
from husky_sim.random_world import random_world

_LONGEST = 120.0
"""Simulated time within which a case must have ended [s]."""
_ON_THE_WAY = 4.0
"""Time after a goal at which something happens [s]."""
_REST = 2.0
"""Time after the end in which the robot comes to rest [s]."""
_STILL = 0.05
"""Speed below which it is at rest [m/s]."""
_NEAR = 0.3
"""Distance from a goal within which it is truly reached [m]."""
_EMPTY = "0.05"
"""Charge of a battery that is critical."""

_HOME, _FAR = PlanePose(0.0, 0.0, 0.0), PlanePose(30.0, 0.0, 0.0)
"""The start, to which it returns, and a place beyond every map."""
_DISTANCE = 2.5
"""Of the goal from the start [m]."""

Act = Callable[[Session, Traveller], object]
"""Makes something happen."""


def _inject(target: str, fault: str) -> Act:
    return lambda session, _: session.inject(graph.PLANT_INJECT_FAULT, target, fault)


def _forget_map(session: Session, _: Traveller) -> None:
    session.add_service(Trigger, graph.CLEAR_MAP)
    session.call(graph.CLEAR_MAP, Trigger.Request())


def _nothing(_: Session, __: Traveller) -> None:
    """Do nothing."""


@dataclass(frozen=True)
class Case:
    """Something that goes wrong.

    Attributes:
        ends: what the navigator may say of the end, in part; "": the goal is reached.
        goal: that is sent: `free`, `wall` or `far`.
        before: done before that.
        on_the_way: done a while after that.
        heal: done at the end.
    """

    ends: tuple[str, ...]
    goal: str = "free"
    before: Act = _nothing
    on_the_way: Act = _nothing
    heal: Act = _nothing


CASES = {
    "goal_in_a_wall": Case(("obstacle",), goal="wall"),
    "goal_off_the_map": Case(("off the map",), goal="far"),
    "goal_cancelled": Case(("cancelled",), on_the_way=lambda _, traveller: traveller.cancel()),
    "goal_replaced": Case(("",), on_the_way=lambda _, traveller: traveller.send(_HOME)),
    "map_forgotten": Case(("",), on_the_way=_forget_map),
    "t265_frozen": Case(("",), on_the_way=_inject("t265", "freeze"), heal=_inject("t265", "")),
    "t265_jumps": Case(("",), on_the_way=_inject("t265", "jump")),
    "camera_frozen": Case(
        ("not seen",), on_the_way=_inject("d435", "freeze"), heal=_inject("d435", "")
    ),
    "camera_covered": Case(
        ("", "not seen"), on_the_way=_inject("d435", "cover"), heal=_inject("d435", "")
    ),
    "battery_low": Case(
        ("battery",), before=_inject("battery", _EMPTY), heal=_inject("battery", "")
    ),
    "no_localizer": Case(
        ("does not know where it is",), on_the_way=lambda session, _: session.kill(graph.LOCALIZER)
    ),
}
"""By name, in this order: after the last one nothing is localised any more."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare cases and seed."""
    what = "what goes wrong, one after the other"
    parser.add_argument("--cases", nargs="+", choices=tuple(CASES), default=list(CASES), help=what)
    parser.add_argument("--seed", type=int, default=0, help="of the world and all sensor noise")


def run(run: Run) -> None:
    """No fall; each case ends as it must, and the robot stands at rest then."""
    options = run.options
    world = random_world(np.random.default_rng(options.seed))
    goals = {"free": _free_goal(world), "wall": _wall_goal(world), "far": _FAR}
    lowest = lowest_upright(run.robot())
    settings, falls = journey_settings(options.seed), 0
    expected = 40.0 * len(options.cases)
    with run.session(settings, expected=expected) as session:
        stand_up(session)
        session.advance(2.0)
        traveller = Traveller(session)
        for name in options.cases:
            case = CASES[name]
            said = _go_through(session, traveller, case, goals[case.goal])
            session.advance(_REST)
            off, _ = off_goal(session, traveller.goal)
            is_there = off < _NEAR
            expected_end = any(
                word in said if word else not said and is_there for word in case.ends
            )
            stands = session.state is not None and session.state.mode == "stand"
            fell = has_fallen(session.truth, lowest)
            safe = stands and not fell and _speed(session) < _STILL
            run.say(f"{name}: {said or 'reached'}; {'safe' if safe else 'NOT SAFE'}")
            run.metrics[name] = said or f"reached, {off:.2f} m off"
            run.require(f"{name}_ok", int(expected_end and safe), lower=1)
            falls += fell
            case.heal(session, traveller)
            session.advance(_REST)
    run.require("falls", falls, upper=0)


def _go_through(session: Session, traveller: Traveller, case: Case, goal: PlanePose) -> str:
    """Go to a goal, or home from there, while something goes wrong; return the navigator's word."""
    if off_goal(session, goal)[0] < 0.5 * _DISTANCE:
        goal = _HOME
    case.before(session, traveller)
    session.advance(_REST)
    traveller.send(goal)
    if case.on_the_way is not _nothing:
        if traveller.go_on(_ON_THE_WAY):
            return f"it has ended before: {traveller.said or 'reached'}"
        case.on_the_way(session, traveller)
    if not traveller.go_on(_LONGEST):
        return f"it has not ended after {_LONGEST:g} s"
    return traveller.said


def _speed(session: Session) -> float:
    """Return the true speed of the base [m/s]."""
    assert session.truth is not None
    v = session.truth.twist.twist.linear
    return math.hypot(v.x, v.y, v.z)


def _free_goal(world: ObstacleWorld) -> PlanePose:
    """Return a pose to which the robot can walk from the start nearly straight."""
    planner = planner_of(world)
    for angle in np.linspace(-math.pi, math.pi, 32, endpoint=False):
        x, y = _DISTANCE * math.cos(angle), _DISTANCE * math.sin(angle)
        goal = PlanePose(x, y, float(angle))
        try:
            route = planner.plan(_HOME, goal, Limits((WALK,)))
        except RouteError:
            continue
        if route.length < 1.1 * _DISTANCE:
            return goal
    raise ValueError("no place 2.5 m from the start is free; take another --seed")


def _wall_goal(world: ObstacleWorld) -> PlanePose:
    """Return the middle of the wall or crate next to the start."""
    nearest = min(world.boxes, key=lambda box: math.hypot(box.ground.x, box.ground.y))
    return PlanePose(nearest.ground.x, nearest.ground.y, 0.0)
