"""Planning a gait cycle on a slope, and the same problem given to SciPy's trust-constr."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize
from scipy.sparse import csc_array, csr_array, triu

from husky_bringup.settings import HelpFormatter
from husky_control.planning.collocation.cycle import make_formulation
from husky_control.planning.collocation.problem import Problem
from husky_control.planning.collocation.request import (
    Machine,
    PlanRequest,
    cycle_model,
    cycle_problem,
    first_guess,
    machine_of,
)
from husky_control.planning.collocation.schedule import make_schedule
from husky_control.planning.collocation.solve import (
    Guess,
    Solution,
    Solver,
    start_arguments,
)
from husky_control.planning.collocation.transcription import pack_numbers
from husky_control.planning.collocation.violations import decision_bounds, row_bounds
from husky_description.robot import load_robot

Array = Any
Clock = Callable[[], float]


def bench(arguments: list[str]) -> dict[str, Any]:
    """Time to plan a cycle on a slope, cold and warm; SciPy's trust-constr on the same problem."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh plan", formatter_class=HelpFormatter)
    parser.add_argument("--slope", type=float, default=30.0, help="[deg]")
    parser.add_argument("--speed", type=float, default=0.3, help="[m/s]")
    parser.add_argument("--repeats", type=int, default=20, help="cold solutions")
    parser.add_argument("--replans", type=int, default=60, help="warm solutions, perturbed")
    parser.add_argument("--seed", type=int, default=0, help="of the perturbations")
    parser.add_argument("--cpu", action="store_true", help="processor time: for a busy machine")
    options = parser.parse_args(arguments)
    clock = time.process_time if options.cpu else time.perf_counter
    machine = machine_of(load_robot())
    request = PlanRequest(slope=math.radians(options.slope), speed=options.speed)
    begun = clock()
    solver = Solver(make_formulation(cycle_model(machine, request, _schedule(request))))
    metrics: dict[str, Any] = {"derive_and_load_ms": 1e3 * (clock() - begun)}
    for intervals in (20, 40):
        own = replace(request, intervals=intervals)
        metrics |= _measure(machine, solver, own, options, clock)
        if intervals == 20:
            metrics |= _compare(machine, solver, own, options, clock)
    metrics["scipy_over_cold"] = metrics["scipy_cold_ms"] / metrics["cold_ms_n20"]
    metrics["scipy_over_warm"] = metrics["scipy_warm_ms"] / metrics["warm_ms_n20"]
    return metrics


def _schedule(request: PlanRequest) -> Any:
    return make_schedule(request.gait_row, request.intervals)


def _problem(machine: Machine, solver: Solver, request: PlanRequest) -> tuple[Problem, Guess]:
    problem = cycle_problem(machine, request, _schedule(request), solver.formulation)
    return problem, first_guess(machine, request, problem)


def _measure(
    machine: Machine, solver: Solver, request: PlanRequest, options: Any, clock: Clock
) -> dict[str, Any]:
    """Cold and warm solutions with IPOPT; warm ones of problems nearby."""
    problem, guess = _problem(machine, solver, request)
    solver.prepare(problem)
    base = solver.solve(problem, guess)
    cold = [_timed(clock, solver, problem, guess)[0] for _ in range(options.repeats)]
    warm, iterations = [], []
    for other in _perturbed(request, options):
        seconds, solution = _timed(clock, solver, _problem(machine, solver, other)[0], base)
        warm.append(seconds)
        iterations.append(solution.iterations)
    tag = f"n{request.intervals}"
    return {
        f"variables_{tag}": len(base.decisions),
        f"constraints_{tag}": len(base.row_multipliers),
        f"cold_ms_{tag}": 1e3 * float(np.median(cold)),
        f"warm_ms_{tag}": 1e3 * float(np.median(warm)),
        f"warm_ms_p95_{tag}": 1e3 * float(np.percentile(warm, 95)),
        f"cold_iterations_{tag}": base.iterations,
        f"warm_iterations_{tag}": float(np.median(iterations)),
    }


def _timed(
    clock: Clock, solver: Solver, problem: Problem, start: Guess | Solution
) -> tuple[float, Solution]:
    begun = clock()
    solution = solver.solve(problem, start)
    return clock() - begun, solution


def _perturbed(request: PlanRequest, options: Any) -> list[PlanRequest]:
    """Requests nearby: slope by 2 deg, speed by a fifth, height by 1 cm."""
    generator = np.random.default_rng(options.seed)
    draws = generator.uniform(-1.0, 1.0, (options.replans, 3))
    height = 0.5
    return [
        replace(
            request,
            slope=request.slope + math.radians(2.0) * a,
            speed=request.speed * (1.0 + 0.2 * b),
            height=height + 0.01 * c,
        )
        for a, b, c in draws
    ]


def _compare(
    machine: Machine, solver: Solver, request: PlanRequest, options: Any, clock: Clock
) -> dict[str, Any]:
    """The same problems to SciPy: cold from the guess, warm from the base solution."""
    problem, guess = _problem(machine, solver, request)
    base = solver.solve(problem, guess)
    cold_seconds, cold = _scipy(clock, solver, problem, guess)
    other = _problem(machine, solver, _perturbed(request, options)[0])[0]
    reference = solver.solve(other, base)
    warm_seconds, warm = _scipy(clock, solver, other, base)
    return {
        "scipy_cold_ms": 1e3 * cold_seconds,
        "scipy_warm_ms": 1e3 * warm_seconds,
        "scipy_cold_iterations": int(cold.nit),
        "scipy_warm_iterations": int(warm.nit),
        "scipy_cost_over_ours": float(cold.fun / base.cost),
        "scipy_warm_cost_over_ours": float(warm.fun / reference.cost),
        "scipy_violation": float(cold.constr_violation),
        "scipy_warm_violation": float(warm.constr_violation),
    }


def _scipy(
    clock: Clock, solver: Solver, problem: Problem, start: Guess | Solution
) -> tuple[float, Any]:
    """Solve with trust-constr, with the same compiled exact derivatives; seconds and result."""
    program = solver.transcription(problem)
    numbers = pack_numbers(problem, program.layout)
    x0 = np.array(start_arguments(problem, program.layout, start)["x0"])

    def hessian(w: Array, factor: float, multipliers: Array) -> Any:
        upper = csc_array(program.hessian(w, numbers, factor, multipliers).sparse())
        return csr_array(upper + triu(upper, 1).T)

    zero = np.zeros(sum(program.layout.rows))
    rows = NonlinearConstraint(
        lambda w: np.array(program.values(w, numbers)[1]).ravel(),
        *row_bounds(problem),
        jac=lambda w: csr_array(program.jacobian(w, numbers)[1].sparse()),
        hess=lambda w, multipliers: hessian(w, 0.0, multipliers),
    )
    begun = clock()
    result = minimize(
        lambda w: float(program.values(w, numbers)[0]),
        x0,
        method="trust-constr",
        jac=lambda w: np.array(program.gradient(w, numbers)[1]).ravel(),
        hess=lambda w: hessian(w, 1.0, zero),
        constraints=[rows],
        bounds=Bounds(*decision_bounds(problem, program.layout)),
        options={"maxiter": 3000},
    )
    return clock() - begun, result
