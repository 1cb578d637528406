"""Judgement of recorded elevation maps: against the ground of the world's file, seen from above.

Cells are compared where they are seen from the robot: a map is moved by the difference of the true
and the estimated pose of the base at its time, in x, y, z and heading. What is judged is the ground
around the robot, not odometry's drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial.transform import Rotation, Slerp

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base
from husky_navigation.cells import Lattice
from husky_navigation.grid_layout import Dimension, GridMapData, from_grid_map
from husky_navigation.map_parameters import MapParameters
from husky_runtime import graph
from husky_sim.devices.d435.optics import intrinsics_of

RADIUS = 2.5
"""Around the robot, within which a map is judged [m]."""
_BEGIN = 1.0
"""Way after which maps are judged: the first images see little [m]."""
_ABOVE = 5.0
"""Height from which the ground is looked at; no ground is so high [m]."""
_STEP = 3
"""Pixels between those of the camera's rays by which the ground in view is found."""
_VIEWS = 0.2
"""Time between two such views [s]."""
_UPPER_SIDE = 0.01
"""Distance within which a ray ends on the upper side of the ground, not on a wall [m]."""
EDGE_TOLERANCE = 0.08
"""Distance within which the edge of a gap or a pit is to be found [m]."""
_DROP = 0.5
"""Difference of heights from which on an edge is that of a pit [m]."""
_LEAST_GAP = 0.25
"""Width from which on a hole in the ground is a gap [m]."""
_LEVEL = 0.05
"""Distance from the height of a gap's edges within which a cell is ground beside it [m]."""


class RecordedMap(NamedTuple):
    """A map of a recording.

    Attributes:
        time: of its newest image [s].
        lattice: where its cells lie in odom.
        elevation: of the ground in odom [m] (n, n), NaN where it was not seen.
        traversability: 0 to 1 (n, n), NaN where it is not known.
    """

    time: float
    lattice: Lattice
    elevation: Array
    traversability: Array


def recorded_maps(recording: Recording) -> list[RecordedMap]:
    """Return the maps of a recording."""
    if not recording.has(graph.ELEVATION_MAP):
        return []
    _, columns = recording.columns(graph.ELEVATION_MAP)
    names = [key for key in columns if key.startswith("layers[")]
    layers = [str(columns[key][0]) for key in names]
    times = columns["header.stamp.sec"] + 1e-9 * columns["header.stamp.nanosec"]
    maps = []
    for k, time in enumerate(times):
        resolution = float(columns["info.resolution"][k])
        x, y, _ = columns["info.pose.position"][k]
        cells = round(float(columns["info.length_x"][k]) / resolution)
        corner = [round(value / resolution) - cells // 2 for value in (x, y)]
        lattice = Lattice(resolution, cells, *corner)
        elevation, traversability = (
            _layer(columns, layers.index(name), k) for name in ("elevation", "traversability")
        )
        maps.append(RecordedMap(float(time), lattice, elevation, traversability))
    return maps


def _layer(columns: dict[str, NDArray[Any]], index: int, k: int) -> Array:
    """Return a layer of the k-th message."""
    prefix = f"data[{index}]"
    dims = [
        Dimension(
            *(
                columns[f"{prefix}.layout.dim[{d}].{part}"][k]
                for part in ("label", "size", "stride")
            )
        )
        for d in range(2)
    ]
    return from_grid_map(GridMapData((dims[0], dims[1]), columns[f"{prefix}.data"][k]))


class TrueGround:
    """The ground of a recorded world, without the robot."""

    def __init__(self, scene: Path):
        """Load the ground of a scene's file."""
        spec = mujoco.MjSpec.from_file(str(scene))
        for listed in (spec.actuators, spec.sensors, spec.equalities, spec.tendons, spec.keys):
            for each in list(listed):
                spec.delete(each)
        for each in (*spec.excludes, *spec.pairs):
            spec.delete(each)
        for body in list(spec.worldbody.bodies):
            spec.delete(body)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)

    def distances(self, origins: Array, directions: Array) -> Array:
        """Return how far along rays the ground is (n,) [m], infinite where there is none.

        Args:
            origins: in world [m] (n, 3).
            directions: unit vectors (n, 3).
        """
        hit = np.full(len(origins), np.inf)
        geom = np.zeros(1, dtype=np.int32)
        for k, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            distance = mujoco.mj_ray(
                self._model, self._data, origin, direction, None, 1, -1, geom, None
            )
            if distance >= 0.0:
                hit[k] = distance
        return hit

    def heights(self, x: Array, y: Array) -> Array:
        """Return the height of the ground at places in world [m] (n,)."""
        origins = np.stack([x, y, np.full(x.shape, _ABOVE)], axis=1)
        down = np.tile([0.0, 0.0, -1.0], (len(x), 1))
        return _ABOVE - self.distances(origins, down)


class SeenGround:
    """When each place of the ground was first in the camera's view, by true poses."""

    def __init__(self, ground: TrueGround, base: Base, robot: Robot, resolution: float):
        """Cast the camera's rays along a recorded way.

        Args:
            ground: of the world.
            base: true motion.
            robot: that carries the camera.
            resolution: edge of a place [m].
        """
        self._resolution = resolution
        self._first: dict[tuple[int, int], float] = {}
        limits = MapParameters()
        rays = _camera_rays(robot)
        times = np.arange(base.time[0], base.time[-1], _VIEWS)
        place, turn = _poses_at(base, times)
        mount = Rotation.from_euler("xyz", robot.d435.rpy)
        for k, time in enumerate(times):
            directions = turn[k].apply(mount.apply(rays))
            lengths = np.linalg.norm(directions, axis=1)
            origin = place[k] + turn[k].apply(np.array(robot.d435.position))
            origins = np.tile(origin, (len(rays), 1))
            distance = ground.distances(origins, directions / lengths[:, None])
            depth = distance / lengths  # a ray's part along the optical axis is 1
            near = (depth >= limits.least_depth) & (depth <= limits.most_depth)
            points = origins[near] + directions[near] * depth[near, None]
            upper = ground.heights(points[:, 0], points[:, 1]) - points[:, 2] < _UPPER_SIDE
            for cell in np.floor(points[upper, :2] / resolution).astype(int).tolist():
                self._first.setdefault((cell[0], cell[1]), float(time))

    def before(self, time: float, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which places in world [m] (n,) were in view before a time [s] (n,)."""
        cells = np.floor(np.stack([x, y], axis=1) / self._resolution).astype(int).tolist()
        return np.array([self._first.get((i, j), math.inf) <= time for i, j in cells])


def _camera_rays(robot: Robot) -> Array:
    """Return the rays of some pixels in axes of camera_link (n, 3), 1 along the view."""
    pinhole = intrinsics_of(robot.d435)
    columns, rows = np.meshgrid(
        np.arange(0, pinhole.width, _STEP), np.arange(0, pinhole.height, _STEP)
    )
    right = (columns.ravel() - pinhole.cx) / pinhole.fx
    down = (rows.ravel() - pinhole.cy) / pinhole.fy
    return np.stack([np.ones(right.shape), -right, -down], axis=1)


def _poses_at(base: Base, times: Array) -> tuple[Array, Rotation]:
    """Return positions [m] (n, 3) and attitudes at times [s] within a recording's."""
    position = np.stack(
        [np.interp(times, base.time, base.position[:, axis]) for axis in range(3)], axis=1
    )
    keep = np.concatenate([[True], np.diff(base.time) > 0.0])
    turn = Slerp(base.time[keep], Rotation.from_quat(base.orientation[keep]))
    return position, turn(np.clip(times, base.time[0], base.time[-1]))


@dataclass(frozen=True)
class JudgedMap:
    """A map beside the truth.

    Attributes:
        map: as it was recorded.
        x, y: of its cells in world, as the robot stands there (n, n) [m].
        height: of the cells in world [m] (n, n), NaN where the ground was not seen.
        truth: height of the ground there [m] (n, n), NaN beyond `RADIUS` and at the edge of a pit.
        in_view: cells that the camera has had in view, within `RADIUS` (n, n).
    """

    map: RecordedMap
    x: Array
    y: Array
    height: Array
    truth: Array
    in_view: NDArray[np.bool_]

    @property
    def error(self) -> Array:
        """Height less truth of the cells within `RADIUS` that are on the map [m] (k,)."""
        error = self.height - self.truth
        return error[np.isfinite(error)]


def judge(
    recording: Recording,
    robot: Robot,
    scene: Path,
    end: float = math.inf,
) -> list[JudgedMap]:
    """Return the maps of a walk from 1 m on, each beside the truth.

    Args:
        recording: of the walk.
        robot: that walked.
        scene: file of the world.
        end: of the walk [s]; later maps do not count.
    """
    ground, base, estimate = TrueGround(scene), recording.base, recording.estimate
    maps = recorded_maps(recording)
    if not maps:
        return []
    seen = SeenGround(ground, base, robot, maps[0].lattice.resolution)
    times = np.array([each.time for each in maps])
    true, true_turn = _poses_at(base, times)
    believed, believed_turn = _poses_at(estimate, times)
    way = np.hypot(*(true[:, :2] - true[0, :2]).T)
    judged = []
    for k, each in enumerate(maps):
        if way[k] < _BEGIN or each.time > end:
            continue
        turn = _heading(true_turn[k]) - _heading(believed_turn[k])
        judged.append(_beside_truth(each, ground, seen, (true[k], believed[k]), turn))
    return judged


def _heading(turn: Rotation) -> float:
    return float(turn.as_euler("ZYX")[0])


def _beside_truth(
    each: RecordedMap,
    ground: TrueGround,
    seen: SeenGround,
    places: tuple[Array, Array],
    turn: float,
) -> JudgedMap:
    """Return a map in world.

    Args:
        each: the map.
        ground: of the world.
        seen: ground that was in view.
        places: of the base, in world and as believed in odom [m].
        turn: from odom to world about z [rad].
    """
    true, believed = places
    x, y = np.meshgrid(*each.lattice.cell_centers(), indexing="ij")
    x, y = x - believed[0], y - believed[1]
    near = np.hypot(x, y) < RADIUS
    c, s = math.cos(turn), math.sin(turn)
    x, y = true[0] + c * x - s * y, true[1] + s * x + c * y
    truth, in_view = np.full(x.shape, np.nan), np.zeros(x.shape, dtype=bool)
    truth[near] = ground.heights(x[near], y[near])
    truth[_is_near_drop(truth, round(EDGE_TOLERANCE / each.lattice.resolution))] = np.nan
    in_view[near] = seen.before(each.time, x[near], y[near])
    height = each.elevation + (true[2] - believed[2])
    return JudgedMap(each, x, y, height, truth, in_view)


def _is_near_drop(truth: Array, cells: int) -> NDArray[np.bool_]:
    """Return which cells are within some cells of the edge of a pit (n, n).

    They are not compared: one that takes the edge for a cell further is wrong by the pit's depth.
    """
    known = np.isfinite(truth)
    high = maximum_filter(np.where(known, truth, -np.inf), 2 * cells + 1)
    low = minimum_filter(np.where(known, truth, np.inf), 2 * cells + 1)
    return np.asarray(known & (high - low > _DROP))


def summary(maps: list[JudgedMap]) -> dict[str, float]:
    """Return RMSE, bias, 95th percentile [m] and coverage of all maps, and how many there are.

    Figures are NaN where no cell was seen.
    """
    error = np.concatenate([each.error for each in maps])
    in_view = sum(int(np.count_nonzero(each.in_view)) for each in maps)
    covered = sum(int(np.count_nonzero(each.in_view & np.isfinite(each.height))) for each in maps)
    return {
        "maps": len(maps),
        "rmse_m": float(np.sqrt(np.mean(error**2))) if error.size else math.nan,
        "bias_m": float(np.mean(error)) if error.size else math.nan,
        "error_p95_m": float(np.quantile(np.abs(error), 0.95)) if error.size else math.nan,
        "coverage": covered / in_view if in_view else math.nan,
    }


def gap_edges(last: JudgedMap, half_width: float = 0.4) -> tuple[float, float]:
    """Return where level ground ends before a gap and begins behind it, x in world [m].

    Each row of cells along x tells one place of each edge; the medians count.

    Args:
        last: map with a gap ahead, in ground of height 0.
        half_width: of the strip around y = 0 whose rows count [m].
    """
    level = np.abs(last.height) < _LEVEL
    resolution = last.map.lattice.resolution
    near_edges, far_edges = [], []
    for j in range(level.shape[1]):
        if abs(float(np.mean(last.y[:, j]))) > half_width:
            continue
        places = last.x[level[:, j], j]
        places = places[np.abs(places - last.x.mean()) < RADIUS]
        if len(places) < 2:
            continue
        jumps = np.diff(places)
        widest = int(np.argmax(jumps))
        if jumps[widest] < _LEAST_GAP:
            continue
        near_edges.append(places[widest] + 0.5 * resolution)
        far_edges.append(places[widest + 1] - 0.5 * resolution)
    if not near_edges:
        return math.nan, math.nan
    return float(np.median(near_edges)), float(np.median(far_edges))
