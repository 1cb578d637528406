"""Send Carbon to the goals of random worlds: slopes, ditches, walls, crates; it sees for itself."""

from __future__ import annotations

import argparse
import csv
import math
from dataclasses import asdict, dataclass, fields

import numpy as np

from husky_experiments.journey import Traveller, obstacle_settings, planner_of
from husky_experiments.metrics.cycle import energy_over
from husky_experiments.metrics.walking import has_fallen, lowest_upright
from husky_experiments.run import Run
from husky_experiments.scripts import stand_up
from husky_experiments.session import SessionError
from husky_experiments.steering import heading_of
from husky_navigation.planning.route import PlanePose, Route, RouteError
from husky_navigation.planning.route_planner import Limits, RoutePlanner
from husky_navigation.planning.route_search import MODES, WALK
from husky_sim.random_world import random_world

_LONGEST = 300.0
"""Simulated time that a world may take [s]."""
_LOOKING = 2.0
"""Time to look at the ground before the goal is sent [s]."""
_NEAR, _TURNED = 0.2, 0.3
"""Distance [m] and angle [rad] from the goal within which it is reached."""
_REACHED = 0.9
"""Share of the worlds in which it must be."""
_DEARER = 1.2
"""Most energy over that of the best route on the true map, median."""


@dataclass(frozen=True)
class Visit:
    """One world, and how it went."""

    seed: int
    barrier: bool  # the only way leads over a ridge
    reached: bool
    fell: bool
    said: str  # by the navigator, of another end
    recoveries: int
    distance_m: float  # from the goal, at the end
    angle_rad: float  # from its heading
    time_s: float
    energy_j: float
    best_j: float  # of the best route on the true map
    best_walking_j: float  # without climbs; inf where no way leads

    @property
    def summary(self) -> str:
        """How it went, in a line."""
        off = f"{self.distance_m:.2f} m, {self.angle_rad:.2f} rad off"
        energy = f"{self.energy_j / 1e3:.1f} kJ, {self.best_j / 1e3:.1f} at best"
        return f"{self.said or 'reached'}; {off}; {self.time_s:.0f} s, {energy}"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare worlds and seed."""
    parser.add_argument("--worlds", type=int, default=20, help="how many (default: 20)")
    parser.add_argument("--seed", type=int, default=0, help="of the first world and its noise")


def run(run: Run) -> None:
    """The goal is reached in nine of ten worlds, without a fall, at little more than least cost."""
    options = run.options
    if options.worlds < 1:
        raise SessionError(f"--worlds is {options.worlds}, it must be 1 or more")
    visits = []
    for seed in range(options.seed, options.seed + options.worlds):
        visit = _visit(run, seed)
        visits.append(visit)
        run.say(f"world {seed}: {visit.summary}")
    with (run.output / "worlds.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [each.name for each in fields(Visit)])
        writer.writeheader()
        writer.writerows(asdict(visit) for visit in visits)
    reached = [visit for visit in visits if visit.reached]
    run.metrics |= {
        "worlds": len(visits),
        "with_barrier": sum(visit.barrier for visit in visits),
        "out_of_reach_without_climb": sum(math.isinf(visit.best_walking_j) for visit in visits),
        "reached_with_barrier": sum(visit.barrier for visit in reached),
    }
    run.require("falls", sum(visit.fell for visit in visits), upper=0)
    run.require("reached", len(reached), lower=math.ceil(_REACHED * len(visits) - 1e-9))
    if reached:
        ratio = float(np.median([visit.energy_j / visit.best_j for visit in reached]))
        run.require("energy_over_best_p50", ratio, upper=_DEARER)
    if not options.no_figures:
        from husky_experiments.figures.navigate import Journey, draw_journeys

        journeys = []
        for visit in visits:
            world = random_world(np.random.default_rng(visit.seed))
            planner, goal = planner_of(world), PlanePose(*world.goal)
            title = f"world {visit.seed}: {visit.said or 'reached'}"
            best = best_route(planner, goal, MODES)
            journeys.append(Journey(title, planner, best, goal, run.recording(_label(visit.seed))))
        draw_journeys(journeys, run.output)


def _visit(run: Run, seed: int) -> Visit:
    """Go through one world."""
    world, label = random_world(np.random.default_rng(seed)), _label(seed)
    goal = PlanePose(*world.goal)
    with run.session(obstacle_settings(seed), label=label, expected=100.0) as session:
        stand_up(session)
        session.advance(_LOOKING)
        traveller, start = Traveller(session), session.time
        traveller.send(goal)
        ended = traveller.go_on(_LONGEST)
        end, said = session.time, traveller.said if ended else f"not ended in {_LONGEST:g} s"
        session.advance(1.0)
        truth, fell = session.truth, has_fallen(session.truth, lowest_upright(run.robot()))
    assert truth is not None
    at, q = truth.pose.pose.position, truth.pose.pose.orientation
    distance = math.hypot(at.x - goal.x, at.y - goal.y)
    angle = abs(math.remainder(heading_of((q.x, q.y, q.z, q.w)) - goal.yaw, 2.0 * math.pi))
    planner = planner_of(world)
    return Visit(
        seed=seed,
        barrier=world.barrier,
        reached=not fell and distance <= _NEAR and angle <= _TURNED,
        fell=fell,
        said=said,
        recoveries=traveller.recoveries,
        distance_m=distance,
        angle_rad=angle,
        time_s=end - start,
        energy_j=energy_over(run.recording(label), start, end),
        best_j=_energy(best_route(planner, goal, MODES)),
        best_walking_j=_energy(best_route(planner, goal, (WALK,))),
    )


def best_route(planner: RoutePlanner, goal: PlanePose, modes: tuple[str, ...]) -> Route | None:
    """Return the best route from the origin with some modes, None where there is none."""
    try:
        return planner.plan(PlanePose(0.0, 0.0, 0.0), goal, Limits(modes))
    except RouteError:
        return None


def _energy(route: Route | None) -> float:
    return math.inf if route is None else route.energy


def _label(seed: int) -> str:
    return f"world_{seed}"
