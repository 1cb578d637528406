"""Solve a problem with IPOPT: a solution that holds, or a failure that names what does not.

Derivatives are exact and, where a C compiler is found, machine code. A solver keeps what it made
for a layout, so that the next problem of the same grid starts at once.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from husky_control.planning.collocation.compiled import compile_functions
from husky_control.planning.collocation.local_functions import (
    LocalFunction,
    LocalFunctions,
    make_local_functions,
)
from husky_control.planning.collocation.problem import Formulation, Problem
from husky_control.planning.collocation.transcription import (
    Layout,
    Transcription,
    pack_decisions,
    pack_numbers,
)
from husky_control.planning.collocation.violations import (
    TOLERANCE,
    Violation,
    decision_bounds,
    row_bounds,
    violations,
)
from husky_description.arrays import Array

COLD_OPTIONS: dict[str, Any] = {
    "tol": TOLERANCE,
    "constr_viol_tol": TOLERANCE,
    "acceptable_iter": 0,  # almost solved is not solved
    "linear_solver": "mumps",
    "mumps_pivot_order": 0,  # AMD
    "mumps_permuting_scaling": 0,  # decisions and rows are of one size already
    "mu_strategy": "adaptive",  # a half to a tenth of the steps of the monotone one
    "max_iter": 250,
    "print_level": 0,
    "sb": "yes",
}
"""Options of IPOPT for a start from a guess."""

WARM_OPTIONS: dict[str, Any] = {
    **COLD_OPTIONS,
    "warm_start_init_point": "yes",
    "mu_strategy": "monotone",
    "nlp_scaling_method": "none",
    "mumps_scaling": 0,
    "mu_init": 1e-7,
    "warm_start_bound_push": 1e-8,
    "warm_start_bound_frac": 1e-8,
    "warm_start_slack_bound_push": 1e-8,
    "warm_start_slack_bound_frac": 1e-8,
    "warm_start_mult_bound_push": 1e-8,
    "min_refinement_steps": 0,  # a step needs no more than the tolerance
    "residual_ratio_max": 1e-6,
    "max_iter": 100,
}
"""Options of IPOPT for a start from a solution nearby, with its multipliers."""


@dataclass(frozen=True)
class Guess:
    """Where to start: values of all decisions."""

    state: Array  # at each node (N + 1, states), or one row for all
    input: Array  # at each point (P, inputs), or one row for all
    static: Array  # (statics,)
    duration: float  # s


class SolveError(Exception):
    """There is no solution; says why.

    Attributes:
        reason: "infeasible" or "not_converged".
        violations: the constraints that cannot all be met, the worst first.
        status: the solver's own word.
    """

    def __init__(self, reason: str, violations: tuple[Violation, ...], status: str) -> None:
        """Reason and violations, worst first."""
        self.reason = reason
        self.violations = violations
        self.status = status
        what = ", ".join(str(violation) for violation in violations) or "no constraint by itself"
        super().__init__(f"{reason}: {what} ({status})")


@dataclass(frozen=True)
class Solution:
    """A solved problem."""

    problem: Problem  # what was solved
    state: Array  # at each node (N + 1, states)
    input: Array  # at each point (P, inputs)
    static: Array  # (statics,)
    duration: float  # s
    cost: float  # of the discretised problem
    decisions: Array  # all of them, in the order of the layout
    bound_multipliers: Array  # of the decisions' bounds
    row_multipliers: Array  # of the constraint rows
    iterations: int  # of the solver
    seconds: float  # that the solver took, wall time

    @property
    def node_time(self) -> Array:
        """Time of each node [s] (N + 1,)."""
        return self.problem.grid * self.duration

    @property
    def point_time(self) -> Array:
        """Time of each point [s] (P,)."""
        return self.node_time[self.problem.point_nodes]


@dataclass
class _Program:
    """What is kept for one layout."""

    transcription: Transcription
    solvers: dict[str, Any] = field(default_factory=dict)


class Solver:
    """Solves the problems of one formulation.

    Attributes:
        formulation: the formulas.
        functions: its blocks, compiled or not.
        digest: hash of the formulas.
    """

    def __init__(
        self,
        formulation: Formulation,
        compiled: bool = True,
        directory: Path | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Derive, and compile unless told not to.

        Args:
            formulation: the formulas.
            compiled: False leaves the derivatives to CasADi's interpreter.
            directory: where compiled code is kept; None for the user's cache.
            options: of IPOPT, over COLD_OPTIONS and WARM_OPTIONS.
        """
        self.formulation = formulation
        self.functions = make_local_functions(formulation)
        self.digest = _digest(self.functions)
        if compiled:
            self.functions = _compiled(formulation.name, self.functions, directory)
        self._options = dict(options or {})
        self._programs: dict[tuple[int, tuple[int, ...]], _Program] = {}

    def transcription(self, problem: Problem) -> Transcription:
        """The nonlinear program of a problem's layout."""
        return self._program(problem).transcription

    def _program(self, problem: Problem) -> _Program:
        if problem.formulation is not self.formulation:
            raise ValueError(f"this solver is for {self.formulation.name!r}, not this problem")
        key = (problem.intervals, problem.switches)
        if key not in self._programs:
            self._programs[key] = _Program(Transcription(problem, self.functions))
        return self._programs[key]

    def _solver(self, program: _Program, kind: str) -> Any:
        if kind not in program.solvers:
            base = WARM_OPTIONS if kind == "warm" else COLD_OPTIONS
            transcription = program.transcription
            program.solvers[kind] = ca.nlpsol(
                kind,
                "ipopt",
                transcription.program(),
                {
                    "grad_f": transcription.gradient,
                    "jac_g": transcription.jacobian,
                    "hess_lag": transcription.hessian,
                    "calc_lam_p": False,
                    "no_nlp_grad": True,
                    "print_time": False,
                    "ipopt": {**base, **self._options},
                },
            )
        return program.solvers[kind]

    def prepare(self, problem: Problem) -> None:
        """Make all that solving a problem of this layout needs, so that it costs no time later."""
        program = self._program(problem)
        for kind in ("cold", "warm"):
            self._solver(program, kind)

    def solve(self, problem: Problem, start: Guess | Solution) -> Solution:
        """Solve from a guess, or warm from the solution of a problem nearby with the same layout.

        A warm start has few iterations; one that does not arrive is no proof that nothing would.

        Raises:
            SolveError: no solution was found; says which constraints stand against one.
            ValueError: the start does not fit the problem.
        """
        program = self._program(problem)
        solver = self._solver(program, "warm" if isinstance(start, Solution) else "cold")
        layout = program.transcription.layout
        arguments = start_arguments(problem, layout, start)
        begun = time.perf_counter()
        result = solver(**arguments)
        seconds = time.perf_counter() - begun
        stats = solver.stats()
        decisions = np.array(result["x"]).ravel()
        if not stats["success"]:
            raise SolveError(
                "not_converged",
                violations(problem, program.transcription, decisions),
                str(stats["return_status"]),
            )
        return _solution(problem, layout, result, decisions, int(stats["iter_count"]), seconds)


def start_arguments(problem: Problem, layout: Layout, start: Guess | Solution) -> dict[str, Any]:
    """Start, numbers and bounds of a problem under the names of CasADi's solvers."""
    form = problem.formulation
    lower, upper = decision_bounds(problem, layout)
    row_lower, row_upper = row_bounds(problem)
    arguments: dict[str, Any] = {
        "p": pack_numbers(problem, layout),
        "lbx": lower,
        "ubx": upper,
        "lbg": row_lower,
        "ubg": row_upper,
    }
    if isinstance(start, Solution):
        if start.decisions.shape != (layout.size,):
            raise ValueError(
                f"a warm start needs the same layout: {start.decisions.size} decisions were "
                f"solved, the problem has {layout.size}"
            )
        arguments["x0"] = start.decisions
        arguments["lam_x0"], arguments["lam_g0"] = start.bound_multipliers, start.row_multipliers
    else:
        try:
            arguments["x0"] = pack_decisions(
                form, layout, start.state, start.input, start.static, start.duration
            )
        except ValueError as error:
            raise ValueError(f"the guess does not fit the problem: {error}") from error
    return arguments


def _digest(functions: LocalFunctions) -> str:
    """Hash of the formulas: whatever changes them changes it."""
    blocks = (functions.interval, functions.point, functions.boundary)
    text = "".join(block.values.serialize() for block in blocks)
    return hashlib.sha256(text.encode()).hexdigest()


def _compiled(name: str, functions: LocalFunctions, directory: Path | None) -> LocalFunctions:
    blocks = (functions.interval, functions.point, functions.boundary)
    plain = [function for block in blocks for function in block.functions]
    quick = compile_functions(name, [*plain, functions.dynamics], directory)
    interval, point, boundary = (
        LocalFunction(
            quick[3 * i], quick[3 * i + 1], quick[3 * i + 2], block.jacobian, block.hessian
        )
        for i, block in enumerate(blocks)
    )
    return LocalFunctions(interval, point, boundary, quick[-1])


def _solution(
    problem: Problem,
    layout: Layout,
    result: Mapping[str, Any],
    decisions: Array,
    iterations: int,
    seconds: float,
) -> Solution:
    form = problem.formulation
    static = decisions[layout.static]
    duration = problem.duration[0]
    if form.free_duration:
        static, duration = static[:-1], float(static[-1])
    return Solution(
        problem,
        decisions[layout.state],
        decisions[layout.input],
        static,
        duration,
        float(result["f"]),
        decisions,
        np.array(result["lam_x"]).ravel(),
        np.array(result["lam_g"]).ravel(),
        iterations,
        seconds,
    )
