"""The formulas of one interval, one point and the boundary, with exact derivatives, as CasADi SX.

The sparse problem is made of many copies of these three, so they are all that is differentiated
and compiled. Each takes its decisions as one column and its numbers as another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from husky_control.planning.collocation.problem import Ends, Formulation, Symbols


@dataclass(frozen=True)
class LocalFunction:
    """One block: its cost and constraint rows, and how its derivatives are laid out."""

    values: Any  # (decisions, numbers) to (cost, rows)
    first: Any  # (decisions, numbers) to (gradient of the cost, nonzeros of the rows' Jacobian)
    # (decisions, numbers, cost factor, row multipliers) to nonzeros of the Hessian of the
    # Lagrangian, its upper triangle
    second: Any
    jacobian: NDArray[np.int_]  # sparsity, row and column of each nonzero (nonzeros, 2)
    # sparsity, row and column of each nonzero, row <= column (nonzeros, 2)
    hessian: NDArray[np.int_]

    @property
    def functions(self) -> tuple[Any, Any, Any]:
        """The three functions, in the order of the attributes."""
        return self.values, self.first, self.second


@dataclass(frozen=True)
class LocalFunctions:
    """All blocks of a formulation, and its dynamics as a function of their own."""

    interval: LocalFunction
    point: LocalFunction
    boundary: LocalFunction
    dynamics: Any  # (state, input, static, parameter, data, time, duration) to the state's rate


def make_local_functions(form: Formulation) -> LocalFunctions:
    """Derive the blocks of a formulation."""
    return LocalFunctions(_interval(form), _point(form), _boundary(form), _dynamics(form))


def _column(name: str, size: int) -> Any:
    return ca.SX.sym(name, size)


def _static(form: Formulation) -> tuple[Any, Any, Any]:
    """Static decisions, parameters, duration: what every block shares."""
    return (
        _column("static", len(form.static_names)),
        _column("parameter", len(form.parameter_names)),
        _column("duration", 1),
    )


def _split_duration(form: Formulation, duration: Any) -> tuple[list[Any], list[Any]]:
    """The duration is the last decision when it is free, else the last number."""
    return ([duration], []) if form.free_duration else ([], [duration])


def _interval(form: Formulation) -> LocalFunction:
    """Both ends of an interval, its cost and its defect.

    Time is counted in shares of the duration, whose rates are the duration times those in seconds:
    a free duration is then one more decision of the dynamics, and steps are numbers.
    """
    nx, nu = len(form.state_names), len(form.input_names)
    x0, u0, x1, u1 = _column("x0", nx), _column("u0", nu), _column("x1", nx), _column("u1", nu)
    static, parameter, duration = _static(form)
    data, share = _column("data", len(form.data_names)), _column("share", 2)
    free, fixed = _split_duration(form, duration)
    still = ca.vertcat(static, *free)
    rates = _Rates(form, ca.vertcat(parameter, data, *fixed))
    step = share[1] - share[0]
    decisions = ca.vertcat(x0, u0, x1, u1, still)
    numbers = ca.vertcat(parameter, data, share, *fixed)
    first = rates.at(ca.vertcat(x0, u0, still), share[0])
    last = rates.at(ca.vertcat(x1, u1, still), share[1])
    if form.scheme == "euler":
        defect = x1 - x0 - step * first.rate
        cost = 0.5 * step * (first.cost + last.cost)
        return _derive(f"{form.name}_interval", decisions, numbers, cost, defect)
    return _lobatto(form, rates, (first, last), share, decisions, numbers)


def _lobatto(
    form: Formulation, rates: _Rates, ends: tuple[_Rate, _Rate], share: Any, z: Any, numbers: Any
) -> LocalFunction:
    """The cubic through both ends with their slopes meets the dynamics at the middle (T29).

    Two thirds of a step times that condition is Simpson's rule. The middle depends on the rates of
    both ends; the chain rule is written out, for to differentiate the whole takes thrice the code.
    """
    nx, nu = len(form.state_names), len(form.input_names)
    first, last = ends
    step = share[1] - share[0]
    x0, x1, still = z[:nx], z[nx + nu : 2 * nx + nu], z[2 * (nx + nu) :]
    u_middle = 0.5 * (z[nx : nx + nu] + z[2 * nx + nu : 2 * (nx + nu)])
    x_middle = 0.5 * (x0 + x1) + 0.125 * step * (first.rate - last.rate)
    middle = rates.at(ca.vertcat(x_middle, u_middle, still), 0.5 * (share[0] + share[1]))
    own = [
        ca.DM(_selection(columns, z.shape[0])) for columns in _point_columns(nx, nu, still.shape[0])
    ]
    select0, select1 = own
    chain = ca.vertcat(
        0.5 * (select0 + select1)[:nx, :]
        + 0.125 * step * (first.jacobian @ select0 - last.jacobian @ select1),
        (0.5 * (select0 + select1))[nx:, :],
    )
    defect = x1 - x0 - step / 6.0 * (first.rate + 4.0 * middle.rate + last.rate)
    jacobian = (select1 - select0)[:nx, :] - step / 6.0 * (
        first.jacobian @ select0 + 4.0 * middle.jacobian @ chain + last.jacobian @ select1
    )
    cost = step / 6.0 * (first.cost + 4.0 * middle.cost + last.cost)
    gradient = (
        step
        / 6.0
        * (
            select0.T @ first.gradient
            + 4.0 * (chain.T @ middle.gradient)
            + select1.T @ last.gradient
        )
    )
    factor, multipliers = ca.SX.sym("factor"), ca.SX.sym("multipliers", nx)
    pull = 0.125 * step * middle.slope(-4.0 * step / 6.0 * multipliers, 4.0 * step / 6.0 * factor)
    outer = -step / 6.0 * multipliers
    hessian = (
        select0.T @ first.hessian(outer + pull, step / 6.0 * factor) @ select0
        + select1.T @ last.hessian(outer - pull, step / 6.0 * factor) @ select1
        + chain.T @ middle.hessian(4.0 * outer, 4.0 * step / 6.0 * factor) @ chain
    )
    return _functions(
        f"{form.name}_interval",
        (z, numbers, factor, multipliers),
        (cost, defect, gradient, jacobian, hessian),
    )


def _point_columns(nx: int, nu: int, still: int) -> tuple[list[int], list[int]]:
    """Where state, input and what does not change of either end stand in an interval."""
    tail = list(range(2 * (nx + nu), 2 * (nx + nu) + still))
    return list(range(nx + nu)) + tail, list(range(nx + nu, 2 * (nx + nu))) + tail


def _selection(columns: list[int], size: int) -> Any:
    """The matrix that picks columns' elements out of a vector."""
    rows = list(range(len(columns)))
    return ca.Sparsity.triplet(len(columns), size, rows, columns)


class _Rates:
    """Rates and cost of one point in time, with their derivatives as functions to be called."""

    def __init__(self, form: Formulation, numbers: Any) -> None:
        nx, nu = len(form.state_names), len(form.input_names)
        state, input = _column("state", nx), _column("input", nu)
        static, parameter, duration = _static(form)
        data, share = _column("data", len(form.data_names)), _column("share", 1)
        free, fixed = _split_duration(form, duration)
        symbols = Symbols(state, input, static, parameter, data, duration * share, duration)
        y = ca.vertcat(state, input, static, *free)
        arguments = [y, ca.vertcat(parameter, data, *fixed), share]
        rate = ca.densify(duration * form.dynamics(symbols))
        cost = ca.SX(duration * form.running_cost(symbols))
        factor, multipliers = ca.SX.sym("factor"), ca.SX.sym("multipliers", nx)
        lagrangian = ca.dot(multipliers, rate) + factor * cost
        self._numbers, self._states = numbers, nx
        self._values = ca.Function(
            "v", arguments, [rate, cost, ca.jacobian(rate, y), ca.gradient(cost, y)]
        )
        self._hessian = ca.Function(
            "h", [*arguments, multipliers, factor], [ca.hessian(lagrangian, y)[0]]
        )

    def at(self, y: Any, share: Any) -> _Rate:
        """Of state, input and what does not change, at a share of the duration."""
        arguments = (y, self._numbers, share)
        rate, cost, jacobian, gradient = self._values(*arguments)
        return _Rate(
            rate,
            cost,
            jacobian,
            gradient,
            lambda multipliers, factor: self._hessian(*arguments, multipliers, factor),
            self._states,
        )


@dataclass(frozen=True)
class _Rate:
    """Rate and cost at one point, per share of the duration."""

    rate: Any
    cost: Any
    jacobian: Any
    gradient: Any
    hessian: Callable[[Any, Any], Any]  # of multipliers times rate plus factor times cost
    states: int

    def slope(self, multipliers: Any, factor: Any) -> Any:
        """Derivative of multipliers times rate plus factor times cost by the state."""
        whole = self.jacobian.T @ multipliers + factor * self.gradient
        return whole[: self.states]


def _point(form: Formulation) -> LocalFunction:
    state = _column("state", len(form.state_names))
    input = _column("input", len(form.input_names))
    static, parameter, duration = _static(form)
    data, share = _column("data", len(form.data_names)), _column("share", 1)
    symbols = Symbols(state, input, static, parameter, data, duration * share, duration)
    rows = [constraint.formula(symbols) for constraint in form.path]
    free, fixed = _split_duration(form, duration)
    return _derive(
        f"{form.name}_point",
        ca.vertcat(state, input, static, *free),
        ca.vertcat(parameter, data, share, *fixed),
        ca.SX(0),
        ca.vertcat(*rows) if rows else ca.SX(0, 1),
    )


def _boundary(form: Formulation) -> LocalFunction:
    first, last = (_column(name, len(form.state_names)) for name in ("first", "last"))
    static, parameter, duration = _static(form)
    ends = Ends(first, last, static, parameter, duration)
    rows = [constraint.formula(ends) for constraint in form.boundary]
    free, fixed = _split_duration(form, duration)
    return _derive(
        f"{form.name}_boundary",
        ca.vertcat(first, last, static, *free),
        ca.vertcat(parameter, *fixed),
        ca.SX(form.final_cost(ends)),
        ca.vertcat(*rows) if rows else ca.SX(0, 1),
    )


def _dynamics(form: Formulation) -> Any:
    static, parameter, duration = _static(form)
    symbols = Symbols(
        _column("state", len(form.state_names)),
        _column("input", len(form.input_names)),
        static,
        parameter,
        _column("data", len(form.data_names)),
        _column("time", 1),
        duration,
    )
    return ca.Function(f"{form.name}_dynamics", list(symbols), [form.dynamics(symbols)])


def _derive(name: str, decisions: Any, numbers: Any, cost: Any, rows: Any) -> LocalFunction:
    """Differentiate a block twice as a whole."""
    cost = ca.SX(cost)
    factor, multipliers = ca.SX.sym("factor"), ca.SX.sym("multipliers", rows.shape[0])
    lagrangian = factor * cost + ca.dot(multipliers, rows)
    return _functions(
        name,
        (decisions, numbers, factor, multipliers),
        (
            cost,
            rows,
            ca.gradient(cost, decisions),
            ca.jacobian(rows, decisions),
            ca.hessian(lagrangian, decisions)[0],
        ),
    )


def _functions(name: str, symbols: tuple[Any, ...], results: tuple[Any, ...]) -> LocalFunction:
    """The three functions of a block; derivatives leave as dense columns of their nonzeros."""
    decisions, numbers, factor, multipliers = symbols
    cost, rows, gradient, jacobian, hessian = results
    jacobian, hessian = ca.sparsify(jacobian), ca.sparsify(ca.triu(hessian))
    values = [ca.densify(cost), ca.densify(rows)]
    first = [ca.densify(gradient), _nonzeros(jacobian)]
    arguments, options = [decisions, numbers], {"cse": True}
    return LocalFunction(
        ca.Function(f"{name}_values", arguments, values, options),
        ca.Function(f"{name}_first", arguments, first, options),
        ca.Function(
            f"{name}_second", [*arguments, factor, multipliers], [_nonzeros(hessian)], options
        ),
        _places(jacobian),
        _places(hessian),
    )


def _nonzeros(matrix: Any) -> Any:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)


def _places(matrix: Any) -> NDArray[np.int_]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.stack([np.array(rows, int), np.array(columns, int)], axis=1).reshape(-1, 2)
