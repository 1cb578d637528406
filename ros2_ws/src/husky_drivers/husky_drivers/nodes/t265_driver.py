"""Lifecycle node `t265_driver`: poses of the tracking camera to `/t265/odom`."""

from __future__ import annotations

import sys
import time

from nav_msgs.msg import Odometry
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from husky_description import graph
from husky_description.nodes import diagnostics, qos
from husky_description.nodes.device_node import DeviceNode
from husky_description.nodes.parameters import declare
from husky_description.nodes.run import run
from husky_drivers.nodes.clock_parameters import declare_clock
from husky_drivers.nodes.odometry_encoder import OdometryEncoder
from husky_drivers.t265_backend import BACKENDS, BackendError, T265Backend, make_backend
from husky_drivers.t265_frames import Confidence, PoseFrame, covariance, odometry
from husky_drivers.t265_gate import JumpLimits
from husky_drivers.t265_link import LinkConfig, State, T265Link
from husky_drivers.vn200_clock import HostClock


class T265Driver(DeviceNode[T265Link]):
    """Publishes each pose as soon as it has come.

    The backend is chosen when the node is configured, and that fails when it cannot work here. The
    device belongs to the active state. One that is not there yet is no failure: it is waited for.
    """

    def __init__(self) -> None:
        super().__init__(graph.T265_DRIVER)
        self._backend_name = declare(
            self,
            "backend",
            "sim",
            "where poses come from: the simulated device on a serial line, or the camera on USB",
            allowed=BACKENDS,
        )
        default_port = graph.serial_port("t265", self.context.get_domain_id())
        self._port = declare(self, "port", default_port, "of backend sim: its serial port")
        self._serial_number = declare(
            self, "serial_number", "", "of backend realsense: which camera, empty for any"
        )
        topic = declare(
            self,
            "topic",
            graph.T265_ODOMETRY,
            "where the poses go; Intel's wrapper called it /camera/odom/sample",
        )
        self._odom_frame = declare(
            self,
            "odom_frame",
            "t265_odom",
            "frame of the poses: t265_link at the camera's start, levelled; z up",
        )
        self._device_clock = declare_clock(self, "pose")
        linear = declare(
            self,
            "linear_accel_cov",
            0.01,
            "variance of position and linear velocity is this times 10^(3 - confidence) [m^2]",
            lower=0.0,
            upper=1e3,
        )
        angular = declare(
            self,
            "angular_velocity_cov",
            0.01,
            "variance of attitude and angular velocity is this times 10^(1 - confidence) [rad^2]",
            lower=0.0,
            upper=1e3,
        )
        self._config = LinkConfig(
            stale_after=declare(
                self,
                "stale_after",
                0.1,
                "wall time without a new frame after which the stream counts as frozen [s]",
                lower=0.01,
                upper=60.0,
            ),
            # A simulation that pauses is no dead device.
            silence_timeout=declare(
                self,
                "silence_timeout",
                1.0 if isinstance(self._device_clock, HostClock) else 10.0,
                "wall time without a new frame after which the device is closed and opened again "
                "[s]",
                lower=0.1,
                upper=60.0,
            ),
            limits=JumpLimits(
                distance=declare(
                    self,
                    "jump_limit",
                    JumpLimits().distance,
                    "a position this far from where the last velocity leads is a jump [m]",
                    lower=0.001,
                    upper=10.0,
                )
            ),
        )
        self._encoders = [
            OdometryEncoder(_message(self._odom_frame, confidence, linear, angular))
            for confidence in Confidence
        ]
        self._publisher = self.create_lifecycle_publisher(Odometry, topic, qos.CONTROL)
        self._backend: T265Backend | None = None
        self._problem = ""
        self._last_report = (time.monotonic(), 0, 0)
        self._diagnostics = diagnostics.Diagnostics(self, "T265", self._report)
        self.autostart()

    # Lifecycle ----------------------------------------------------------------------------------
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the backend; fails, and says why, when it cannot work on this machine."""
        try:
            self._backend = make_backend(self._backend_name, self._port, self._serial_number)
        except BackendError as error:
            self._problem = f"backend {self._backend_name}: {error}"
            self.get_logger().error(self._problem)
            return TransitionCallbackReturn.FAILURE
        self._problem = ""
        return super().on_configure(state)

    def make_link(self) -> T265Link:
        """Return a link to the backend."""
        assert self._backend is not None
        self._last_report = (time.monotonic(), 0, 0)
        return T265Link(self._backend, self._config, self._publish, self._log_event)

    # In the link's thread -----------------------------------------------------------------------
    def _publish(self, frame: PoseFrame, host_ns: int) -> None:
        """Publish one frame in ROS axes."""
        stamp = self._device_clock.stamp(frame.time_ns, host_ns)
        encoder = self._encoders[frame.tracker_confidence]
        self._publisher.publish(encoder.encode(stamp, *odometry(frame)))

    def _log_event(self, text: str) -> None:
        self.get_logger().info(text)

    # Report -------------------------------------------------------------------------------------
    def _report(self) -> diagnostics.Report:
        """Return level, message and values for `/diagnostics`."""
        link = self._link
        if link is None:
            level = diagnostics.ERROR if self._problem else diagnostics.WARN
            values: dict[str, object] = {"backend": self._backend_name, "problem": self._problem}
            return level, self._problem or "not active", values
        gate, state = link.gate, link.state
        now = time.monotonic()
        last, last_good, last_jumps = self._last_report
        self._last_report = (now, gate.counters.good, gate.counters.jumps)
        values = {
            "state": state.value,
            "backend": self._backend_name,
            "device": link.backend.path,
            "rate": f"{(gate.counters.good - last_good) / max(now - last, 1e-3):.1f}",
            "tracker_confidence": gate.confidence,
            **vars(gate.counters),
            "last_jump": f"{gate.last_jump:.3f}",
            "times_frozen": link.times_frozen,
            **link.backend.counters(),
            "connections": link.connections,
            "reconnects": max(0, link.connections - 1),
            "problem": link.error,
        }
        if state in (State.STOPPED, State.NO_DEVICE):
            return diagnostics.ERROR, f"{state.value}: {link.error}", values
        if state is State.LOST:
            return diagnostics.ERROR, state.value, values
        jumps = gate.counters.jumps - last_jumps
        if jumps:
            return diagnostics.WARN, f"{jumps} jumps, last {gate.last_jump:.2f}", values
        level = diagnostics.OK if state is State.TRACKING else diagnostics.WARN
        return level, state.value, values


def _message(odom_frame: str, confidence: int, linear: float, angular: float) -> Odometry:
    """Return a message in which only stamp, pose and twist are missing."""
    message = Odometry()
    message.header.frame_id = odom_frame
    message.child_frame_id = graph.FRAME_T265
    message.pose.covariance = covariance(confidence, linear, angular)
    message.twist.covariance = covariance(confidence, linear, angular)
    return message


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(T265Driver)


if __name__ == "__main__":
    sys.exit(main())
