"""The elevation map in a scene: the surface through its cells, coloured by traversability."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from grid_map_msgs.msg import GridMap
from numpy.typing import NDArray
from viser import SceneApi

from husky_description.arrays import Array
from husky_navigation.grid_layout import Dimension, GridMapData, from_grid_map

_COLOURS = ((198, 72, 60), (214, 128, 82), (222, 180, 112), (190, 200, 132), (140, 190, 140))
"""Of equal classes of traversability from 0 to 1; the lightness tells them apart as well."""
_GREY = (150, 155, 165)
"""Where traversability is not known."""
_MOST_CELLS = 200
"""Cells along an edge that are drawn, at most; of a larger map every second is, or third, ..."""
_LIFT = 0.01
"""Height by which the map is drawn too high [m]; the simulated ground would hide it otherwise."""
_HIGHEST = 1e4
"""Heights beyond it are not drawn [m]."""


@dataclass(frozen=True, eq=False)
class ElevationCells:
    """Cells of a map that are drawn.

    Attributes:
        frame: of x, y and heights.
        x: of cells [m] (rows,).
        y: of cells [m] (columns,).
        elevation: height [m] (rows, columns), NaN where it is not known.
        traversability: from 0, an obstacle, to 1 (rows, columns), NaN where it is not known.
    """

    frame: str
    x: Array
    y: Array
    elevation: Array
    traversability: Array


class Patch(NamedTuple):
    """Part of a surface that has one colour.

    Attributes:
        vertices: in the map's frame [m] (n, 3).
        faces: indices of vertices (m, 3), counterclockwise as seen from above.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


class ElevationDrawing:
    """The newest elevation map, and its objects in the scene: one for each colour."""

    def __init__(self, scene: SceneApi, path_of: Callable[[str], str]):
        """Draw nothing yet.

        Args:
            scene: to draw in.
            path_of: returns the scene's name of a frame.
        """
        self._scene, self._path_of = scene, path_of
        self._cells: ElevationCells | None = None
        self._handles: dict[int, Any] = {}  # of objects, by their colours
        self._path = ""
        self._shown, self._changed = True, False

    @property
    def frame(self) -> str:
        """The map's frame, "" where there is no map."""
        return self._cells.frame if self._cells is not None else ""

    def take(self, message: GridMap) -> None:
        """Take a map in the place of the one before.

        Raises:
            ValueError: it has no elevation, or a layer is malformed.
        """
        self._cells, self._changed = read_cells(message), True

    def show(self, shown: bool) -> None:
        """Show the map, or hide it."""
        self._changed |= shown != self._shown
        self._shown = shown

    def clear(self) -> None:
        """Forget the map."""
        self._cells, self._changed = None, True

    def surfaces(self) -> Iterator[tuple[str, Array]]:
        """Yield the map's frame and triangles [m] (n, 3, 3) for each colour that is seen."""
        for handle in self._handles.values():
            if handle.visible:
                yield self.frame, handle.vertices[handle.faces]

    def draw(self) -> None:
        """Bring the scene up to date."""
        if not self._changed:
            return
        self._changed = False
        cells = self._cells if self._shown else None
        patches = surface_patches(cells) if cells is not None else {}
        if cells is not None:
            self._move_to(f"{self._path_of(cells.frame)}/elevation")
        for number, handle in self._handles.items():
            if number not in patches:
                handle.visible = False
        for number, patch in patches.items():
            self._draw_patch(number, patch)

    def _move_to(self, path: str) -> None:
        """Have the objects below a name of the scene."""
        if path != self._path:
            for handle in self._handles.values():
                handle.remove()
            self._handles.clear()
            self._path = path

    def _draw_patch(self, number: int, patch: Patch) -> None:
        """Draw a patch of a colour; one that is as it was is not sent again."""
        old = self._handles.get(number)
        if (
            old is not None
            and np.array_equal(old.vertices, patch.vertices)
            and np.array_equal(old.faces, patch.faces)
        ):
            old.visible = True
            return
        self._handles[number] = self._scene.add_mesh_simple(
            f"{self._path}/{number}",
            *patch,
            color=(*_COLOURS, _GREY)[number],
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            position=(0.0, 0.0, _LIFT),
        )


def read_cells(message: GridMap) -> ElevationCells:
    """Return the cells of a map that are drawn.

    The orientation of a map is that of its frame, as grid_map has it.

    Raises:
        ValueError: there is no frame, no resolution, no layer "elevation", or a layer is malformed.
    """
    resolution = message.info.resolution
    if not message.header.frame_id:
        raise ValueError("header.frame_id is empty, it must name a frame")
    if not resolution > 0.0:
        raise ValueError(f"info.resolution is {resolution}, it must be above 0")
    if len(message.data) != len(message.layers):
        raise ValueError(f"{len(message.data)} layers of data have {len(message.layers)} names")
    layers = dict(zip(message.layers, message.data, strict=True))
    if "elevation" not in layers:
        raise ValueError(f"layers are {', '.join(layers)[:100] or 'none'}, elevation must be there")
    starts = message.outer_start_index, message.inner_start_index
    elevation = _read_layer(layers["elevation"], starts)
    rows, columns = elevation.shape
    traversability: Array = np.full((rows, columns), np.nan)
    if "traversability" in layers:
        traversability = _read_layer(layers["traversability"], starts)
    if traversability.shape != (rows, columns):
        raise ValueError(f"layers have {(rows, columns)} and {traversability.shape} cells")
    step = max(1, -(-max(rows, columns) // _MOST_CELLS))
    center = message.info.pose.position
    return ElevationCells(
        message.header.frame_id,
        _centres(center.x, rows, resolution)[::step],
        _centres(center.y, columns, resolution)[::step],
        elevation[::step, ::step],
        traversability[::step, ::step],
    )


def _read_layer(layer: Any, starts: tuple[int, int]) -> Array:
    """Return a layer of a map [i, j] along +x and +y.

    Args:
        layer: as std_msgs/Float32MultiArray.
        starts: row and column at which the map begins in it, as grid_map counts them: a ring.
    """
    dim = [Dimension(each.label, each.size, each.stride) for each in layer.layout.dim]
    if len(dim) != 2:
        raise ValueError(f"a layer has {len(dim)} dimensions, it must have 2")
    data = np.frombuffer(layer.data, np.float32)
    return np.roll(from_grid_map(GridMapData((dim[0], dim[1]), data)), starts, (0, 1))


def _centres(center: float, count: int, resolution: float) -> Array:
    """Return the coordinates of the cells' centres along an axis [m] (count,)."""
    steps: Array = np.arange(count, dtype=np.float64) - 0.5 * (count - 1)
    return center + resolution * steps


def surface_patches(cells: ElevationCells) -> dict[int, Patch]:
    """Return the surface through the centres of cells, by the colours of `_COLOURS` and `_GREY`.

    Where four cells that form a square are known there are two triangles; they have the colour of
    the least traversable of the four. Nothing is drawn across cells that are not known.
    """
    known = np.abs(cells.elevation) < _HIGHEST  # NaN is not
    squares = np.logical_and.reduce(_corners(known))
    classes = _classes(np.fmin.reduce(_corners(cells.traversability)))
    columns = len(cells.y)
    found = {}
    for number in range(len(_COLOURS) + 1):
        i, j = np.nonzero(squares & (classes == number))
        if not i.size:
            continue
        low = i * columns + j
        a, b, c, d = low, low + columns, low + columns + 1, low + 1
        faces = np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))
        numbers = np.zeros(known.size, np.uint32)
        numbers[faces] = 1
        used = np.flatnonzero(numbers)
        numbers[used] = np.arange(used.size)
        place = cells.x[used // columns], cells.y[used % columns], cells.elevation.flat[used]
        found[number] = Patch(np.stack(place, axis=1).astype(np.float32), numbers[faces])
    return found


def _corners(layer: NDArray[Any]) -> list[NDArray[Any]]:
    """Return the four corners of each square between cells, arrays of a row and column less."""
    return [layer[:-1, :-1], layer[1:, :-1], layer[1:, 1:], layer[:-1, 1:]]


def _classes(traversability: Array) -> NDArray[np.int64]:
    """Return the number of the colour of each traversability."""
    count = len(_COLOURS)
    known = np.isfinite(traversability)
    of_known = np.floor(count * np.where(known, traversability, 0.0)).clip(0, count - 1)
    classes: NDArray[np.int64] = np.where(known, of_known, count).astype(np.int64)
    return classes
