"""What a plan is asked for, and the cycle problem that it becomes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from husky_control.gait.table import GAITS, Gait
from husky_control.planning.collocation.cycle import (
    ATTITUDE,
    POSITION,
    SLOT_DATA,
    VELOCITY,
    CycleModel,
    Weights,
)
from husky_control.planning.collocation.problem import Formulation, Problem
from husky_control.planning.collocation.schedule import Schedule, make_schedule
from husky_control.planning.collocation.solve import Guess
from husky_control.planning.plan import THRUST_MODES
from husky_control.planning.rom_parameters import RomParameters, rom_parameters
from husky_description.arrays import Array

if TYPE_CHECKING:
    from husky_description.robot import Robot


FORCE_LIMIT = 3.0
"""Greatest component of a foot's force, of the weight: keeps the search from wandering."""
SHIFT_LIMIT = 0.3
"""Greatest shift of the footholds along the slope [m]."""

PITCHING = Weights(position=(2000.0, 2000.0, 1000.0), attitude=(500.0, 10.0, 500.0))
"""Weights where the body has to pitch to direct its thrust: free to, and to come lower for it."""


@dataclass(frozen=True)
class PlanRequest:
    """What is asked of the planner."""

    slope: float = 0.0  # of the ground, from -pi/2 to pi/2, positive: forward is uphill [rad]
    speed: float = 0.3  # along x of the slope, negative goes backward [m/s]
    friction: float = 0.7  # coefficient of friction [-]
    friction_margin: float = 0.5  # share of it to leave unused, 0 up to 1 [-]
    thrust_mode: str = "vector"  # one of `plan.THRUST_MODES`
    gait: str | Gait = "trot"  # a row of the gait table, by name or as changed by the caller
    # least and greatest period [s]; None for that of the gait (T30)
    period: tuple[float, float] | None = None
    thrust_limit: float | None = None  # of all fans together [N]; None for what the robot has
    thrust_tilt: float = math.pi  # greatest angle of the thrust from body z in mode vector [rad]
    # of the centre of mass over the slope [m]; None for that of the gait
    height: float | None = None
    intervals: int = 20  # N of the cycle
    weights: Weights | None = None  # of the cost; None for those of the thrust mode

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ValueError: a number is out of range or a name unknown; says which, and what is allowed.
        """
        for name, (lower, upper) in _RANGES.items():
            value = getattr(self, name)
            if value is not None and not lower <= value <= upper:
                raise ValueError(f"{name} is {value}, it must be from {lower:.4g} to {upper:.4g}")
        if self.thrust_mode not in THRUST_MODES:
            raise ValueError(f"thrust_mode is {self.thrust_mode!r}, it must be in {THRUST_MODES}")
        if isinstance(self.gait, str) and self.gait not in GAITS:
            raise ValueError(f"gait is {self.gait!r}, it must be one of {sorted(GAITS)}")
        if self.period is not None:
            low, high = self.period
            if not 0.1 <= low <= high <= 10.0:
                raise ValueError(f"period is {self.period}, it must be ordered, from 0.1 to 10 s")

    @property
    def gait_row(self) -> Gait:
        """The row of the gait table."""
        return GAITS[self.gait] if isinstance(self.gait, str) else self.gait

    @property
    def weights_used(self) -> Weights:
        """The request's weights, or those of its thrust mode."""
        if self.weights is not None:
            return self.weights
        return PITCHING if self.thrust_mode == "body_z" else Weights()

    @property
    def usable_friction(self) -> float:
        """Tangential over normal force that the plan may use [-]."""
        return (1.0 - self.friction_margin) * self.friction


_RANGES = {
    "slope": (-math.pi / 2, math.pi / 2),
    "speed": (-2.0, 2.0),
    "friction": (0.05, 3.0),
    "friction_margin": (0.0, 0.95),
    "thrust_limit": (0.0, 1000.0),
    "thrust_tilt": (0.0, math.pi),
    "height": (0.1, 0.7),
    "intervals": (4, 400),
}


@dataclass(frozen=True)
class Machine:
    """What planning needs to know of a robot."""

    rom: RomParameters  # the reduced-order model
    side: Array  # +1 for left, -1 for right legs (4,)
    leg_length: tuple[float, float]  # see CycleModel
    leg_forward: tuple[float, float]  # see CycleModel
    leg_sideways: tuple[float, float]  # see CycleModel
    foot_radius: float  # [m]
    thrust_limit: float  # of all fans together [N]


THRUST_SHARE = 0.95
"""Of what the fans can give; the rest is left to those who correct."""
STRAIGHT = 0.98
"""Greatest leg length, of that of a straight leg: beyond it the knee has no lever."""
FOLDED = 2.3
"""Greatest bend of a knee that carries [rad]."""
LEG_SWING = 0.9
"""Greatest angle of a leg fore and aft [rad]; nearer to the limits of hip and knee than walking
comes at any length of the leg."""


def machine_of(robot: Robot) -> Machine:
    """Read what planning needs from the robot's numbers."""
    thigh, shin = robot.thigh_length, robot.shin_length
    folded = min(FOLDED, -float(robot.joint_lower[2]))
    shortest = math.sqrt(thigh**2 + shin**2 + 2.0 * thigh * shin * math.cos(folded))
    return Machine(
        rom_parameters(robot),
        np.array(robot.side),
        (shortest, STRAIGHT * (thigh + shin)),
        (-LEG_SWING, LEG_SWING),
        (float(robot.joint_lower[0]), float(robot.joint_upper[0])),
        float(robot.foot_radius),
        THRUST_SHARE * float(len(robot.fan_position) * robot.fans.max_thrust),
    )


def cycle_model(machine: Machine, request: PlanRequest, schedule: Schedule) -> CycleModel:
    """The model whose formulas serve a request."""
    free = request.period is not None and request.period[0] < request.period[1]
    return CycleModel(
        machine.rom,
        machine.leg_length,
        machine.leg_forward,
        machine.leg_sideways,
        machine.foot_radius,
        schedule.slots,
        "vector" if request.thrust_mode == "vector" else "body_z",
        directed=request.thrust_tilt < math.pi,
        free_duration=free,
    )


def cycle_problem(
    machine: Machine, request: PlanRequest, schedule: Schedule, formulation: Formulation
) -> Problem:
    """The numbers of a request's cycle, for the formulation of its model."""
    gait = request.gait_row
    period = request.period or (gait.period, gait.period)
    weight = float(machine.rom.mass * np.linalg.norm(machine.rom.gravity))
    limit = machine.thrust_limit if request.thrust_limit is None else request.thrust_limit
    numbers = [
        request.slope,
        request.speed,
        request.usable_friction,
        limit / weight,
        request.thrust_tilt,
        center_height(machine, request),
        *request.weights_used.flat(),
    ]
    problem = Problem(
        formulation,
        schedule.grid,
        period,
        schedule.switches,
        np.array(numbers),
        _slot_data(machine, gait, schedule),
        static_lower=np.array([-SHIFT_LIMIT]),
        static_upper=np.array([SHIFT_LIMIT]),
    )
    _bound_inputs(problem, schedule, request)
    return problem


def center_height(machine: Machine, request: PlanRequest) -> float:
    """Nominal height of the centre of mass over the ground [m]."""
    if request.height is not None:
        return request.height
    base = request.gait_row.stance_height + machine.foot_radius
    return float(base + machine.rom.center_of_mass[2])


def nominal_feet(machine: Machine, gait: Gait) -> Array:
    """Footholds at mid-stance from the centre of mass, along the slope [m] (4, 2)."""
    feet = machine.rom.hip_position[:, :2].copy()
    feet[:, 0] += gait.forward_spread * np.sign(feet[:, 0])
    feet[:, 1] += gait.lateral_spread * machine.side
    return feet


def _slot_data(machine: Machine, gait: Gait, schedule: Schedule) -> Array:
    feet, hips = nominal_feet(machine, gait), machine.rom.hip_position
    table = schedule.slot_legs()
    data = np.zeros((*table.shape, len(SLOT_DATA)))
    for interval, slot in np.argwhere(table >= 0):
        leg = table[interval, slot]
        data[interval, slot] = [
            *hips[leg],
            machine.side[leg],
            *feet[leg],
            schedule.middle[interval, leg],
        ]
    return data.reshape(len(table), -1)


def _bound_inputs(problem: Problem, schedule: Schedule, request: PlanRequest) -> None:
    """Unilateral contact; feet in the air push on nothing and are nowhere limited."""
    lower, upper = problem.input_lower, problem.input_upper
    path_lower, path_upper = problem.path_lower, problem.path_upper
    forces = 3 * schedule.slots
    lower[:, :forces], upper[:, :forces] = -FORCE_LIMIT, FORCE_LIMIT
    lower[:, 2:forces:3] = 0.0
    if request.thrust_mode != "vector":
        lower[:, forces:] = 0.0
    if request.thrust_mode == "none":
        upper[:, forces:] = 0.0
    empty = schedule.slot_legs()[problem.point_intervals] < 0
    for point, slot in np.argwhere(empty):
        own = slice(3 * slot, 3 * slot + 3)
        lower[point, own] = upper[point, own] = 0.0
        rows = _slot_rows(problem.formulation, schedule.slots, slot)
        path_lower[point, rows], path_upper[point, rows] = -np.inf, np.inf


def _slot_rows(form: Formulation, slots: int, slot: int) -> list[int]:
    """Path rows that belong to one slot."""
    rows: list[int] = []
    first = 0
    for constraint in form.path:
        if constraint.name in ("friction", "leg_length", "leg_angle"):
            each = constraint.size // slots
            rows += range(first + slot * each, first + (slot + 1) * each)
        first += constraint.size
    return rows


def first_guess(machine: Machine, request: PlanRequest, problem: Problem) -> Guess:
    """The body in steady motion, its weight shared by standing feet and thrust."""
    schedule = make_schedule(request.gait_row, request.intervals)
    duration = 0.5 * sum(problem.duration)
    height = center_height(machine, request)
    thrust, ground = steady_forces(request.slope, request.usable_friction)
    own, pitch = thrust, 0.0
    if request.thrust_mode != "vector":
        pitch = _guess_pitch(request) if request.thrust_mode == "body_z" else 0.0
        own = np.array([np.linalg.norm(thrust)])
    state = np.zeros((problem.intervals + 1, 12))
    state[:, POSITION] = [0.0, 0.0, height]
    state[:, 0] = request.speed * duration * problem.grid
    state[:, ATTITUDE] = [0.0, math.tan(0.25 * pitch), 0.0]
    state[:, VELOCITY] = [request.speed, 0.0, 0.0]
    standing = schedule.slot_legs()[problem.point_intervals] >= 0
    share = standing / np.maximum(standing.sum(axis=1, keepdims=True), 1)
    forces = (share[:, :, None] * ground).reshape(len(share), -1)
    input = np.concatenate([forces, np.tile(own, (len(forces), 1))], axis=1)
    shift = -height * ground[0] / max(float(ground[2]), 0.1)
    return Guess(state, input, np.clip([shift], -SHIFT_LIMIT, SHIFT_LIMIT), duration)


def _guess_pitch(request: PlanRequest) -> float:
    """Body against the slope so that body z pulls uphill [rad]; none where friction suffices."""
    thrust, _ = steady_forces(request.slope, request.usable_friction)
    if not thrust.any():
        return 0.0
    return math.copysign(min(abs(request.slope) + 0.25, 1.2), request.slope)


def steady_forces(slope: float, usable_friction: float) -> tuple[Array, Array]:
    """Least thrust that keeps the ground's force in the cone at rest, and that force.

    Both in the slope frame, in units of the weight (3,). Where the cone holds the weight alone the
    thrust is zero; else it is (sin a - t cos a) / sqrt(1 + t^2), up and into the slope.
    """
    pull, press = math.sin(abs(slope)), math.cos(slope)
    t = usable_friction
    missing = max(0.0, (pull - t * press) / math.sqrt(1.0 + t * t))
    direction = np.array([math.copysign(1.0, slope), 0.0, -t]) / math.sqrt(1.0 + t * t)
    thrust: Array = missing * direction
    return thrust, np.array([math.sin(slope), 0.0, press]) - thrust
