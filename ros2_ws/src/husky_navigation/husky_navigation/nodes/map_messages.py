"""The elevation map as `grid_map_msgs/GridMap` and as `nav_msgs/OccupancyGrid`."""

from __future__ import annotations

import array

import numpy as np
from grid_map_msgs.msg import GridMap
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from std_msgs.msg import Float32MultiArray, MultiArrayDimension, MultiArrayLayout

from husky_description.arrays import Array
from husky_navigation.cells import Lattice
from husky_navigation.elevation_map import ElevationMap
from husky_navigation.grid_layout import (
    Dimension,
    Floats,
    GridMapData,
    from_grid_map,
    to_grid_map,
    to_occupancy_grid,
)
from husky_navigation.planning.world_map import MapHeights
from husky_navigation.surface import Surface, occupancy_of
from husky_runtime import graph
from husky_runtime.nodes import stamps

BASIC_LAYERS = ("elevation",)
"""Layers that a cell must have to be valid."""
TOP, AGE = "top", "age"
"""Layers of the highest surface in each cell, and of the time since it was measured; a map may
lack them."""


def grid_map_message(ground: ElevationMap, surface: Surface, time_ns: int) -> GridMap:
    """Return the map and the shape of its surface at a time [ns].

    Its layers are elevation [m], variance [m^2], top [m], age [s], slope [rad], step [m],
    roughness [m] and traversability [-], NaN where they are not known.
    """
    layers = {
        "elevation": ground.elevation,
        "variance": ground.variance,
        TOP: ground.top,
        AGE: ground.age,
        "slope": surface.slope,
        "step": surface.step,
        "roughness": surface.roughness,
        "traversability": surface.traversability,
    }
    message = GridMap(
        layers=list(layers),
        basic_layers=list(BASIC_LAYERS),
        data=[_layer_message(layer) for layer in layers.values()],
    )
    message.header.frame_id = graph.FRAME_ODOM
    stamps.fill(message.header.stamp, time_ns)
    info, lattice = message.info, ground.lattice
    info.resolution = lattice.resolution
    info.length_x = info.length_y = lattice.cells * lattice.resolution
    info.pose.position.x, info.pose.position.y = lattice.center
    return message


def heights_of(message: GridMap) -> MapHeights:
    """Return the heights of a map; without their layers the top is the elevation, the age is 0.

    Raises:
        ValueError: the map is in another frame than `odom`, or has no elevation, or is not square.
    """
    frame = message.header.frame_id
    if frame != graph.FRAME_ODOM:
        raise ValueError(f"frame_id is {frame[:40]!r}, it must be {graph.FRAME_ODOM!r}")
    if BASIC_LAYERS[0] not in message.layers or len(message.layers) != len(message.data):
        raise ValueError(f"there is no layer {BASIC_LAYERS[0]!r}")
    elevation = _layer_of(message, BASIC_LAYERS[0])
    top = _layer_of(message, TOP) if TOP in message.layers else elevation
    age = _layer_of(message, AGE) if AGE in message.layers else np.zeros_like(elevation)
    info, cells = message.info, elevation.shape[0]
    for layer in (elevation, top, age):
        if layer.shape != (cells, cells) or info.resolution <= 0.0 or cells == 0:
            raise ValueError(f"{layer.shape} cells of {info.resolution} m are no square map")
    at = info.pose.position
    corner = (round(each / info.resolution) - cells // 2 for each in (at.x, at.y))
    return MapHeights(elevation, top, age, Lattice(info.resolution, cells, *corner))


def _layer_of(message: GridMap, name: str) -> Array:
    """Return a layer of a map (n, m); raises ValueError if it has not two dimensions."""
    told = message.data[list(message.layers).index(name)]
    if len(told.layout.dim) != 2:
        raise ValueError(f"the layer has {len(told.layout.dim)} dimensions, it must have 2")
    column, row = (Dimension(each.label, each.size, each.stride) for each in told.layout.dim)
    return from_grid_map(GridMapData((column, row), np.array(told.data, np.float32)))


def occupancy_message(ground: ElevationMap, surface: Surface, time_ns: int) -> OccupancyGrid:
    """Return the costs of the map's cells for a planner at a time [ns]."""
    costs = occupancy_of(surface, ground.parameters)
    return costs_message(costs, ground.lattice, graph.FRAME_ODOM, time_ns)


def costs_message(
    costs: NDArray[np.int8], lattice: Lattice, frame: str, time_ns: int
) -> OccupancyGrid:
    """Return costs of cells (n, n), -1 unknown to 100, as a message in a frame at a time [ns]."""
    message = OccupancyGrid()
    message.header.frame_id = frame
    stamps.fill(message.header.stamp, time_ns)
    info = message.info
    info.map_load_time = message.header.stamp
    info.resolution = lattice.resolution
    info.width = info.height = lattice.cells
    info.origin.position.x = lattice.x * lattice.resolution
    info.origin.position.y = lattice.y * lattice.resolution
    message.data = array.array("b", to_occupancy_grid(costs).tobytes())
    return message


def _layer_message(layer: Array) -> Float32MultiArray:
    laid_out = to_grid_map(layer)
    dim = [
        MultiArrayDimension(label=each.label, size=each.size, stride=each.stride)
        for each in laid_out.dim
    ]
    return Float32MultiArray(layout=MultiArrayLayout(dim=dim), data=_floats(laid_out.data))


def _floats(values: Floats) -> array.array[float]:
    """Return numbers as the messages' own type, which is not looked through one by one."""
    return array.array("f", values.tobytes())
