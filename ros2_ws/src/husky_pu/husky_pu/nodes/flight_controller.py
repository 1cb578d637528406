"""Node `flight_controller`: the simulated Pixhawk, from its sensors to the fans' pulses.

It stands for a device: everybody but the plant talks to it over MAVLink (UDP, serial line) and
SBUS. In lockstep its tick waits for the companion's setpoints and for the radio's frames as long as
those take part; in realtime it waits for nobody.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Hashable

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from husky_msgs.msg import FanCommand, FlightSensors
from husky_pu.autopilot.fan_watch import name_lost
from husky_pu.autopilot.imu import SensorSample
from husky_pu.autopilot.mavlink_setpoints import SETPOINT_PERIOD_NS
from husky_pu.autopilot.pace import FramePace
from husky_pu.autopilot.state import Severity
from husky_pu.nodes.flight_controller_parameters import declare_autopilot, declare_memory
from husky_pu.nodes.flight_controller_ports import FlightControllerPorts
from husky_pu.radio import sbus
from husky_runtime import graph
from husky_runtime.lockstep import Peer, Presence
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.message_guard import check_count, refuser
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import make_peer
from husky_runtime.nodes.run import run
from husky_runtime.nodes.tick_clock import TickClock, percentile_ms
from husky_runtime.patient_clock import PatientClock
from husky_runtime.stamp_gate import StampGate, Turn

_LOOK_PERIOD = 1e-4
"""Wall time between two looks at the ports while a tick waits [s]."""
_LOOK_TIME = 0.02
"""Wall time after which a tick that waits lets the executor look at the rest [s]."""
_STANDSTILL = 0.25
"""Wall time without a tick after which time counts as standing still [s]."""


class FlightController(OneClock, Node):
    """Carries sensors, bytes and frames to the autopilot and its pulses to the fans."""

    def __init__(self) -> None:
        """Declare parameters, open the ports, subscribe."""
        super().__init__(graph.FLIGHT_CONTROLLER)
        what = "lockstep: wait for setpoints and radio frames that take part; realtime: do not"
        pace = declare(self, "time", "lockstep", what, allowed=("lockstep", "realtime"))
        self._lockstep = pace == "lockstep"
        what = "wall time a silent companion or radio is waited for [s]"
        grace = declare(self, "grace", 1.0, what, 0.2, 60.0)
        self._memory = declare_memory(self)
        self._autopilot = declare_autopilot(self, self._memory, lockstep=self._lockstep)
        self._names = self._autopilot.mixer.names
        self._keepings = self._autopilot.parameters.keepings
        self._ports = FlightControllerPorts(self, self._autopilot.server)
        what = "between the radio's frames, which lockstep counts [s]"
        period = declare(self, "sbus_period", 0.014, what, 0.004, 0.1)
        self._pace: FramePace[sbus.Frame] = FramePace(round(1e9 * period))
        self._companion = make_peer(self, graph.PIXHAWK_BRIDGE, grace, start_grace=None)
        self._radio = make_peer(self, graph.RC_TRANSMITTER, grace, start_grace=None)
        self._pending: SensorSample | None = None
        self._tick_ns = -1
        self._gate: StampGate[FlightSensors] = StampGate(
            graph.TICK_PERIOD_NS,
            refuser(self, graph.FLIGHT_SENSORS),
            graph.CLOCK_LAG_NS,
            replay=not self._lockstep,
        )
        self._patient_clock = PatientClock()
        self._ticked_at = 0.0
        self._ticks = TickClock(graph.TICK_PERIOD)
        self._command = FanCommand()
        self._publisher = self.create_publisher(FanCommand, graph.FAN_COMMAND, qos.CONTROL_OFFERED)
        self.hot = [
            self.create_subscription(Clock, graph.CLOCK, self._on_clock, qos.CLOCK),
            self.create_subscription(
                FlightSensors, graph.FLIGHT_SENSORS, self._on_sensors, qos.CONTROL
            ),
        ]
        self._diagnostics = diagnostics.Diagnostics(self, "Pixhawk 2.4.8", self._report)

    # The tick -----------------------------------------------------------------------------------
    def _on_clock(self, clock: Clock) -> None:
        self._gate.hear_witness(stamps.to_ns(clock.clock))

    def _on_sensors(self, message: FlightSensors) -> None:
        check_count("fan_speed", message.fan_speed, len(self._names))
        check_count("fan_current", message.fan_current, len(self._names))
        for turn, each in self._gate.admit(stamps.to_ns(message.stamp), message):
            if turn is Turn.REPEAT:
                if self._tick_ns >= 0:
                    self._publisher.publish(self._command)  # what was lost, or a sign of life
                continue
            if turn is Turn.RESTART:
                self._restart()
            self._begin_tick(each)

    def _begin_tick(self, message: FlightSensors) -> None:
        self._pending = SensorSample(
            stamps.to_ns(message.stamp),
            tuple(message.angular_velocity.tolist()),
            tuple(message.specific_force.tolist()),
            tuple(message.magnetic_field.tolist()),
            message.pressure,
            message.battery_voltage,
            message.battery_current,
            tuple(message.fan_speed),
            tuple(message.fan_current),
        )
        self._go_on()

    def _go_on(self) -> None:
        """Tick as soon as what it waits for is there; come back later if that takes long."""
        assert self._pending is not None
        until = time.monotonic() + _LOOK_TIME
        while True:
            self._poll()
            if self._ready(self._pending.time_ns):
                self._tick()
                return
            if time.monotonic() >= until:
                return
            time.sleep(_LOOK_PERIOD)

    def _ready(self, now_ns: int) -> bool:
        if not self._lockstep:
            return True
        due_ns = now_ns - SETPOINT_PERIOD_NS
        setpoint = now_ns % SETPOINT_PERIOD_NS != 0 or self._companion.ready(due_ns)
        if not setpoint:
            setpoint = self._given_up(self._companion)
        frame = self._radio.presence is not Presence.EXPECTED or self._pace.ready(now_ns)
        if not frame and self._given_up(self._radio):
            self._pace.lost()
            frame = True
        return setpoint and frame

    def _given_up(self, peer: Peer) -> bool:
        """Return whether somebody awaited is no longer waited for."""
        if peer.expire(time.monotonic()):
            self.get_logger().warning(f"{peer.name} is silent: going on without it")
        return peer.presence is not Presence.EXPECTED

    def _tick(self) -> None:
        sample, self._pending = self._pending, None
        assert sample is not None
        self._ticks.start()
        self._tick_ns = sample.time_ns
        if self._lockstep:
            while (frame := self._pace.next_due(sample.time_ns)) is not None:
                self._receive_frame(frame)
        self._command.pwm = self._autopilot.tick(sample)
        self._command.tilt[:] = self._autopilot.vehicle.tilt
        stamps.fill(self._command.stamp, sample.time_ns)
        self._publisher.publish(self._command)
        self._ticks.end()
        self._send()
        self._remember()
        self._ticked_at = self._patient_clock.read(time.monotonic())

    def quiet(self) -> None:
        """Nothing from the plant for 2 ms: look at the ports, and at who is waited for."""
        now = self._patient_clock.read(time.monotonic())
        if self._pending is not None:
            self._go_on()
            return
        self._poll()
        if now - self._ticked_at > _STANDSTILL:
            self._autopilot.server.release(standstill=True)
        self._send()
        self._remember()

    def _restart(self) -> None:
        """The world starts again at an earlier time: a new flight, disarmed."""
        self._poll()
        self._autopilot.restart()
        self._companion.restart()
        self._radio.restart()
        self._pace.restart()
        self._tick_ns = -1
        self.get_logger().warning("time has gone back: started anew, disarmed")

    # Ports --------------------------------------------------------------------------------------
    def _poll(self) -> None:
        """Take what has come on every port."""
        server = self._autopilot.server
        before = server.stamp_ns
        frames = self._ports.receive(self._autopilot)
        if server.stamp_ns > before:
            self._companion.answer(server.stamp_ns)
        for frame in frames:
            self._take_frame(frame)

    def _take_frame(self, frame: sbus.Frame) -> None:
        if not self._lockstep:
            self._receive_frame(frame)
            return
        now_ns = max(self._tick_ns, 0)
        self._radio.answer(now_ns)
        self._pace.push(frame, now_ns)

    def _receive_frame(self, frame: sbus.Frame) -> None:
        self._autopilot.receive_rc(frame.pulses, failsafe=frame.failsafe, lost=frame.frame_lost)

    def _send(self) -> None:
        self._ports.send(self._autopilot.server)

    def _remember(self) -> None:
        """Have written what is to outlast us; say when that fails."""
        if self._memory is None:
            return
        parameters = self._autopilot.parameters
        if parameters.keepings != self._keepings:
            self._keepings = parameters.keepings
            self._memory.keep(parameters.kept)
        if problem := self._memory.news():
            self.get_logger().warning(f"parameters are not stored: {problem}")
            text = (Severity.WARNING, "Parameters are not stored: see the log")
            self._autopilot.vehicle.logic.texts.append(text)

    def close(self) -> None:
        """Stop the pulses and close the ports."""
        if self._tick_ns >= 0:
            self._command.pwm = [0] * len(self._names)
            self._publisher.publish(self._command)
        self._ports.close()
        self._remember()
        if self._memory is not None:
            self._memory.close()

    # Report -------------------------------------------------------------------------------------
    def _report(self) -> diagnostics.Report:
        vehicle, server = self._autopilot.vehicle, self._autopilot.server
        logic, stream = vehicle.logic, vehicle.stream
        durations = self._ticks.durations()
        silent = self._patient_clock.read(time.monotonic()) - self._ticked_at
        values = {
            "ticks": self._ticks.ticks,
            "tick_ms_p50": f"{percentile_ms(durations, 50):.3f}",
            "tick_ms_p99": f"{percentile_ms(durations, 99):.3f}",
            "armed": logic.armed,
            "mode": logic.mode.value,
            "failsafe": logic.failsafe.value if logic.failsafe else "",
            "fans_lost": name_lost(self._names, logic.fans_ok),
            "battery_remaining": f"{vehicle.battery.remaining:.2f}",
            "parameters_kept": len(self._autopilot.parameters.kept),
            "links": ", ".join(map(_link_name, server.links.names)),
            "links_evicted": server.links.evicted,
            "setpoints": stream.accepted,
            "setpoints_refused": stream.refused,
            "setpoints_contested": stream.contested,
            "frames_damaged": server.links.damaged,
            "frames_badly_signed": server.links.refused,
            "impostors": server.impostors,
            "sbus_frames": self._ports.radio.frames,
            "sbus_garbage_bytes": self._ports.radio.garbage_bytes,
            "serial_bytes_dropped": self._ports.dropped,
            "peer_losses": self._companion.losses + self._radio.losses,
        }
        lost = [p.name for p in (self._companion, self._radio) if p.presence is Presence.LOST]
        if logic.failsafe is not None or logic.terminated:
            word = logic.failsafe.value if logic.failsafe else "flight termination"
            return diagnostics.ERROR, word, values
        if values["fans_lost"]:
            return diagnostics.ERROR, f"fan lost: {values['fans_lost']}", values
        if lost:
            return diagnostics.ERROR, f"{' and '.join(lost)} lost", values
        if self._memory is not None and self._memory.problem:
            return diagnostics.WARN, f"parameters not stored: {self._memory.problem}", values
        if self._ticks.ticks == 0 or silent > 1.0:
            return diagnostics.WARN, "no sensors", values
        state = f"{'armed' if logic.armed else 'disarmed'}, {logic.mode.value}"
        return diagnostics.OK, state, values


def _link_name(link: Hashable) -> str:
    return f"{link[0]}:{link[1]}" if isinstance(link, tuple) else str(link)


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(FlightController)


if __name__ == "__main__":
    sys.exit(main())
