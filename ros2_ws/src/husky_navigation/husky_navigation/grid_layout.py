"""Map layers in the memory layouts of grid_map_msgs/GridMap and nav_msgs/OccupancyGrid.

In this package a layer is an array [i, j] along +x and +y from the map's lowest corner. A GridMap
counts rows from the greatest x and columns from the greatest y, and stores column after column; an
OccupancyGrid stores row after row of equal y, from the lowest corner.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array

Floats = NDArray[np.float32]


class Dimension(NamedTuple):
    """One of std_msgs/MultiArrayDimension."""

    label: str
    size: int
    stride: int


class GridMapData(NamedTuple):
    """One layer as std_msgs/Float32MultiArray: `layout.dim` and `data`; data_offset is 0.

    RViz and grid_map take the layer for column-major by the first label alone, and refuse others.
    """

    dim: tuple[Dimension, Dimension]
    data: Floats


def to_grid_map(layer: Array) -> GridMapData:
    """Return a layer (rows, columns) in the layout of a GridMap with start indices 0."""
    rows, columns = layer.shape
    dim = (
        Dimension("column_index", columns, rows * columns),
        Dimension("row_index", rows, rows),
    )
    return GridMapData(dim, layer[::-1, ::-1].astype(np.float32).ravel(order="F"))


def from_grid_map(data: GridMapData) -> Array:
    """Return the layer that `to_grid_map` has laid out.

    Raises:
        ValueError: the labels are not those of a column-major GridMap, or the length is wrong.
    """
    labels = tuple(each.label for each in data.dim)
    if labels != ("column_index", "row_index"):
        raise ValueError(f"dim has labels {labels}, they must be column_index, row_index")
    columns, rows = (each.size for each in data.dim)
    if data.data.size != rows * columns:
        raise ValueError(f"data has {data.data.size} numbers, it must have {rows} x {columns}")
    layer: Array = data.data.reshape((rows, columns), order="F")[::-1, ::-1].astype(np.float64)
    return layer


def to_occupancy_grid(occupancy: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return occupancy [i, j] as the data of an OccupancyGrid whose origin is the lowest corner.

    Its width is the number of cells along x, its height that along y.
    """
    return occupancy.ravel(order="F")
