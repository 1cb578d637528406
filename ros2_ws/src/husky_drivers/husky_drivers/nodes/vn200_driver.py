"""Lifecycle node `vn200_driver`: the VN-200 on its serial line to `/imu/data`."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from sensor_msgs.msg import Imu

from husky_description.rotation import swap_body, swap_world_and_body
from husky_drivers.nodes.clock_parameters import declare_clock
from husky_drivers.nodes.sample_publisher import SamplePublisher
from husky_drivers.vn200.commissioning import IDENTITY
from husky_drivers.vn200.imu import ImuFigures, Values
from husky_drivers.vn200.link import Vn200Link
from husky_drivers.vn200.session import SessionConfig, SessionState, Vn200Session
from husky_runtime import graph
from husky_runtime.nodes import diagnostics
from husky_runtime.nodes.device_node import DeviceNode
from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.patched_message import PatchedMessage
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.nodes.run import run

_ROTATION = "nine numbers of a rotation matrix"
_GARBAGE_SHARE = 0.01
"""Share of bytes of no packet and no line above which somebody else's output is on the line."""


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
        simulated = self._device_clock.simulated
        silence = 10.0 if simulated else 0.25
        what = (
            "wall time that a stale device may answer nothing before the port is reopened and its "
            "baud rate looked for [s]"
        )
        frame = (
            "reference frame rotation that register 26 of the device must hold, row by row: from "
            "the device's axes into forward, right, down of imu_link"
        )
        self._config = SessionConfig(
            frame_rotation=tuple(
                declare(self, "frame_rotation", list(IDENTITY), frame, constraints=_ROTATION)
            ),
            baud=declare(self, "baud", 921600, "rate to run the line at [baud]", 9600, 921600),
            rate=declare(self, "rate", 800, "packet rate, a divisor of 800 [Hz]", 1, 800),
            stale_after=stale,
            silence_timeout=declare(self, "silence_timeout", silence, what, 0.001, 60.0),
        )
        self._message = imu_message(ImuFigures.of(declare_robot(self).imu))
        self._samples = SamplePublisher(self, Imu, graph.IMU, simulated=simulated)
        self._last_report = _Counts()
        self._diagnostics = diagnostics.Diagnostics(self, "VN-200", self._report)
        self.autostart()

    def make_link(self) -> Vn200Link:
        """Return a link to the port."""
        self._last_report = _Counts()
        publish, world_time = self._publish, self.world_time
        return Vn200Link(
            self._port, self._config, publish, self.say, world_time, longest_look(self)
        )

    # In the link's thread -----------------------------------------------------------------------
    def _publish(self, values: Values, host_ns: int) -> None:
        """Publish one sample in ROS axes."""
        device_ns, x, y, z, w, p, q, r, a, b, c = values
        sample = self._message.encode_at(
            self._device_clock.stamp(int(device_ns), host_ns),
            swap_world_and_body((x, y, z, w)),
            swap_body((p, q, r)),
            swap_body((a, b, c)),
        )
        self._samples.publish(sample)

    # Report -------------------------------------------------------------------------------------
    def _report(self) -> diagnostics.Report:
        """Return level, message and values for `/diagnostics`."""
        link = self._link
        if link is None:
            return diagnostics.WARN, "not active", {"port": self._port}
        session = link.session
        stream, samples = session.parser.counters, session.samples.counters
        last, now = self._last_report, _Counts.of(session)
        self._last_report = now
        period = max(now.time - last.time, 1e-3)
        garbage = now.garbage - last.garbage
        values: Mapping[str, object] = {
            "state": link.state,
            "port": link.path,
            "model": session.setup.model,
            "baud": session.baud,
            "rate": f"{(now.good - last.good) / period:.1f}",
            "samples": samples.good,
            "missed": samples.missed,
            "repeated": samples.repeated,
            "invalid": samples.invalid,
            "clock_restarts": samples.clock_restarts,
            "crc_errors": stream.crc_errors,
            "checksum_errors": stream.checksum_errors,
            "truncated": stream.truncated,
            "garbage_bytes": stream.garbage_bytes,
            "garbage_rate": f"{garbage / period:.0f}",
            "gravity_error_deg": f"{math.degrees(session.gravity.angle):.1f}",
            "changed": "; ".join(session.setup.changes.values()),
            "connections": link.connections,
            "reconnects": max(0, link.connections - 1),
            "times_stale": session.times_stale,
            "device_errors": session.device_errors,
            "problem": link.error or session.problem,
        }
        if not link.connected:
            return diagnostics.ERROR, f"{link.state}: {link.error}", values
        if session.told_state is not SessionState.STREAMING:
            if session.setup.refusal:
                return diagnostics.ERROR, f"{link.state}: {session.problem}", values
            why = f": {session.problem}" if session.problem else ""
            return diagnostics.WARN, link.state + why, values
        if now.damaged > last.damaged:
            return diagnostics.WARN, f"{now.damaged - last.damaged} messages damaged", values
        if last.streaming and garbage > _GARBAGE_SHARE * (now.bytes - last.bytes):
            return diagnostics.WARN, f"{garbage / period:.0f} bytes/s are no packet of ours", values
        if session.gravity.disagrees:
            turned = f"attitude and gravity differ by {math.degrees(session.gravity.angle):.0f} deg"
            return diagnostics.WARN, f"{turned}: a tare? Power the device off and on", values
        return diagnostics.OK, link.state, values


@dataclass(frozen=True)
class _Counts:
    """Counts that a report compares with those of the one before.

    Attributes:
        time: monotonic time [s].
        good, damaged: samples, and messages that are none.
        bytes, garbage: arrived, and those of no message.
        streaming: samples came: before, bytes of another baud rate or output are expected.
    """

    time: float = field(default_factory=time.monotonic)
    good: int = 0
    damaged: int = 0
    bytes: int = 0
    garbage: int = 0
    streaming: bool = False

    @staticmethod
    def of(session: Vn200Session) -> _Counts:
        """Return those of now."""
        stream, samples = session.parser.counters, session.samples.counters
        return _Counts(
            good=samples.good,
            damaged=stream.crc_errors + stream.checksum_errors + stream.truncated + samples.invalid,
            bytes=stream.bytes,
            garbage=stream.garbage_bytes,
            streaming=session.told_state is SessionState.STREAMING,
        )


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
