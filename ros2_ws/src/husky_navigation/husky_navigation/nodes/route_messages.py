"""Routes and planning grids as messages: path, drawing, cost map."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from visualization_msgs.msg import Marker, MarkerArray

from husky_navigation.nodes.map_messages import costs_message
from husky_navigation.planning.planning_grid import PlanningGrid
from husky_navigation.planning.route import Leg, PlanePose, Route
from husky_navigation.planning.route_search import CLIMB, FLY, WALK
from husky_navigation.planning.world_map import WorldMap
from husky_runtime import graph
from husky_runtime.nodes import stamps
from husky_runtime.nodes.markers import BLUE, ORANGE, VIOLET, make_marker

COLOURS = {WALK: BLUE, CLIMB: ORANGE, FLY: VIOLET}
"""Of the legs of a route, by their modes."""
_STEP = 0.1
"""Between two poses of a path [m]."""
_OVER = 0.05
"""Height of the drawing over the ground [m]."""
_LETHAL, _STEEP = 100, 60
"""Costs of ground that no foot is put on, and of ground that is climbed."""


def pose_message(pose: PlanePose, z: float, time_ns: int) -> PoseStamped:
    """Return a pose in `map` at a height [m] and a time [ns]."""
    message = PoseStamped()
    message.header.frame_id = graph.FRAME_MAP
    stamps.fill(message.header.stamp, time_ns)
    at, q = message.pose.position, message.pose.orientation
    at.x, at.y, at.z = float(pose.x), float(pose.y), z
    q.z, q.w = math.sin(0.5 * pose.yaw), math.cos(0.5 * pose.yaw)
    return message


def path_message(route: Route, world: WorldMap, time_ns: int) -> Path:
    """Return the poses of a route, on the ground or where it flies, `_STEP` apart; the heading is
    that of the nose.
    """
    path = Path()
    path.header.frame_id = graph.FRAME_MAP
    stamps.fill(path.header.stamp, time_ns)
    for leg in route.legs:
        path.poses += [
            pose_message(pose, _height(leg, world, pose.x, pose.y), time_ns) for pose in _poses(leg)
        ]
    return path


def route_markers(route: Route | None, world: WorldMap, time_ns: int) -> MarkerArray:
    """Return a line for each leg, in the colour of its mode, and the energy it will cost; of no
    route, what takes the last one away.
    """
    clear = Marker(ns="route", action=Marker.DELETEALL)
    clear.header.frame_id = graph.FRAME_MAP
    markers = [clear]
    for number, leg in enumerate(route.legs if route else ()):
        poses = _poses(leg)
        line = make_marker(
            Marker.LINE_STRIP, graph.FRAME_MAP, "route", 2 * number, COLOURS[leg.mode], len(poses)
        )
        for point, pose in zip(line.points, poses, strict=True):
            point.x, point.y = pose.x, pose.y
            point.z = _height(leg, world, pose.x, pose.y) + _OVER
        line.scale.x = 0.04
        markers += [line, _label(leg, line.points[len(poses) // 2], 2 * number + 1)]
    for marker in markers:
        stamps.fill(marker.header.stamp, time_ns)
        marker.lifetime.sec = marker.lifetime.nanosec = 0  # until the next route
    return MarkerArray(markers=markers)


def _label(leg: Leg, place: Point, number: int) -> Marker:
    """Return the energy of a leg as text over its middle."""
    text = make_marker(
        Marker.TEXT_VIEW_FACING, graph.FRAME_MAP, "route", number, (1.0, 1.0, 1.0), 0
    )
    text.pose.position.x, text.pose.position.y, text.pose.position.z = place.x, place.y, 0.4
    text.pose.position.z += place.z
    text.scale.z = 0.15
    text.text = f"{leg.mode} {leg.energy / 1e3:.1f} kJ"
    return text


def cost_message(grid: PlanningGrid, time_ns: int) -> OccupancyGrid:
    """Return the costs of the planning cells: 0 free, 60 climbed or next to it, 100 never."""
    costs = np.where(grid.rough, _LETHAL, np.where(grid.free.any(axis=0), 0, _STEEP))
    costs = np.where(grid.filled, costs, -1).astype(np.int8)
    return costs_message(costs, grid.lattice, graph.FRAME_MAP, time_ns)


def _poses(leg: Leg) -> list[PlanePose]:
    """Return poses along a leg, its corners among them."""
    found = []
    for start, end in pairwise(leg.points):
        dx, dy = end - start
        yaw, count = math.atan2(dy, dx), max(1, math.ceil(math.hypot(dx, dy) / _STEP))
        for x, y in start + np.outer(np.arange(count) / count, (dx, dy)):
            found.append(PlanePose(float(x), float(y), yaw))
    x, y = leg.points[-1]
    return [*found, PlanePose(float(x), float(y), leg.yaw)]


def _height(leg: Leg, world: WorldMap, x: float, y: float) -> float:
    """Return the height of a flight, else of the ground at a place [m], 0 where it was not seen."""
    if math.isfinite(leg.altitude):
        return leg.altitude
    cell = world.lattice.index_of(x, y)
    height = math.nan if cell is None else float(world.elevation[cell])
    return height if math.isfinite(height) else 0.0
