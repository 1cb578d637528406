"""Helpers of the tests of the console's page: viser's server as it has it, maps to draw."""

import array
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from grid_map_msgs.msg import GridMap
from std_msgs.msg import Float32MultiArray, MultiArrayDimension

from husky_bringup.console.server import PageServer

Heights = Callable[[float, float], float]
"""A layer of a map as a function of x and y [m]."""


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    started = PageServer()
    yield started
    started.stop()


def grid_map(
    cells: tuple[int, int],
    center: tuple[float, float] = (0.0, 0.0),
    starts: tuple[int, int] = (0, 0),
    resolution: float = 0.1,
    **layers: Heights,
) -> GridMap:
    """A map of rows and columns as grid_map lays it out.

    After GridMapMath.cpp of grid_map_core: index 0 is at the greatest coordinate, indices are
    counted from the buffer's start and wrap round, and the matrix is stored by columns.
    """
    message = GridMap(layers=list(layers))
    message.header.frame_id, message.info.resolution = "odom", resolution
    message.info.length_x, message.info.length_y = (resolution * count for count in cells)
    place = message.info.pose.position
    place.x, place.y = center
    message.outer_start_index, message.inner_start_index = starts
    for height in layers.values():
        stored = np.full(cells, np.nan, np.float32)
        for row, column in np.ndindex(cells):
            x = center[0] + 0.5 * message.info.length_x - (row + 0.5) * resolution
            y = center[1] + 0.5 * message.info.length_y - (column + 0.5) * resolution
            at = (row + starts[0]) % cells[0], (column + starts[1]) % cells[1]
            stored[at] = height(x, y)
        layer = Float32MultiArray(data=array.array("f", stored.T.tobytes()))
        layer.layout.dim = [
            MultiArrayDimension(label="column_index", size=cells[1], stride=cells[0] * cells[1]),
            MultiArrayDimension(label="row_index", size=cells[0], stride=cells[0]),
        ]
        message.data = [*message.data, layer]
    return message
