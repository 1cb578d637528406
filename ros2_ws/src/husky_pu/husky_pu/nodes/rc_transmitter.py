"""Node `rc_transmitter`: a joystick as the pilot's radio, SBUS frames on a serial line."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Joy

from husky_description import graph
from husky_description.nodes import diagnostics, qos, stamps
from husky_description.nodes.parameters import declare
from husky_description.nodes.run import run
from husky_pu.rc_mapping import FrameSchedule, JoyLayout, JoyQueue, RcMapping
from husky_pu.sbus import encode
from husky_pu.sbus_line import SbusLine


class RcTransmitter(Node):
    """Sends a frame each 7 or 14 ms, of simulated time when there is a simulation.

    A lost joystick shows as the failsafe flag with the throttle low, a lost line in the
    diagnostics; neither ends the node.
    """

    def __init__(self) -> None:
        """Declare parameters, subscribe, start to send."""
        super().__init__(graph.RC_TRANSMITTER)
        source = declare(
            self,
            "time",
            "lockstep",
            "what times the frames: lockstep, realtime: /clock; hardware: this machine's clock. In "
            "lockstep those due until the next message of /clock go out at once",
            allowed=("lockstep", "realtime", "hardware"),
        )
        default_port = graph.serial_port("sbus", self.context.get_domain_id())
        port = declare(self, "port", default_port, "serial port of the receiver's output, 8E2")
        period = declare(
            self, "period", 0.014, "between frames: 0.007 or 0.014 [s]", lower=0.007, upper=0.014
        )
        if round(1e3 * period, 6) not in (7.0, 14.0):
            raise ValueError(f"parameter period is {period} s, it must be 0.007 or 0.014 s")
        layout = JoyLayout()
        places = {
            name: declare(self, f"joy_{name}", getattr(layout, name), what, lower=-1, upper=31)
            for name, what in _PLACES.items()
        }
        self._mapping = RcMapping(
            JoyLayout(**places),
            dead_band=declare(
                self,
                "dead_band",
                0.02,
                "share of a centred stick's travel that is centre [-]",
                lower=0.0,
                upper=0.5,
            ),
            silence=declare(
                self,
                "joy_silence",
                0.5,
                "age at which a joystick message is lost: failsafe [s]",
                lower=0.05,
                upper=5.0,
            ),
            momentary=declare(
                self, "momentary", False, "buttons spring back: each press turns a switch over"
            ),
            upper_half=declare(
                self, "upper_half", False, "the throttle springs back: its centre is no thrust"
            ),
        )
        period_ns = round(1e9 * period)
        clock_period_ns = round(1e9 / graph.topic(graph.CLOCK).rate)
        self._schedule = FrameSchedule(period_ns, clock_period_ns if source == "lockstep" else 0)
        self._period_ns = period_ns
        self._now = 0.0
        self._clock_ns = -1
        self._waiting = JoyQueue() if source == "lockstep" else None
        self._line = SbusLine(port)
        self._reported = (0, 0)
        # Joysticks before the clock: what was sent before a time is here at that time.
        self.hot: Sequence[Subscription] = [
            self.create_subscription(Joy, graph.JOY, self._on_joy, qos.COMMAND)
        ]
        self.hot_timers: list[Timer] = []
        if source == "hardware":
            self.hot_timers.append(self.create_timer(period, self._on_timer))
        else:
            clock = self.create_subscription(Clock, graph.CLOCK, self._on_clock, qos.CLOCK)
            self.hot = [*self.hot, clock]
        self._diagnostics = diagnostics.Diagnostics(self, "SBUS transmitter", self._report)

    def _on_joy(self, joy: Joy) -> None:
        if self._waiting is None:
            self._move(joy.axes, joy.buttons)
        else:
            stamp = 1e-9 * stamps.to_ns(joy.header.stamp)
            self._waiting.push(stamp, joy.axes, joy.buttons, self._now)

    def _move(self, axes: Sequence[float], buttons: Sequence[int]) -> None:
        if not self._mapping.joy(axes, buttons, self._now):
            self.get_logger().warning(
                f"joystick message refused: {self._mapping.refusal}", throttle_duration_sec=1.0
            )

    def _on_clock(self, clock: Clock) -> None:
        now_ns = stamps.to_ns(clock.clock)
        if now_ns == self._clock_ns:
            return  # The time of a world that stands still is told again and again.
        self._clock_ns = now_ns
        frames, back = self._schedule.due(now_ns)
        self._now = 1e-9 * now_ns
        if back:
            self._mapping.restart(self._now)
        if self._waiting is not None:
            if back:
                self._waiting.clear()
            for axes, buttons in self._waiting.due(self._now):
                self._move(axes, buttons)
        for number in frames:
            self._send(max(self._now, 1e-9 * self._period_ns * number))

    def _on_timer(self) -> None:
        self._now = time.monotonic()
        self._send(self._now)

    def _send(self, now: float) -> None:
        self._line.write(encode(self._mapping.frame(now)), time.monotonic())

    def _report(self) -> diagnostics.Report:
        line, mapping = self._line, self._mapping
        last_sent, last_dropped = self._reported
        self._reported = (line.sent, line.dropped)
        lost = mapping.lost(self._now)
        values = {
            "port": line.path,
            "sent": line.sent,
            "dropped": line.dropped,
            "connections": line.connections,
            "failsafe": lost,
            "refused_joy": mapping.refused,
            "refusal": mapping.refusal,
            "problem": line.error,
        }
        if not line.connected:
            return diagnostics.ERROR, f"no line: {line.error}", values
        if line.dropped > last_dropped:
            return diagnostics.WARN, f"{line.dropped - last_dropped} frames dropped", values
        if lost:
            return diagnostics.WARN, "failsafe: no joystick", values
        sends = line.sent > last_sent
        return diagnostics.OK, "sending" if sends else "no frame since the last report", values

    def quiet(self) -> None:
        """Nothing to do: time comes as messages or by the timer."""

    def close(self) -> None:
        """Give the line back."""
        self._line.close()


_PLACES = {
    "throttle": "axis for thrust, down is none",
    "roll": "axis for roll, left is positive",
    "pitch": "axis for pitch, forward (nose down) is positive",
    "yaw": "axis for yaw, left is positive",
    "arm": "button of the arming switch",
    "kill": "button of the kill switch",
    "mode": "button of the mode switch: off STABILIZED, on OFFBOARD",
}
"""Parameters joy_<name>: what is where in sensor_msgs/Joy, -1 for nowhere."""


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(RcTransmitter)


if __name__ == "__main__":
    sys.exit(main())
