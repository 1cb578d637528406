"""The planner: a request becomes a plan that was checked, or a failure that names its reason."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from husky_control.planning.collocation.compiled import cache_directory
from husky_control.planning.collocation.cycle import (
    ATTITUDE,
    POSITION,
    RATE,
    VELOCITY,
    CycleModel,
    make_formulation,
)
from husky_control.planning.collocation.elastic import find_conflict
from husky_control.planning.collocation.mesh import check_on_finer_mesh, node_rates
from husky_control.planning.collocation.plan_store import PlanStore
from husky_control.planning.collocation.problem import Formulation
from husky_control.planning.collocation.request import (
    Machine,
    PlanRequest,
    center_height,
    cycle_model,
    cycle_problem,
    first_guess,
    machine_of,
    nominal_feet,
    steady_forces,
)
from husky_control.planning.collocation.rodrigues import rotation_from_rodrigues
from husky_control.planning.collocation.schedule import Schedule, make_schedule
from husky_control.planning.collocation.solve import Solution, SolveError, Solver
from husky_control.planning.collocation.violations import Violation
from husky_control.planning.plan import PLAN_VERSION, MeshError, Plan
from husky_description.arrays import Array

if TYPE_CHECKING:
    from husky_description.robot import Robot


MESH_TOLERANCE = 1e-3
"""Greatest mesh error of a plan, in m, rad, m/s and rad/s."""
REMEMBERED = 100
"""Plans in memory, and solutions of the same formulas to start from; beyond, the oldest goes."""


class PlanFailure(Exception):
    """There is no plan; says why.

    Attributes:
        reason: "infeasible", "not_converged" or "mesh".
        constraint: name of the constraint that stands most against it; "" when none does.
        violations: all that cannot be met together, the worst first.
    """

    def __init__(self, reason: str, violations: Iterable[Violation], hint: str = "") -> None:
        """Reason, violations worst first, what to try."""
        self.reason = reason
        self.violations = tuple(violations)
        self.constraint = self.violations[0].name if self.violations else ""
        words = ", ".join(str(violation) for violation in self.violations)
        super().__init__("; ".join(part for part in (f"{reason}: {words}", hint) if part))


@dataclass
class _Kind:
    """What requests of the same formulas share."""

    formulation: Formulation
    solver: Solver
    model: CycleModel
    solutions: list[tuple[PlanRequest, Solution]]


class Planner:
    """Plans gait cycles on slopes; remembers plans, and starts from the one nearest to a request.

    Attributes:
        machine: the robot that is planned for.
        warm_starts: how many of the plans started from a solution nearby.
        store: where plans outlast the planner, or None.
    """

    def __init__(
        self, machine: Machine, directory: Path | None = None, compiled: bool = True
    ) -> None:
        """Nothing is derived before the first request.

        Args:
            machine: the robot to plan for.
            directory: where plans are kept; None keeps them for the planner's life only.
            compiled: False leaves derivatives to CasADi's interpreter.
        """
        self.machine = machine
        self.warm_starts = 0
        self.store = PlanStore(directory) if directory is not None else None
        self._compiled = compiled
        self._kinds: dict[tuple[object, ...], _Kind] = {}
        self._plans: dict[str, Plan] = {}

    def plan(self, request: PlanRequest) -> Plan:
        """The plan of a request, from memory, from disk or solved.

        Raises:
            PlanFailure: there is none.
            ValueError: the request does not fit the gait's phases.
        """
        return self.solve(request)[0]

    def solve(self, request: PlanRequest, fresh: bool = False) -> tuple[Plan, Solution | None]:
        """As `plan`, with the solution when it was solved now; `fresh` solves whatever is
        remembered.
        """
        schedule = make_schedule(request.gait_row, request.intervals)
        _check_statics(self.machine, request)
        kind = self._kind(request, schedule)
        key = _key(request, kind.solver.digest)
        if not fresh:
            kept = self._kept(key, request)
            if kept is not None:
                return kept, None
        solution = self._solve(kind, request, schedule)
        plan = _make_plan(self.machine, request, schedule, kind, solution)
        kind.solutions.append((request, solution))
        del kind.solutions[:-REMEMBERED]
        self._keep(key, plan)
        return plan, solution

    def _kind(self, request: PlanRequest, schedule: Schedule) -> _Kind:
        model = cycle_model(self.machine, request, schedule)
        key = (model.slots, model.thrust_mode, model.directed, model.free_duration)
        if key not in self._kinds:
            form = make_formulation(model)
            self._kinds[key] = _Kind(form, Solver(form, self._compiled), model, [])
        return self._kinds[key]

    def _kept(self, key: str, request: PlanRequest) -> Plan | None:
        if key in self._plans:
            return self._plans[key]
        plan = self.store.find(key, request) if self.store is not None else None
        if plan is not None:
            self._remember(key, plan)
        return plan

    def _keep(self, key: str, plan: Plan) -> None:
        self._remember(key, plan)
        if self.store is not None:
            self.store.keep(key, plan)

    def _remember(self, key: str, plan: Plan) -> None:
        self._plans[key] = plan
        if len(self._plans) > REMEMBERED:
            del self._plans[next(iter(self._plans))]

    def _solve(self, kind: _Kind, request: PlanRequest, schedule: Schedule) -> Solution:
        problem = cycle_problem(self.machine, request, schedule, kind.formulation)
        guess = first_guess(self.machine, request, problem)
        near = _nearest(kind, request, len(schedule.grid), schedule.switches)
        if near is not None:
            try:
                solution = kind.solver.solve(problem, near)
                self.warm_starts += 1
                return solution
            except SolveError:
                pass  # the guess is another place to start from
        try:
            return kind.solver.solve(problem, guess)
        except SolveError as error:
            conflict = find_conflict(problem, guess)
            if conflict:
                raise PlanFailure("infeasible", conflict) from error
            hint = "no constraint stands against it: try other weights, period or intervals"
            raise PlanFailure("not_converged", error.violations, hint) from error


def default_planner(robot: Robot) -> Planner:
    """A planner for a robot that keeps its plans in the user's cache directory."""
    return Planner(machine_of(robot), cache_directory() / "plans")


def _key(request: PlanRequest, digest: str) -> str:
    """Names a plan by all that it depends on."""
    text = repr((PLAN_VERSION, digest, request.gait_row, request))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _nearest(
    kind: _Kind, request: PlanRequest, nodes: int, switches: tuple[int, ...]
) -> Solution | None:
    """The solution of the request nearest by slope and speed, of the same layout."""

    def distance(pair: tuple[PlanRequest, Solution]) -> float:
        other = pair[0]
        return math.hypot(other.slope - request.slope, other.speed - request.speed)

    fitting = [
        pair
        for pair in kind.solutions
        if len(pair[1].problem.grid) == nodes
        and pair[1].problem.switches == switches
        and pair[0].thrust_mode == request.thrust_mode
    ]
    return min(fitting, key=distance)[1] if fitting else None


def _check_statics(machine: Machine, request: PlanRequest) -> None:
    """What holds for the mean over any cycle: the thrust must make up for what friction lacks.

    Mean ground force and mean thrust carry the weight; the cone and the ball of the thrust are
    convex, so they hold the means of what they hold.

    Raises:
        PlanFailure: the fans cannot give that much.
    """
    thrust, _ = steady_forces(request.slope, request.usable_friction)
    weight = float(machine.rom.mass * np.linalg.norm(machine.rom.gravity))
    needed = float(np.linalg.norm(thrust)) * weight
    limit = 0.0
    if request.thrust_mode != "none":
        limit = machine.thrust_limit if request.thrust_limit is None else request.thrust_limit
    if needed > limit:
        hint = (
            f"{math.degrees(request.slope):.1f} deg with tangential/normal <= "
            f"{request.usable_friction:.3g} needs {needed:.1f} N or more, allowed are {limit:.1f} N"
        )
        raise PlanFailure("infeasible", [Violation("thrust", needed - limit, "N")], hint)


def _make_plan(
    machine: Machine, request: PlanRequest, schedule: Schedule, kind: _Kind, solution: Solution
) -> Plan:
    problem, functions, model = solution.problem, kind.solver.functions, kind.model
    state, rates = solution.state[problem.point_nodes], node_rates(solution, functions)
    rotation = np.stack([rotation_from_rodrigues(sigma) for sigma in state[:, ATTITUDE]])
    legs = schedule.slot_legs()[problem.point_intervals]
    gait = request.gait_row
    limit = machine.thrust_limit if request.thrust_limit is None else request.thrust_limit
    return Plan(
        slope=request.slope,
        speed=request.speed,
        friction=request.friction,
        friction_margin=request.friction_margin,
        thrust_mode=request.thrust_mode,
        gait=gait.name,
        period=solution.duration,
        duty=gait.duty,
        touchdown_phase=np.array(gait.touchdown_phase),
        height=center_height(machine, request),
        mass=machine.rom.mass,
        thrust_limit=0.0 if request.thrust_mode == "none" else limit,
        center_of_mass=machine.rom.center_of_mass,
        time=solution.point_time,
        position=state[:, POSITION],
        rotation=rotation,
        velocity=state[:, VELOCITY],
        angular_velocity=state[:, RATE],
        acceleration=rates[:, VELOCITY],
        angular_acceleration=rates[:, RATE],
        foot_force=model.weight * _leg_forces(solution.input, legs),
        thrust=model.weight * _thrust(solution.input[:, 3 * model.slots :], rotation),
        stance=schedule.stance[problem.point_intervals],
        foothold=_footholds(machine, request, solution),
        mesh_error=_mesh_error(kind, solution),
        cost=solution.cost,
    )


def _leg_forces(input: Array, legs: NDArray[np.int_]) -> Array:
    forces = np.zeros((len(input), 4, 3))
    for point, slot in np.argwhere(legs >= 0):
        forces[point, legs[point, slot]] = input[point, 3 * slot : 3 * slot + 3]
    return forces


def _thrust(own: Array, rotation: Array) -> Array:
    """In the slope frame: as it is, or along body z."""
    return own if own.shape[1] == 3 else rotation[:, :, 2] * own


def _footholds(machine: Machine, request: PlanRequest, solution: Solution) -> Array:
    gait = request.gait_row
    feet = np.zeros((4, 3))
    feet[:, :2] = nominal_feet(machine, gait)
    middle = np.array(gait.touchdown_phase) + 0.5 * gait.duty
    feet[:, 0] += request.speed * solution.duration * middle + solution.static[0]
    return feet


def _mesh_error(kind: _Kind, solution: Solution) -> MeshError:
    """Errors of the parts of the state; sigma is a quarter of the angle.

    Raises:
        PlanFailure: one is beyond MESH_TOLERANCE.
    """
    worst = np.abs(check_on_finer_mesh(solution, kind.solver.functions).error).max(axis=0)
    parts = (POSITION, ATTITUDE, VELOCITY, RATE)
    position, sigma, velocity, rate = (float(np.linalg.norm(worst[part])) for part in parts)
    error = MeshError(position, 4.0 * sigma, velocity, rate)
    if not error.within(MESH_TOLERANCE):
        found = Violation("mesh_error", max(astuple(error)), "-")
        raise PlanFailure("mesh", [found], f"allowed is {MESH_TOLERANCE}: more intervals")
    return error
