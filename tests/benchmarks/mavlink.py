"""From a thrust command to the pulses that follow it, over MAVLink, in realtime."""

from __future__ import annotations

import argparse
import os
import socket
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool

from husky_bringup.processes import Processes
from husky_bringup.settings import HelpFormatter
from husky_bringup.system import NodeSpec
from husky_msgs.msg import FanCommand, FlightSensors, PropulsionCommand, PropulsionState
from husky_msgs.srv import SetFlightMode
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

os.environ.setdefault("MAVLINK20", "1")
from pymavlink.dialects.v20 import common as mavlink

_SENSOR_PERIOD = 0.002
_HOLD = 0.6
"""Time that a thrust is held before the next step [s]."""
_LOW, _HIGH = 10.0, 14.0
"""Collective thrusts that take turns [N]; a small step is within every slew limit."""
_NOTICE = 4
"""Change of a pulse that counts as the answer [us]."""
_PORT = 18570
_AT_ONCE = 32
"""Questions before the first answer is awaited."""


def bench(arguments: list[str]) -> dict[str, Any]:
    """Thrust command to pulses: latency over MAVLink; messages per second of the autopilot."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh mavlink", formatter_class=HelpFormatter)
    parser.add_argument("--steps", type=int, default=60, help="steps of thrust measured")
    parser.add_argument("--seconds", type=float, default=5.0, help="of questions and answers")
    options = parser.parse_args(arguments)
    specs = (
        NodeSpec("husky_pu", graph.FLIGHT_CONTROLLER, {"time": "realtime"}),
        NodeSpec("husky_pu", graph.PIXHAWK_BRIDGE, {"time": "realtime"}),
    )
    domain = int(os.environ.get("ROS_DOMAIN_ID", "0"))
    with tempfile.TemporaryDirectory() as logs, Processes(logs=Path(logs)) as processes:
        processes.start_all(specs)
        world = _World()
        try:
            world.arm()
            latencies = world.steps(options.steps)
            rate = _messages_per_second(("127.0.0.1", _PORT + domain), options.seconds)
        finally:
            world.close()
    return {
        "command_to_pwm_ms_p50": float(np.percentile(latencies, 50)),
        "command_to_pwm_ms_p99": float(np.percentile(latencies, 99)),
        "steps": len(latencies),
        "messages_per_s": rate,
        "bare_messages_per_s": _bare_messages_per_second(options.seconds),
    }


class _World:
    """Plays the plant, whose unit stands still, and the controller; watches the pulses."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = Node("bench", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._sensors = self.node.create_publisher(FlightSensors, graph.FLIGHT_SENSORS, qos.CONTROL)
        self._commands = self.node.create_publisher(
            PropulsionCommand, graph.PROPULSION_COMMAND, qos.CONTROL
        )
        self.node.create_subscription(FanCommand, graph.FAN_COMMAND, self._on_pwm, qos.CONTROL)
        self.node.create_subscription(
            PropulsionState, graph.PROPULSION_STATE, self._on_state, qos.STATUS
        )
        self._arm = self.node.create_client(SetBool, graph.PROPULSION_ARM)
        self._mode = self.node.create_client(SetFlightMode, graph.PROPULSION_SET_MODE)
        self._pwm = np.zeros(4)
        self._pwm_at = 0.0
        self._connected = False
        self._thrust = 0.0
        self._before: np.ndarray | None = None
        self._answered_at = 0.0
        self._running = True
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def _play(self) -> None:
        """Sensors at 500 Hz, the command with every fifth, on the wall clock."""
        sensors, command = FlightSensors(), PropulsionCommand(kind=PropulsionCommand.WRENCH)
        sensors.specific_force = [0.0, 0.0, -9.81]
        sensors.magnetic_field = [0.195, 0.0, 0.48]
        sensors.pressure = 101325.0
        sensors.battery_voltage, sensors.battery_current = 24.5, 2.0
        sensors.fan_speed = sensors.fan_current = [0.0] * 4
        tick, start = 0, time.perf_counter()
        while self._running:
            tick += 1
            time.sleep(max(0.0, start + tick * _SENSOR_PERIOD - time.perf_counter()))
            stamps.fill(sensors.stamp, tick * 2_000_000)
            self._sensors.publish(sensors)
            if tick % 5 == 0:
                stamps.fill(command.stamp, tick * 2_000_000)
                command.force.z = self._thrust
                self._commands.publish(command)

    def _on_pwm(self, command: FanCommand) -> None:
        self._pwm = np.array(command.pwm, dtype=float)
        if self._before is not None and np.abs(self._pwm - self._before).max() >= _NOTICE:
            self._before, self._answered_at = None, time.perf_counter()

    def _on_state(self, state: PropulsionState) -> None:
        self._connected = state.connected

    def spin(self, seconds: float) -> None:
        """Serve callbacks for a while of wall time."""
        end = time.perf_counter() + seconds
        while (left := end - time.perf_counter()) > 0.0:
            self.executor.spin_once(timeout_sec=min(left, 0.05))

    def _ask(self, client: Any, request: Any) -> None:
        future = client.call_async(request)
        self.executor.spin_until_future_complete(future, timeout_sec=5.0)
        if not future.done() or not future.result().success:
            answer = future.result().message if future.done() else "no answer"
            raise RuntimeError(f"{client.srv_name}: {answer}")

    def arm(self) -> None:
        """Wait for the link, choose OFFBOARD, arm, take the thrust to where the steps begin."""
        end = time.perf_counter() + 30.0
        while not self._connected or not self._arm.service_is_ready():
            if time.perf_counter() > end:
                raise RuntimeError("the flight controller was not found within 30 s")
            self.spin(0.1)
        self.spin(2.0)
        self._ask(self._mode, SetFlightMode.Request(mode="OFFBOARD"))
        self._ask(self._arm, SetBool.Request(data=True))
        self._thrust = _LOW
        self.spin(2.0)

    def steps(self, count: int) -> np.ndarray:
        """Step the thrust; return the times until a pulse has followed [ms].

        The step goes out with the next command, so up to 10 ms of it is waiting for that.
        """
        latencies = []
        for number in range(count):
            self.spin(_HOLD)
            self._before = self._pwm.copy()
            self._thrust = _LOW if number % 2 else _HIGH
            asked = time.perf_counter()
            end = asked + 1.0
            while self._before is not None and time.perf_counter() < end:
                self.executor.spin_once(timeout_sec=0.05)
            if self._before is not None:
                raise RuntimeError("the pulses did not follow the thrust within 1 s")
            latencies.append(1e3 * (self._answered_at - asked))
        return np.array(latencies)

    def close(self) -> None:
        """End the thread and leave the graph."""
        self._running = False
        self._thread.join()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def _messages_per_second(address: tuple[str, int], seconds: float) -> float:
    """Ask for one parameter again and again, many questions at once; count both directions."""
    encoder = mavlink.MAVLink(None, srcSystem=254, srcComponent=190)
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    count = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.settimeout(0.2)
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            for _ in range(_AT_ONCE):
                question = encoder.param_request_read_encode(1, 1, b"COM_OF_LOSS_T", -1)
                line.sendto(question.pack(encoder), address)
            answers = 0
            try:
                while answers < _AT_ONCE:
                    for message in parser.parse_buffer(line.recv(65536)) or ():
                        answers += message.get_type() == "PARAM_VALUE"
            except TimeoutError:
                pass
            count += _AT_ONCE + answers
    return count / seconds


def _bare_messages_per_second(seconds: float) -> float:
    """The same question, answered by a thread that does nothing but parse and answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(0.2)
        running = threading.Event()
        running.set()

        def answer() -> None:
            parser = mavlink.MAVLink(None)
            encoder = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
            while running.is_set():
                try:
                    data, peer = server.recvfrom(4096)
                except TimeoutError:
                    continue
                for _ in parser.parse_buffer(data) or ():
                    message = encoder.param_value_encode(b"COM_OF_LOSS_T", 1.0, 9, 70, 3)
                    server.sendto(message.pack(encoder), peer)

        thread = threading.Thread(target=answer)
        thread.start()
        try:
            return _messages_per_second(server.getsockname(), seconds)
        finally:
            running.clear()
            thread.join()
