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

from husky_pu.radio.rc_mapping import JOY_PLACES, FrameSchedule, JoyLayout, JoyQueue, RcMapping
from husky_pu.radio.sbus import encode
from husky_pu.radio.sbus_line import SbusLine
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.message_guard import refuser
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.nodes.run import run
from husky_runtime.stamp_gate import StampGate, Turn


class RcTransmitter(OneClock, Node):
    """Sends a frame each 7 or 14 ms, of simulated time when there is a simulation.

    A lost joystick shows as the failsafe flag with the throttle low, a lost line in the
    diagnostics; neither ends the node.
    """

    def __init__(self) -> None:
        """Declare parameters, subscribe, start to send."""
        super().__init__(graph.RC_TRANSMITTER)
        what = (
            "what times the frames: lockstep, realtime: /clock; hardware: this machine's clock. In "
            "lockstep those due until the next message of /clock go out at once"
        )
        sources = ("lockstep", "realtime", "hardware")
        source = declare(self, "time", "lockstep", what, allowed=sources)
        default_port = default_serial_port(self, "sbus")
        port = declare(self, "port", default_port, "serial port of the receiver's output, 8E2")
        period = declare(self, "period", 0.014, "between frames: 0.007 or 0.014 [s]", 0.007, 0.014)
        if round(1e3 * period, 6) not in (7.0, 14.0):
            raise ValueError(f"parameter period is {period} s, it must be 0.007 or 0.014 s")
        self._mapping = declare_mapping(self)
        self._period_ns = round(1e9 * period)
        clock_period_ns = round(1e9 / graph.topic(graph.CLOCK).rate)
        lockstep = source == "lockstep"
        self._schedule = FrameSchedule(self._period_ns, clock_period_ns if lockstep else 0)
        self._now = 0.0
        self._gate: StampGate[Clock] = StampGate(
            clock_period_ns, refuser(self, graph.CLOCK), 2 * clock_period_ns
        )
        self._waiting = JoyQueue() if lockstep else None
        self._line = SbusLine(port)
        self._reported = (0, 0)
        # Joysticks before the clock: what was sent before a time is here at that time.
        self.hot: list[Subscription] = [
            self.create_subscription(Joy, graph.JOY, self._on_joy, qos.COMMAND)
        ]
        self.hot_timers: list[Timer] = []
        if source == "hardware":
            self.hot_timers.append(self.create_timer(period, self._on_timer))
        else:
            clock = self.create_subscription(Clock, graph.CLOCK, self._on_clock, qos.CLOCK)
            self.hot.append(clock)
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
        for turn, _ in self._gate.admit(now_ns, clock):
            # A world that stands still tells its time again and again; at 0 none has gone by.
            if turn is not Turn.REPEAT and now_ns > 0:
                self._go_on(now_ns)

    def _go_on(self, now_ns: int) -> None:
        """Send the frames until a time, act on what has been moved until then."""
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


def declare_mapping(node: Node) -> RcMapping:
    """Declare what the joystick's axes and buttons do; return it."""
    layout = JoyLayout()
    places = {
        name: declare(node, f"joy_{name}", getattr(layout, name), what, -1, 31)
        for name, what in JOY_PLACES.items()
    }
    what = "share of a centred stick's travel that is centre [-]"
    dead_band = declare(node, "dead_band", 0.02, what, 0.0, 0.5)
    what = "age at which a joystick message is lost: failsafe [s]"
    silence = declare(node, "joy_silence", 0.5, what, 0.05, 5.0)
    what = "buttons spring back: each press turns a switch over"
    momentary = declare(node, "momentary", False, what)
    what = "the throttle springs back: its centre is no thrust"
    upper_half = declare(node, "upper_half", False, what)
    return RcMapping(
        JoyLayout(**places),
        dead_band=dead_band,
        silence=silence,
        momentary=momentary,
        upper_half=upper_half,
    )


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(RcTransmitter)


if __name__ == "__main__":
    sys.exit(main())
