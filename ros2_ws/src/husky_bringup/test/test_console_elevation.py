"""The elevation map in the scene of the page: where its surface is, and of which colours."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from console_bench import grid_map
from grid_map_msgs.msg import GridMap
from rclpy.serialization import serialize_message

from husky_bringup.console import elevation as module
from husky_bringup.console.elevation import (
    _COLOURS,
    _GREY,
    _LIFT,
    ElevationDrawing,
    read_cells,
    surface_patches,
)
from husky_bringup.console.server import PageServer
from husky_bringup.nodes.shown import decode_shown
from husky_description.arrays import Array
from husky_runtime import graph

CENTER, EDGE = (1.2, -3.4), 0.1
NORMAL = np.array((-0.1, 0.2, 1.0)) / math.sqrt(1.05)
"""Of `plane`, upwards."""


def plane(x: float, y: float) -> float:
    return 0.1 * x - 0.2 * y + 0.3


def triangles(message: GridMap) -> dict[int, Array]:
    """Corners of the triangles (n, 3, 3) of each colour [m]."""
    patches = surface_patches(read_cells(message))
    return {number: patch.vertices[patch.faces] for number, patch in patches.items()}


class Drawing(ElevationDrawing):
    """A drawing whose objects in the frame `odom` are found by their colours."""

    def of(self, message: GridMap | None = None) -> dict[int, Any]:
        if message is not None:
            self.take(message)
        self.draw()
        names = {n: f"/odom/elevation/{n}" for n in range(len(_COLOURS) + 1)}
        found = {n: self._scene.get_handle_by_name(name) for n, name in names.items()}
        return {n: handle for n, handle in found.items() if handle is not None and handle.visible}


@pytest.fixture
def drawing(server: PageServer) -> Drawing:
    server.scene.reset()
    return Drawing(server.scene, "/{}".format)


# Its surface --------------------------------------------------------------------------------------
@pytest.mark.parametrize("starts", [(0, 0), (2, 5)])
def test_the_surface_of_a_plane_is_that_plane(starts: tuple[int, int]) -> None:
    (corners,) = triangles(grid_map((4, 7), CENTER, starts, EDGE, elevation=plane)).values()
    np.testing.assert_allclose(corners[..., 2], plane(corners[..., 0], corners[..., 1]), atol=1e-6)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(
        across / EDGE**2, np.tile(NORMAL * math.sqrt(1.05), (36, 1)), atol=1e-4
    )
    half = 0.5 * EDGE * (np.array((4, 7)) - 1)  # from the first cell's centre to the last one's
    low, high = corners[..., :2].min((0, 1)), corners[..., :2].max((0, 1))
    np.testing.assert_allclose((low, high), (CENTER - half, CENTER + half), atol=1e-6)


def test_nothing_is_drawn_where_nothing_is_known() -> None:
    hidden = {(3, 2): math.nan, (0, 0): math.inf, (5, 5): 1e30}

    def height(x: float, y: float) -> float:
        return hidden.get((math.floor(x / EDGE), math.floor(y / EDGE)), 0.25)

    center = 3 * EDGE, 3 * EDGE
    (corners,) = triangles(grid_map((6, 6), center, resolution=EDGE, elevation=height)).values()
    assert len(corners) == 2 * (25 - 4 - 1 - 1), "squares that have no such corner"
    cells = {tuple(cell) for cell in np.floor(corners[..., :2] / EDGE).reshape(-1, 2).astype(int)}
    assert cells == set(np.ndindex(6, 6)) - set(hidden)
    assert triangles(grid_map((6, 6), elevation=lambda x, y: math.nan)) == {}


def test_a_square_has_the_colour_of_its_least_traversable_corner() -> None:
    """Along x from 0 to 1 and on to what is not known; of two unknown ones it is the other's."""

    def ease(x: float, y: float) -> float:
        return x if x < 1.0 else math.nan

    found = triangles(
        grid_map((13, 2), (0.65, 0.0), resolution=0.1, elevation=plane, traversability=ease)
    )
    lowest = {n: np.unique(corners[..., 0].min(1).round(2)) for n, corners in found.items()}
    assert {n: list(x) for n, x in lowest.items()} == {
        0: [0.05, 0.15],
        1: [0.25, 0.35],
        2: [0.45, 0.55],
        3: [0.65, 0.75],
        4: [0.85, 0.95],
        len(_COLOURS): [1.05, 1.15],
    }


@pytest.mark.parametrize("value", [-7.0, 0.0, 1.0, 7.0])
def test_a_traversability_out_of_range_counts_as_the_nearest(value: float) -> None:
    message = grid_map((2, 2), elevation=plane, traversability=lambda x, y: value)
    assert list(triangles(message)) == [0 if value <= 0.0 else len(_COLOURS) - 1]


def test_of_a_large_map_fewer_cells_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_CELLS", 5)
    cells = read_cells(grid_map((11, 4), CENTER, elevation=plane))
    assert cells.elevation.shape == cells.traversability.shape == (4, 2)
    expected = [[plane(x, y) for y in cells.y] for x in cells.x]
    np.testing.assert_allclose(cells.elevation, expected, atol=1e-6)


# In the scene -------------------------------------------------------------------------------------
def test_a_map_is_drawn_in_its_frame_and_replaces_the_one_before(drawing: Drawing) -> None:
    drawn = drawing.of(grid_map((3, 3), elevation=plane, traversability=lambda x, y: 0.9))
    assert list(drawn) == [4] and drawn[4].color == _COLOURS[4]
    assert tuple(drawn[4].position) == (0.0, 0.0, _LIFT) and len(drawn[4].faces) == 8
    drawn = drawing.of(grid_map((4, 3), elevation=plane))
    assert list(drawn) == [5] and drawn[5].color == _GREY and len(drawn[5].faces) == 12
    moved = grid_map((3, 3), elevation=plane)
    moved.header.frame_id = "other"
    assert drawing.of(moved) == {} and drawing.frame == "other"
    found = [drawing._scene.get_handle_by_name(f"/{at}/elevation/5") for at in ("odom", "other")]
    assert found[0] is None and found[1] is not None and found[1].visible


def test_a_map_is_hidden_and_shown_again_as_it_is_by_then(drawing: Drawing) -> None:
    first = drawing.of(grid_map((3, 3), elevation=plane))[5]
    for shown in (False, True):
        drawing.show(shown)
        assert list(drawing.of(grid_map((3, 3), elevation=plane))) == [5] * shown
    assert drawing.of()[5] is first, "what has not changed is not sent again"
    drawing.clear()
    assert drawing.of() == {} and drawing.frame == ""


def test_what_waits_for_who_does_not_keep_up_is_one_map(
    server: PageServer, drawing: Drawing
) -> None:
    def change(step: int) -> None:
        drawing.of(grid_map((3, 3), elevation=lambda x, y: 0.01 * step))

    change(1)
    change(2)
    waiting = server._websock_server._broadcast_buffer.message_from_id
    before = len(waiting)
    for step in range(3, 30):
        change(step)
    assert 0 < len(waiting) <= before


# Bad maps -----------------------------------------------------------------------------------------
def renamed(message: GridMap) -> None:
    message.layers = ["height"]


def unnamed(message: GridMap) -> None:
    message.layers = []


def of_no_frame(message: GridMap) -> None:
    message.header.frame_id = ""


def of_no_extent(message: GridMap) -> None:
    message.info.resolution = 0.0


def by_rows(message: GridMap) -> None:
    dim = message.data[0].layout.dim
    dim[0].label, dim[1].label = dim[1].label, dim[0].label


def of_one_dimension(message: GridMap) -> None:
    message.data[0].layout.dim = message.data[0].layout.dim[:1]


def cut(message: GridMap) -> None:
    message.data[0].data = message.data[0].data[:-1]


def of_two_sizes(message: GridMap) -> None:
    more = grid_map((2, 3), traversability=plane)
    message.layers, message.data = ["elevation", "traversability"], [*message.data, *more.data]


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (renamed, "layers are height, elevation must be there"),
        (unnamed, "1 layers of data have 0 names"),
        (of_no_frame, "frame_id is empty"),
        (of_no_extent, "resolution is 0.0"),
        (by_rows, "must be column_index, row_index"),
        (of_one_dimension, "1 dimensions"),
        (cut, "data has 5 numbers, it must have 3 x 2"),
        (of_two_sizes, r"\(3, 2\) and \(2, 3\) cells"),
    ],
)
def test_what_is_no_map_is_refused_and_the_old_one_stays(
    drawing: Drawing, spoil: Callable[[GridMap], None], why: str
) -> None:
    drawing.of(grid_map((3, 2), elevation=plane))
    bad = grid_map((3, 2), elevation=plane)
    spoil(bad)
    with pytest.raises(ValueError, match=why):
        drawing.take(bad)
    assert list(drawing.of()) == [5]


def test_a_map_as_it_comes_is_let_in_unless_its_numbers_are_none() -> None:
    """Its layers are longer than other lists may be, and mostly NaN."""
    message = grid_map((2, 2), elevation=plane)
    message.data[0].data = np.full(40_000, np.nan, np.float32)
    for dim in message.data[0].layout.dim:
        dim.size = 200
    found = decode_shown(graph.ELEVATION_MAP, serialize_message(message), GridMap)
    assert len(found.data[0].data) == 40_000 and surface_patches(read_cells(found)) == {}
    message.info.resolution = math.nan
    with pytest.raises(ValueError, match=r"info\.resolution"):
        decode_shown(graph.ELEVATION_MAP, serialize_message(message), GridMap)
