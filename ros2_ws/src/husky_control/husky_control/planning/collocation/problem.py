"""What is to be solved: an optimal control problem as formulas, and one instance of it as numbers.

A `Formulation` holds formulas only, so that its derivatives are made, and compiled, once. A
`Problem` adds the grid and the numbers; problems of one formulation share what was compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array

SCHEMES = ("lobatto", "euler")
"""Cubic Lobatto, that is Hermite-Simpson (T29), or explicit Euler (T28), kept to compare."""


class Symbols(NamedTuple):
    """What a formula of one point in time may use; columns of CasADi's SX."""

    state: Any
    input: Any
    static: Any  # decisions that do not change with time
    parameter: Any  # numbers of the problem
    data: Any  # numbers of the interval that the point is seen from
    time: Any  # s, since the start
    duration: Any  # s


class Ends(NamedTuple):
    """What a formula of the boundary may use; columns of CasADi's SX."""

    first: Any  # state at the start
    last: Any  # state at the end
    static: Any
    parameter: Any
    duration: Any


@dataclass(frozen=True)
class Constraint:
    """Rows of g with lower <= g <= upper, under the name by which a failure tells of them."""

    name: str  # what is limited, e.g. "friction"
    formula: Callable[[Any], Any]  # of Symbols (on a path) or Ends (at the boundary), to a column
    lower: tuple[float, ...]  # for each row, -inf where there is none
    upper: tuple[float, ...]  # for each row, inf where there is none
    unit: str = "-"  # in which violations are told
    scale: float = 1.0  # what 1 in a row is in that unit

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.lower)


_UNSET: Any = None
"""Of a field that is filled in with its shape."""


def _no_cost(_: Any) -> float:
    return 0.0


@dataclass(frozen=True)
class Formulation:
    """The formulas of an optimal control problem.

    Minimise the integral of running_cost plus final_cost over states, inputs and static decisions
    such that state' = dynamics, path constraints hold at each point and boundary constraints
    between the first and the last one (T28-T30).
    """

    name: str  # a C identifier, for compiled code
    state_names: tuple[str, ...]  # of the decisions
    input_names: tuple[str, ...]
    dynamics: Callable[[Symbols], Any]  # Symbols to the rate of the state
    running_cost: Callable[[Symbols], Any] = _no_cost  # Symbols to a number per second
    final_cost: Callable[[Ends], Any] = _no_cost  # Ends to a number
    path: tuple[Constraint, ...] = ()  # constraints on Symbols
    boundary: tuple[Constraint, ...] = ()  # constraints on Ends
    static_names: tuple[str, ...] = ()  # of the decisions that do not change with time
    parameter_names: tuple[str, ...] = ()  # of the problem's numbers
    data_names: tuple[str, ...] = ()  # of the numbers that each interval has
    free_duration: bool = False  # whether the duration is a decision (T30)
    scheme: str = "lobatto"  # one of SCHEMES

    def __post_init__(self) -> None:
        """Check the scheme and the names.

        Raises:
            ValueError: the scheme is unknown, or two constraints have one name.
        """
        if self.scheme not in SCHEMES:
            raise ValueError(f"scheme is {self.scheme!r}, it must be one of {SCHEMES}")
        names = [constraint.name for constraint in (*self.path, *self.boundary)]
        if len(set(names)) != len(names):
            raise ValueError(f"two constraints have the same name: {names}")

    @property
    def path_size(self) -> int:
        """Rows of all path constraints at one point."""
        return sum(constraint.size for constraint in self.path)

    @property
    def boundary_size(self) -> int:
        """Rows of all boundary constraints."""
        return sum(constraint.size for constraint in self.boundary)


@dataclass
class Problem:
    """One instance of a formulation. A switch splits the inputs: they may jump at its node.

    N intervals, N + 1 nodes, P = N + 1 + number of switches points. A point is a node seen from
    one side: it has the node's state and inputs of its own. Points are in the order of time.
    """

    formulation: Formulation  # the formulas
    grid: Array  # of the nodes, as shares of the duration from 0 to 1 (N + 1,)
    # s, least and greatest; equal unless the formulation leaves it free
    duration: tuple[float, float]
    switches: tuple[int, ...] = ()  # nodes in 1 .. N - 1 where the inputs may jump, increasing
    # in the order of the formulation's names
    parameter: Array = field(default_factory=lambda: np.zeros(0))
    data: Array = _UNSET  # of each interval (N, number of names)
    state_lower: Array = _UNSET  # at each node (N + 1, states); None for no bounds
    state_upper: Array = _UNSET  # at each node (N + 1, states); None for no bounds
    input_lower: Array = _UNSET  # at each point (P, inputs); None for no bounds
    input_upper: Array = _UNSET  # at each point (P, inputs); None for no bounds
    static_lower: Array = _UNSET  # None for no bounds
    static_upper: Array = _UNSET  # None for no bounds
    path_lower: Array = _UNSET  # at each point (P, rows); None for those of the constraints
    path_upper: Array = _UNSET  # at each point (P, rows); None for those of the constraints

    def __post_init__(self) -> None:
        """Check all shapes and fill in what is not limited.

        Raises:
            ValueError: a field has a wrong shape or value; the message names it.
        """
        form = self.formulation
        self.grid = np.asarray(self.grid, dtype=float)
        if self.grid.ndim != 1 or len(self.grid) < 2 or np.any(np.diff(self.grid) <= 0.0):
            raise ValueError("grid must increase from 0 to 1, with 2 nodes or more")
        if abs(self.grid[0]) > 1e-12 or abs(self.grid[-1] - 1.0) > 1e-12:
            raise ValueError(f"grid goes from {self.grid[0]} to {self.grid[-1]}, not from 0 to 1")
        self._check_switches()
        least, greatest = self.duration
        if not 0.0 < least <= greatest < np.inf or (least < greatest and not form.free_duration):
            raise ValueError(
                f"duration is {self.duration} s, it must be positive, ordered and finite, and both "
                "ends equal unless the formulation has free_duration"
            )
        nodes, points = self.intervals + 1, self.points
        self.parameter = _filled("parameter", self.parameter, (len(form.parameter_names),), 0.0)
        self.data = _filled("data", self.data, (self.intervals, len(form.data_names)), 0.0)
        for name, shape in (
            ("state", (nodes, len(form.state_names))),
            ("input", (points, len(form.input_names))),
            ("static", (len(form.static_names),)),
        ):
            self._fill_bounds(name, shape, -np.inf, np.inf)
        lower = [value for constraint in form.path for value in constraint.lower]
        upper = [value for constraint in form.path for value in constraint.upper]
        self._fill_bounds("path", (points, form.path_size), np.array(lower), np.array(upper))

    def _check_switches(self) -> None:
        inside = all(0 < node < self.intervals for node in self.switches)
        if not inside or list(self.switches) != sorted(set(self.switches)):
            raise ValueError(
                f"switches are {self.switches}, they must increase within 1 .. {self.intervals - 1}"
            )

    def _fill_bounds(self, name: str, shape: tuple[int, ...], lower: Any, upper: Any) -> None:
        low = _filled(f"{name}_lower", getattr(self, f"{name}_lower"), shape, lower)
        high = _filled(f"{name}_upper", getattr(self, f"{name}_upper"), shape, upper)
        if np.any(low > high):
            raise ValueError(f"{name}_lower is above {name}_upper at {np.argwhere(low > high)[0]}")
        setattr(self, f"{name}_lower", low)
        setattr(self, f"{name}_upper", high)

    @property
    def intervals(self) -> int:
        """N."""
        return len(self.grid) - 1

    @property
    def points(self) -> int:
        """P."""
        return len(self.grid) + len(self.switches)

    @property
    def point_nodes(self) -> NDArray[np.int_]:
        """The node of each point (P,)."""
        return np.sort(np.concatenate([np.arange(len(self.grid)), np.array(self.switches, int)]))

    @property
    def interval_points(self) -> NDArray[np.int_]:
        """First and last point of each interval (N, 2)."""
        first = np.arange(self.intervals)
        first = first + np.searchsorted(np.array(self.switches, int), first, side="right")
        return np.stack([first, first + 1], axis=1)

    @property
    def point_intervals(self) -> NDArray[np.int_]:
        """The interval that each point belongs to; between two of one stretch the later (P,)."""
        intervals = np.empty(self.points, dtype=int)
        intervals[self.interval_points[:, 1]] = np.arange(self.intervals)
        intervals[self.interval_points[:, 0]] = np.arange(self.intervals)
        return intervals


def _filled(name: str, value: Any, shape: tuple[int, ...], default: Any) -> Array:
    """An array of a shape; None and too few dimensions are broadcast."""
    array = np.asarray(default if value is None else value, dtype=float)
    try:
        array = np.array(np.broadcast_to(array, shape))
    except ValueError as error:
        raise ValueError(f"{name} has shape {array.shape}, it must have {shape}") from error
    if np.any(np.isnan(array)):
        raise ValueError(f"{name} has values that are not numbers")
    return array
