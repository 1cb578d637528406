"""Lifecycle node `d435_driver`: images of the depth camera, as realsense-ros publishes them."""

from __future__ import annotations

import array
import sys

from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from husky_description.link_frames import transform_of
from husky_drivers.camera_link import CameraState
from husky_drivers.d435.choice import BACKENDS, make_backend
from husky_drivers.d435.frames import OPTICAL_ROTATION, Deprojection, DepthFrame, Intrinsics
from husky_drivers.d435.gate import LEAST_VALID
from husky_drivers.d435.link import D435Backend, D435Link, DepthLinkConfig
from husky_drivers.d435.realsense import GREATEST_DECIMATION, DepthStream
from husky_drivers.nodes.camera_node import CameraNode
from husky_drivers.nodes.clock_parameters import declare_clock
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.patched_message import PatchedMessage
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.nodes.run import run
from husky_runtime.nodes.transforms import declare_transforms, tell_fixed

_POINT_SIZE = 12
"""Bytes of a point: x, y, z as float32."""


class D435Driver(CameraNode[D435Link]):
    """Publishes each depth image and its pinhole as soon as they have come."""

    def __init__(self) -> None:
        """Declare parameters and make the publishers; the device is opened on activation."""
        super().__init__(graph.D435_DRIVER)
        what = "where images come from: the simulated device on a socket, or the camera on USB"
        self._backend_name = declare(self, "backend", "sim", what, allowed=BACKENDS)
        default_port = default_serial_port(self, "d435")
        self._port = declare(self, "port", default_port, "of backend sim: path of its socket")
        what = "of backend realsense: which camera, empty for any"
        self._serial_number = declare(self, "serial_number", "", what)
        self._stream = self._declare_stream()
        self._device_clock = declare_clock(self, "image")
        self._config = self._declare_link()
        what = f"offer the points of each image on {graph.absolute(graph.DEPTH_POINTS)}"
        self._with_points = declare(self, "pointcloud.enable", False, what)
        self._images = self.create_lifecycle_publisher(Image, graph.DEPTH_IMAGE, qos.STATUS)
        self._infos = self.create_lifecycle_publisher(
            CameraInfo, graph.DEPTH_CAMERA_INFO, qos.STATUS
        )
        self._points = self.create_lifecycle_publisher(PointCloud2, graph.DEPTH_POINTS, qos.STATUS)
        self._pinhole: _Pinhole | None = None
        camera = declare_robot(self).d435
        if declare_transforms(self, "the camera"):
            mounting = transform_of(camera.position.tolist(), camera.rpy.tolist())
            edges = [
                (graph.FRAME_BASE, graph.FRAME_CAMERA),
                (graph.FRAME_CAMERA, graph.FRAME_CAMERA_DEPTH),
                (graph.FRAME_CAMERA_DEPTH, graph.FRAME_CAMERA_OPTICAL),
            ]
            nowhere = (0.0, 0.0, 0.0)
            same = (*nowhere, 0.0, 0.0, 0.0, 1.0)
            tell_fixed(self, edges, [mounting, same, (*nowhere, *OPTICAL_ROTATION)])
        self._backend: D435Backend | None = None
        self._diagnostics = diagnostics.Diagnostics(self, "D435", self.report)
        self.autostart()

    def _declare_stream(self) -> DepthStream:
        """Declare the real camera's stream; raises ValueError for a bad profile."""
        default = DepthStream()
        what = "of backend realsense: size and rate of the camera's images, WIDTHxHEIGHTxFPS"
        profile = declare(self, "profile", default.profile, what)
        what = "of backend realsense: pixels that become one, in each direction"
        decimation = declare(self, "decimation", default.decimation, what, 1, GREATEST_DECIMATION)
        return DepthStream.of_profile(profile, decimation)

    def _declare_link(self) -> DepthLinkConfig:
        """Declare when a stream is frozen, dead or covered."""
        what = "time without a new image after which the stream counts as frozen [s]"
        stale = declare(self, "stale_after", 0.5, what, 0.01, 60.0)
        silence = 10.0 if self._device_clock.simulated else 5.0
        what = "time without a new image after which the device is closed and opened again [s]"
        silence = declare(self, "silence_timeout", silence, what, 0.1, 60.0)
        what = "share of pixels with depth below which the camera counts as covered [-]"
        least = declare(self, "least_valid", LEAST_VALID, what, 0.0, 1.0)
        return DepthLinkConfig(stale, silence, least)

    # As CameraNode asks -------------------------------------------------------------------------
    def choose_backend(self) -> None:
        """Make the backend; raises BackendError."""
        self._backend = make_backend(
            self._backend_name, self._port, self._serial_number, self._stream
        )

    def make_camera_link(self) -> D435Link:
        """Return a link to the backend."""
        assert self._backend is not None
        return D435Link(self._backend, self._config, self._publish, self.say, self.world_time)

    def measured(self, link: D435Link) -> dict[str, object]:
        """Return the share of pixels with depth."""
        return {"valid": f"{link.gate.valid:.3f}"}

    def judge(self, link: D435Link) -> tuple[bytes, str]:
        """Return level and message for a camera that is there."""
        if link.state is CameraState.STUCK:
            return diagnostics.ERROR, link.state.value
        streaming = link.state is CameraState.STREAMING
        return diagnostics.OK if streaming else diagnostics.WARN, link.state.value

    # In the link's thread -----------------------------------------------------------------------
    def _publish(self, frame: DepthFrame, host_ns: int) -> None:
        """Publish one image and its pinhole; its points, too, if they are wanted."""
        stamp = self._device_clock.stamp(frame.time_ns, host_ns)
        pinhole = self._pinhole
        if pinhole is None or pinhole.deprojection.intrinsics != frame.intrinsics:
            pinhole = self._pinhole = _Pinhole(frame.intrinsics)
        image = image_message(frame)
        stamps.fill(image.header.stamp, stamp)
        self._infos.publish(pinhole.info.encode_at(stamp))
        self._images.publish(image)
        if self._with_points and self._points.get_subscription_count() > 0:
            cloud = points_message(frame, pinhole.deprojection)
            cloud.header = image.header
            self._points.publish(cloud)


class _Pinhole:
    """Messages of a pinhole, made once: the intrinsics of a camera hardly ever change.

    Attributes:
        info: message of a stamp.
        deprojection: takes images to points.
    """

    def __init__(self, intrinsics: Intrinsics):
        message = camera_info_message(intrinsics)
        self.info = PatchedMessage(message, [message.header.stamp])
        self.deprojection = Deprojection(intrinsics)


def image_message(frame: DepthFrame) -> Image:
    """Return a depth image in millimetres, without its stamp."""
    depth = frame.millimetres()
    message = Image(
        height=depth.shape[0],
        width=depth.shape[1],
        encoding="16UC1",
        is_bigendian=0,
        step=2 * depth.shape[1],
    )
    message.header.frame_id = graph.FRAME_CAMERA_OPTICAL
    message.data = array.array("B", depth.astype("<u2", copy=False).tobytes())
    return message


def camera_info_message(intrinsics: Intrinsics) -> CameraInfo:
    """Return the pinhole of depth images, without its stamp."""
    message = CameraInfo(
        height=intrinsics.height,
        width=intrinsics.width,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=intrinsics.camera_matrix,
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=intrinsics.projection_matrix,
    )
    message.header.frame_id = graph.FRAME_CAMERA_OPTICAL
    return message


def points_message(frame: DepthFrame, deprojection: Deprojection) -> PointCloud2:
    """Return the points of the pixels that have depth, in optical axes, without header."""
    points = deprojection.points(frame)
    message = PointCloud2(
        height=1,
        width=len(points),
        is_bigendian=False,
        point_step=_POINT_SIZE,
        row_step=_POINT_SIZE * len(points),
        is_dense=True,
    )
    message.fields = [
        PointField(name=name, offset=4 * place, datatype=PointField.FLOAT32, count=1)
        for place, name in enumerate("xyz")
    ]
    message.data = array.array("B", points.astype("<f4", copy=False).tobytes())
    return message


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(D435Driver)


if __name__ == "__main__":
    sys.exit(main())
