"""The node as a process: fake sensors in, pulses out, a ground station over UDP, a serial line."""

import socket
import subprocess
import sys
import tempfile
import time

import pytest
import rclpy
import serial
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from husky_description import graph
from husky_description.nodes import qos, stamps
from husky_msgs.msg import FanCommand, FlightSensors
from husky_pu.sbus import encode, frame_of_pulses

pytestmark = pytest.mark.graph


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class World:
    """A unit at rest, level, heading north: publishes its sensors and keeps the answers."""

    def __init__(self, **parameters):
        self.directory = tempfile.TemporaryDirectory()
        self.port = free_port()
        self.pixhawk = f"{self.directory.name}/pixhawk"
        self.sbus = f"{self.directory.name}/sbus"
        values = {
            "udp_port": self.port,
            "serial_port": self.pixhawk,
            "sbus_port": self.sbus,
            "time": "realtime",
            **parameters,
        }
        arguments = [part for k, v in values.items() for part in ("-p", f"{k}:={v}")]
        self.log = open(f"{self.directory.name}/log", "w+")  # noqa: SIM115
        self.process = subprocess.Popen(
            [sys.executable, "-m", "husky_pu.nodes.flight_controller", "--ros-args", *arguments],
            stdout=self.log,
            stderr=subprocess.STDOUT,
        )
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("world", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.publisher = self.node.create_publisher(
            FlightSensors, graph.FLIGHT_SENSORS, qos.CONTROL
        )
        self.commands = []
        self.node.create_subscription(
            FanCommand, graph.FAN_COMMAND, self.commands.append, qos.CONTROL
        )
        self.time_ns = -2_000_000
        self.station = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{self.port}", source_system=255, dialect="common"
        )

    def say(self):
        message = FlightSensors()
        stamps.fill(message.stamp, self.time_ns)
        message.specific_force = [0.0, 0.0, -9.81]
        message.magnetic_field = [0.21, 0.0, 0.43]
        message.pressure = 101325.0
        message.battery_voltage, message.battery_current = 25.0, 2.0
        self.publisher.publish(message)

    def tick(self, count=1, patience=20.0):
        """Advance as the plant does: the next state when the last was answered."""
        for _ in range(count):
            self.time_ns += 2_000_000
            self.say()
            start = said = time.monotonic()
            while not (self.commands and stamps.to_ns(self.commands[-1].stamp) == self.time_ns):
                self.executor.spin_once(timeout_sec=0.02)
                if time.monotonic() - said > 0.1:
                    said = time.monotonic()
                    self.say()
                if time.monotonic() - start > patience or self.process.poll() is not None:
                    self.log.seek(0)
                    raise AssertionError(f"no answer to {self.time_ns}: {self.log.read()}")

    def heard(self, kind, accept=lambda message: True, ticks=1000):
        """Tick until the ground station hears a message."""
        for _ in range(ticks):
            while (message := self.station.recv_msg()) is not None:
                if message.get_type() == kind and accept(message):
                    return message
            self.tick()
        raise AssertionError(f"no {kind}")

    def beat(self):
        self.station.mav.heartbeat_send(6, 8, 0, 0, 0)

    def arm(self, force=0):
        self.station.mav.command_long_send(1, 1, 400, 0, 1, force, 0, 0, 0, 0, 0)

    def close(self):
        self.station.close()
        self.process.terminate()
        self.process.wait(20)
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
        self.log.close()
        self.directory.cleanup()


@pytest.fixture
def world(request):
    made = World(**getattr(request, "param", {}))
    yield made
    made.close()


def test_a_ground_station_over_udp(world):
    world.tick()
    world.beat()
    heartbeat = world.heard("HEARTBEAT")
    assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_PX4
    assert mavutil.mode_string_v10(heartbeat) == "STABILIZED"
    world.tick(600)

    world.station.mav.param_request_list_send(1, 1)
    names = {}
    while len(names) < 2 or len(names) < next(iter(names.values())):
        message = world.heard("PARAM_VALUE")
        names[message.param_id] = message.param_count
    assert "COM_OF_LOSS_T" in names

    world.arm()
    text = world.heard("STATUSTEXT", lambda m: "denied" in m.text)
    assert "no manual control input" in text.text
    ack = world.heard("COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert list(world.commands[-1].pwm) == [1000] * 4

    world.arm(force=21196)
    ack = world.heard("COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert world.heard("HEARTBEAT").base_mode & 128


def test_serial_line_and_radio(world):
    world.tick()
    with (
        serial.Serial(world.pixhawk, 921600, timeout=0) as line,
        serial.Serial(world.sbus, 100000, parity="E", stopbits=2, timeout=0) as radio,
    ):
        received = bytearray()

        def run(seconds, arm, throttle=1000):
            frame = encode(frame_of_pulses([1500, 1500, throttle, 1500, 1000, arm, 1000]))
            for index in range(int(seconds * 500)):
                if index % 7 == 0:
                    radio.write(frame)
                world.tick()
                received.extend(line.read(4096))

        run(2.0, 1000)
        run(0.3, 2000)
        run(1.0, 2000, 1500)
    messages = mavlink.MAVLink(None).parse_buffer(bytes(received))
    assert any(m.get_type() == "SERVO_OUTPUT_RAW" for m in messages)
    assert any(m.get_type() == "RC_CHANNELS" and m.chan3_raw == 1500 for m in messages)
    assert any(m.get_type() == "HEARTBEAT" and m.base_mode & 128 for m in messages)
    assert min(world.commands[-1].pwm) > 1100


def test_reset_of_the_world(world):
    world.tick(700)
    world.beat()
    world.arm(force=21196)
    world.heard("COMMAND_ACK")
    world.time_ns = -2_000_000
    world.commands.clear()
    world.tick(5)
    world.beat()
    heartbeat = world.heard("HEARTBEAT", lambda m: not m.base_mode & 128)
    assert heartbeat.system_status in (mavlink.MAV_STATE_BOOT, mavlink.MAV_STATE_STANDBY)


@pytest.mark.parametrize("world", [{"time": "lockstep", "grace": 0.5}], indirect=True)
def test_lockstep_waits_for_the_companion_while_it_takes_part(world):
    world.tick(10)

    def setpoint(stamp_ms):
        world.station.mav.set_attitude_target_send(
            stamp_ms, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.0
        )

    setpoint(world.time_ns // 1_000_000)  # 18 ms: from now on it takes part
    time.sleep(0.2)  # on its way
    world.tick(5)  # 28 ms
    world.time_ns += 2_000_000  # 30 ms needs a setpoint of 20 ms
    world.say()
    end = time.monotonic() + 0.2
    while time.monotonic() < end:
        world.executor.spin_once(timeout_sec=0.02)
    assert stamps.to_ns(world.commands[-1].stamp) == 28_000_000
    setpoint(20)
    end = time.monotonic() + 20.0
    while stamps.to_ns(world.commands[-1].stamp) < 30_000_000 and time.monotonic() < end:
        world.executor.spin_once(timeout_sec=0.02)
    assert stamps.to_ns(world.commands[-1].stamp) == 30_000_000
    world.tick(20)  # it falls silent: after the grace period time goes on
    assert world.time_ns == 70_000_000
