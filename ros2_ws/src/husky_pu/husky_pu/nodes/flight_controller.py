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

from husky_description import graph
from husky_description.lockstep import Peer, Presence
from husky_description.nodes import diagnostics, qos, stamps
from husky_description.nodes.parameters import declare, declare_mounting
from husky_description.nodes.run import run
from husky_description.nodes.tick_clock import TickClock, percentile_ms
from husky_description.pty_port import PtyPort
from husky_description.robot import LEGS, load_robot
from husky_msgs.msg import FanCommand, FlightSensors
from husky_pu import sbus
from husky_pu.autopilot import Autopilot, AutopilotConfig
from husky_pu.autopilot_imu import SensorSample
from husky_pu.autopilot_pace import FramePace
from husky_pu.flight_parameters import read_overrides
from husky_pu.gimbal import Gimbal
from husky_pu.mavlink_frames import read_key
from husky_pu.mavlink_ports import SerialLine, UdpPort
from husky_pu.mavlink_setpoints import SETPOINT_PERIOD_NS
from husky_pu.mixer import Mixer

_LOOK_PERIOD = 1e-4
"""Wall time between two looks at the ports while a tick waits [s]."""
_LOOK_TIME = 0.02
"""Wall time after which a tick that waits lets the executor look at the rest [s]."""
_STANDSTILL = 0.25
"""Wall time without a tick after which time counts as standing still [s]."""
_UDP_PORT = 18570
"""Where PX4's simulated autopilot listens, for the first of several."""


class FlightController(Node):
    """Carries sensors, bytes and frames to the autopilot and its pulses to the fans."""

    def __init__(self) -> None:
        """Declare parameters, open the ports, subscribe."""
        super().__init__(graph.FLIGHT_CONTROLLER)
        domain = self.context.get_domain_id()
        self._lockstep = (
            declare(
                self,
                "time",
                "lockstep",
                "lockstep: wait for setpoints and radio frames that take part; realtime: do not",
                allowed=("lockstep", "realtime"),
            )
            == "lockstep"
        )
        grace = declare(
            self,
            "grace",
            1.0,
            "wall time a silent companion or radio is waited for [s]",
            lower=0.2,
            upper=60.0,
        )
        self._autopilot = self._make_autopilot()
        udp_port = declare(
            self,
            "udp_port",
            0,
            "local UDP port of MAVLink; 0 for PX4's 18570 plus ROS_DOMAIN_ID, -1 for none",
            lower=-1,
            upper=65535,
        )
        udp_host = declare(self, "udp_host", "127.0.0.1", "address to listen at")
        station = declare(
            self, "ground_station", "", "host:port of a ground station to speak to first"
        )
        serial_port = declare(
            self,
            "serial_port",
            graph.serial_port("pixhawk", domain),
            "where the serial line with MAVLink appears, empty for none",
        )
        baud = declare(self, "baud", 921600, "of that line [baud]", lower=9600, upper=3000000)
        sbus_port = declare(
            self,
            "sbus_port",
            graph.serial_port("sbus", domain),
            "where the radio receiver's line appears, empty for none",
        )
        udp_port = udp_port or _UDP_PORT + domain
        self._udp = UdpPort(udp_port, station, udp_host) if udp_port > 0 else None
        self._serial = SerialLine(serial_port, baud) if serial_port else None
        self._sbus = PtyPort(sbus_port) if sbus_port else None
        if self._udp is not None and self._udp.station is not None:
            self._autopilot.server.open_link(self._udp.station)
        self._sbus_parser = sbus.SbusParser()
        period = declare(
            self,
            "sbus_period",
            0.014,
            "between the radio's frames, which lockstep counts [s]",
            lower=0.004,
            upper=0.1,
        )
        self._pace: FramePace[sbus.Frame] = FramePace(round(1e9 * period))
        self._companion = Peer(graph.PIXHAWK_BRIDGE, grace, start_grace=None)
        self._radio = Peer(graph.RC_TRANSMITTER, grace, start_grace=None)
        self._pending: SensorSample | None = None
        self._tick_ns = -1
        self._ticked_at = 0.0
        self._ticks = TickClock(graph.TICK_PERIOD)
        self._command = FanCommand()
        self._publisher = self.create_publisher(FanCommand, graph.FAN_COMMAND, qos.CONTROL)
        self.hot = [
            self.create_subscription(
                FlightSensors, graph.FLIGHT_SENSORS, self._on_sensors, qos.CONTROL
            )
        ]
        self._diagnostics = diagnostics.Diagnostics(self, "Pixhawk 2.4.8", self._report)

    def _make_autopilot(self) -> Autopilot:
        robot = load_robot(**declare_mounting(self))
        seed = declare(self, "seed", 0, "of the sensors' errors", lower=0, upper=2**31 - 1)
        inertia = declare(
            self,
            "inertia",
            [0.03, 0.03, 0.05],
            "about roll, pitch, yaw of all that flies together [kg m^2]; sets the rate loops",
        )
        if len(inertia) != 3 or not all(1e-4 <= j <= 10.0 for j in inertia):
            raise ValueError(f"parameter inertia is {list(inertia)}, it must be 3 of 1e-4 to 10")
        key = declare(self, "signing_key", "", "of MAVLink, 64 hexadecimal digits; empty for none")
        overrides = declare(
            self, "parameters", "", "of the autopilot that differ: NAME=VALUE, NAME=VALUE"
        )
        battery = robot.battery
        resistance = battery.cell_resistance + battery.wiring_resistance / battery.cells
        values = {
            "BAT1_N_CELLS": float(battery.cells),
            "BAT1_CAPACITY": battery.capacity / 3.6,
            "BAT1_R_INTERNAL": resistance,
            **read_overrides(overrides),
        }
        return Autopilot(
            Mixer(robot),
            AutopilotConfig(
                inertia=(inertia[0], inertia[1], inertia[2]),
                seed=seed,
                parameters=values,
                signing_key=read_key(key) if key else b"",
                lockstep=self._lockstep,
                gimbal=Gimbal.of(robot),
            ),
        )

    # The tick -----------------------------------------------------------------------------------
    def _on_sensors(self, message: FlightSensors) -> None:
        stamp = stamps.to_ns(message.stamp)
        if stamp == self._tick_ns or (self._pending and stamp == self._pending.time_ns):
            if self._tick_ns >= 0:
                self._publisher.publish(self._command)  # what was lost, or a sign of life
            return
        if stamp < self._tick_ns:
            self._restart()
        self._pending = SensorSample(
            stamp,
            tuple(message.angular_velocity.tolist()),
            tuple(message.specific_force.tolist()),
            tuple(message.magnetic_field.tolist()),
            message.pressure,
            message.battery_voltage,
            message.battery_current,
            tuple(message.fan_speed.tolist()),
            tuple(message.fan_current.tolist()),
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
            while (frame := self._pace.take(sample.time_ns)) is not None:
                self._receive_frame(frame)
        self._command.pwm[:] = self._autopilot.tick(sample)
        self._command.tilt[:] = self._autopilot.vehicle.tilt
        stamps.fill(self._command.stamp, sample.time_ns)
        self._publisher.publish(self._command)
        self._ticks.end()
        self._send()
        self._ticked_at = time.monotonic()

    def quiet(self) -> None:
        """Nothing from the plant for 2 ms: look at the ports, and at who is waited for."""
        if self._pending is not None:
            self._go_on()
            return
        self._poll()
        if time.monotonic() - self._ticked_at > _STANDSTILL:
            self._autopilot.server.release(standstill=True)
        self._send()

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
        autopilot, server = self._autopilot, self._autopilot.server
        before = server.stamp_ns
        if self._udp is not None:
            for link, data in self._udp.read():
                autopilot.receive(data, link)
        if self._serial is not None:
            connected = self._serial.connected
            data = self._serial.read()
            if data:
                autopilot.receive(data, self._serial.link)
            if self._serial.connected and not connected:
                server.open_link(self._serial.link)
            elif connected and not self._serial.connected:
                server.close_link(self._serial.link)
        if server.stamp_ns > before:
            self._companion.answer(server.stamp_ns)
        if self._sbus is not None:
            data = self._sbus.read(sbus.BAUD)
            for frame in self._sbus_parser.feed(data) if data else ():
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
        """Put on every link what waits for it."""
        server = self._autopilot.server
        for link in server.links:
            data = server.take_output(link)
            if not data:
                continue
            if self._serial is not None and link == self._serial.link:
                self._serial.write(data)
            elif self._udp is not None:
                self._udp.write(link, data)

    def close(self) -> None:
        """Stop the pulses and close the ports."""
        if self._tick_ns >= 0:
            self._command.pwm[:] = 0
            self._publisher.publish(self._command)
        for port in (self._udp, self._serial, self._sbus):
            if port is not None:
                port.close()

    # Report -------------------------------------------------------------------------------------
    def _report(self) -> diagnostics.Report:
        vehicle, server = self._autopilot.vehicle, self._autopilot.server
        logic, stream = vehicle.logic, vehicle.stream
        durations = self._ticks.durations()
        values = {
            "ticks": self._ticks.ticks,
            "tick_ms_p50": f"{percentile_ms(durations, 50):.3f}",
            "tick_ms_p99": f"{percentile_ms(durations, 99):.3f}",
            "armed": logic.armed,
            "mode": logic.mode.value,
            "failsafe": logic.failsafe.value if logic.failsafe else "",
            "fans_lost": ", ".join(
                leg for leg, ok in zip(LEGS, logic.fans_ok, strict=True) if not ok
            ),
            "battery_remaining": f"{vehicle.battery.remaining:.2f}",
            "links": ", ".join(map(_link_name, server.links)),
            "setpoints": stream.accepted,
            "setpoints_refused": stream.refused,
            "setpoints_contested": stream.contested,
            "frames_damaged": server.damaged,
            "frames_badly_signed": server.unsigned,
            "impostors": server.impostors,
            "sbus_frames": self._sbus_parser.frames,
            "sbus_garbage_bytes": self._sbus_parser.garbage_bytes,
            "serial_bytes_dropped": self._serial.dropped if self._serial is not None else 0,
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
        if self._ticks.ticks == 0 or time.monotonic() - self._ticked_at > 1.0:
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
