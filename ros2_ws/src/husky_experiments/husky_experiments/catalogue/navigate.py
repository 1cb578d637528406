"""Send a robot to the goals of random worlds by what it sees for itself.

Carbon walks and climbs among slopes, ditches, walls and crates; Husky-beta walks around the boxes
of the lab's worlds, or flies over them.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from husky_experiments.journey import (
    LAB,
    OBSTACLES,
    REACHED_WITHIN,
    WORLDS,
    Traveller,
    journey_settings,
    off_goal,
    planner_of,
)
from husky_experiments.metrics.cycle import energy_over
from husky_experiments.metrics.walking import has_fallen, lowest_upright
from husky_experiments.run import Run
from husky_experiments.scripts import stand_up
from husky_experiments.session import SessionError
from husky_navigation.planning.route import PlanePose, Route, RouteError
from husky_navigation.planning.route_planner import Limits, RoutePlanner
from husky_navigation.planning.route_search import MODES, WALK

_LONGEST = 300.0
"""Simulated time that a world may take [s]."""
_LOOKING = 2.0
"""Time to look at the ground before the goal is sent [s]."""
_COURSES = {"carbon": OBSTACLES, "beta": LAB}
"""On which a robot is sent if nothing else is asked for."""
_REACHED = 0.9
"""Share of the worlds in which it must be."""
_DEARER = {"carbon": 1.2}
"""Most energy over that of the best route on the true map, median; a look around in the air costs
Husky-beta more than its whole walk.
"""


@dataclass(frozen=True)
class Visit:
    """One world, and how it went."""

    seed: int
    barrier: bool  # no way leads to the goal on level ground
    reached: bool
    fell: bool
    said: str  # by the navigator, of another end
    recoveries: int
    distance_m: float  # from the goal, at the end
    angle_rad: float  # from its heading
    time_s: float
    energy_j: float
    best_j: float  # of the best route on the true map
    best_walking_j: float  # of the best walk alone; inf where no way leads

    @property
    def summary(self) -> str:
        """How it went, in a line."""
        off = f"{self.distance_m:.2f} m, {self.angle_rad:.2f} rad off"
        energy = f"{self.energy_j / 1e3:.1f} kJ, {self.best_j / 1e3:.1f} at best"
        return f"{self.said or 'reached'}; {off}; {self.time_s:.0f} s, {energy}"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare robot, course, worlds and seed."""
    parser.add_argument("--robot", choices=tuple(_COURSES), default="carbon")
    what = "random worlds (default: obstacles for carbon, lab for beta)"
    parser.add_argument("--course", choices=tuple(WORLDS), help=what)
    parser.add_argument("--worlds", type=int, default=20, help="how many (default: 20)")
    parser.add_argument("--seed", type=int, default=0, help="of the first world and its noise")


def run(run: Run) -> None:
    """The goal is reached in nine of ten worlds, without a fall, at little more than least cost."""
    options = run.options
    if options.worlds < 1:
        raise SessionError(f"--worlds is {options.worlds}, it must be 1 or more")
    course = options.course or _COURSES[options.robot]
    visits, references = [], []
    for seed in range(options.seed, options.seed + options.worlds):
        reference = Reference(seed, options.robot, course)
        visit = _visit(run, reference)
        visits.append(visit)
        references.append(reference)
        _write(visits, run.output / "worlds.csv")
        run.say(f"world {seed}: {visit.summary}")
    reached = [visit for visit in visits if visit.reached]
    run.metrics |= {
        "worlds": len(visits),
        "with_barrier": sum(visit.barrier for visit in visits),
        "out_of_reach_walking": sum(math.isinf(visit.best_walking_j) for visit in visits),
        "reached_with_barrier": sum(visit.barrier for visit in reached),
    }
    run.require("falls", sum(visit.fell for visit in visits), upper=0)
    run.require("reached", len(reached), lower=math.ceil(_REACHED * len(visits) - 1e-9))
    if reached:
        ratio = float(np.median([visit.energy_j / visit.best_j for visit in reached]))
        run.metrics["energy_over_best_p50"] = ratio
        if options.robot in _DEARER:
            run.require("energy_over_best_p50", upper=_DEARER[options.robot])
    if not options.no_figures:
        from husky_experiments.figures.navigate import Journey, draw_journeys, modes_at_base

        journeys = []
        for visit, reference in zip(visits, references, strict=True):
            recording = run.recording(_label(visit.seed))
            journeys.append(
                Journey(
                    f"world {visit.seed}: {visit.said or 'reached'}",
                    reference.ground,
                    reference.best,
                    reference.goal,
                    recording.base.position[:, :2],
                    modes_at_base(recording),
                )
            )
        draw_journeys(journeys, run.output)


class Reference:
    """A world as it truly is, for comparison.

    Attributes:
        seed: of the world.
        robot, course: their names.
        barrier: no way leads to the goal on level ground.
        goal: of the robot.
        ground: its map, all of it seen.
        best, best_walking: cheapest routes with all modes, and by a walk alone; None for none.
    """

    def __init__(self, seed: int, robot: str, course: str) -> None:
        """Plan on the true map."""
        world = WORLDS[course](np.random.default_rng(seed))
        self.seed, self.robot, self.course = seed, robot, course
        self.barrier, self.goal = world.barrier, PlanePose(*world.goal)
        planner = planner_of(world, robot)
        self.ground = planner.world
        self.best, self.best_walking = (
            _route(planner, self.goal, modes) for modes in (MODES, (WALK,))
        )


def _route(planner: RoutePlanner, goal: PlanePose, modes: tuple[str, ...]) -> Route | None:
    """Return the cheapest route from the origin by some modes, None where there is none."""
    try:
        return planner.plan(PlanePose(0.0, 0.0, 0.0), goal, Limits(modes))
    except RouteError:
        return None


def _visit(run: Run, reference: Reference) -> Visit:
    """Go through one world."""
    seed, goal, label = reference.seed, reference.goal, _label(reference.seed)
    settings = journey_settings(seed, reference.robot, reference.course)
    with run.session(settings, label=label, expected=100.0) as session:
        stand_up(session)
        session.advance(_LOOKING)
        traveller, start = Traveller(session), session.time
        traveller.send(goal)
        ended = traveller.go_on(_LONGEST)
        end, said = session.time, traveller.said if ended else f"not ended in {_LONGEST:g} s"
        session.advance(1.0)
        distance, angle = off_goal(session, goal)
        fell = has_fallen(session.truth, lowest_upright(run.robot()))
    near, turned = REACHED_WITHIN[reference.robot]
    return Visit(
        seed=seed,
        barrier=reference.barrier,
        reached=not fell and distance <= near and angle <= turned,
        fell=fell,
        said=said,
        recoveries=traveller.recoveries,
        distance_m=distance,
        angle_rad=angle,
        time_s=end - start,
        energy_j=energy_over(run.recording(label), start, end),
        best_j=_energy(reference.best),
        best_walking_j=_energy(reference.best_walking),
    )


def _write(visits: Sequence[Visit], path: Path) -> None:
    """Write the table of the worlds so far: those of a run that is stopped are kept."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [each.name for each in fields(Visit)])
        writer.writeheader()
        writer.writerows(asdict(visit) for visit in visits)


def _energy(route: Route | None) -> float:
    return math.inf if route is None else route.energy


def _label(seed: int) -> str:
    return f"world_{seed}"
