"""The thesis's reduced-order model HROM: a torso of 6 degrees of freedom on four massless legs.

One definition serves NumPy and CasADi: every function takes the arrays of either and returns its
own kind (`array_namespace`). A vector of n is (n,) in NumPy and (n, 1) in CasADi; a set of one
3-vector per leg is (4, 3) in both. Legs are in the house's order. World: z up, or a slope's frame
with gravity turned (`rom_parameters.in_slope_frame`). Body: origin at the centre of mass, axes x
forward, y left, z up.

Hip angles are those of the thesis as printed, T23: the leg is turned by gamma about x, then by phi
about y. In these axes phi swings the leg fore and aft (positive: foot backward) and gamma sideways
(positive: foot to the left), though the thesis calls phi frontal; `leg_coordinates` converts from
and to the joints of the robot, whose order is the other one (hip frontal about x first).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from husky_control.planning.array_namespace import checked_vector, is_casadi, namespace_of
from husky_control.planning.rom_parameters import RomParameters
from husky_description.arrays import Array
from husky_description.kinematics import LEGS

LEG_STATES = 3 * LEGS
"""Size of q_L, of its rates and of u_L: phi, gamma, r of each leg."""
STATES = 2 * LEG_STATES + 9 + 3 + 3 + 3
"""Size of the state of T26."""

LEG_POSITION = slice(0, 12)
LEG_VELOCITY = slice(12, 24)
ROTATION = slice(24, 33)
POSITION = slice(33, 36)
ANGULAR_VELOCITY = slice(36, 39)
VELOCITY = slice(39, 42)


# ------------------------------------------------------------------------------ state (T26)


class RomState(NamedTuple):
    """The state of T26 in parts, of NumPy or CasADi."""

    leg_position: Any  # (12) phi [rad], gamma [rad], r [m] of each leg
    leg_velocity: Any  # (12) their rates
    rotation: Any  # (3, 3) body to world
    position: Any  # (3) m, centre of mass in world
    angular_velocity: Any  # (3) rad/s in body
    velocity: Any  # (3) m/s, centre of mass in world


def pack_state(state: RomState) -> Any:
    """Return x = [q_L, q_L', r_b, p_b, w_b, p_b'] (42), r_b the columns of the rotation (T26).

    Raises:
        ValueError: a part has another shape; names it.
    """
    rotation = state.rotation if is_casadi(state.rotation) else np.asarray(state.rotation, float)
    if rotation.shape != (3, 3):
        raise ValueError(f"rotation must have shape (3, 3), not {rotation.shape}")
    legs, body = (
        [checked_vector(name, getattr(state, name), size) for name in names]
        for size, names in (
            (LEG_STATES, ("leg_position", "leg_velocity")),
            (3, ("position", "angular_velocity", "velocity")),
        )
    )
    columns = [rotation[:, j] for j in range(3)]
    return namespace_of(*state).concatenate([*legs, *columns, *body])


def unpack_state(x: Any) -> RomState:
    """Return the parts of a state (42).

    Raises:
        ValueError: the shape is another one.
    """
    x = checked_vector("x", x, STATES)
    r = x[ROTATION]
    rotation = namespace_of(x).matrix([[r[i], r[3 + i], r[6 + i]] for i in range(3)])
    return RomState(
        x[LEG_POSITION], x[LEG_VELOCITY], rotation, x[POSITION], x[ANGULAR_VELOCITY], x[VELOCITY]
    )


# ------------------------------------------------------------------------- kinematics (T23)


def leg_vector(phi: Any, gamma: Any, length: Any) -> Any:
    """Return l_f = R_y(phi) R_x(gamma) [0, 0, -r] (3) in body, from the hip to the foot (T23).

    Args:
        phi: rad about y.
        gamma: rad about x.
        length: r, m.
    """
    xp = namespace_of(phi, gamma, length)
    return xp.vector(
        [
            -length * xp.sin(phi) * xp.cos(gamma),
            length * xp.sin(gamma),
            -length * xp.cos(phi) * xp.cos(gamma),
        ]
    )


def leg_jacobian(phi: Any, gamma: Any, length: Any) -> Any:
    """Return d l_f / d (phi, gamma, r), (3, 3): two columns in m/rad, one without unit."""
    xp = namespace_of(phi, gamma, length)
    sp, cp, sg, cg = xp.sin(phi), xp.cos(phi), xp.sin(gamma), xp.cos(gamma)
    return xp.matrix(
        [
            [-length * cp * cg, length * sp * sg, -sp * cg],
            [0.0, length * cg, sg],
            [length * sp * cg, length * cp * sg, -cp * cg],
        ]
    )


def feet_in_body(leg_position: Any, parameters: RomParameters) -> Any:
    """Return l_h + l_f of each leg, (4, 3) m in body from the centre of mass, for q_L (12)."""
    q = checked_vector("leg_position", leg_position, LEG_STATES)
    return namespace_of(q).rows([_foot_in_body(q, leg, parameters) for leg in range(LEGS)])


def _foot_in_body(q: Any, leg: int, parameters: RomParameters) -> Any:
    return parameters.hip_position[leg] + leg_vector(*(q[3 * leg + k] for k in range(3)))


def foot_positions(x: Any, parameters: RomParameters) -> Any:
    """Return p_f = p_b + R_b l_h + R_b l_f of each foot's centre, (4, 3) m in world (T23)."""
    state = unpack_state(x)
    return namespace_of(x).rows(
        [
            state.position + state.rotation @ _foot_in_body(state.leg_position, leg, parameters)
            for leg in range(LEGS)
        ]
    )


def foot_velocities(x: Any, parameters: RomParameters) -> Any:
    """Return p_f' of each foot, (4, 3) m/s in world: B_g^T v + R_b J_leg q_L'."""
    state = unpack_state(x)
    xp = namespace_of(x)
    rates = []
    for leg in range(LEGS):
        own = slice(3 * leg, 3 * leg + 3)
        q, arm = state.leg_position, _foot_in_body(state.leg_position, leg, parameters)
        swing = leg_jacobian(*(q[3 * leg + k] for k in range(3))) @ state.leg_velocity[own]
        turn = xp.skew(state.angular_velocity) @ arm
        rates.append(state.velocity + state.rotation @ (turn + swing))
    return xp.rows(rates)


# --------------------------------------------------------------------- dynamics (T24, T25)


def mass_matrix(parameters: RomParameters) -> Array:
    """Return M of T25, (6, 6): mass and inertia; legs have no mass, so no posture enters."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = np.eye(3) * parameters.mass
    matrix[3:, 3:] = parameters.inertia
    return matrix


def bias(x: Any, parameters: RomParameters) -> Any:
    """Return H of T25, (6): [-m g, w x J w], from the Lagrangian on SO(3) of T24."""
    omega = unpack_state(x).angular_velocity
    xp = namespace_of(x, parameters.gravity)
    gyroscopic = xp.skew(omega) @ (parameters.inertia @ omega)
    return xp.concatenate([-parameters.mass * parameters.gravity, gyroscopic])


def ground_input_matrix(x: Any, leg: int, parameters: RomParameters) -> Any:
    """Return B_g of one foot, (6, 3): (d p_f' / d v)^T with v = [p_b', w_b] (T25).

    Args:
        x: state (42).
        leg: 0 to 3.
        parameters: of the model.

    Raises:
        ValueError: there is no such leg, or x has another shape.
    """
    if leg not in range(LEGS):
        raise ValueError(f"leg must be 0 to {LEGS - 1}, not {leg!r}")
    state = unpack_state(x)
    return force_input_matrix(_foot_in_body(state.leg_position, leg, parameters), state.rotation)


def force_input_matrix(arm: Any, rotation: Any) -> Any:
    """Return B_g of a force in world that acts at an arm (3) in body, (6, 3) (T25).

    Args:
        arm: m, from the centre of mass.
        rotation: (3, 3) body to world.
    """
    xp = namespace_of(arm, rotation)
    moment = xp.skew(arm) @ rotation.T
    rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    return xp.matrix([*rows, *([moment[i, j] for j in range(3)] for i in range(3))])


def thrust_input_matrix() -> Array:
    """Return B_T of T25, (6, 3): (d p_b' / d v)^T; the thrust acts at the centre of mass."""
    return np.vstack((np.eye(3), np.zeros((3, 3))))


def body_acceleration(x: Any, u_g: Any, u_T: Any, parameters: RomParameters) -> Any:
    """Return [p_b'', w_b'] (6): M^-1 (sum_i B_gi u_gi + B_T u_T - H) (T25).

    Arguments as those of `f_rom`; p_b'' in m/s^2 in world, w_b' in rad/s^2 in body.
    """
    u_g, u_T = checked_vector("u_g", u_g, 3 * LEGS), checked_vector("u_T", u_T, 3)
    force = thrust_input_matrix() @ u_T - bias(x, parameters)
    for leg in range(LEGS):
        force = force + ground_input_matrix(x, leg, parameters) @ u_g[3 * leg : 3 * leg + 3]
    return parameters.mass_matrix_inverse @ force


def f_rom(x: Any, u_L: Any, u_g: Any, u_T: Any, parameters: RomParameters) -> Any:
    """Return the rate of the state, x' = f_ROM(x, u_L, u_g, u_T) (42) (T26).

    Args:
        x: state (42), see `pack_state`.
        u_L: (12) q_L'': rad/s^2, rad/s^2, m/s^2 of each leg.
        u_g: (12) N, force of the ground on each foot, in world; zero for a swing foot.
        u_T: (3) N, thrust at the centre of mass, in world.
        parameters: of the model.

    Raises:
        ValueError: an argument has another shape; names it.
    """
    u_L = checked_vector("u_L", u_L, LEG_STATES)
    state = unpack_state(x)
    xp = namespace_of(x, u_L, u_g, u_T, parameters.gravity)
    turning = state.rotation @ xp.skew(state.angular_velocity)
    acceleration = body_acceleration(x, u_g, u_T, parameters)
    return xp.concatenate(
        [
            state.leg_velocity,
            u_L,
            turning[:, 0],
            turning[:, 1],
            turning[:, 2],
            state.velocity,
            acceleration[3:6],
            acceleration[0:3],
        ]
    )


# ------------------------------------------------------------------------ conserved, derived


def energy(x: Any, parameters: RomParameters) -> Any:
    """Return K + V of T24 [J]: m |p'|^2 / 2 + w^T J w / 2 - m p^T g; zero at the world's origin."""
    state = unpack_state(x)
    kinetic = 0.5 * parameters.mass * _dot(state.velocity, state.velocity) + 0.5 * _dot(
        state.angular_velocity, parameters.inertia @ state.angular_velocity
    )
    return kinetic - parameters.mass * _dot(state.position, parameters.gravity)


def angular_momentum(x: Any, parameters: RomParameters) -> Any:
    """Return R_b J w_b (3) kg m^2/s about the centre of mass, in world."""
    state = unpack_state(x)
    return state.rotation @ (parameters.inertia @ state.angular_velocity)


def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def rom_function(parameters: RomParameters) -> Any:
    """Return f_ROM as a `casadi.Function` of SX: f_rom(x, u_L, u_g, u_T) -> x_dot.

    Args:
        parameters: of the model, with gravity in numbers.
    """
    import casadi as ca

    x, u_L = ca.SX.sym("x", STATES), ca.SX.sym("u_L", LEG_STATES)
    u_g, u_T = ca.SX.sym("u_g", 3 * LEGS), ca.SX.sym("u_T", 3)
    names = ["x", "u_L", "u_g", "u_T"]
    return ca.Function(
        "f_rom", [x, u_L, u_g, u_T], [f_rom(x, u_L, u_g, u_T, parameters)], names, ["x_dot"]
    )


def standing_state(parameters: RomParameters, height: float) -> Array:
    """Return the state (42) at rest with legs straight down, feet at z = 0.

    Args:
        parameters: of the model.
        height: m, of the hips over the centres of the feet: r of every leg.

    Raises:
        ValueError: the height is not above zero.
    """
    if not height > 0.0:
        raise ValueError(f"height must be > 0 m, not {height}")
    legs = np.tile([0.0, 0.0, height], LEGS)
    position = np.array([0.0, 0.0, height - parameters.hip_position[0, 2]])
    zero = np.zeros(3)
    x: Array = pack_state(RomState(legs, np.zeros(12), np.eye(3), position, zero, zero))
    return x
