"""The height of an image over the map, and the drift of odometry's height."""

import numpy as np
import pytest

from husky_navigation.cells import unseen_cells
from husky_navigation.depth_view import no_seen_cells
from husky_navigation.drift import HeightDrift, height_over_map
from husky_navigation.map_parameters import MapParameters

PARAMETERS = MapParameters()


def compared(difference, outliers=0, cells_seen=200, edges=0):
    """Return cells compared and height of an image that lies higher by a difference [m]."""
    random = np.random.default_rng(5)
    cells, seen = unseen_cells(20), no_seen_cells(20)
    cells.height[:] = random.uniform(-0.1, 0.1, (20, 20))
    cells.variance[:], cells.support[:] = 1e-5, 50.0
    seen.height[:] = cells.height + difference + 0.005 * random.standard_normal((20, 20))
    seen.variance[:], seen.points[:] = 2.5e-5, 5
    seen.height.reshape(-1)[:outliers] += 0.2
    seen.edge.reshape(-1)[:edges] = 1
    return height_over_map(cells, seen, np.arange(cells_seen), PARAMETERS)


def test_height_is_that_of_most_cells():
    count, height = compared(0.012, outliers=40)
    assert count == 200
    # A deviation of 5 mm over the root of 160; a prior of 1 cm is nothing beside them.
    assert height == pytest.approx(0.012, abs=1.5e-3)


def test_edges_do_not_count():
    assert compared(0.01, edges=50)[0] == 150


def test_too_few_cells_tell_nothing():
    assert compared(0.01, cells_seen=PARAMETERS.correction_cells - 1)[1] is None


def test_a_jump_is_not_corrected():
    assert compared(0.3)[1] is None


def test_drift_is_a_kalman_filter_of_one_state():
    """Against the same by the information that prior and measurements hold."""
    drift = HeightDrift(growth=4e-6)
    level, variance, lifted = 0.0, 0.0, 0.0
    random = np.random.default_rng(1)
    for _ in range(20):
        drift.walk(0.5)
        variance += 2e-6
        measured, error = random.normal(0.004, 0.003), random.uniform(0.002, 0.01) ** 2
        information = 1.0 / variance + 1.0 / error
        estimate = (level / variance + measured / error) / information
        lift = drift.correct(measured - level, error)
        lifted += lift
        assert lift == pytest.approx(estimate - level, rel=1e-9)
        level, variance = estimate, 1.0 / information
        assert drift.variance == pytest.approx(variance, rel=1e-9)
    assert lifted == pytest.approx(level)


def test_a_robot_that_does_not_walk_moves_no_map():
    drift = HeightDrift(growth=1e-5)
    assert drift.correct(0.01, 1e-6) == 0.0
