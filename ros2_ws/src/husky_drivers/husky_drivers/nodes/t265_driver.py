"""Lifecycle node `t265_driver`: poses of the tracking camera to `/t265/odom`."""

from __future__ import annotations

import sys

from nav_msgs.msg import Odometry

from husky_description.link_frames import transform_of
from husky_drivers.camera_link import CameraState
from husky_drivers.nodes.camera_node import CameraNode
from husky_drivers.nodes.clock_parameters import declare_clock
from husky_drivers.nodes.sample_publisher import SamplePublisher
from husky_drivers.t265.choice import BACKENDS, make_backend
from husky_drivers.t265.frames import Confidence, PoseFrame, covariance, odometry
from husky_drivers.t265.gate import JumpLimits
from husky_drivers.t265.link import LinkConfig, T265Backend, T265Link
from husky_runtime import graph
from husky_runtime.nodes import diagnostics
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.patched_message import PatchedMessage
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.nodes.run import run
from husky_runtime.nodes.transforms import SeenFrom, declare_transforms, tell_fixed


class T265Driver(CameraNode[T265Link]):
    """Publishes each pose as soon as it has come."""

    def __init__(self) -> None:
        """Declare parameters and make the publisher; the device is opened on activation."""
        super().__init__(graph.T265_DRIVER)
        what = "where poses come from: the simulated device on a serial line, or the camera on USB"
        self._backend_name = declare(self, "backend", "sim", what, allowed=BACKENDS)
        default_port = default_serial_port(self, "t265")
        self._port = declare(self, "port", default_port, "of backend sim: its serial port")
        what = "of backend realsense: which camera, empty for any"
        self._serial_number = declare(self, "serial_number", "", what)
        what = "where the poses go; Intel's wrapper called it /camera/odom/sample"
        topic = declare(self, "topic", graph.T265_ODOMETRY, what)
        what = "frame of the poses: t265_link at the camera's start, levelled; z up"
        self._odom_frame = declare(self, "odom_frame", graph.FRAME_T265_ODOM, what)
        self._device_clock = declare_clock(self, "pose")
        self._messages = self._declare_messages()
        self._config = self._declare_link()
        simulated = self._device_clock.simulated
        self._poses = SamplePublisher(self, Odometry, topic, simulated=simulated)
        self._frame: SeenFrom | None = None
        camera = declare_robot(self).t265
        if declare_transforms(self, "the camera and of the frame of its poses"):
            mounting = transform_of(camera.position.tolist(), camera.rpy.tolist())
            tell_fixed(self, [(graph.FRAME_BASE, graph.FRAME_T265)], [mounting])
            self._frame = SeenFrom(self, graph.FRAME_T265, self._odom_frame)
        self._backend: T265Backend | None = None
        self._last_jumps = 0
        self._diagnostics = diagnostics.Diagnostics(self, "T265", self.report)
        self.autostart()

    def _declare_messages(self) -> list[PatchedMessage]:
        """Declare the covariances; return a message for each confidence of the tracker."""
        what = "variance of position and linear velocity is this times 10^(3 - confidence) [m^2]"
        linear = declare(self, "linear_accel_cov", 0.01, what, 0.0, 1e3)
        what = "variance of attitude and angular velocity is this times 10^(1 - confidence) [rad^2]"
        angular = declare(self, "angular_velocity_cov", 0.01, what, 0.0, 1e3)
        return [
            odometry_message(self._odom_frame, confidence, linear, angular)
            for confidence in Confidence
        ]

    def _declare_link(self) -> LinkConfig:
        """Declare when a stream is frozen, dead or jumps."""
        what = "time without a new frame after which the stream counts as frozen [s]"
        stale = declare(self, "stale_after", 0.1, what, 0.01, 60.0)
        silence = 10.0 if self._device_clock.simulated else 1.0
        what = "time without a new frame after which the device is closed and opened again [s]"
        silence = declare(self, "silence_timeout", silence, what, 0.1, 60.0)
        what = "a position this far from where the last velocity leads is a jump [m]"
        jump = declare(self, "jump_limit", JumpLimits().distance, what, 0.001, 10.0)
        return LinkConfig(stale, silence, JumpLimits(distance=jump))

    # As CameraNode asks -------------------------------------------------------------------------
    def choose_backend(self) -> None:
        """Make the backend; raises BackendError."""
        self._backend = make_backend(self._backend_name, self._port, self._serial_number)

    def make_camera_link(self) -> T265Link:
        """Return a link to the backend."""
        assert self._backend is not None
        self._last_jumps = 0
        return T265Link(self._backend, self._config, self._publish, self.say, self.world_time)

    def measured(self, link: T265Link) -> dict[str, object]:
        """Return the tracker's confidence and the last jump."""
        gate = link.gate
        return {"tracker_confidence": gate.confidence, "last_jump": f"{gate.last_jump:.3f}"}

    def judge(self, link: T265Link) -> tuple[bytes, str]:
        """Return level and message for a camera that is there."""
        gate = link.gate
        jumps = gate.counters.jumps - self._last_jumps
        self._last_jumps = gate.counters.jumps
        if link.state is CameraState.LOST:
            return diagnostics.ERROR, link.state.value
        if jumps:
            return diagnostics.WARN, f"{jumps} jumps, last {gate.last_jump:.2f}"
        tracking = link.state is CameraState.TRACKING
        return diagnostics.OK if tracking else diagnostics.WARN, link.state.value

    # In the link's thread -----------------------------------------------------------------------
    def _publish(self, frame: PoseFrame, host_ns: int) -> None:
        """Publish one frame in ROS axes."""
        stamp = self._device_clock.stamp(frame.time_ns, host_ns)
        message = self._messages[frame.tracker_confidence]
        pose, twist = odometry(frame)
        data = message.encode_at(stamp, pose[:3], pose[3:], twist[:3], twist[3:])
        self._poses.publish(data)
        if self._frame is not None:
            self._frame.tell(stamp, pose)


def odometry_message(
    odom_frame: str, confidence: int, linear: float, angular: float
) -> PatchedMessage:
    """Return a message of stamp, position, orientation, linear and angular velocity."""
    message = Odometry()
    message.header.frame_id = odom_frame
    message.child_frame_id = graph.FRAME_T265
    message.pose.covariance = covariance(confidence, linear, angular)
    message.twist.covariance = covariance(confidence, linear, angular)
    pose, twist = message.pose.pose, message.twist.twist
    places = (pose.position, pose.orientation, twist.linear, twist.angular)
    return PatchedMessage(message, (message.header.stamp, *places))


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(T265Driver)


if __name__ == "__main__":
    sys.exit(main())
