"""Other people's MAVLink clients against the process `flight_controller`, over UDP.

Two ground stations that share no code with this project: MAVSDK (C++) and MAVProxy (on pymavlink's
own connection). `pip install mavsdk` brings no other package; MAVProxy brings a dozen.
"""

import importlib.util
import os
import re
import socket
import subprocess
import sys
import threading
import time

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from husky_description import graph
from husky_description.nodes import qos, stamps
from husky_msgs.msg import FlightSensors

pytestmark = pytest.mark.graph


def needs(package):
    return pytest.mark.skipif(
        importlib.util.find_spec(package) is None, reason=f"{package} is not installed"
    )


class StandingWorld(threading.Thread):
    """The sensors of a vehicle that stands still, at about 500 Hz."""

    def __init__(self, domain):
        super().__init__(daemon=True)
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("world", context=self.context)
        self.publisher = self.node.create_publisher(
            FlightSensors, graph.FLIGHT_SENSORS, qos.CONTROL
        )
        self.running = True

    def run(self):
        message = FlightSensors(
            angular_velocity=[0.0, 0.0, 0.0],
            specific_force=[0.0, 0.0, -9.81],
            magnetic_field=[0.2, 0.0, 0.4],
            pressure=101325.0,
            battery_voltage=24.5,
            battery_current=1.0,
        )
        start, tick = time.monotonic(), 0
        while self.running:
            tick += 1
            stamps.fill(message.stamp, tick * graph.TICK_PERIOD_NS)
            self.publisher.publish(message)
            time.sleep(max(0.0, start + tick * graph.TICK_PERIOD - time.monotonic()))

    def close(self):
        self.running = False
        self.join()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def udp_port(tmp_path):
    """A flight controller that runs; the port where it listens."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    domain = 1 + os.getpid() % 100
    environment = dict(os.environ)
    environment["ROS_DOMAIN_ID"] = str(domain)
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    settings = {
        "time": "realtime",
        "udp_port": port,
        "serial_port": tmp_path / "pixhawk",
        "sbus_port": tmp_path / "sbus",
    }
    words = [word for item in settings.items() for word in ("-p", "{}:={}".format(*item))]
    process = subprocess.Popen(
        [sys.executable, "-m", "husky_pu.nodes.flight_controller", "--ros-args", *words],
        env=environment,
    )
    world = StandingWorld(domain)
    world.start()
    yield port
    assert process.poll() is None, "the flight controller has ended"
    process.kill()
    process.wait()
    world.close()


def wait(condition, what):
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.1)


@needs("mavsdk")
def test_mavsdk(udp_port):
    from mavsdk import ComponentType, Configuration, Mavsdk
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.offboard import Attitude, Offboard
    from mavsdk.plugins.param import Param
    from mavsdk.plugins.telemetry import Telemetry

    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    with Mavsdk(configuration) as mavsdk:
        mavsdk.add_any_connection(f"udpout://127.0.0.1:{udp_port}")
        system = mavsdk.first_autopilot(60.0)
        assert system is not None
        parameters, action = Param(system), Action(system)
        offboard, telemetry = Offboard(system), Telemetry(system)

        listed = parameters.get_all_params()
        names = {p.name for p in (*listed.int_params, *listed.float_params)}
        assert {"COM_OF_LOSS_T", "MC_ROLLRATE_P", "BAT1_N_CELLS"} <= names
        assert parameters.get_param_float("COM_OF_LOSS_T") == pytest.approx(1.0)
        assert parameters.get_param_int("BAT1_N_CELLS") == 6

        with pytest.raises(Exception, match="DENIED"):
            action.arm()  # neither a radio nor a stream of setpoints
        offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.0))  # from now on at 20 Hz
        time.sleep(1.0)
        offboard.start()
        action.arm()
        wait(telemetry.armed, "armed")
        offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.25))
        time.sleep(1.0)
        assert offboard.is_active()
        assert telemetry.armed()
        assert telemetry.battery().voltage_v == pytest.approx(24.5, abs=0.3)
        q = telemetry.attitude_quaternion()
        assert abs(q.w) == pytest.approx(1.0, abs=0.05)  # level, facing north
        action.kill()
        wait(lambda: not telemetry.armed(), "disarmed")


@needs("MAVProxy")
def test_mavproxy(udp_port, tmp_path):
    command = [sys.executable, "-m", "MAVProxy.mavproxy", f"--master=udpout:127.0.0.1:{udp_port}"]
    command += [f"--state-basedir={tmp_path}", "--default-modules=param,arm,mode,cmdlong"]
    environment = dict(os.environ)
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    log = tmp_path / "log"
    with log.open("w") as output:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=output, stderr=output, text=True,
            cwd=tmp_path, env=environment,
        )  # fmt: skip

        def say(text):
            process.stdin.write(text + "\n")
            process.stdin.flush()

        def heard(pattern):
            return re.search(pattern, log.read_text())

        def stream(thrust, until, what):
            """Send setpoints at about 10 Hz until something is true."""

            def sent():
                say(f"attitude 1 0 0 0 {thrust}")
                return until()

            wait(sent, what)

        try:
            wait(lambda: heard(r"Received \d\d+ parameters"), "parameters")
            say("param show COM_OF_LOSS_T")
            wait(lambda: heard(r"COM_OF_LOSS_T +1\.0"), "a parameter")
            end = time.monotonic() + 1.5
            stream(0, lambda: time.monotonic() > end, "a stream")
            say("long DO_SET_MODE 1 6")
            stream(0, lambda: heard("Mode OFFBOARD"), "OFFBOARD")
            # By force, PX4's way; `arm throttle force` says ArduPilot's number.
            say("long COMPONENT_ARM_DISARM 1 21196")
            stream(0, lambda: heard("AP: Armed"), "armed")
            end = time.monotonic() + 1.0
            stream(0.25, lambda: time.monotonic() > end, "thrust")
            say("status SERVO_OUTPUT_RAW")
            stream(0.25, lambda: heard(r"SERVO_OUTPUT_RAW \{"), "pulses")
            pulses = heard(r"servo1_raw : (\d+)")
            assert int(pulses[1]) > 1100
            say("status BATTERY_STATUS")
            stream(0.25, lambda: heard(r"voltages : \[40\d\d, 40\d\d"), "the battery")
            say("disarm force")
            stream(0, lambda: heard("AP: Disarmed"), "disarmed")
        finally:
            process.kill()
            process.wait()
