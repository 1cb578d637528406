"""Lifecycle node `vn200_driver`: the VN-200 on its serial line to `/imu/data`."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping

from sensor_msgs.msg import Imu

from husky_description.rotation import swap_body, swap_world_and_body
from husky_drivers.nodes.clock_parameters import declare_clock
from husky_drivers.vn200.clock import HostClock
from husky_drivers.vn200.imu import ImuFigures, Values
from husky_drivers.vn200.link import Vn200Link
from husky_drivers.vn200.session import SessionConfig, SessionState
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos
from husky_runtime.nodes.device_node import DeviceNode
from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.patched_message import PatchedMessage
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.nodes.run import run


class Vn200Driver(DeviceNode[Vn200Link]):
    """Publishes each sample of the IMU as soon as its last byte has come.

    The port belongs to the active state: it is opened on activation and given back on
    deactivation. A port that is not there yet is no failure: it is waited for.
    """

    def __init__(self) -> None:
        """Declare parameters and make the publisher; the port is opened on activation."""
        super().__init__(graph.VN200_DRIVER)
        default_port = default_serial_port(self, "vn200")
        self._port = declare(self, "port", default_port, "serial port of the VN-200")
        self._device_clock = declare_clock(self, "sample")
        what = "wall time without a sample after which the line counts as stale [s]"
        stale = declare(self, "stale_after", 0.05, what, 0.001, 60.0)
        # A simulation that pauses is no dead device.
        silence = 0.25 if isinstance(self._device_clock, HostClock) else 10.0
        what = (
            "wall time that a stale device may answer nothing before the port is reopened and its "
            "baud rate looked for [s]"
        )
        self._config = SessionConfig(
            baud=declare(self, "baud", 921600, "rate to run the line at [baud]", 9600, 921600),
            rate=declare(self, "rate", 800, "packet rate, a divisor of 800 [Hz]", 1, 800),
            stale_after=stale,
            silence_timeout=declare(self, "silence_timeout", silence, what, 0.001, 60.0),
        )
        self._message = imu_message(ImuFigures.of(declare_robot(self).imu))
        self._publisher = self.create_lifecycle_publisher(Imu, graph.IMU, qos.CONTROL_OFFERED)
        self._last_report = (time.monotonic(), 0, 0)
        self._diagnostics = diagnostics.Diagnostics(self, "VN-200", self._report)
        self.autostart()

    def make_link(self) -> Vn200Link:
        """Return a link to the port."""
        self._last_report = (time.monotonic(), 0, 0)
        publish, world_time = self._publish, self.world_time
        return Vn200Link(
            self._port, self._config, publish, self.say, world_time, longest_look(self)
        )

    # In the link's thread -----------------------------------------------------------------------
    def _publish(self, values: Values, host_ns: int) -> None:
        """Publish one sample in ROS axes."""
        device_ns, x, y, z, w, p, q, r, a, b, c = values
        self._publisher.publish(
            self._message.encode_at(
                self._device_clock.stamp(int(device_ns), host_ns),
                swap_world_and_body((x, y, z, w)),
                swap_body((p, q, r)),
                swap_body((a, b, c)),
            )
        )

    # Report -------------------------------------------------------------------------------------
    def _report(self) -> diagnostics.Report:
        """Return level, message and values for `/diagnostics`."""
        link = self._link
        if link is None:
            return diagnostics.WARN, "not active", {"port": self._port}
        session = link.session
        stream, samples = session.parser.counters, session.samples.counters
        damaged = stream.crc_errors + stream.checksum_errors + stream.truncated + samples.invalid
        now = time.monotonic()
        last, last_good, last_damaged = self._last_report
        self._last_report = (now, samples.good, damaged)
        values: Mapping[str, object] = {
            "state": link.state,
            "port": link.path,
            "model": session.model,
            "baud": session.baud,
            "rate": f"{(samples.good - last_good) / max(now - last, 1e-3):.1f}",
            "samples": samples.good,
            "missed": samples.missed,
            "repeated": samples.repeated,
            "invalid": samples.invalid,
            "clock_restarts": samples.clock_restarts,
            "crc_errors": stream.crc_errors,
            "checksum_errors": stream.checksum_errors,
            "truncated": stream.truncated,
            "garbage_bytes": stream.garbage_bytes,
            "connections": link.connections,
            "reconnects": max(0, link.connections - 1),
            "times_stale": session.times_stale,
            "device_errors": session.device_errors,
            "problem": link.error or session.problem,
        }
        if not link.connected:
            return diagnostics.ERROR, f"{link.state}: {link.error}", values
        if session.told_state is not SessionState.STREAMING:
            return diagnostics.WARN, link.state, values
        if damaged > last_damaged:
            return diagnostics.WARN, f"{damaged - last_damaged} messages damaged", values
        return diagnostics.OK, link.state, values


def imu_message(figures: ImuFigures) -> PatchedMessage:
    """Return a message of stamp, orientation, angular velocity and specific force."""
    message = Imu()
    message.header.frame_id = graph.FRAME_IMU
    for covariance, variances in (
        (message.orientation_covariance, figures.orientation_variance),
        (message.angular_velocity_covariance, [figures.angular_velocity_variance] * 3),
        (message.linear_acceleration_covariance, [figures.linear_acceleration_variance] * 3),
    ):
        covariance[0], covariance[4], covariance[8] = variances
    return PatchedMessage(
        message,
        (
            message.header.stamp,
            message.orientation,
            message.angular_velocity,
            message.linear_acceleration,
        ),
    )


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(Vn200Driver)


if __name__ == "__main__":
    sys.exit(main())
