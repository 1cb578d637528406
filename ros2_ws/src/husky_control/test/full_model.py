"""The thesis's own problem: the whole state of T26, joint accelerations, ground forces and thrust.

State and dynamics are those of `reduced_order` in the frame of the slope, z = 0 being the plane of
the centres of standing feet; forces are in units of the weight. Feet that stand have no velocity at
any point, and are at their footholds when they touch down; feet in the air push on nothing and stay
above the ground. The rotation has nine numbers: at the start it is the identity, and the cycle ends
when it is so again.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from husky_control.planning.collocation.problem import (
    Constraint,
    Ends,
    Formulation,
    Problem,
    Symbols,
)
from husky_control.planning.collocation.request import (
    FORCE_LIMIT,
    Machine,
    PlanRequest,
    center_height,
    nominal_feet,
    steady_forces,
)
from husky_control.planning.collocation.schedule import Schedule
from husky_control.planning.collocation.solve import Guess
from husky_control.planning.reduced_order import (
    ANGULAR_VELOCITY,
    LEG_POSITION,
    LEG_STATES,
    LEG_VELOCITY,
    POSITION,
    ROTATION,
    STATES,
    VELOCITY,
    f_rom,
    foot_positions,
    foot_velocities,
)
from husky_control.planning.rom_parameters import in_slope_frame
from husky_description.arrays import Array
from husky_description.kinematics import LEGS

LEG_INPUT, FORCE_INPUT, THRUST_INPUT = slice(0, 12), slice(12, 24), slice(24, 27)
"""Parts of the input: q_L'' , forces of all four feet, thrust."""

WEIGHTS = {"leg": 20.0, "leg_rate": 0.2, "leg_acceleration": 1e-3, "force": 2.0, "thrust": 100.0}
"""Of the cost, beside those of the body: rad and m alike, forces in units of the weight."""
_BODY = {"rotation": 500.0, "position": 2000.0, "angular_velocity": 20.0, "velocity": 200.0}


def full_formulation(machine: Machine) -> Formulation:
    """The formulas of the thesis's problem for a robot."""
    formulas = _Formulas(machine)
    zero3, free = (0.0,) * 3, (math.inf,)
    weight = formulas.weight
    return Formulation(
        name="full_model",
        state_names=tuple(f"x{i}" for i in range(STATES)),
        input_names=tuple(f"u{i}" for i in range(THRUST_INPUT.stop)),
        parameter_names=("slope", "speed", "friction", "thrust_limit", "height"),
        data_names=tuple(f"foothold_{leg}_{axis}" for leg in range(LEGS) for axis in "xy"),
        dynamics=formulas.dynamics,
        running_cost=formulas.cost,
        path=(
            Constraint("friction", formulas.friction, (0.0,) * LEGS, free * LEGS, "N", weight),
            Constraint("thrust", formulas.thrust_reserve, (0.0,), free, "N", weight),
            Constraint("standing_foot", formulas.foot_velocity, zero3 * LEGS, zero3 * LEGS, "m/s"),
            Constraint("foothold", formulas.foothold_gap, zero3 * LEGS, zero3 * LEGS, "m"),
            Constraint("clearance", formulas.clearance, (0.0,) * LEGS, free * LEGS, "m"),
        ),
        boundary=(Constraint("periodicity", formulas.period_gap, (0.0,) * 36, (0.0,) * 36, "-"),),
    )


class _Formulas:
    def __init__(self, machine: Machine) -> None:
        self._rom = machine.rom
        self.weight = float(machine.rom.mass * np.linalg.norm(machine.rom.gravity))

    def dynamics(self, symbols: Symbols) -> Any:
        """f_ROM (T26)."""
        parameters = in_slope_frame(self._rom, symbols.parameter[0])
        u = symbols.input
        force, thrust = self.weight * u[FORCE_INPUT], self.weight * u[THRUST_INPUT]
        return f_rom(symbols.state, u[LEG_INPUT], force, thrust, parameters)

    def cost(self, symbols: Symbols) -> Any:
        """e^T Q e + u^T R u (T28)."""
        x, u, speed, height = symbols.state, symbols.input, *_numbers(symbols, "speed", "height")
        hips = self._rom.hip_position
        legs = ca.vertcat(*(ca.vertcat(0.0, 0.0, height + hips[leg, 2]) for leg in range(LEGS)))
        body = ca.vertcat(speed * symbols.time, 0.0, height)
        return (
            WEIGHTS["leg"] * ca.sumsqr(x[LEG_POSITION] - legs)
            + WEIGHTS["leg_rate"] * ca.sumsqr(x[LEG_VELOCITY])
            + _BODY["rotation"] * ca.sumsqr(x[ROTATION] - np.eye(3).ravel()) / 2.0
            + _BODY["position"] * ca.sumsqr(x[POSITION] - body)
            + _BODY["angular_velocity"] * ca.sumsqr(x[ANGULAR_VELOCITY])
            + _BODY["velocity"] * ca.sumsqr(x[VELOCITY] - ca.vertcat(speed, 0.0, 0.0))
            + WEIGHTS["leg_acceleration"] * ca.sumsqr(u[LEG_INPUT])
            + WEIGHTS["force"] * ca.sumsqr(u[FORCE_INPUT])
            + WEIGHTS["thrust"] * ca.sumsqr(u[THRUST_INPUT])
        )

    def friction(self, symbols: Symbols) -> Any:
        """What the cone leaves of each foot's force (T16)."""
        (usable,) = _numbers(symbols, "friction")
        forces = [symbols.input[12 + 3 * leg : 15 + 3 * leg] for leg in range(LEGS)]
        return ca.vertcat(*(usable * f[2] - ca.sqrt(f[0] ** 2 + f[1] ** 2 + 1e-6) for f in forces))

    def thrust_reserve(self, symbols: Symbols) -> Any:
        """What the limit leaves of the thrust."""
        (limit,) = _numbers(symbols, "thrust_limit")
        return limit - ca.sqrt(ca.sumsqr(symbols.input[THRUST_INPUT]) + 1e-6)

    def foot_velocity(self, symbols: Symbols) -> Any:
        """Velocity of each foot."""
        return ca.vec(foot_velocities(symbols.state, self._rom).T)

    def foothold_gap(self, symbols: Symbols) -> Any:
        """From the foothold of each foot to the foot."""
        feet = foot_positions(symbols.state, self._rom)
        footholds = [ca.horzcat(symbols.data[2 * leg : 2 * leg + 2].T, 0.0) for leg in range(LEGS)]
        return ca.vec((feet - ca.vertcat(*footholds)).T)

    def clearance(self, symbols: Symbols) -> Any:
        """Height of each foot over the plane of the standing ones."""
        return foot_positions(symbols.state, self._rom)[:, 2]

    def period_gap(self, ends: Ends) -> Any:
        """End less start, a stride further on; of the rotation the three numbers that are free."""
        gap = ends.last - ends.first
        gap[POSITION.start] -= ends.parameter[1] * ends.duration
        turn = ends.last[ROTATION]
        return ca.vertcat(
            gap[: ROTATION.start],
            turn[1] - turn[3],
            turn[2] - turn[6],
            turn[5] - turn[7],
            gap[POSITION.start :],
        )


def _numbers(symbols: Symbols, *names: str) -> tuple[Any, ...]:
    order = ("slope", "speed", "friction", "thrust_limit", "height")
    return tuple(symbols.parameter[order.index(name)] for name in names)


def full_problem(
    machine: Machine, request: PlanRequest, schedule: Schedule, formulation: Formulation
) -> tuple[Problem, Guess]:
    """The numbers of a cycle with vectored thrust, and where to start.

    Footholds are where the steady body wants them: shifted along the slope so that the ground's
    force goes through the centre of mass.
    """
    gait = request.gait_row
    weight = float(machine.rom.mass * np.linalg.norm(machine.rom.gravity))
    height = center_height(machine, request) - machine.foot_radius
    limit = machine.thrust_limit if request.thrust_limit is None else request.thrust_limit
    thrust, ground = steady_forces(request.slope, request.usable_friction)
    feet = nominal_feet(machine, gait)
    feet[:, 0] -= height * ground[0] / ground[2]
    places = np.tile(feet, (len(schedule.middle), 1, 1))
    places[:, :, 0] += request.speed * gait.period * schedule.middle
    problem = Problem(
        formulation,
        schedule.grid,
        (gait.period, gait.period),
        schedule.switches,
        np.array([request.slope, request.speed, request.usable_friction, limit / weight, height]),
        places.reshape(len(places), -1),
    )
    _bound(problem, schedule, machine)
    return problem, _guess(machine, request, schedule, problem, height, thrust, ground)


def _bound(problem: Problem, schedule: Schedule, machine: Machine) -> None:
    state_lower, state_upper = problem.state_lower, problem.state_upper
    lower, upper = problem.input_lower, problem.input_upper
    path_lower, path_upper = problem.path_lower, problem.path_upper
    assert state_lower is not None and state_upper is not None
    assert lower is not None and upper is not None
    assert path_lower is not None and path_upper is not None
    state_lower[0, ROTATION] = state_upper[0, ROTATION] = np.eye(3).ravel()
    state_lower[:, 2:12:3], state_upper[:, 2:12:3] = machine.leg_length
    for angle in (0, 1):
        state_lower[:, angle:12:3], state_upper[:, angle:12:3] = machine.leg_forward
    standing = schedule.stance[problem.point_intervals]
    lower[:, FORCE_INPUT] = np.repeat(np.where(standing, -FORCE_LIMIT, 0.0), 3, axis=1)
    upper[:, FORCE_INPUT] = np.repeat(np.where(standing, FORCE_LIMIT, 0.0), 3, axis=1)
    lower[:, FORCE_INPUT.start + 2 : FORCE_INPUT.stop : 3] = 0.0
    landing = standing.copy()
    landing[1:] &= ~standing[:-1]
    # Rows: 4 friction, 1 thrust, 12 velocities, 12 footholds, 4 clearances.
    free = np.hstack(
        [
            ~standing,
            np.zeros((len(standing), 1), dtype=bool),
            np.repeat(~standing, 3, axis=1),
            np.repeat(~landing, 3, axis=1),
            standing,
        ]
    )
    path_lower[free], path_upper[free] = -np.inf, np.inf


def _guess(
    machine: Machine,
    request: PlanRequest,
    schedule: Schedule,
    problem: Problem,
    height: float,
    thrust: Array,
    ground: Array,
) -> Guess:
    state = np.zeros((problem.intervals + 1, STATES))
    state[:, 2:12:3] = height + machine.rom.hip_position[:, 2]
    state[:, ROTATION] = np.eye(3).ravel()
    state[:, POSITION] = [0.0, 0.0, height]
    state[:, POSITION.start] = request.speed * problem.duration[0] * problem.grid
    state[:, VELOCITY] = [request.speed, 0.0, 0.0]
    standing = schedule.stance[problem.point_intervals]
    share = standing / np.maximum(standing.sum(axis=1, keepdims=True), 1)
    forces = (share[:, :, None] * ground).reshape(len(share), -1)
    legs = np.zeros((len(share), LEG_STATES))
    input = np.concatenate([legs, forces, np.tile(thrust, (len(share), 1))], axis=1)
    return Guess(state, input, np.zeros(0), problem.duration[0])
