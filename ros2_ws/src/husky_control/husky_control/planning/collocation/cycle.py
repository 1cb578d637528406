"""One gait cycle on a slope as an optimal control problem of a single rigid body.

Legs of the reduced-order model have no mass (T23-T25), so that with footholds that stand on the
slope its torso is a rigid body under the ground forces of the standing feet and the thrust. All is
in the slope frame; the ground is z = 0 and gravity is turned. Forces are in units of the weight.

    state   position [m] (3), attitude sigma (3), velocity [m/s] (3), angular velocity in body (3)
    input   force of each standing foot (3 each), thrust (3; along body z only: 1)
    static  shift of all footholds along x [m]

The cost is that of T28, e^T Q e + u^T R u per second, e against the nominal body: upright on the
slope, at its height, moving at the wanted speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import casadi as ca
import numpy as np

from husky_control.planning.collocation.problem import Constraint, Ends, Formulation, Symbols
from husky_control.planning.collocation.rodrigues import rodrigues_rate, rotation_from_rodrigues
from husky_control.planning.reduced_order import (
    RomState,
    bias,
    force_input_matrix,
    pack_state,
    thrust_input_matrix,
)
from husky_control.planning.rom_parameters import RomParameters, in_slope_frame
from husky_description.arrays import Array

CONES = ("cone", "pyramid")
"""Friction limits (T16): the cone itself, or the pyramid inscribed in it."""

POSITION, ATTITUDE, VELOCITY, RATE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
"""Parts of the state."""

_ROUND = 1e-3
"""Of the weight: rounds the tip of the friction cone and the middle of the thrust's ball."""


@dataclass(frozen=True)
class Weights:
    """Weights Q and R of T28, per second."""

    # along the slope, across and normal to it [1/m^2]
    position: tuple[float, float, float] = (2000.0, 2000.0, 10000.0)
    attitude: tuple[float, float, float] = (500.0, 500.0, 500.0)  # about body x, y, z [1/rad^2]
    velocity: tuple[float, float, float] = (200.0, 200.0, 200.0)  # as position [s^2/m^2]
    angular_velocity: tuple[float, float, float] = (20.0, 20.0, 20.0)  # as attitude [s^2/rad^2]
    force: float = 2.0  # of each foot, in units of the weight [-]
    thrust: float = 100.0  # in units of the weight [-]
    foothold_shift: float = 1.0  # of the footholds against the hips [1/m^2]

    def flat(self) -> Array:
        """All weights in order."""
        values = [np.atleast_1d(getattr(self, field.name)) for field in fields(self)]
        return np.concatenate(values).astype(float)


@dataclass(frozen=True)
class CycleModel:
    """What the formulas of a cycle depend on; its numbers are compiled in."""

    rom: RomParameters  # the reduced-order model's numbers (T24)
    leg_length: tuple[float, float]  # least and greatest distance from hip to foot centre [m]
    # least and greatest angle of a leg about body y, positive backward [rad]
    leg_forward: tuple[float, float]
    # least and greatest angle of a leg about body x, positive outward [rad]
    leg_sideways: tuple[float, float]
    foot_radius: float  # a foot's centre is this far from the ground [m]
    slots: int  # most feet that stand at once
    thrust_mode: str  # "vector", or "body_z", which also serves where there is no thrust
    directed: bool = False  # whether the direction of a vectored thrust is limited
    cone: str = "cone"  # one of CONES
    scheme: str = "lobatto"  # of the collocation
    free_duration: bool = False  # whether the period is a decision

    def __post_init__(self) -> None:
        """Check the choices.

        Raises:
            ValueError: a choice is unknown; names it.
        """
        if self.cone not in CONES:
            raise ValueError(f"cone is {self.cone!r}, it must be one of {CONES}")
        if self.thrust_mode not in ("vector", "body_z"):
            raise ValueError(f"thrust_mode is {self.thrust_mode!r}, not 'vector' or 'body_z'")

    @property
    def weight(self) -> float:
        """Mass times gravity [N]: the unit of force."""
        return float(self.rom.mass * np.linalg.norm(self.rom.gravity))


PARAMETERS = ("slope", "speed", "friction", "thrust_limit", "thrust_tilt", "height")
"""Numbers of a problem before the weights: [rad], [m/s], usable share of the normal force [-], of
the weight [-], greatest angle of the thrust from body z [rad], of the centre of mass [m]."""

SLOT_DATA = ("hip_x", "hip_y", "hip_z", "side", "foot_x", "foot_y", "middle")
"""Numbers of a slot in an interval: hip from the centre of mass [m], +1 left -1 right, nominal
foothold from the nominal centre of mass at mid-stance [m], share of the period at mid-stance."""


def make_formulation(model: CycleModel) -> Formulation:
    """The formulas of a cycle."""
    thrusts = ("x", "y", "z") if model.thrust_mode == "vector" else ("body_z",)
    inputs = [f"force_{slot}_{axis}" for slot in range(model.slots) for axis in "xyz"]
    formulas = _Formulas(model)
    return Formulation(
        name=f"cycle_{model.thrust_mode}_{model.slots}",
        state_names=tuple(
            f"{part}_{axis}"
            for part in ("position", "attitude", "velocity", "angular_velocity")
            for axis in "xyz"
        ),
        input_names=(*inputs, *(f"thrust_{axis}" for axis in thrusts)),
        static_names=("foothold_shift",),
        parameter_names=(*PARAMETERS, *(f"weight_{i}" for i in range(len(Weights().flat())))),
        data_names=tuple(f"{name}_{slot}" for slot in range(model.slots) for name in SLOT_DATA),
        dynamics=formulas.dynamics,
        running_cost=formulas.cost,
        path=_path_constraints(model, formulas),
        boundary=(Constraint("periodicity", formulas.period_gap, (0.0,) * 12, (0.0,) * 12),),
        free_duration=model.free_duration,
        scheme=model.scheme,
    )


def _path_constraints(model: CycleModel, formulas: _Formulas) -> tuple[Constraint, ...]:
    slots, weight = model.slots, model.weight
    rows = 4 if model.cone == "pyramid" else 1
    lower, upper = zip(model.leg_length, model.leg_forward, model.leg_sideways, strict=True)

    def limited_below(
        name: str, formula: Callable[[Symbols], Any], rows: int, unit: str, scale: float
    ) -> Constraint:
        return Constraint(name, formula, (0.0,) * rows, (math.inf,) * rows, unit, scale)

    constraints = [
        limited_below("friction", formulas.friction, rows * slots, "N", weight),
        limited_below("thrust", formulas.thrust_reserve, 1, "N", weight),
        Constraint("leg_length", formulas.leg_length, lower[:1] * slots, upper[:1] * slots, "m"),
        Constraint("leg_angle", formulas.leg_angle, lower[1:] * slots, upper[1:] * slots, "rad"),
    ]
    if model.thrust_mode == "vector" and model.directed:
        tilt = limited_below("thrust_direction", formulas.thrust_direction, 1, "N", weight)
        constraints.append(tilt)
    return tuple(constraints)


class _Formulas:
    """The formulas of one model."""

    def __init__(self, model: CycleModel) -> None:
        self._model = model
        self._count = len(PARAMETERS)

    def _number(self, symbols: Symbols | Ends, name: str) -> Any:
        return symbols.parameter[PARAMETERS.index(name)]

    def _slot(self, symbols: Symbols, slot: int, name: str) -> Any:
        return symbols.data[slot * len(SLOT_DATA) + SLOT_DATA.index(name)]

    def _foothold(self, symbols: Symbols, slot: int) -> Any:
        """Where the foot touches the ground, slope frame."""
        way = (
            self._number(symbols, "speed") * symbols.duration * self._slot(symbols, slot, "middle")
        )
        x = self._slot(symbols, slot, "foot_x") + way + symbols.static[0]
        return ca.vertcat(x, self._slot(symbols, slot, "foot_y"), 0.0)

    def _force(self, symbols: Symbols, slot: int) -> Any:
        return symbols.input[3 * slot : 3 * slot + 3]

    def _thrust(self, symbols: Symbols) -> Any:
        """In the slope frame."""
        own = symbols.input[3 * self._model.slots :]
        if self._model.thrust_mode == "vector":
            return own
        return rotation_from_rodrigues(symbols.state[ATTITUDE])[:, 2] * own

    def _leg(self, symbols: Symbols, slot: int) -> Any:
        """From the hip to the centre of the foot, in body."""
        foot = self._foothold(symbols, slot)
        foot[2] += self._model.foot_radius
        hip = ca.vertcat(*(self._slot(symbols, slot, f"hip_{axis}") for axis in "xyz"))
        rotation = rotation_from_rodrigues(symbols.state[ATTITUDE])
        return rotation.T @ (foot - symbols.state[POSITION]) - hip

    def dynamics(self, symbols: Symbols) -> Any:
        """Rate of the state: M v' + H = sum of B_g u_g + B_T u_T (T25)."""
        model, state = self._model, symbols.state
        parameters = in_slope_frame(model.rom, self._number(symbols, "slope"))
        rotation = rotation_from_rodrigues(state[ATTITUDE])
        legs = ca.SX.zeros(12)
        whole = RomState(legs, legs, rotation, state[POSITION], state[RATE], state[VELOCITY])
        force = thrust_input_matrix() @ (model.weight * self._thrust(symbols))
        force -= bias(pack_state(whole), parameters)
        for slot in range(model.slots):
            arm = rotation.T @ (self._foothold(symbols, slot) - state[POSITION])
            force += force_input_matrix(arm, rotation) @ (model.weight * self._force(symbols, slot))
        acceleration = parameters.mass_matrix_inverse @ force
        turning = rodrigues_rate(state[ATTITUDE], state[RATE])
        return ca.vertcat(state[VELOCITY], turning, acceleration)

    def cost(self, symbols: Symbols) -> Any:
        """e^T Q e + u^T R u (T28)."""
        state, speed = symbols.state, self._number(symbols, "speed")
        reference = ca.vertcat(speed * symbols.time, 0.0, self._number(symbols, "height"))
        slots = self._model.slots
        error = ca.vertcat(
            state[POSITION] - reference,
            4.0 * state[ATTITUDE],  # sigma is a quarter of the angle
            state[VELOCITY] - ca.vertcat(speed, 0.0, 0.0),
            state[RATE],
        )
        weights = symbols.parameter[self._count :]
        force, thrust, shift = weights[12], weights[13], weights[14]
        forces = symbols.input[: 3 * slots]
        own = symbols.input[3 * slots :]
        cost = ca.dot(weights[:12], error**2) + shift * symbols.static[0] ** 2
        return cost + force * ca.sumsqr(forces) + thrust * ca.sumsqr(own)

    def friction(self, symbols: Symbols) -> Any:
        """What the cone leaves of each foot's force (T16), not below zero."""
        rows, usable = [], self._number(symbols, "friction")
        for slot in range(self._model.slots):
            force = self._force(symbols, slot)
            if self._model.cone == "cone":
                tangential = ca.sqrt(force[0] ** 2 + force[1] ** 2 + _ROUND**2)
                rows.append(usable * force[2] - tangential)
            else:
                side = usable / math.sqrt(2.0) * force[2]
                rows += [side + force[0], side - force[0], side + force[1], side - force[1]]
        return ca.vertcat(*rows)

    def thrust_reserve(self, symbols: Symbols) -> Any:
        """What the limit leaves of the thrust, not below zero."""
        own = symbols.input[3 * self._model.slots :]
        if self._model.thrust_mode == "body_z":
            return self._number(symbols, "thrust_limit") - own
        return self._number(symbols, "thrust_limit") - ca.sqrt(ca.sumsqr(own) + _ROUND**2)

    def thrust_direction(self, symbols: Symbols) -> Any:
        """Thrust along body z less what its tilt asks for, not below zero."""
        own = self._thrust(symbols)
        along = ca.dot(rotation_from_rodrigues(symbols.state[ATTITUDE])[:, 2], own)
        size = ca.sqrt(ca.sumsqr(own) + _ROUND**2)
        return along - ca.cos(self._number(symbols, "thrust_tilt")) * size + _ROUND

    def leg_length(self, symbols: Symbols) -> Any:
        """Hip to foot centre of each slot [m]."""
        legs = (self._leg(symbols, slot) for slot in range(self._model.slots))
        return ca.vertcat(*(ca.sqrt(ca.sumsqr(leg)) for leg in legs))

    def leg_angle(self, symbols: Symbols) -> Any:
        """Angles of each slot's leg: backward, outward [rad]."""
        rows = []
        for slot in range(self._model.slots):
            leg = self._leg(symbols, slot)
            outward = leg[1] * self._slot(symbols, slot, "side")
            rows += [ca.atan2(-leg[0], -leg[2]), ca.atan2(outward, -leg[2])]
        return ca.vertcat(*rows)

    def period_gap(self, ends: Ends) -> Any:
        """End of the cycle less its start, a stride further on."""
        gap = ends.last - ends.first
        gap[0] -= self._number(ends, "speed") * ends.duration
        return gap
