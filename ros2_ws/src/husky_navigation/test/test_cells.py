"""The lattice of cells, and what is kept when the map moves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_navigation.cells import Lattice, age, forget, shift, unseen_cells


@settings(max_examples=40)
@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_lattice_stays_on_the_cells_of_odom(x, y):
    lattice = Lattice(0.04, 200, 0, 0).around(x, y)
    center = np.array(lattice.center)
    np.testing.assert_allclose(center / 0.04, np.round(center / 0.04), atol=1e-9)
    assert np.abs(center - [x, y]).max() <= 0.02 + 1e-9


@settings(max_examples=40)
@given(st.floats(-3.9, 3.9), st.floats(-3.9, 3.9))
def test_a_place_lies_in_its_cell(x, y):
    lattice = Lattice(0.04, 200, -100, -100)
    i, j = lattice.index_of(x, y)
    centers = lattice.cell_centers()
    assert abs(centers[0][i] - x) <= 0.02 + 1e-9
    assert abs(centers[1][j] - y) <= 0.02 + 1e-9


def test_places_beyond_the_map_have_no_cell():
    lattice = Lattice(0.04, 200, -100, -100)
    assert lattice.index_of(4.01, 0.0) is None
    assert lattice.index_of(0.0, -4.01) is None


@pytest.mark.parametrize("step", [(0, 0), (3, 0), (0, -2), (-4, 5), (7, -9), (10, 0), (-99, 1)])
def test_shift_keeps_cells_at_their_places(step):
    """A dictionary by place says which cells stay."""
    count = 10
    cells = unseen_cells(count)
    cells.height[:] = np.arange(count * count).reshape(count, count)
    cells.contradictions[:] = cells.height
    known = {(i, j): cells.height[i, j] for i in range(count) for j in range(count)}
    shift(cells, *step)
    for i in range(count):
        for j in range(count):
            expected = known.get((i + step[0], j + step[1]), np.nan)
            np.testing.assert_equal(cells.height[i, j], expected)
            assert cells.contradictions[i, j] == (0 if np.isnan(expected) else expected)


def test_forgotten_cells_are_unseen_and_others_stay():
    cells = unseen_cells(4)
    cells.height[:], cells.support[:] = 1.0, 7.0
    which = np.zeros((4, 4), dtype=bool)
    which[1, 2] = True
    forget(cells, which)
    assert np.isnan(cells.height[1, 2])
    assert cells.support[1, 2] == 0.0
    assert np.count_nonzero(cells.support == 7.0) == 15


def test_cells_age():
    cells = unseen_cells(2)
    cells.height[0, 0], cells.variance[0, 0] = 0.5, 1e-4
    age(cells, 0.3, 2e-5, 0.01)
    age(cells, 0.2, 0.0, 0.0)
    assert cells.height[0, 0] == pytest.approx(0.51)
    assert cells.variance[0, 0] == pytest.approx(1.2e-4)
    assert cells.age[0, 0] == pytest.approx(0.5)
    assert np.isnan(cells.height[1, 1])
