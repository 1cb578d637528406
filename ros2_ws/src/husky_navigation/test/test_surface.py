"""Slope, step and roughness of grounds in closed form, and by NumPy's least squares."""

import math

import numpy as np
import pytest

from husky_navigation.map_parameters import MapParameters
from husky_navigation.surface import Surface, occupancy_of, surface_of

P = MapParameters()
X, Y = np.meshgrid(0.04 * np.arange(20), 0.04 * np.arange(20), indexing="ij")


@pytest.mark.parametrize(("gradient_x", "gradient_y"), [(0.0, 0.0), (0.3, 0.0), (-0.2, 0.5)])
def test_a_plane_has_a_slope_and_no_roughness(gradient_x, gradient_y):
    surface = surface_of(0.2 + gradient_x * X + gradient_y * Y, P)
    expected = math.atan(math.hypot(gradient_x, gradient_y))
    corner = surface.slope.copy()
    np.testing.assert_allclose(corner[2:-2, 2:-2], expected, atol=1e-9)
    np.testing.assert_allclose(surface.roughness[2:-2, 2:-2], 0.0, atol=1e-7)
    rise = 0.08 * (abs(gradient_x) + abs(gradient_y))  # over 3 cells both ways
    np.testing.assert_allclose(surface.step[2:-2, 2:-2], rise, atol=1e-9)


def test_plane_and_roughness_are_those_of_least_squares():
    random = np.random.default_rng(4)
    elevation = 0.05 * random.standard_normal((20, 20))
    elevation[random.random((20, 20)) < 0.2] = np.nan
    surface = surface_of(elevation, P)
    for i, j in ((5, 5), (9, 12), (0, 7), (19, 3)):
        window = slice(max(0, i - 2), i + 3), slice(max(0, j - 2), j + 3)
        z = elevation[window].ravel()
        known = np.isfinite(z)
        if np.isnan(elevation[i, j]) or 2 * known.sum() < 25:
            assert np.isnan(surface.slope[i, j])
            continue
        a = np.column_stack([np.ones(z.size), X[window].ravel(), Y[window].ravel()])[known]
        fit, residual, _, _ = np.linalg.lstsq(a, z[known])
        gradient = math.hypot(fit[1], fit[2])
        assert surface.slope[i, j] == pytest.approx(math.atan(gradient), rel=1e-9)
        spread = math.sqrt(residual[0] / (known.sum() - 1))
        assert surface.roughness[i, j] == pytest.approx(spread * math.cos(math.atan(gradient)))


def test_a_step_is_found_beside_it_and_nowhere_else():
    surface = surface_of(np.where(X > 0.39, 0.1, 0.0), P)
    step = surface.step[:, 10]
    assert np.count_nonzero(step) == 4  # 2 cells to each side
    np.testing.assert_allclose(step[step > 0.0], 0.1)


def test_a_single_high_cell_is_no_wall():
    """One cell stands higher than the limit: 9 of its neighbours see it, those afar fewer."""
    elevation = np.zeros((20, 20))
    elevation[10, 10] = 0.2
    step = surface_of(elevation, P).step
    assert step[10, 10] == pytest.approx(0.2)
    assert step[12, 12] == pytest.approx(0.2 / 4)
    assert step[13, 10] == 0.0


def test_cells_that_were_not_seen_have_no_surface():
    elevation = np.full((20, 20), np.nan)
    elevation[8:12, 8:12] = 0.0
    surface = surface_of(elevation, P)
    assert np.isnan(surface.slope[:8]).all()
    assert np.isfinite(surface.slope[9:11, 9:11]).all()
    assert np.isnan(surface.slope[8, 8])  # 9 of 25 neighbours


def test_traversability_is_a_mean_of_three():
    one = np.ones((1, 1))
    elevation = 0.3 * X
    surface = surface_of(elevation, P)
    expected = (1.0 - math.atan(0.3) / 1.0) + (1.0 - 0.024 / 0.12) + 1.0
    assert surface.traversability[10, 10] == pytest.approx(expected / 3.0)
    wall = Surface(0.1 * one, 0.2 * one, 0.01 * one, 0.5 * one)
    assert occupancy_of(wall, P)[0, 0] == 100  # a step beyond its limit
    path = Surface(0.1 * one, 0.02 * one, 0.01 * one, 0.8 * one)
    assert occupancy_of(path, P)[0, 0] == 20
    unseen = Surface(*(np.nan * one for _ in range(4)))
    assert occupancy_of(unseen, P)[0, 0] == -1
