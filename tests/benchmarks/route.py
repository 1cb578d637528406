"""Planning a route over random worlds of obstacles, all of the ground known, by processor time."""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from husky_bringup.settings import HelpFormatter
from husky_experiments.journey import planner_of
from husky_navigation.planning.abilities import ABILITIES
from husky_navigation.planning.planning_grid import grid_of
from husky_navigation.planning.route import PlanePose, RouteError
from husky_navigation.planning.route_finder import find_route
from husky_navigation.planning.route_search import RouteGraph
from husky_navigation.planning.travel_costs import TravelCosts
from husky_sim.random_world import random_world

_PARTS = ("grid", "graph", "search")
_NEIGHBOURS = [(di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1) if di or dj]


def bench(arguments: list[str]) -> dict[str, Any]:
    """Time to plan a route over 200 x 200 cells from the map of heights, and its parts."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh route", formatter_class=HelpFormatter)
    parser.add_argument("--worlds", type=int, default=40, help="random worlds")
    parser.add_argument("--seed", type=int, default=0, help="of the first world")
    parser.add_argument("--robot", choices=sorted(ABILITIES), default="carbon", help="its name")
    options = parser.parse_args(arguments)
    if options.worlds < 1:
        parser.error(f"--worlds is {options.worlds}, it must be 1 or more")
    abilities, costs = ABILITIES[options.robot], TravelCosts.load(options.robot)
    times, climbs, flights, unreached = [], 0, 0, 0
    for seed in range(options.seed - 1, options.seed + options.worlds):
        world = random_world(np.random.default_rng(max(seed, options.seed)))
        seen = planner_of(world).world
        marks = [time.process_time()]
        grid = grid_of(seen, abilities)
        marks.append(time.process_time())
        graph = RouteGraph(grid, abilities, costs)
        marks.append(time.process_time())
        try:
            start, goal = PlanePose(0.0, 0.0, 0.0), PlanePose(*world.goal)
            modes = find_route(graph, start, goal).modes
        except RouteError:
            modes = ()
        marks.append(time.process_time())
        if seed < options.seed:
            continue  # the kernels are compiled or loaded
        times.append(np.diff(marks))
        climbs += "climb" in modes
        flights += "fly" in modes
        unreached += not modes
    plain = _plain_search(grid.known.shape[0])
    times_of = {"plan": np.sum(times, axis=1), **dict(zip(_PARTS, np.array(times).T, strict=True))}
    return {
        "worlds": options.worlds,
        "cells": grid.known.size,
        "unreached": unreached,
        "with_climb": climbs,
        "with_flight": flights,
        "plan_over_plain": float(np.median(times_of["plan"])) / plain,
        **{
            f"{part}_cpu_ms_p{percent}": 1e3 * float(np.percentile(values, percent))
            for part, values in times_of.items()
            for percent in (50, 95)
        },
    }


def _plain_search(cells: int) -> float:
    """Return the processor time of a search over a free grid of eight neighbours [s]."""
    number = np.arange(cells * cells).reshape(cells, cells)
    starts, ends, ways = [], [], []
    for di, dj in _NEIGHBOURS:
        i, j = (slice(max(0, -d), cells - max(0, d)) for d in (di, dj))
        starts.append(number[i, j].ravel())
        ends.append(np.roll(number, (-di, -dj), (0, 1))[i, j].ravel())
        ways.append(np.full(starts[-1].size, np.hypot(di, dj)))
    edges = np.concatenate(ways), (np.concatenate(starts), np.concatenate(ends))
    graph = csr_matrix(edges, (cells * cells,) * 2)
    begun = time.process_time()
    dijkstra(graph, indices=0, return_predecessors=True)
    return time.process_time() - begun
