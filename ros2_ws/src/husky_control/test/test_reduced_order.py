"""The reduced-order model against Pinocchio, finite differences, conservation laws and CasADi."""

import casadi as ca
import numpy as np
import pytest
from rom_integration import integrate_rom
from scipy.spatial.transform import Rotation

from husky_control.planning.reduced_order import (
    ANGULAR_VELOCITY,
    LEG_POSITION,
    LEG_VELOCITY,
    POSITION,
    ROTATION,
    VELOCITY,
    RomState,
    angular_momentum,
    bias,
    body_acceleration,
    energy,
    f_rom,
    feet_in_body,
    foot_positions,
    foot_velocities,
    ground_input_matrix,
    leg_jacobian,
    leg_vector,
    mass_matrix,
    pack_state,
    rom_function,
    standing_state,
    thrust_input_matrix,
    unpack_state,
)
from husky_control.planning.rom_parameters import in_slope_frame, rom_parameters
from husky_description.robot import load_robot

ROBOT = load_robot()
PARAMETERS = rom_parameters(ROBOT)
SEEDS = range(5)
NO_LEGS, NO_GROUND, NO_THRUST = np.zeros(12), np.zeros(12), np.zeros(3)


def random_state(rng):
    """A state within what the robot does, in a random attitude."""
    legs = np.tile([0.0, 0.0, 0.5], 4) + rng.uniform(-0.6, 0.6, 12) * np.tile([1.0, 1.0, 0.15], 4)
    return pack_state(
        RomState(
            legs,
            rng.uniform(-3.0, 3.0, 12),
            Rotation.from_rotvec(rng.uniform(-2.0, 2.0, 3)).as_matrix(),
            rng.uniform(-1.0, 1.0, 3),
            rng.uniform(-4.0, 4.0, 3),
            rng.uniform(-2.0, 2.0, 3),
        )
    )


def random_inputs(rng):
    return (
        rng.uniform(-50.0, 50.0, 12),
        rng.uniform(-60.0, 60.0, 12),
        rng.uniform(-40.0, 40.0, 3),
    )


def leg_by_scipy(phi, gamma, length):
    """R_y(phi) R_x(gamma) [0, 0, -r], by SciPy's rotations; of one leg, or of many (n,)."""
    about_y, about_x = np.multiply.outer(phi, [0, 1, 0]), np.multiply.outer(gamma, [1, 0, 0])
    turned = Rotation.from_rotvec(about_y) * Rotation.from_rotvec(about_x)
    return turned.apply(np.multiply.outer(length, [0.0, 0.0, -1.0]))


# ------------------------------------------------------------------------------ state (T26)


def test_the_state_is_ordered_as_in_the_thesis():
    rng = np.random.default_rng(0)
    rotation = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
    parts = RomState(
        np.arange(12.0),
        np.arange(12.0) + 20.0,
        rotation,
        rng.random(3),
        rng.random(3),
        rng.random(3),
    )
    x = pack_state(parts)
    assert x.shape == (42,)
    # The columns of the rotation, one after the other.
    np.testing.assert_array_equal(x[24:33], rotation.T.reshape(-1))
    for where, name in (
        (LEG_POSITION, "leg_position"),
        (LEG_VELOCITY, "leg_velocity"),
        (POSITION, "position"),
        (ANGULAR_VELOCITY, "angular_velocity"),
        (VELOCITY, "velocity"),
    ):
        np.testing.assert_array_equal(x[where], getattr(parts, name))
    for part, again in zip(parts, unpack_state(x), strict=True):
        np.testing.assert_array_equal(part, again)


def test_an_expression_is_packed_and_unpacked_alike():
    x = ca.SX.sym("x", 42)
    difference = ca.Function("d", [x], [pack_state(unpack_state(x)) - x])
    assert difference(np.random.default_rng(1).random(42)).is_zero()


# ------------------------------------------------------------------------- kinematics (T23)


@pytest.mark.parametrize("seed", SEEDS)
def test_feet_are_where_rotations_of_scipy_put_them(seed):
    x = random_state(np.random.default_rng(seed))
    state = unpack_state(x)
    feet = foot_positions(x, PARAMETERS)
    for leg, (phi, gamma, length) in enumerate(state.leg_position.reshape(4, 3)):
        arm = PARAMETERS.hip_position[leg] + leg_by_scipy(phi, gamma, length)
        np.testing.assert_allclose(feet_in_body(x[LEG_POSITION], PARAMETERS)[leg], arm, atol=1e-15)
        np.testing.assert_allclose(feet[leg], state.position + state.rotation @ arm, atol=1e-15)


def test_what_the_leg_angles_mean():
    """Positive phi swings a foot backward and positive gamma to the left; r is the distance."""
    np.testing.assert_allclose(leg_vector(0.0, 0.0, 0.5), [0.0, 0.0, -0.5])
    np.testing.assert_allclose(leg_vector(np.pi / 2, 0.0, 0.5), [-0.5, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(leg_vector(0.0, np.pi / 2, 0.5), [0.0, 0.5, 0.0], atol=1e-15)
    # Turned by gamma first: the order of the text, R_y(phi) R_x(gamma).
    np.testing.assert_allclose(leg_vector(0.7, np.pi / 2, 0.5), [0.0, 0.5, 0.0], atol=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_leg_jacobian_is_the_slope_of_the_leg_vector(seed):
    q, step = random_state(np.random.default_rng(seed))[:3], 1e-5
    jacobian = leg_jacobian(*q)
    for k, change in enumerate(np.eye(3) * step):
        slope = (leg_vector(*(q + change)) - leg_vector(*(q - change))) / (2 * step)
        # Central difference: step^2 / 6 times a third derivative below 1 m.
        np.testing.assert_allclose(jacobian[:, k], slope, atol=1e-10)


@pytest.mark.parametrize("seed", SEEDS)
def test_foot_velocities_are_the_slopes_of_foot_positions(seed):
    rng = np.random.default_rng(seed)
    x, step = random_state(rng), 1e-4
    rate = f_rom(x, *random_inputs(rng), PARAMETERS)

    def moved(dt):
        """Positions changed at their rates, the rotation along its geodesic."""
        state = unpack_state(x)
        turn = Rotation.from_rotvec(dt * state.angular_velocity).as_matrix()
        y = x + dt * rate
        y[ROTATION] = (state.rotation @ turn).T.reshape(-1)
        return foot_positions(y, PARAMETERS)

    # step^2 / 6 times a third derivative, below 200 m/s^3 here.
    slope = (moved(step) - moved(-step)) / (2 * step)
    np.testing.assert_allclose(foot_velocities(x, PARAMETERS), slope, atol=1e-6)


# --------------------------------------------------------------------- dynamics (T24, T25)


@pytest.mark.parametrize("seed", SEEDS)
def test_input_matrices_are_the_slopes_of_velocities(seed):
    """B_g = (d p_f' / d v)^T and B_T = (d p_b' / d v)^T: both velocities are linear in v."""
    x = random_state(np.random.default_rng(seed))
    here = foot_velocities(x, PARAMETERS)
    for leg in range(4):
        slope = np.empty((6, 3))
        for k in range(6):
            y = x.copy()
            y[VELOCITY.start + k if k < 3 else ANGULAR_VELOCITY.start + k - 3] += 1.0
            slope[k] = foot_velocities(y, PARAMETERS)[leg] - here[leg]
        # Linear: only rounding of numbers below 10 is left.
        np.testing.assert_allclose(ground_input_matrix(x, leg, PARAMETERS), slope, atol=1e-14)
    np.testing.assert_array_equal(thrust_input_matrix(), np.eye(6)[:, :3])


@pytest.mark.parametrize("seed", SEEDS)
def test_the_equations_of_motion_are_met(seed):
    """M [p''; w'] + H = sum B_g u_g + B_T u_T, each part by its own function."""
    rng = np.random.default_rng(seed)
    x, (_, u_g, u_t) = random_state(rng), random_inputs(rng)
    left = mass_matrix(PARAMETERS) @ body_acceleration(x, u_g, u_t, PARAMETERS)
    left += bias(x, PARAMETERS)
    right = thrust_input_matrix() @ u_t
    for leg in range(4):
        right += ground_input_matrix(x, leg, PARAMETERS) @ u_g[3 * leg : 3 * leg + 3]
    np.testing.assert_allclose(left, right, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_forces_work_as_the_energy_grows(seed):
    """dE/dt is the power of the ground at the body's own point, and of the thrust at its middle."""
    rng = np.random.default_rng(seed)
    x, (_, u_g, u_t) = random_state(rng), random_inputs(rng)
    state = unpack_state(x)
    symbol = ca.SX.sym("x", 42)
    slope = ca.Function("e", [symbol], [ca.gradient(energy(symbol, PARAMETERS), symbol)])
    rate = np.array(slope(x)).ravel() @ f_rom(x, NO_LEGS, u_g, u_t, PARAMETERS)
    v = np.concatenate((state.velocity, state.angular_velocity))
    power = u_t @ state.velocity
    for leg in range(4):
        power += u_g[3 * leg : 3 * leg + 3] @ ground_input_matrix(x, leg, PARAMETERS).T @ v
    assert rate == pytest.approx(power, rel=1e-12)


def test_energy_and_momentum_are_conserved_in_free_flight():
    x = random_state(np.random.default_rng(7))
    times, states = integrate_rom(
        lambda t, y: f_rom(y, NO_LEGS, NO_GROUND, NO_THRUST, PARAMETERS), x, 1.0, 500
    )
    energies = np.array([energy(y, PARAMETERS) for y in states])
    momenta = np.array([angular_momentum(y, PARAMETERS) for y in states])
    # Order 4 with 2 ms steps at 4.4 rad/s: 500 (w dt)^5 / 120 is 2e-10; what is left is less.
    np.testing.assert_allclose(energies, energies[0], rtol=1e-10)
    np.testing.assert_allclose(momenta, np.tile(momenta[0], (501, 1)), atol=1e-10)
    fall = 0.5 * times[:, None] ** 2 * PARAMETERS.gravity
    path = x[POSITION] + times[:, None] * x[VELOCITY] + fall
    np.testing.assert_allclose(states[:, POSITION], path, atol=1e-12)
    assert np.linalg.norm(x[ANGULAR_VELOCITY]) > 3.0, "a slow spin proves little"


def test_trajectory_is_that_of_pinocchio():
    """A body of the same inertia under moving feet's forces, by Pinocchio's articulated body."""
    pin = pytest.importorskip("pinocchio")
    x = random_state(np.random.default_rng(3))
    x[LEG_VELOCITY] *= 0.2
    u_t = np.array([12.0, -3.0, 20.0])

    def ground(t):
        return np.tile([4.0, -2.0, 18.0], 4) * np.sin(7.0 * t + np.arange(12.0))

    model = pin.Model()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    inertia = pin.Inertia(PARAMETERS.mass, np.zeros(3), np.array(PARAMETERS.inertia))
    model.appendBodyToJoint(body, inertia, pin.SE3.Identity())
    model.gravity.linear = np.array(PARAMETERS.gravity)
    data = model.createData()
    state = unpack_state(x)

    steps, duration = 2000, 0.5
    dt = duration / steps
    halves = np.arange(2 * steps + 1)[:, None] * 0.5 * dt  # all at once, for SciPy takes its time
    legs = (state.leg_position + halves * state.leg_velocity).reshape(-1, 3)
    arms = leg_by_scipy(*legs.T).reshape(-1, 4, 3) + PARAMETERS.hip_position

    def acceleration(half, q, v):
        """Of the body after so many half steps, from forces moved into its frame by SciPy's
        rotation.
        """
        rotation = Rotation.from_quat(q[3:7]).as_matrix()
        pushes = ground(0.5 * dt * half).reshape(4, 3) @ rotation
        external = pin.StdVec_Force()
        external.append(pin.Force.Zero())
        moment = np.cross(arms[half], pushes).sum(axis=0)
        external.append(pin.Force(rotation.T @ u_t + pushes.sum(axis=0), moment))
        return pin.aba(model, data, q, v, np.zeros(6), external)

    quaternion = Rotation.from_matrix(state.rotation).as_quat()
    q = np.concatenate((state.position, quaternion))
    v = np.concatenate((state.rotation.T @ state.velocity, state.angular_velocity))
    for k in range(steps):  # the midpoint rule
        first = acceleration(2 * k, q, v)
        middle = pin.integrate(model, q, 0.5 * dt * (v + 0.25 * dt * first))
        second = acceleration(2 * k + 1, middle, v + 0.5 * dt * first)
        q = pin.integrate(model, q, dt * (v + 0.5 * dt * first))
        v = v + dt * second
    rate = lambda t, y: f_rom(y, NO_LEGS, ground(t), u_t, PARAMETERS)  # noqa: E731
    _, states = integrate_rom(rate, x, duration, 250)
    end = unpack_state(states[-1])
    # The reference is of order 2: 0.25 ms steps leave some 1e-6 of what turns and moves.
    reference = Rotation.from_quat(q[3:7]).as_matrix()
    np.testing.assert_allclose(end.position, q[:3], atol=5e-6)
    np.testing.assert_allclose(end.rotation, reference, atol=5e-6)
    np.testing.assert_allclose(end.velocity, reference @ v[:3], atol=3e-5)
    np.testing.assert_allclose(end.angular_velocity, v[3:], atol=3e-5)
    assert np.linalg.norm(end.rotation - state.rotation) > 0.5, "it must have turned"


# -------------------------------------------------------------------------- f_ROM and CasADi


def function_inputs(function):
    return [(function.name_in(k), function.size1_in(k)) for k in range(function.n_in())]


@pytest.mark.parametrize("seed", SEEDS)
def test_numpy_and_casadi_agree(seed):
    rng = np.random.default_rng(seed)
    x, inputs = random_state(rng), random_inputs(rng)
    expected = f_rom(x, *inputs, PARAMETERS)
    assert expected.shape == (42,)
    function = rom_function(PARAMETERS)
    np.testing.assert_allclose(np.array(function(x, *inputs)).ravel(), expected, atol=1e-12)
    symbols = [ca.MX.sym(name, size) for name, size in function_inputs(function)]
    matrices = ca.Function("f", symbols, [f_rom(*symbols, PARAMETERS)])
    np.testing.assert_allclose(np.array(matrices(x, *inputs)).ravel(), expected, atol=1e-12)
    exact = f_rom(ca.DM(x), *map(ca.DM, inputs), PARAMETERS)
    np.testing.assert_allclose(np.array(exact).ravel(), expected, atol=1e-12)
    symbol = ca.SX.sym("x", 42)
    for measure in (foot_positions, foot_velocities, bias, energy, angular_momentum):
        value = ca.Function("m", [symbol], [measure(symbol, PARAMETERS)])(x)
        reference = np.asarray(measure(x, PARAMETERS))
        shape = reference.shape if reference.ndim == 2 else (reference.size, 1)
        assert value.shape == shape, measure.__name__
        np.testing.assert_allclose(np.array(value), reference.reshape(shape), atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_derivatives_of_casadi_are_finite_differences(seed):
    """df/dx, df/du of CasADi's exact derivatives against differences of the NumPy model."""
    rng = np.random.default_rng(seed)
    point = [random_state(rng), *random_inputs(rng)]
    function = rom_function(PARAMETERS)
    symbols = [function.sx_in(k) for k in range(4)]
    step = 1e-5
    for k, symbol in enumerate(symbols):
        jacobian = ca.Function("j", symbols, [ca.jacobian(function(*symbols), symbol)])
        exact = np.array(jacobian(*point))
        numeric = np.empty(exact.shape)
        for column in range(point[k].size):
            ahead, behind = [p.copy() for p in point], [p.copy() for p in point]
            ahead[k][column] += step
            behind[k][column] -= step
            change = f_rom(*ahead, PARAMETERS) - f_rom(*behind, PARAMETERS)
            numeric[:, column] = change / (2 * step)
        # Truncation: step^2 / 6 times a third derivative below 1e3; rounding: 1e-16 * 1e3 / step.
        np.testing.assert_allclose(exact, numeric, atol=1e-7)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_rotation_moves_along_so3(seed):
    """R^T R' is skew, so that R^T R stays one along the exact flow."""
    rng = np.random.default_rng(seed)
    x = random_state(rng)
    rate = f_rom(x, *random_inputs(rng), PARAMETERS)
    turning = unpack_state(x).rotation.T @ unpack_state(rate).rotation
    np.testing.assert_allclose(turning + turning.T, 0.0, atol=1e-14)
    np.testing.assert_allclose(
        [turning[2, 1], turning[0, 2], turning[1, 0]], x[ANGULAR_VELOCITY], atol=1e-14
    )


# -------------------------------------------------------------------------------- slopes


def test_a_slope_turns_gravity_only():
    parameters = in_slope_frame(PARAMETERS, np.radians(30.0))
    size = np.linalg.norm(PARAMETERS.gravity)
    np.testing.assert_allclose(parameters.gravity, [-size / 2, 0.0, -size * np.sqrt(0.75)])
    assert parameters.mass == PARAMETERS.mass
    np.testing.assert_array_equal(parameters.inertia, PARAMETERS.inertia)


@pytest.mark.parametrize("slope", [0.0, 0.4, np.pi / 2])
def test_motion_on_a_slope_is_that_in_the_world(slope):
    """The frame is an inertial one: the same motion, seen from it."""
    rng = np.random.default_rng(11)
    x, (u_l, u_g, u_t) = random_state(rng), random_inputs(rng)
    world_from_slope = Rotation.from_euler("y", -slope).as_matrix()
    state = unpack_state(x)
    seen = pack_state(
        state._replace(
            rotation=world_from_slope.T @ state.rotation,
            position=world_from_slope.T @ state.position,
            velocity=world_from_slope.T @ state.velocity,
        )
    )
    turned = (u_g.reshape(4, 3) @ world_from_slope).reshape(-1)
    here = f_rom(seen, u_l, turned, world_from_slope.T @ u_t, in_slope_frame(PARAMETERS, slope))
    there = f_rom(x, u_l, u_g, u_t, PARAMETERS)
    np.testing.assert_allclose(here[VELOCITY], world_from_slope.T @ there[VELOCITY], atol=1e-12)
    np.testing.assert_allclose(here[ANGULAR_VELOCITY], there[ANGULAR_VELOCITY], atol=1e-11)


def test_a_slope_may_stay_a_symbol():
    angle, x = ca.SX.sym("slope"), ca.SX.sym("x", 42)
    parameters = in_slope_frame(PARAMETERS, angle)
    rate = f_rom(x, NO_LEGS, NO_GROUND, NO_THRUST, parameters)
    function = ca.Function("f", [x, angle], [rate])
    state = random_state(np.random.default_rng(2))
    expected = f_rom(state, NO_LEGS, NO_GROUND, NO_THRUST, in_slope_frame(PARAMETERS, 0.5))
    np.testing.assert_allclose(np.array(function(state, 0.5)).ravel(), expected, atol=1e-12)
    # The state may be numbers all the same.
    again = ca.Function("g", [angle], [f_rom(state, NO_LEGS, NO_GROUND, NO_THRUST, parameters)])
    np.testing.assert_allclose(np.array(again(0.5)).ravel(), expected, atol=1e-12)
    with pytest.raises(ValueError, match="gravity must be numbers"):
        in_slope_frame(parameters, 0.1)


# ------------------------------------------------------------------------------ bad input


def test_standing_state():
    x = standing_state(PARAMETERS, ROBOT.stand_height)
    np.testing.assert_allclose(foot_positions(x, PARAMETERS)[:, 2], 0.0, atol=1e-15)
    with pytest.raises(ValueError, match="height must be > 0 m, not 0"):
        standing_state(PARAMETERS, 0.0)


@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("x", (41, 12, 12, 3)),
        ("u_L", (42, 3, 12, 3)),
        ("u_g", (42, 12, 6, 3)),
        ("u_T", (42, 12, 12, 1)),
    ],
)
def test_a_wrong_shape_is_named(name, sizes):
    with pytest.raises(ValueError, match=rf"^{name} must have shape"):
        f_rom(*map(np.zeros, sizes), PARAMETERS)
    with pytest.raises(ValueError, match=rf"^{name} must have shape"):
        f_rom(*map(ca.SX.zeros, sizes), PARAMETERS)


def test_bad_parts_of_a_state_and_bad_legs():
    state = unpack_state(standing_state(PARAMETERS, 0.5))
    with pytest.raises(ValueError, match=r"rotation must have shape \(3, 3\), not \(4,\)"):
        pack_state(state._replace(rotation=np.array([0.0, 0.0, 0.0, 1.0])))
    with pytest.raises(ValueError, match=r"velocity must have shape \(3,\), not \(2,\)"):
        pack_state(state._replace(velocity=np.zeros(2)))
    for leg in (-1, 4):
        with pytest.raises(ValueError, match=f"leg must be 0 to 3, not {leg}"):
            ground_input_matrix(np.zeros(42), leg, PARAMETERS)
