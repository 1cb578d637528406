"""A solution between its points: the dynamics integrated, the constraints on a finer mesh.

Between the nodes a solution is cubics for the states and lines for the inputs (T29), or lines for
both where the scheme is Euler's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from husky_control.planning.collocation.local_functions import LocalFunctions
from husky_control.planning.collocation.solve import Solution
from husky_description.arrays import Array

SUBSTEPS = 8
"""Runge-Kutta steps in an interval: their error is far below that of one cubic."""


@dataclass(frozen=True)
class MeshCheck:
    """What a solution is like between its points."""

    # state at the end of each interval, integrated from its start with the solution's inputs, less
    # the solution's own (N, states)
    error: Array
    # how far each path constraint is exceeded anywhere on the finer mesh, in its unit
    excess: dict[str, float]


def check_on_finer_mesh(
    solution: Solution, functions: LocalFunctions, samples: int = SUBSTEPS
) -> MeshCheck:
    """Integrate the dynamics through each interval, and look at path constraints between points, at
    so many samples in each interval.
    """
    path = solution.problem.formulation.path
    excess = dict.fromkeys((constraint.name for constraint in path), 0.0)
    for share in np.linspace(0.0, 1.0, samples + 1):
        for name, amount in _excess_at(solution, functions, float(share)).items():
            excess[name] = max(excess[name], amount)
    return MeshCheck(integration_error(solution, functions), excess)


def _excess_at(solution: Solution, functions: LocalFunctions, share: float) -> dict[str, float]:
    """Excess of each path constraint at one share of all intervals."""
    problem, form = solution.problem, solution.problem.formulation
    if not form.path_size:
        return {}
    state, input = interpolate(solution, functions, share)
    time = problem.grid[:-1] + share * np.diff(problem.grid)
    still, numbers = [*solution.static], [time[:, None]]
    if form.free_duration:
        still.append(solution.duration)
    else:
        numbers.append(np.full((len(time), 1), solution.duration))
    fixed = np.tile(problem.parameter, (len(time), 1))
    decisions = np.hstack([state, input, np.tile(still, (len(time), 1))])
    _, found = functions.point.values.map(len(time))(
        decisions.T, np.hstack([fixed, problem.data, *numbers]).T
    )
    rows, first = np.array(found).T, problem.interval_points[:, 0]
    beyond = np.maximum(problem.path_lower[first] - rows, rows - problem.path_upper[first])
    result, column = {}, 0
    for constraint in form.path:
        own = beyond[:, column : column + constraint.size]
        result[constraint.name] = max(0.0, float(own.max())) * constraint.scale
        column += constraint.size
    return result


def integration_error(solution: Solution, functions: LocalFunctions) -> Array:
    """Integrated state less the solution's at the end of each interval (N, states)."""
    problem = solution.problem
    ends = problem.interval_points
    time = solution.node_time
    begin, step = time[:-1], np.diff(time)
    u0, u1 = solution.input[ends[:, 0]], solution.input[ends[:, 1]]
    rate = functions.dynamics.map(problem.intervals)

    def derivative(state: Array, share: float) -> Array:
        input = (u0 + share * (u1 - u0)) if _has_lines(solution) else u0
        return _evaluate(rate, solution, state, input, begin + share * step)

    state = solution.state[:-1].copy()
    h = step[:, None] / SUBSTEPS
    for k in range(SUBSTEPS):
        share, half = k / SUBSTEPS, 0.5 / SUBSTEPS
        k1 = derivative(state, share)
        k2 = derivative(state + 0.5 * h * k1, share + half)
        k3 = derivative(state + 0.5 * h * k2, share + half)
        k4 = derivative(state + h * k3, share + 2.0 * half)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state - solution.state[1:]


def _has_lines(solution: Solution) -> bool:
    return solution.problem.formulation.scheme == "lobatto"


def node_rates(solution: Solution, functions: LocalFunctions) -> Array:
    """Rate of the state at each point, by the dynamics with the point's inputs (P, states)."""
    problem = solution.problem
    rate = functions.dynamics.map(problem.points)
    nodes = problem.point_nodes
    return _evaluate(
        rate,
        solution,
        solution.state[nodes],
        solution.input,
        solution.point_time,
        problem.data[problem.point_intervals],
    )


def _evaluate(
    rate: Any,
    solution: Solution,
    state: Array,
    input: Array,
    time: Array,
    data: Array | None = None,
) -> Array:
    problem = solution.problem
    data = problem.data if data is None else data
    copies = len(state)
    return np.array(
        rate(
            state.T,
            input.T,
            np.tile(solution.static[:, None], copies),
            np.tile(problem.parameter[:, None], copies),
            data.T,
            time[None, :],
            np.full((1, copies), solution.duration),
        )
    ).T


def interpolate(solution: Solution, functions: LocalFunctions, share: float) -> tuple[Array, Array]:
    """States (N, states) and inputs (N, inputs) at a share of every interval, 0 to 1."""
    ends = solution.problem.interval_points
    x0, x1 = solution.state[:-1], solution.state[1:]
    u0, u1 = solution.input[ends[:, 0]], solution.input[ends[:, 1]]
    if not _has_lines(solution):
        return x0 + share * (x1 - x0), u0
    rates = node_rates(solution, functions)
    step = np.diff(solution.node_time)[:, None]
    slope0, slope1 = step * rates[ends[:, 0]], step * rates[ends[:, 1]]
    rest = 1.0 - share
    state = (
        (1.0 + 2.0 * share) * rest**2 * x0
        + share**2 * (3.0 - 2.0 * share) * x1
        + share * rest * (rest * slope0 - share * slope1)
    )
    return state, u0 + share * (u1 - u0)
