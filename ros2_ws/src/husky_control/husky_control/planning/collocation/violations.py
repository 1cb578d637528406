"""Bounds of a problem's decisions and rows, and which of them decisions violate, by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from husky_control.planning.collocation.problem import Constraint, Problem
from husky_control.planning.collocation.transcription import (
    Layout,
    Transcription,
    pack_decisions,
    pack_numbers,
)
from husky_description.arrays import Array

TOLERANCE = 1e-6
"""Largest violation of a row that a solution may have, in the row's own unit."""


@dataclass(frozen=True)
class Violation:
    """How far a named constraint is from being met."""

    name: str  # of the constraint
    amount: float  # in its unit
    unit: str  # of the amount
    time: float | None = None  # of the worst point [s]; None for the boundary

    def __str__(self) -> str:
        """In words."""
        when = "" if self.time is None else f" at {self.time:.3f} s"
        return f"{self.name} by {self.amount:.4g} {self.unit}{when}"


def decision_bounds(problem: Problem, layout: Layout) -> tuple[Array, Array]:
    """Least and greatest value of each decision."""
    p, form = problem, problem.formulation
    least, greatest = p.duration
    return (
        pack_decisions(form, layout, p.state_lower, p.input_lower, p.static_lower, least),
        pack_decisions(form, layout, p.state_upper, p.input_upper, p.static_upper, greatest),
    )


def row_bounds(problem: Problem) -> tuple[Array, Array]:
    """Least and greatest value of each constraint row."""
    form = problem.formulation
    defects = np.zeros(problem.intervals * len(form.state_names))
    ends = form.boundary
    return (
        np.concatenate([defects, problem.path_lower.ravel(), *(c.lower for c in ends)]),
        np.concatenate([defects, problem.path_upper.ravel(), *(c.upper for c in ends)]),
    )


def violations(
    problem: Problem, transcription: Transcription, decisions: Array, tolerance: float = TOLERANCE
) -> tuple[Violation, ...]:
    """The constraints that decisions violate by more than a tolerance, the worst first."""
    form = problem.formulation
    layout = transcription.layout
    _, values = transcription.values(decisions, pack_numbers(problem, layout))
    rows = np.array(values).ravel()
    lower, upper = row_bounds(problem)
    excess = np.maximum(np.maximum(lower - rows, rows - upper), 0.0)
    defects, paths, ends = np.split(excess, np.cumsum(layout.rows)[:2])
    duration = float(decisions[layout.static[-1]]) if form.free_duration else problem.duration[0]
    node_time = problem.grid * duration
    found = _worst("dynamics", defects.reshape(problem.intervals, -1), "-", node_time)
    found += _by_name(form.path, paths, node_time[problem.point_nodes])
    found += _by_name(form.boundary, ends, None)
    low, high = decision_bounds(problem, layout)
    beyond = np.maximum(np.maximum(low - decisions, decisions - high), 0.0)
    for names, places in ((form.state_names, layout.state), (form.input_names, layout.input)):
        times = node_time if places is layout.state else node_time[problem.point_nodes]
        for column, name in enumerate(names):
            found += _worst(f"bounds of {name}", beyond[places[:, column]][:, None], "-", times)
    kept = [(amount, violation) for amount, violation in found if amount > tolerance]
    kept.sort(key=lambda pair: -pair[0])
    return tuple(violation for _, violation in kept)


_Found = list[tuple[float, Violation]]
"""Violations with the excess of their row, by which they are compared."""


def _by_name(constraints: tuple[Constraint, ...], excess: Array, times: Array | None) -> _Found:
    found: _Found = []
    table = excess.reshape(1 if times is None else len(times), -1)
    column = 0
    for constraint in constraints:
        own = table[:, column : column + constraint.size]
        found += _worst(constraint.name, own, constraint.unit, times, constraint.scale)
        column += constraint.size
    return found


def _worst(name: str, excess: Array, unit: str, times: Array | None, scale: float = 1.0) -> _Found:
    if not excess.size:
        return []
    row = int(np.argmax(excess.max(axis=1)))
    amount = float(excess[row].max())
    time = None if times is None else float(times[row])
    return [(amount, Violation(name, scale * amount, unit, time))]
