"""Stability against closed forms: support polygon, zero-moment point, friction, return map."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from husky_control.stability import (
    GRAVITY,
    center_of_pressure,
    fit_return_map,
    friction_pyramid,
    friction_ratio,
    in_friction_cone,
    perturbed_return_map,
    return_map_of_steps,
    static_margin,
    support_polygon,
    zero_moment_point,
)

SQUARE = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
COORDINATE = st.floats(-2.0, 2.0).map(lambda x: round(x, 3))
POINTS = st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=8)


# ------------------------------------------------------------------ polygon (T15)


def test_polygon_is_the_hull_counter_clockwise():
    polygon = support_polygon([*SQUARE, (0.0, 0.0), (0.5, 0.5), (1.0, 0.0), (1.0, 1.0)])
    assert {tuple(point) for point in polygon} == set(SQUARE)
    x, y = polygon.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert area == pytest.approx(4.0)


def test_height_of_the_contacts_does_not_matter():
    flat = support_polygon(SQUARE)
    assert np.array_equal(support_polygon([(x, y, 0.3 * x) for x, y in SQUARE]), flat)


@given(POINTS)
def test_polygon_is_convex_and_holds_all_points(points):
    polygon = support_polygon(points)
    assert {tuple(corner) for corner in polygon.tolist()} <= set(points)
    if len(polygon) < 3:
        return
    edges = np.roll(polygon, -1, axis=0) - polygon
    following = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0.0).all()
    for point in points:
        offset = np.array(point) - polygon
        assert (edges[:, 0] * offset[:, 1] - edges[:, 1] * offset[:, 0] >= -1e-12).all()


@pytest.mark.parametrize("points", [[], [(1.0,)], [(0.0, math.nan)], [(math.inf, 0.0)]])
def test_polygon_refuses_what_are_no_points(points):
    with pytest.raises(ValueError, match="points must"):
        support_polygon(points)


@pytest.mark.parametrize(
    ("com", "margin"),
    [
        ((0.0, 0.0), 1.0),
        ((0.25, 0.5), 0.5),
        ((1.0, 0.0), 0.0),
        ((1.5, 0.0), -0.5),
        ((2.0, 2.0), -math.sqrt(2.0)),  # the nearest place is a corner
        ((0.0, 0.0, 7.0), 1.0),  # along gravity
    ],
)
def test_margin_of_a_square(com, margin):
    assert static_margin(com, SQUARE) == pytest.approx(margin, abs=1e-12)


def test_margin_of_a_triangle_is_the_radius_of_its_inscribed_circle():
    side = 0.6
    corners = [(side * math.cos(a), side * math.sin(a)) for a in (0.0, 2.0944, 4.18879)]
    assert static_margin((0.0, 0.0), corners) == pytest.approx(0.5 * side, abs=1e-5)


def test_fewer_than_three_feet_have_no_margin():
    assert static_margin((0.0, 0.5), [(0.0, 0.0), (0.0, 1.0)]) == 0.0
    assert static_margin((0.3, 0.5), [(0.0, 0.0), (0.0, 1.0)]) == pytest.approx(-0.3)
    assert static_margin((0.0, 1.5), [(0.0, 0.0), (0.0, 1.0)]) == pytest.approx(-0.5)
    assert static_margin((3.0, 4.0), [(0.0, 0.0)]) == pytest.approx(-5.0)
    assert static_margin((0.0, 0.0), np.empty((0, 2))) == -math.inf
    assert static_margin((0.5, 0.1), [(0, 0), (1, 0), (2, 0)]) == pytest.approx(-0.1)


@given(POINTS, st.tuples(COORDINATE, COORDINATE))
def test_margin_is_the_distance_to_the_edge_by_brute_force(points, com):
    polygon = support_polygon(points)
    assume(len(polygon) >= 3)
    s = np.linspace(0.0, 1.0, 401)[:, None]
    edges = [a + s * (b - a) for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)]
    sampled = min(float(np.hypot(*(edge - com).T).min()) for edge in edges)
    # Samples lie within 4 sqrt(2) / 400 / 2 of the nearest point of an edge.
    assert abs(static_margin(com, points)) == pytest.approx(sampled, abs=8e-3)


# ------------------------------------------------------- ZMP, centre of pressure


def test_zmp_at_rest_is_under_the_centre_of_mass():
    np.testing.assert_array_equal(zero_moment_point((0.1, -0.2, 0.5), np.zeros(3)), [0.1, -0.2])


def test_zmp_of_the_inverted_pendulum():
    # x'' = g / h (x - p): a pendulum about p = 0.03 has its zero-moment point there.
    h, x, pivot = 0.5, 0.1, 0.03
    acceleration = (GRAVITY / h * (x - pivot), 0.0, 0.0)
    zmp = zero_moment_point((x, 0.0, h + 0.2), acceleration, ground=0.2)
    np.testing.assert_allclose(zmp, [pivot, 0.0], atol=1e-12)


def test_zmp_needs_weight():
    heavier = zero_moment_point((0.0, 0.0, 0.5), (1.0, 0.0, GRAVITY))
    np.testing.assert_allclose(heavier, [-0.5 / (2 * GRAVITY), 0.0])
    with pytest.raises(ValueError, match="free fall"):
        zero_moment_point((0.0, 0.0, 0.5), (0.0, 0.0, -GRAVITY))


@settings(max_examples=50)
@given(
    st.lists(st.floats(0.5, 40.0), min_size=4, max_size=4),
    st.lists(st.floats(-0.4, 0.4), min_size=8, max_size=8),
)
def test_centre_of_pressure_is_the_zmp_of_the_forces_that_make_it(load, tangential):
    """Forces on four feet of a point mass, without spin: both points follow from mechanics."""
    feet = np.array([(0.2, 0.1, 0.0), (0.2, -0.1, 0.0), (-0.2, 0.1, 0.0), (-0.2, -0.1, 0.0)])
    forces = np.column_stack((np.reshape(tangential, (4, 2)) * np.array(load)[:, None], load))
    pressure = center_of_pressure(feet, forces)
    total, mass, height = forces.sum(axis=0), 7.6, 0.5
    # The resultant through the centre of pressure meets this height at a centre of mass that
    # it does not turn (but for yaw).
    com = np.append(pressure + height * total[:2] / total[2], height)
    acceleration = total / mass - [0.0, 0.0, GRAVITY]
    np.testing.assert_allclose(zero_moment_point(com, acceleration), pressure, atol=1e-9)
    assert static_margin(pressure, feet) > -1e-12


def test_centre_of_pressure_needs_pressure():
    with pytest.raises(ValueError, match="vertical"):
        center_of_pressure([(0.0, 0.0)], [(1.0, 0.0, 0.0)])


# ----------------------------------------------------------------- friction (T16)


def test_friction_ratio_by_hand():
    ratio = friction_ratio([(3.0, 4.0, 10.0), (0.0, 0.0, 5.0), (1.0, 0.0, 0.0), (1.0, 0.0, -2.0)])
    np.testing.assert_allclose(ratio, [0.5, 0.0, np.inf, np.inf])


def test_cone_is_open_at_its_edge():
    assert in_friction_cone((0.69, 0.0, 1.0), 0.7)
    assert not in_friction_cone((0.7, 0.0, 1.0), 0.7)
    assert not in_friction_cone((0.0, 0.0, 0.0), 0.7)
    assert not in_friction_cone((0.0, 0.0, -1.0), 0.7)


@given(
    st.integers(3, 12),
    st.floats(0.05, 1.5),
    st.floats(0.0, 2 * math.pi),
    st.floats(0.0, 2.0),
)
def test_pyramid_lies_inside_of_the_cone_and_touches_it(faces, friction, direction, share):
    pyramid = friction_pyramid(friction, faces)
    assert pyramid.shape == (faces, 3)
    force = np.array([math.cos(direction), math.sin(direction), 0.0]) * share * friction
    force[2] = 1.0
    if (pyramid @ force <= 0.0).all():
        assert friction_ratio(force) <= friction * (1.0 + 1e-9)
    # Inside of the inscribed radius everything is allowed, whatever the direction.
    if share <= math.cos(math.pi / faces) * (1.0 - 1e-9):
        assert (pyramid @ force <= 0.0).all()
    corner = math.pi / faces
    edge = np.array([friction * math.cos(corner), friction * math.sin(corner), 1.0])
    assert (pyramid @ edge).max() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("friction", "faces"), [(0.0, 4), (-1.0, 4), (0.7, 2), (math.nan, 4)])
def test_pyramid_refuses_nonsense(friction, faces):
    with pytest.raises(ValueError, match="friction must be > 0 and faces >= 3"):
        friction_pyramid(friction, faces)


# ------------------------------------------------------------ return map (T14)

LINEAR = np.array([[0.6, 0.3, 0.0], [-0.3, 0.6, 0.1], [0.0, 0.0, -0.4]])
FIXED = np.array([0.5, -2.0, 0.01])


def linear(state):
    return FIXED + LINEAR @ (state - FIXED)


@pytest.mark.parametrize("seed", range(3))
def test_a_linear_map_is_found_exactly_from_its_pairs(seed):
    random = np.random.default_rng(seed)
    # States of very unlike size, as heights beside velocities.
    states = FIXED + random.normal(size=(30, 3)) * [0.1, 1.0, 1e-4]
    found = fit_return_map(states, np.array([linear(state) for state in states]))
    np.testing.assert_allclose(found.jacobian, LINEAR, atol=1e-6)
    np.testing.assert_allclose(found.fixed_point, FIXED, atol=1e-9)
    # 0.6 +- 0.3 i and -0.4, by hand.
    assert found.spectral_radius == pytest.approx(math.hypot(0.6, 0.3))
    moduli = np.abs(found.eigenvalues)
    np.testing.assert_allclose(moduli, [math.hypot(0.6, 0.3)] * 2 + [0.4], atol=1e-6)
    assert found.stable
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-9)


def test_a_noisy_log_tells_map_and_noise():
    random = np.random.default_rng(0)
    state, states, sigma = FIXED.copy(), [], 0.02
    for _ in range(4000):
        states.append(state)
        state = linear(state) + sigma * random.normal(size=3)
    found = return_map_of_steps(states)
    # Least squares of 4000 pairs: standard errors near 1 / sqrt(4000) = 0.016; four of them.
    np.testing.assert_allclose(found.jacobian, LINEAR, atol=0.064)
    np.testing.assert_allclose(found.residual, sigma, rtol=0.05)


def test_an_unstable_map_is_called_so():
    states = np.linspace(-1.0, 1.0, 5)[:, None]
    found = fit_return_map(states, 1.2 * states - 0.1)
    assert not found.stable
    assert found.spectral_radius == pytest.approx(1.2)
    assert found.fixed_point == pytest.approx(0.5)


def rimless_wheel(slope, spokes=8, length=1.0):
    """Return map of the rimless wheel (McGeer 1990): angular rate just after each impact."""
    half = math.pi / spokes
    loss = math.cos(2.0 * half)
    gain = 2.0 * GRAVITY / length * (math.cos(half - slope) - math.cos(half + slope))

    def step(state):
        return np.array([loss * math.sqrt(state[0] ** 2 + gain)])

    return step, loss, gain


@pytest.mark.parametrize("slope", [0.05, 0.08, 0.15])
def test_rimless_wheel_has_its_fixed_point_and_eigenvalue(slope):
    step, loss, gain = rimless_wheel(slope)
    # w* = loss sqrt(w*^2 + gain), and the slope of the map there is loss^2.
    fixed = loss * math.sqrt(gain / (1.0 - loss**2))
    found = perturbed_return_map(step, [1.3 * fixed], 1e-4, rounds=8)
    assert found.fixed_point[0] == pytest.approx(fixed, rel=1e-6)
    assert found.eigenvalues[0] == pytest.approx(loss**2, rel=1e-4)
    assert found.stable
    # Eight steps from elsewhere come nearer by this factor a step.
    state = np.array([fixed + 1e-3])
    for _ in range(8):
        state = step(state)
    assert state[0] - fixed == pytest.approx(1e-3 * loss**16, rel=1e-2)


def test_what_cannot_be_fitted_is_refused_with_its_reason():
    random = np.random.default_rng(0)
    states = random.normal(size=(10, 2))
    with pytest.raises(ValueError, match="need at least 3 pairs, not 2"):
        fit_return_map(states[:2], states[:2])
    with pytest.raises(ValueError, match="alike"):
        fit_return_map(states, states[:5])
    with pytest.raises(ValueError, match="finite"):
        fit_return_map(np.where(states > 1.0, np.nan, states), states)
    with pytest.raises(ValueError, match="state 1 does not vary"):
        fit_return_map(np.column_stack((states[:, 0], np.ones(10))), states)
    with pytest.raises(ValueError, match="every direction"):
        fit_return_map(np.column_stack((states[:, 0], states[:, 0])), states)
    with pytest.raises(ValueError, match="no isolated fixed point"):
        fit_return_map(states, states * [1.0, 0.5] + 1.0)
    with pytest.raises(ValueError, match="no isolated fixed point"):
        fit_return_map(states, states + 1.0)
    with pytest.raises(ValueError, match="m >= 2"):
        return_map_of_steps(states[:1])
    with pytest.raises(ValueError, match="rounds"):
        perturbed_return_map(lambda state: state, [0.0], 0.1, rounds=0)
