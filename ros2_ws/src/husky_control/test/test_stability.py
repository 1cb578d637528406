"""Stability against closed forms: support polygon, return map."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from husky_control.gait.stability import fit_return_map, static_margin, support_polygon
from husky_description.gravity import GRAVITY

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
    found = fit_return_map(states[:-1], states[1:])
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
    point = np.array([1.3 * fixed])
    for _ in range(8):  # Newton's method, by central differences
        states = point + np.array([[1e-4], [-1e-4]])
        found = fit_return_map(states, np.array([step(state) for state in states]))
        point = found.fixed_point
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
