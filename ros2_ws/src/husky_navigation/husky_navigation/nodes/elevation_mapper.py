"""Node `elevation_mapper`: a map of the ground around the robot from the depth camera and feet."""

from __future__ import annotations

import contextlib
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from grid_map_msgs.msg import GridMap
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from husky_description.parameters import Bounds, bounds_of
from husky_msgs.msg import ControllerState
from husky_navigation.depth_view import DepthImage, DepthView, PinholeCamera
from husky_navigation.elevation_map import ElevationMap
from husky_navigation.ground_mapper import GroundMapper
from husky_navigation.map_parameters import MapParameters
from husky_navigation.nodes.map_messages import grid_map_message, occupancy_message
from husky_navigation.pose_history import JointHistory
from husky_navigation.surface import surface_of
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.message_guard import Refused
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.run import run
from husky_runtime.nodes.tick_clock import percentile_ms

_TUNABLE = {
    "resolution": "edge of a cell [m]",
    "length": "edge of the map [m], an even number of cells",
    "least_depth": "nearer depths are not used [m]",
    "most_depth": "farther depths are not used [m]",
    "most_slope": "slope that counts as an obstacle [rad]",
    "most_step": "height of a step that counts as an obstacle [m]",
    "most_roughness": "deviation from a plane that counts as an obstacle [m]",
}
"""Fields of `MapParameters` that are parameters of the node."""
_UNKNOWN = 0.5
"""Variance of the velocity on `/odometry` from which on the base is not known [m^2/s^2]: it says 1
of a robot that falls or hangs."""
_SILENT_NS = 1_000_000_000
"""Time without an image that is a fault [ns]."""
_TIMES_KEPT = 1024
"""Images and maps whose times are kept."""


class ElevationMapper(OneClock, Node):
    """Maps the ground; publishes the map once a second of the images' time."""

    def __init__(self) -> None:
        """Declare parameters and let the kernels be compiled, or loaded."""
        super().__init__(graph.ELEVATION_MAPPER)
        robot = declare_robot(self)
        parameters = self._declare_map()
        what = "between two maps, in the images' time [s]"
        self._period_ns = round(1e9 * declare(self, "publish_period", 1.0, what, 0.05, 60.0))
        _warm_up(parameters)
        self._joints = JointHistory()
        self.mapper = GroundMapper(robot, self._joints.at, parameters)
        self.hot: Sequence[Subscription] = []
        self._camera: PinholeCamera | None = None
        self._size = (0, 0)
        self._received_ns = -1
        self._base_known: bool | None = None
        self._published_ns = -1
        self._image_times, self._map_times = _WorkTimes("image"), _WorkTimes("map")
        self._maps = self.create_publisher(GridMap, graph.ELEVATION_MAP, qos.LATCHED)
        self._grids = self.create_publisher(OccupancyGrid, graph.OCCUPANCY, qos.LATCHED)
        self._listen()
        self.create_service(Trigger, graph.CLEAR_MAP, self._on_clear)
        self._diagnostics = diagnostics.Diagnostics(self, "elevation map", self._report)

    def _declare_map(self) -> MapParameters:
        """Declare the map's parameters; raises ValueError for those that contradict each other."""
        default, bounds = MapParameters(), bounds_of(MapParameters)
        values = {}
        for name, what in _TUNABLE.items():
            limits = bounds[name]
            assert isinstance(limits, Bounds)
            values[name] = declare(
                self, name, getattr(default, name), what, limits.lower, limits.upper
            )
        return MapParameters(**values)

    def _listen(self) -> None:
        """Subscribe, in the order in which messages are taken: joints, poses, then images."""
        info = self.create_subscription(
            CameraInfo, graph.DEPTH_CAMERA_INFO, self._on_camera_info, qos.STATUS
        )
        state = self.create_subscription(
            ControllerState, graph.CONTROLLER_STATE, self._on_controller_state, qos.SEQUENCE
        )
        odometry = self.create_subscription(
            Odometry, graph.ODOMETRY, self._on_odometry, qos.SEQUENCE
        )
        self.create_subscription(Image, graph.DEPTH_IMAGE, self._on_image, qos.STATUS)
        self._taken_with_images = info, state, odometry

    @property
    def unawaited(self) -> tuple[Subscription, ...]:
        """Images alone wake the node: what they need has come before them, 110 messages a second.

        An image that has to wait for its pose is looked at 50 ms later.
        """
        return (*super().unawaited, *self._taken_with_images)

    # Measurements -------------------------------------------------------------------------------
    def _on_camera_info(self, info: CameraInfo) -> None:
        k = info.k
        self._camera = PinholeCamera(fx=k[0], fy=k[4], cx=k[2], cy=k[5])
        self._size = info.width, info.height

    def _on_image(self, image: Image) -> None:
        if self._camera is None:
            raise Refused(f"no camera_info on {graph.absolute(graph.DEPTH_CAMERA_INFO)} yet")
        if (image.width, image.height) != self._size:
            size, told = f"{image.width} x {image.height}", "{} x {}".format(*self._size)
            raise Refused(f"image is {size} pixels, camera_info is of {told}")
        try:
            with self._timed_images():
                stamp = stamps.to_ns(image.header.stamp)
                self.mapper.add_image(stamp, _depth_of(image), self._camera)
                self._received_ns = stamp
        except ValueError as error:
            raise Refused(str(error)) from error
        self._publish_if_due()

    def _on_odometry(self, odometry: Odometry) -> None:
        at = odometry.pose.pose
        p, q = at.position, at.orientation
        self._base_known = known = bool(odometry.twist.covariance[0] < _UNKNOWN)
        try:
            with self._timed_images():
                self.mapper.add_pose(
                    stamps.to_ns(odometry.header.stamp),
                    np.array((p.x, p.y, p.z)),
                    np.array((q.x, q.y, q.z, q.w)),
                    known=known,
                )
        except ValueError as error:
            raise Refused(str(error)) from error
        self._publish_if_due()

    def _on_controller_state(self, state: ControllerState) -> None:
        stamp = stamps.to_ns(state.stamp)
        standing = np.array(state.stance) & np.array(state.contact)
        self._joints.add(stamp, np.array(state.joint_positions))
        with self._timed_images():
            self.mapper.add_contacts(stamp, standing)

    def _on_clear(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.mapper.clear()
        self._publish_if_due()
        response.success, response.message = True, "the map is empty"
        return response

    # The map ------------------------------------------------------------------------------------
    @contextlib.contextmanager
    def _timed_images(self) -> Iterator[None]:
        """Time a measurement with which an image goes into the map; leave others out."""
        before, begun = self.mapper.counts["images"], _now()
        yield
        if self.mapper.counts["images"] > before:
            self._image_times.add(begun)

    def _publish_if_due(self) -> None:
        """Publish the map if it is time, after images may have gone into it."""
        stamp = self.mapper.image_time
        if stamp < 0:
            if self._published_ns >= 0:
                self._publish(max(0, self.mapper.pose_time))  # an empty map
            self._published_ns = -1
            return
        if 0 <= self._published_ns <= stamp < self._published_ns + self._period_ns:
            return
        self._published_ns = stamp
        self._publish(stamp)

    def _publish(self, stamp: int) -> None:
        """Publish the map with a stamp [ns]."""
        begun = _now()
        ground = self.mapper.map
        surface = surface_of(ground.elevation, ground.parameters)
        self._maps.publish(grid_map_message(ground, surface, stamp))
        self._grids.publish(occupancy_message(ground, surface, stamp))
        self._map_times.add(begun)

    def _report(self) -> diagnostics.Report:
        mapper = self.mapper
        values: dict[str, object] = {
            **{name: mapper.counts[name] for name in _COUNTED},
            **self._image_times.percentiles(),
            **self._map_times.percentiles(),
        }
        if mapper.last is not None:
            values |= {
                "known_cells": int(np.count_nonzero(~np.isnan(mapper.map.elevation))),
                **mapper.last.pixels._asdict(),
                "contradicted": mapper.last.contradicted,
                "removed": mapper.last.removed,
                "correction": f"{mapper.last.correction:.4f}",
                "lift": f"{mapper.last.lift:.4f}",
            }
        return (*self._judge(), values)

    def _judge(self) -> tuple[bytes, str]:
        """Return level and message."""
        mapper = self.mapper
        if self._base_known is None:
            return diagnostics.WARN, "waiting for odometry"
        if not self._base_known:
            return diagnostics.WARN, "the base's velocity is not known: the robot does not stand"
        if self._camera is None:
            return diagnostics.WARN, "waiting for camera_info"
        if self._received_ns < 0:
            return diagnostics.WARN, "waiting for depth images"
        silent = mapper.pose_time - self._received_ns
        if silent > _SILENT_NS:
            return diagnostics.WARN, f"no depth image for {silent / 1e9:.1f} s: the map is old"
        if silent < -_SILENT_NS:
            return diagnostics.WARN, f"no odometry for {-silent / 1e9:.1f} s: the map is old"
        if self._received_ns - mapper.image_time > _SILENT_NS:
            return diagnostics.WARN, "images have no pose or joints: the map is old"
        if mapper.last is not None and not mapper.last.believed:
            return diagnostics.WARN, "the image contradicts the map"
        return diagnostics.OK, "mapping"

    def quiet(self) -> None:
        """Nothing to do: messages wake the node."""

    def close(self) -> None:
        """Nothing to do: the node moves nothing."""


_COUNTED = (
    "images",
    "footholds",
    "restarts",
    "repeated",
    "without_pose",
    "without_joints",
    "lost_footholds",
)
"""Counters of `GroundMapper`, as they are reported."""


class _WorkTime(NamedTuple):
    """Wall time and processor time of this thread [s], both since some instant."""

    wall: float
    processor: float


def _now() -> _WorkTime:
    return _WorkTime(time.perf_counter(), time.thread_time())


class _WorkTimes:
    """Wall time and processor time of the newest pieces of work of one kind.

    Wall time has in it the time for which other processes had the processor; processor time is
    what the work takes on a core of its own.
    """

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._kept: deque[_WorkTime] = deque(maxlen=_TIMES_KEPT)

    def add(self, begun: _WorkTime) -> None:
        """Add work that began at a time and has just been done."""
        now = _now()
        self._kept.append(_WorkTime(now.wall - begun.wall, now.processor - begun.processor))

    def percentiles(self) -> dict[str, str]:
        """Return median and 99th percentile as they are reported [ms], nothing before any work."""
        if not self._kept:
            return {}
        wall, processor = np.array(self._kept).T
        return {
            f"{self._kind}_{name}_p{percent}": f"{percentile_ms(times, percent):.2f}"
            for name, times in (("ms", wall), ("cpu_ms", processor))
            for percent in (50, 99)
        }


def _depth_of(image: Image) -> DepthImage:
    """Return the depth of an image [mm]; raises Refused for one that has none."""
    if image.encoding != "16UC1":
        raise Refused(f"encoding is {image.encoding[:40]!r}, it must be '16UC1'")
    if image.header.frame_id != graph.FRAME_CAMERA_OPTICAL:
        allowed = graph.FRAME_CAMERA_OPTICAL
        raise Refused(f"frame_id is {image.header.frame_id[:40]!r}, it must be {allowed!r}")
    if image.step != 2 * image.width or len(image.data) != image.step * image.height:
        raise Refused(
            f"{len(image.data)} bytes in rows of {image.step} are no image of "
            f"{image.width} x {image.height} pixels of 2 bytes"
        )
    kind = ">u2" if image.is_bigendian else "<u2"
    depth = np.frombuffer(image.data, kind).reshape(image.height, image.width)
    return depth.astype(np.uint16, copy=False)


def _warm_up(parameters: MapParameters) -> None:
    """Compile the kernels, or load them, before the first image waits for them."""
    blank, ground = np.zeros((120, 160), np.uint16), ElevationMap(parameters)
    pinhole = PinholeCamera(100.0, 100.0, 79.5, 59.5)
    ground.integrate(DepthView(blank, pinhole, np.eye(3), np.zeros(3), 0.0))
    surface_of(ground.elevation, parameters)


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(ElevationMapper)


if __name__ == "__main__":
    sys.exit(main())
