"""Why a problem cannot be solved: give each named constraint some slack, and see who needs it.

The least sum of slacks under the same dynamics is a problem that has a solution; constraints whose
slack does not vanish are those that cannot all be met. Bounds of decisions stay hard.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import casadi as ca
import numpy as np

from husky_control.planning.collocation.problem import Constraint, Formulation, Problem
from husky_control.planning.collocation.solve import Guess, SolveError, Solver
from husky_control.planning.collocation.violations import Violation

NOTABLE = 1e-4
"""Slack in a constraint's rows that tells of a conflict; far above the solver's tolerance."""
_OPTIONS = {"tol": 1e-5, "max_iter": 200}
"""Of IPOPT: a slack is looked at, not used."""
_KEEP_NEAR = 1e-4
"""Weight of the slacks' squares: makes the least sum unique."""


def find_conflict(problem: Problem, start: Guess) -> tuple[Violation, ...]:
    """The constraints that cannot all be met, and by how much at least; the worst first.

    Violations are in the constraints' units. There are none when all slacks vanish, which means
    that a solution exists and was not found, or when this search does not arrive either.
    """
    form = problem.formulation
    soft = elastic_formulation(form)
    extra = len(soft.static_names) - len(form.static_names)
    relaxed = elastic_problem(problem, soft)
    guess = dataclasses.replace(start, static=np.concatenate([start.static, np.ones(extra)]))
    try:
        solution = Solver(soft, compiled=False, options=_OPTIONS).solve(relaxed, guess)
    except SolveError:
        return ()
    slack = solution.static[len(form.static_names) :]
    constraints = (*form.path, *form.boundary)
    order = np.argsort(-slack)
    return tuple(
        Violation(constraints[i].name, slack[i] * constraints[i].scale, constraints[i].unit)
        for i in order
        if slack[i] > NOTABLE
    )


def elastic_formulation(form: Formulation) -> Formulation:
    """The same formulas with a slack for each named constraint, and their sum as the cost."""
    first = len(form.static_names)

    def without(symbols: Any) -> Any:
        return symbols._replace(static=symbols.static[:first])

    def soften(constraint: Constraint, index: int) -> Constraint:
        def formula(symbols: Any) -> Any:
            rows, slack = constraint.formula(without(symbols)), symbols.static[first + index]
            return ca.vertcat(rows + slack, rows - slack)

        nothing = (math.inf,) * constraint.size
        return dataclasses.replace(
            constraint,
            formula=formula,
            lower=(*constraint.lower, *(-value for value in nothing)),
            upper=(*nothing, *constraint.upper),
        )

    def slack_cost(ends: Any) -> Any:
        slack = ends.static[first:]
        return ca.sum1(slack) + _KEEP_NEAR * ca.sumsqr(slack)

    constraints = [soften(c, i) for i, c in enumerate((*form.path, *form.boundary))]
    return dataclasses.replace(
        form,
        name=f"{form.name}_elastic",
        static_names=(*form.static_names, *(f"slack_{c.name}" for c in constraints)),
        dynamics=lambda symbols: form.dynamics(without(symbols)),
        running_cost=lambda symbols: 1e-8 * form.running_cost(without(symbols)),
        final_cost=slack_cost,
        path=tuple(constraints[: len(form.path)]),
        boundary=tuple(constraints[len(form.path) :]),
    )


def elastic_problem(problem: Problem, soft: Formulation) -> Problem:
    """The numbers of a problem for its elastic formulation."""
    lower, upper = problem.path_lower, problem.path_upper
    extra = len(soft.static_names) - len(problem.static_lower)
    lows, highs, column = [], [], 0
    for constraint in problem.formulation.path:
        own = slice(column, column + constraint.size)
        nothing = np.full_like(lower[:, own], np.inf)
        lows += [lower[:, own], -nothing]
        highs += [nothing, upper[:, own]]
        column += constraint.size
    empty = np.zeros((problem.points, 0))
    return dataclasses.replace(
        problem,
        formulation=soft,
        static_lower=np.concatenate([problem.static_lower, np.zeros(extra)]),
        static_upper=np.concatenate([problem.static_upper, np.full(extra, np.inf)]),
        path_lower=np.concatenate([*lows, empty], axis=1),
        path_upper=np.concatenate([*highs, empty], axis=1),
    )
