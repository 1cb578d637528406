"""Fusion of heights into one cell against the estimate of least variance, and its other rules."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_navigation.cells import unseen_cells
from husky_navigation.fusion import HeightMeasurements, fuse, level_cells
from husky_navigation.map_parameters import MapParameters

FREE = MapParameters(gate=10.0, least_variance=1e-8)
PLAIN = MapParameters()


def show(cells, height, variance, points=5.0, parameters=PLAIN):
    seen = level_cells(np.array([height]), variance, points)
    return fuse(cells, np.array([0]), seen, parameters)[:2]


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.floats(-0.02, 0.02), st.floats(0.01, 0.05)),
        min_size=1,
        max_size=12,
    )
)
def test_heights_fuse_into_their_weighted_mean(seen):
    cells = unseen_cells(1)
    for height, deviation in seen:
        show(cells, height, deviation**2, parameters=FREE)
    weights = np.array([deviation**-2 for _, deviation in seen])
    heights = np.array([height for height, _ in seen])
    # Independent of order: the estimate of least variance of all at once.
    assert cells.height[0, 0] == pytest.approx(np.average(heights, weights=weights), abs=1e-12)
    assert cells.variance[0, 0] == pytest.approx(1.0 / weights.sum(), rel=1e-9)


def test_what_measurements_have_in_common_does_not_average_out():
    cells = unseen_cells(1)
    one = np.ones(1)
    seen = HeightMeasurements(0.0 * one, 4e-4 * one, 1e-4 * one, one, 0.0 * one, 0.0 * one)
    for _ in range(100):
        fuse(cells, np.array([0]), seen, PLAIN)
    assert cells.variance[0, 0] == pytest.approx(1e-4)


def test_a_better_variance_outlasts_a_worse_view():
    cells = unseen_cells(1)
    show(cells, 0.0, 2e-5)
    one = np.ones(1)
    far = HeightMeasurements(0.0 * one, 1e-3 * one, 2e-4 * one, one, 0.0 * one, 0.0 * one)
    fuse(cells, np.array([0]), far, PLAIN)
    assert cells.variance[0, 0] <= 2e-5


def test_an_outlier_changes_nothing_until_it_lasts():
    cells = unseen_cells(1)
    for _ in range(5):
        show(cells, 0.0, 1e-4, points=10.0)
    assert show(cells, 0.3, 1e-4) == (1, 0)
    assert show(cells, -0.2, 1e-4) == (1, 0)  # disagrees with the other outlier, too
    assert show(cells, 0.3, 1e-4) == (1, 0)
    assert cells.height[0, 0] == 0.0
    outcomes = [show(cells, 0.3, 1e-4) for _ in range(2)]
    assert outcomes == [(1, 0), (0, 1)]
    assert cells.height[0, 0] == pytest.approx(0.3)
    assert cells.contradictions[0, 0] == 0


def test_agreement_between_outliers_keeps_the_height():
    cells = unseen_cells(1)
    show(cells, 0.0, 1e-4, points=50.0)
    for _ in range(20):
        show(cells, 0.3, 1e-4)
        show(cells, 0.0, 1e-4)
    assert cells.height[0, 0] == pytest.approx(0.0)


def test_a_blurred_view_must_last_longer():
    cells = unseen_cells(1)
    show(cells, 0.0, 1e-5, points=50.0)
    replaced = [show(cells, 0.3, 2e-3)[1] for _ in range(PLAIN.lasting_contradictions)]
    assert replaced.index(1) == PLAIN.lasting_contradictions - 1


def many(height):
    return HeightMeasurements(
        *(np.full(10, value) for value in (height, 1e-4, 1e-5, 5.0, 0.0, 0.0))
    )


def test_measurements_of_a_wrong_pose_change_nothing():
    """Of 10 cells 8 are known; the others stay unseen, and one that agrees by chance as it was."""
    cells = unseen_cells(4)
    fuse(cells, np.arange(8), many(0.0).of(np.arange(10) < 8), PLAIN)
    before = [values.copy() for values in cells[:4]]
    wrong = many(0.2)
    wrong.height[0] = 0.01
    assert fuse(cells, np.arange(10), wrong, PLAIN) == (7, 0, False)
    for kept, values in zip(before, cells[:4], strict=True):
        np.testing.assert_array_equal(values, kept)
    # When the pose stays so, the map follows.
    outcomes = [fuse(cells, np.arange(10), wrong, PLAIN) for _ in range(3)]
    assert outcomes == [(7, 0, False), (0, 7, False), (0, 0, True)]
    np.testing.assert_allclose(cells.height.ravel()[1:10], 0.2)


def test_offset_is_that_of_all_points():
    cells = unseen_cells(1)
    places, points = np.array([0.010, -0.004, 0.012]), np.array([3.0, 6.0, 1.0])
    for place, count in zip(places, points, strict=True):
        seen = level_cells(np.zeros(1), 1e-4, count)._replace(offset_x=np.array([place]))
        fuse(cells, np.array([0]), seen, PLAIN)
    assert cells.offset_x[0, 0] == pytest.approx(np.average(places, weights=points))
    assert cells.support[0, 0] == 10.0
