"""Boxes that a world of obstacles is built of; the floor of its ditches is a plane below them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from husky_sim.obstacle_world import (
    DITCH_DEPTH,
    ObstacleWorld,
    Rectangle,
    Ridge,
    Square,
    UprightBox,
)
from husky_sim.ramp import Place
from husky_sim.scene_grounds import Patch, SolidBox

_MARGIN = 4.0
"""Level ground beyond the fence [m]."""
_BURIED = 0.05
"""Depth of ridges, walls and crates below the ground [m]."""


def ground_boxes(world: ObstacleWorld) -> list[SolidBox]:
    """Return the level ground around the ditches, from height 0 down to the floor of ditches."""
    boxes = []
    for patch in _patches_around(world.ditches, world.square):
        x, y = (patch.x_start + patch.x_end) / 2, (patch.y_start + patch.y_end) / 2
        length, width = patch.x_end - patch.x_start, patch.y_end - patch.y_start
        boxes.append(_upright_box(Rectangle(x, y, 0.0, length, width), -DITCH_DEPTH, 0.0))
    return boxes


def obstacle_boxes(boxes: Iterable[UprightBox], ridges: Iterable[Ridge]) -> list[SolidBox]:
    """Return the boxes of what stands on the ground: upright boxes, then ridges."""
    solids = [_upright_box(each.ground, -_BURIED, each.height) for each in boxes]
    for ridge in ridges:
        solids += _ridge_boxes(ridge)
    return solids


def _patches_around(ditches: tuple[Rectangle, ...], square: Square) -> list[Patch]:
    """Return strips along y that fill the square and its margin except for the ditches."""
    pits = [
        Patch(d.x - d.length / 2, d.x + d.length / 2, d.y - d.width / 2, d.y + d.width / 2)
        for d in ditches
    ]
    first, last = square.first_x - _MARGIN, square.last_x + _MARGIN
    edge = square.side / 2 + _MARGIN
    cuts = sorted({first, last, *(p.x_start for p in pits), *(p.x_end for p in pits)})
    patches = []
    for start, end in pairwise(cuts):
        crossed = [p for p in pits if p.x_start < (start + end) / 2 < p.x_end]
        low = -edge
        for pit in sorted(crossed, key=lambda pit: pit.y_start):
            patches.append(Patch(start, end, low, pit.y_start))
            low = pit.y_end
        patches.append(Patch(start, end, low, edge))
    return patches


def _upright_box(ground: Rectangle, bottom: float, top: float) -> SolidBox:
    """Return a box over a rectangle between two heights [m]."""
    return SolidBox(
        np.array((ground.x, ground.y, (bottom + top) / 2)),
        np.array((ground.length / 2, ground.width / 2, (top - bottom) / 2)),
        (math.cos(ground.yaw / 2), 0.0, 0.0, math.sin(ground.yaw / 2)),
    )


def _ridge_boxes(ridge: Ridge) -> list[SolidBox]:
    """Return a slab under each facet of both flanks, and a box under the level top."""
    ground = ridge.ground
    back = Rectangle(ground.x, ground.y, ground.yaw + math.pi, ground.length, ground.width)
    facets = list(pairwise(ridge.outline))
    # The slabs below two facets gape where the surface turns up: the lower one reaches further,
    # which stays below the surface.
    angles = [math.atan2(end[1] - start[1], end[0] - start[0]) for start, end in facets]
    turns = [max(0.0, after - before) for before, after in pairwise([*angles, 0.0])]
    boxes = [
        _slab(side, start, end, turn)
        for side in (ground, back)
        for (start, end), turn in zip(facets, turns, strict=True)
    ]
    level = Rectangle(ground.x, ground.y, ground.yaw, ground.length - 2.0 * ridge.run, ground.width)
    return [*boxes, _upright_box(level, -_BURIED, ridge.height)]


def _slab(ground: Rectangle, start: Place, end: Place, turn: float) -> SolidBox:
    """Return a box below a facet that rises along the heading of a ridge, down into the ground.

    Args:
        ground: of the ridge; the facet is as wide.
        start: distance from the edge of the ground where the facet begins, and its height [m].
        end: the same where it ends [m].
        turn: angle by which the next facet is steeper [rad], 0 if it is not.
    """
    angle = math.atan2(end[1] - start[1], end[0] - start[0])
    c, s = math.cos(angle), math.sin(angle)
    thickness = (end[1] + _BURIED) / c
    length = math.dist(start, end) + thickness * math.tan(turn)
    along = start[0] + c * length / 2 + s * thickness / 2
    z = start[1] + s * length / 2 - c * thickness / 2
    x, y = ground.at(along - ground.length / 2, 0.0)
    half_yaw, half_pitch = ground.yaw / 2, -angle / 2
    return SolidBox(
        np.array((x, y, z)),
        np.array((length / 2, ground.width / 2, thickness / 2)),
        (
            math.cos(half_yaw) * math.cos(half_pitch),
            -math.sin(half_yaw) * math.sin(half_pitch),
            math.cos(half_yaw) * math.sin(half_pitch),
            math.sin(half_yaw) * math.cos(half_pitch),
        ),
    )
