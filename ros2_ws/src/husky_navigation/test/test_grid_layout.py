"""Layouts of layers against the definitions of grid_map and OccupancyGrid."""

import numpy as np
import pytest

from husky_navigation.cells import Lattice
from husky_navigation.grid_layout import (
    Dimension,
    GridMapData,
    from_grid_map,
    to_grid_map,
    to_occupancy_grid,
)

LATTICE = Lattice(0.04, 6, 40, -21)


def test_a_layer_comes_back():
    layer = np.random.default_rng(1).standard_normal((6, 4))
    layer[2, 3] = np.nan
    np.testing.assert_allclose(from_grid_map(to_grid_map(layer)), layer, rtol=1e-6)


def test_grid_map_finds_the_place_of_each_number():
    """grid_map: position = centre + length / 2 - (index + 1/2) resolution, on both axes."""
    x, y = LATTICE.cell_centers()
    layer = 100.0 * x[:, None] + y[None, :]
    sent = to_grid_map(layer)
    assert sent.dim == (Dimension("column_index", 6, 36), Dimension("row_index", 6, 6))
    assert sent.data.dtype == np.float32
    for row in range(6):
        for column in range(6):
            place = np.array(LATTICE.center) + 0.12 - 0.04 * (np.array([row, column]) + 0.5)
            # Column-major: the stride of a column is the number of rows.
            number = sent.data[column * sent.dim[1].stride + row]
            assert number == pytest.approx(100.0 * place[0] + place[1], rel=1e-6)


def test_a_foreign_layout_is_refused():
    sent = to_grid_map(np.zeros((3, 3)))
    swapped = GridMapData((sent.dim[1], sent.dim[0]), sent.data)
    with pytest.raises(ValueError, match=r"labels .*row_index.*column_index.*must be"):
        from_grid_map(swapped)
    with pytest.raises(ValueError, match="8 numbers"):
        from_grid_map(GridMapData(sent.dim, sent.data[:-1]))


def test_an_occupancy_grid_counts_along_x_first():
    occupancy = np.arange(12, dtype=np.int8).reshape(4, 3)
    data = to_occupancy_grid(occupancy)
    for i in range(4):
        for j in range(3):
            assert data[j * 4 + i] == occupancy[i, j]  # width 4 along x
