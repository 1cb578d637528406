"""The sparse problem: many copies of a formulation's blocks, and where each of their numbers goes.

Decisions are in the order of time: the state of a node, then the inputs of its points; static
decisions and a free duration come last. Constraint rows are the defects of all intervals, the path
rows of all points, the boundary. Nothing is differentiated here: Jacobian and Hessian are gathered
from the blocks' nonzeros, the Hessian by adding up what blocks share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from husky_control.planning.collocation.local_functions import LocalFunction, LocalFunctions
from husky_control.planning.collocation.problem import Formulation, Problem
from husky_description.arrays import Array

Indices = NDArray[np.int_]


@dataclass(frozen=True)
class Layout:
    """Where decisions, numbers and rows stand; depends on the grid's size and switches only."""

    state: Indices  # decision of each node's state (N + 1, states)
    input: Indices  # decision of each point's input (P, inputs)
    static: Indices  # decision of each static decision, a free duration last
    parameter: Indices  # number of each parameter of the problem
    data: Indices  # number of the data of each interval (N, data)
    share: Indices  # number of each node's share of the duration (N + 1,)
    duration: Indices  # number of a fixed duration, none where it is free
    size: int  # how many decisions
    numbers: int  # how many numbers
    rows: tuple[int, int, int]  # of the constraints: those of intervals, of points, of the boundary


def make_layout(problem: Problem) -> Layout:
    """Number the decisions, numbers and rows of a problem."""
    form = problem.formulation
    nx, nu = len(form.state_names), len(form.input_names)
    state = np.empty((problem.intervals + 1, nx), dtype=int)
    input = np.empty((problem.points, nu), dtype=int)
    size, last_node = 0, -1
    for point, node in enumerate(problem.point_nodes):
        if node != last_node:
            state[node] = size + np.arange(nx)
            size += nx
        input[point] = size + np.arange(nu)
        size, last_node = size + nu, node
    static = size + np.arange(len(form.static_names) + form.free_duration)
    counts = (
        len(form.parameter_names),
        problem.intervals * len(form.data_names),
        problem.intervals + 1,
        0 if form.free_duration else 1,
    )
    starts = np.concatenate([[0], np.cumsum(counts)])
    parameter, data, share, duration = (
        starts[i] + np.arange(count) for i, count in enumerate(counts)
    )
    return Layout(
        state,
        input,
        static,
        parameter,
        data.reshape(problem.intervals, -1),
        share,
        duration,
        size + len(static),
        int(starts[-1]),
        (problem.intervals * nx, problem.points * form.path_size, form.boundary_size),
    )


@dataclass(frozen=True)
class _Block:
    """One local function, the decisions and numbers of each of its copies, its first row."""

    local: LocalFunction
    decisions: Indices  # (copies, local decisions)
    numbers: Indices  # (copies, local numbers)
    rows: int  # of one copy
    first_row: int

    @property
    def copies(self) -> int:
        return len(self.decisions)

    def call(self, function: Any, w: Any, p: Any, *more: Any) -> Any:
        """All copies at once; what a copy returns is a column."""
        return function.map(self.copies)(
            _gather(w, self.decisions), _gather(p, self.numbers), *more
        )


class Transcription:
    """The nonlinear program of a problem's layout, as CasADi functions of (decisions, numbers).

    Attributes:
        layout: where what stands.
        values: (w, p) to (cost, rows).
        gradient: (w, p) to (cost, its gradient).
        jacobian: (w, p) to (rows, their sparse Jacobian).
        hessian: (w, p, cost factor, row multipliers) to the upper triangle of the Lagrangian's.
    """

    def __init__(self, problem: Problem, functions: LocalFunctions) -> None:
        """Lay out and assemble; other problems of the same layout may use it."""
        self.layout = make_layout(problem)
        self._blocks = _blocks(problem, functions, self.layout)
        self._w = ca.MX.sym("w", self.layout.size)
        self._p = ca.MX.sym("p", self.layout.numbers)
        self.values = self._values()
        self.gradient, self.jacobian = self._first()
        self.hessian = self._second()

    def program(self) -> dict[str, Any]:
        """The program as CasADi's solvers take it."""
        cost, rows = self.values(self._w, self._p)
        return {"x": self._w, "p": self._p, "f": cost, "g": rows}

    def _values(self) -> Any:
        costs, rows = [], []
        for block in self._blocks:
            cost, block_rows = block.call(block.local.values, self._w, self._p)
            costs.append(ca.sum2(cost))
            rows.append(ca.vec(block_rows))
        outputs = [sum(costs), ca.vertcat(*rows)]
        return ca.Function("nlp_fg", [self._w, self._p], outputs, ["x", "p"], ["f", "g"])

    def _first(self) -> tuple[Any, Any]:
        gradients, nonzeros, rows, columns = [], [], [], []
        for block in self._blocks:
            gradient, jacobian = block.call(block.local.first, self._w, self._p)
            gradients.append(ca.vec(gradient))
            nonzeros.append(ca.vec(jacobian))
            places = block.local.jacobian
            first = block.first_row + block.rows * np.arange(block.copies)
            rows.append((first[:, None] + places[:, 0]).ravel())
            columns.append(block.decisions[:, places[:, 1]].ravel())
        decisions = np.concatenate([block.decisions.ravel() for block in self._blocks])
        size = self.layout.size
        gradient = ca.densify(
            _scatter(ca.vertcat(*gradients), decisions, np.zeros_like(decisions), (size, 1))
        )
        jacobian = _scatter(
            ca.vertcat(*nonzeros),
            np.concatenate(rows),
            np.concatenate(columns),
            (sum(self.layout.rows), size),
        )
        cost, g = self.values(self._w, self._p)
        inputs = [self._w, self._p]
        return (
            ca.Function("nlp_grad_f", inputs, [cost, gradient], ["x", "p"], ["f", "grad_f_x"]),
            ca.Function("nlp_jac_g", inputs, [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        )

    def _second(self) -> Any:
        factor = ca.MX.sym("lam_f")
        multipliers = ca.MX.sym("lam_g", sum(self.layout.rows))
        nonzeros, rows, columns = [], [], []
        for block in self._blocks:
            last = block.first_row + block.rows * block.copies
            own = ca.reshape(multipliers[block.first_row : last], block.rows, block.copies)
            factors = ca.repmat(factor, 1, block.copies)
            hessian = block.call(block.local.second, self._w, self._p, factors, own)
            nonzeros.append(ca.vec(hessian))
            places = block.decisions[:, block.local.hessian]
            rows.append(places.min(axis=2).ravel())
            columns.append(places.max(axis=2).ravel())
        matrix = _scatter(
            ca.vertcat(*nonzeros),
            np.concatenate(rows),
            np.concatenate(columns),
            (self.layout.size, self.layout.size),
        )
        inputs = [self._w, self._p, factor, multipliers]
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("nlp_hess_l", inputs, [matrix], names, ["triu_hess_gamma_x_x"])


def _blocks(problem: Problem, functions: LocalFunctions, layout: Layout) -> list[_Block]:
    form = problem.formulation
    nodes, ends = problem.point_nodes, problem.interval_points
    intervals, points = problem.intervals, problem.points
    interval_rows, point_rows, boundary_rows = layout.rows
    blocks = [
        _Block(
            functions.interval,
            _columns(
                intervals,
                layout.state[:-1],
                layout.input[ends[:, 0]],
                layout.state[1:],
                layout.input[ends[:, 1]],
                layout.static,
            ),
            _columns(
                intervals,
                layout.parameter,
                layout.data,
                np.stack([layout.share[:-1], layout.share[1:]], axis=1),
                layout.duration,
            ),
            len(form.state_names),
            0,
        )
    ]
    if point_rows:
        blocks.append(
            _Block(
                functions.point,
                _columns(points, layout.state[nodes], layout.input, layout.static),
                _columns(
                    points,
                    layout.parameter,
                    layout.data[problem.point_intervals],
                    layout.share[nodes][:, None],
                    layout.duration,
                ),
                form.path_size,
                interval_rows,
            )
        )
    blocks.append(
        _Block(
            functions.boundary,
            _columns(1, layout.state[:1], layout.state[-1:], layout.static),
            _columns(1, layout.parameter, layout.duration),
            boundary_rows,
            interval_rows + point_rows,
        )
    )
    return blocks


def _columns(copies: int, *parts: Indices) -> Indices:
    """Indices side by side; those of one dimension are the same for every copy."""
    wide = [np.broadcast_to(part, (copies, np.shape(part)[-1])) for part in parts]
    return np.concatenate(wide, axis=1).astype(int)


def _gather(vector: Any, indices: Indices) -> Any:
    """Columns of a vector's elements, one column for each row of indices."""
    copies, rows = indices.shape
    return ca.reshape(vector[indices.ravel().tolist()], rows, copies)


def _scatter(nonzeros: Any, rows: Indices, columns: Indices, shape: tuple[int, int]) -> Any:
    """A sparse matrix from entries at places; entries at the same place are added."""
    places, target = np.unique(columns * shape[0] + rows, return_inverse=True)
    sparsity = ca.Sparsity.triplet(
        *shape, (places % shape[0]).tolist(), (places // shape[0]).tolist()
    )
    if len(places) == len(target):
        ordered = nonzeros[np.argsort(target).tolist()]
    else:
        collect = ca.Sparsity.triplet(
            len(places), len(target), target.tolist(), list(range(len(target)))
        )
        ordered = ca.mtimes(ca.DM(collect, 1.0), nonzeros)
    return ca.sparsity_cast(ordered, sparsity)


def pack_numbers(problem: Problem, layout: Layout) -> Array:
    """The numbers of a problem in the order of its layout."""
    duration = [] if problem.formulation.free_duration else [problem.duration[0]]
    return np.concatenate([problem.parameter, problem.data.ravel(), problem.grid, duration])


def pack_decisions(
    form: Formulation, layout: Layout, state: Array, input: Array, static: Array, duration: float
) -> Array:
    """Decisions as one vector: guesses, bounds or solutions."""
    w = np.empty(layout.size)
    w[layout.state], w[layout.input] = state, input
    w[layout.static] = [*static, duration] if form.free_duration else static
    return w
