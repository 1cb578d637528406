"""Collocation against optimal control problems whose solutions are known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from husky_control.planning.collocation.elastic import find_conflict
from husky_control.planning.collocation.mesh import check_on_finer_mesh, interpolate
from husky_control.planning.collocation.problem import Constraint, Formulation, Problem
from husky_control.planning.collocation.solve import Guess, SolveError, Solver

GUESS = Guess(np.zeros(2), np.zeros(1), np.zeros(0), 1.0)


def ends(first: tuple[float, ...], last: tuple[float, ...]) -> tuple[Constraint, ...]:
    return (
        Constraint("start", lambda e: e.first, first, first, "m"),
        Constraint("end", lambda e: e.last, last, last, "m"),
    )


def double_integrator(**changes: Any) -> Formulation:
    fields: dict[str, Any] = {
        "name": "double_integrator",
        "state_names": ("place", "speed"),
        "input_names": ("force",),
        "dynamics": lambda s: ca.vertcat(s.state[1], s.input[0]),
        "running_cost": lambda s: s.input[0] ** 2,
        "boundary": ends((0.0, 0.0), (1.0, 0.0)),
        **changes,
    }
    return Formulation(**fields)


def even(count: int) -> np.ndarray:
    return np.linspace(0.0, 1.0, count + 1)


def solver(form: Formulation) -> Solver:
    return Solver(form, compiled=False)


def test_least_effort_from_rest_to_rest_is_exact() -> None:
    """u = 6 - 12 t, cost 12: lines and cubics hold it exactly."""
    form = double_integrator()
    solution = solver(form).solve(Problem(form, even(5), (1.0, 1.0)), GUESS)
    assert solution.cost == pytest.approx(12.0, abs=1e-6)
    assert np.allclose(solution.input[:, 0], 6.0 - 12.0 * solution.point_time, atol=1e-6)
    assert np.allclose(solution.state[:, 0], 3 * even(5) ** 2 - 2 * even(5) ** 3, atol=1e-7)


def pendulum_cost_error(scheme: str, count: int) -> float:
    """Least effort that brings a linear pendulum from x0 to rest, against its Gramian."""
    form = double_integrator(
        dynamics=lambda s: ca.vertcat(s.state[1], -9.0 * s.state[0] + s.input[0]),
        boundary=ends((1.0, 0.0), (0.0, 0.0)),
        scheme=scheme,
    )
    a, b = np.array([[0.0, 1.0], [-9.0, 0.0]]), np.array([0.0, 1.0])
    times, weights = np.polynomial.legendre.leggauss(40)
    gramian = sum(
        0.5 * w * np.outer(expm(a * t) @ b, expm(a * t) @ b)
        for t, w in zip(0.5 * (times + 1.0), weights, strict=True)
    )
    gap = expm(a) @ [1.0, 0.0]
    exact = float(gap @ np.linalg.solve(gramian, gap))
    cost = solver(form).solve(Problem(form, even(count), (1.0, 1.0)), GUESS).cost
    return abs(cost - exact)


@pytest.mark.parametrize(("scheme", "order", "count"), [("lobatto", 4, 4), ("euler", 1, 80)])
def test_order_of_convergence(scheme: str, order: int, count: int) -> None:
    ratio = pendulum_cost_error(scheme, count) / pendulum_cost_error(scheme, 2 * count)
    assert math.log2(ratio) == pytest.approx(order, abs=0.3)


def test_cubics_beat_euler_on_the_same_grid() -> None:
    assert pendulum_cost_error("lobatto", 10) < 1e-3 * pendulum_cost_error("euler", 10)


def test_least_time_with_a_bounded_force_is_bang_bang() -> None:
    """A free duration (T30): 2 s for 1 m with 1 m/s^2, the inputs split at the middle."""
    limit = Constraint("force_limit", lambda s: s.input[0], (-1.0,), (1.0,), "N")
    form = double_integrator(
        running_cost=lambda s: 0.0,
        final_cost=lambda e: e.duration,
        path=(limit,),
        free_duration=True,
    )
    problem = Problem(form, even(8), (0.5, 10.0), switches=(4,))
    solution = solver(form).solve(problem, GUESS)
    assert solution.duration == pytest.approx(2.0, abs=1e-4)
    assert solution.input[1:4, 0] == pytest.approx(1.0, abs=1e-3)
    assert solution.input[6:-1, 0] == pytest.approx(-1.0, abs=1e-3)


def test_a_limited_speed_is_kept_at_every_point() -> None:
    limit = Constraint("speed_limit", lambda s: s.state[1], (-math.inf,), (1.2,), "m/s")
    form = double_integrator(path=(limit,))
    solution = solver(form).solve(Problem(form, even(20), (1.0, 1.0)), GUESS)
    assert solution.state[:, 1].max() <= 1.2 + 1e-6
    # The force falls along a line to zero at t1 = 3/2 (1 - 1/v), here a node, and then mirrored;
    # v (1 - 2/3 t1) = 1 m.
    assert solution.cost == pytest.approx(8.0 * 1.2**2 / (3.0 * 0.25), rel=1e-6)


def nonlinear() -> Formulation:
    """A driven pendulum with a static force, a parameter and data of intervals."""
    return double_integrator(
        dynamics=lambda s: ca.vertcat(
            s.state[1],
            -s.parameter[0] * ca.sin(s.state[0]) + s.input[0] + s.static[0] + s.data[0] * s.time,
        ),
        running_cost=lambda s: s.input[0] ** 2 + 0.1 * s.static[0] ** 2 + s.state[0] ** 2,
        static_names=("push",),
        parameter_names=("stiffness",),
        data_names=("wind",),
    )


def nonlinear_problem(form: Formulation, count: int) -> Problem:
    return Problem(form, even(count), (1.5, 1.5), (), np.array([9.0]), np.full((count, 1), 0.5))


def test_the_finer_mesh_is_what_scipy_integrates() -> None:
    form = nonlinear()
    engine = solver(form)
    solution = engine.solve(
        nonlinear_problem(form, 6), Guess(np.zeros(2), np.zeros(1), np.zeros(1), 1.5)
    )
    error = check_on_finer_mesh(solution, engine.functions).error
    k = 2
    begin, end = solution.node_time[k : k + 2]

    def rate(t: float, x: np.ndarray) -> list[float]:
        u = np.interp(t, [begin, end], solution.input[k : k + 2, 0])
        push = u + solution.static[0] + 0.5 * t
        return [x[1], -9.0 * math.sin(x[0]) + push]

    path = solve_ivp(rate, (begin, end), solution.state[k], rtol=1e-11, atol=1e-12)
    assert np.allclose(path.y[:, -1] - solution.state[k + 1], error[k], atol=2e-7)  # Runge-Kutta


def test_mesh_error_falls_with_the_fifth_power_of_the_step() -> None:
    form = nonlinear()
    engine = solver(form)
    guess = Guess(np.zeros(2), np.zeros(1), np.zeros(1), 1.5)
    worst = [
        float(
            np.abs(
                check_on_finer_mesh(
                    engine.solve(nonlinear_problem(form, n), guess), engine.functions
                ).error
            ).max()
        )
        for n in (8, 16)
    ]
    assert math.log2(worst[0] / worst[1]) == pytest.approx(5.0, abs=0.6)


def test_cubics_meet_the_dynamics_at_nodes_and_middle() -> None:
    """T29: the slope of the cubic is f_ROM at both ends, and at the middle by the defect."""
    form = nonlinear()
    engine = solver(form)
    solution = engine.solve(
        nonlinear_problem(form, 8), Guess(np.zeros(2), np.zeros(1), np.zeros(1), 1.5)
    )
    step, tiny = 1.5 / 8, 1e-5
    for share in (0.0, 0.5, 1.0):
        ahead, _ = interpolate(solution, engine.functions, share + tiny)
        behind, _ = interpolate(solution, engine.functions, share - tiny)
        state, input = interpolate(solution, engine.functions, share)
        slope = (ahead - behind) / (2 * tiny * step)
        time = solution.node_time[:-1] + share * step
        push = input[:, 0] + solution.static[0] + 0.5 * time
        rate = np.stack([state[:, 1], -9.0 * np.sin(state[:, 0]) + push], axis=1)
        assert np.allclose(slope, rate, atol=1e-6)


def test_a_warm_start_finds_the_same_optimum_in_fewer_steps() -> None:
    form = nonlinear()
    engine = solver(form)
    guess = Guess(np.zeros(2), np.zeros(1), np.zeros(1), 1.5)
    base = engine.solve(nonlinear_problem(form, 12), guess)
    other = nonlinear_problem(form, 12)
    other.parameter[0] = 9.5
    cold, warm = engine.solve(other, guess), engine.solve(other, base)
    assert warm.iterations < cold.iterations
    assert warm.cost == pytest.approx(cold.cost, rel=1e-6)
    assert np.allclose(warm.input, cold.input, atol=1e-4)


def too_weak(limit: float) -> tuple[Formulation, Problem]:
    rows = Constraint("force_limit", lambda s: s.input[0], (-limit,), (limit,), "N")
    form = double_integrator(path=(rows,))
    return form, Problem(form, even(10), (1.0, 1.0))


def test_an_infeasible_problem_names_its_constraint() -> None:
    """1 m in 1 s from rest to rest needs 4 m/s^2."""
    form, problem = too_weak(2.0)
    with pytest.raises(SolveError) as failure:
        solver(form).solve(problem, GUESS)
    assert failure.value.violations
    names = {violation.name: violation for violation in find_conflict(problem, GUESS)}
    assert names.keys() & {"force_limit", "start", "end"}
    assert all(violation.amount > 0.0 for violation in names.values())


def test_a_feasible_problem_has_no_conflict() -> None:
    _, problem = too_weak(5.0)
    assert find_conflict(problem, GUESS) == ()


Change = Callable[[], Any]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: double_integrator(scheme="magic"), "magic.*lobatto"),
        (lambda: double_integrator(boundary=(ends((0.0,), (0.0,))[0],) * 2), "same name"),
        (lambda: Problem(double_integrator(), np.array([0.0, 0.5]), (1.0, 1.0)), "grid"),
        (lambda: Problem(double_integrator(), np.array([0.0, 0.6, 0.5, 1.0]), (1, 1)), "grid"),
        (lambda: Problem(double_integrator(), even(4), (1.0, 2.0)), "duration"),
        (lambda: Problem(double_integrator(), even(4), (1.0, 1.0), switches=(4,)), "switches"),
        (lambda: Problem(double_integrator(), even(4), (1.0, 1.0), parameter=np.ones(3)), "param"),
        (
            lambda: Problem(
                double_integrator(), even(4), (1.0, 1.0), state_lower=np.full(2, np.nan)
            ),
            "state_lower",
        ),
        (
            lambda: Problem(
                double_integrator(),
                even(4),
                (1, 1),
                input_lower=np.ones(1),
                input_upper=-np.ones(1),
            ),
            "above",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(make: Change, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_starts_that_do_not_fit_are_refused() -> None:
    form = double_integrator()
    engine = solver(form)
    base = engine.solve(Problem(form, even(5), (1.0, 1.0)), GUESS)
    with pytest.raises(ValueError, match="same layout"):
        engine.solve(Problem(form, even(6), (1.0, 1.0)), base)
    with pytest.raises(ValueError, match="guess"):
        engine.solve(
            Problem(form, even(6), (1.0, 1.0)),
            Guess(np.zeros(3), np.zeros(1), np.zeros(0), 1.0),
        )
    with pytest.raises(ValueError, match="solver is for"):
        engine.solve(Problem(double_integrator(), even(6), (1.0, 1.0)), GUESS)
