"""A bare relay: as many processes, hops and bytes as the walking graph, and no work in them.

Every process takes its messages and sends the ones that the robot's node would send, on the same
executor, with the same quality of service and the same rule of who waits for whom (or, with
HUSKY_RELAY_PIPELINED=0, in four hops one after the other). What the graph
takes longer than this is its own work. Started by `loop.py`, one process for each role:

    python relay.py ROLE [TICKS]      ROLE: plant, drive_bridge, vn200_driver, low_level_controller
"""

from __future__ import annotations

import array
import json
import os
import sys
import time

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu, JointState

from husky_description.robot import JOINT_NAMES
from husky_msgs.msg import JointCommand, ServoCommand, ServoState
from husky_runtime import graph, starter
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.executor import WaitSetExecutor

_IMU_PERIOD_NS = 1_250_000
_IMU_BYTES = 54
LINE = f"/tmp/husky-relay-{os.environ.get('ROS_DOMAIN_ID', '0')}"
"""Where the IMU's line appears."""
_PIPELINED = os.environ.get("HUSKY_RELAY_PIPELINED", "1") == "1"
_WARM_UP = 200
"""Ticks that are not measured."""


class Plant(Node):
    """Sends the state of tick k when k - 1 is answered; writes IMU bytes to a line."""

    def __init__(self, ticks: int):
        super().__init__(graph.PLANT)
        self._left = ticks
        self._time_ns = 0
        self._imu_ns = 0
        self._times: list[float] = []
        self._state = ServoState()
        self._publisher = self.create_publisher(ServoState, graph.SERVO_STATE, qos.CONTROL)
        self.hot = [
            self.create_subscription(
                ServoCommand, graph.SERVO_COMMAND, self._on_answer, qos.CONTROL
            )
        ]
        while not os.path.exists(LINE):
            time.sleep(0.05)
        self._line = os.open(LINE, os.O_RDWR)

    def quiet(self) -> None:
        ready = (
            self.count_subscribers(graph.SERVO_STATE)
            and self.count_subscribers(graph.JOINT_COMMAND)
            and self.count_subscribers(graph.JOINT_STATES)
            and self.count_subscribers(graph.IMU)
        )
        if not self._times and ready:
            time.sleep(1.0)  # both ends of each topic must have met
            self._send()

    def _send(self) -> None:
        self._times.append(time.perf_counter())
        while self._imu_ns < self._time_ns:
            os.write(self._line, self._imu_ns.to_bytes(8, "little").ljust(_IMU_BYTES, b"\0"))
            self._imu_ns += _IMU_PERIOD_NS
        stamps.fill(self._state.stamp, self._time_ns)
        self._publisher.publish(self._state)

    def _on_answer(self, command: ServoCommand) -> None:
        if stamps.to_ns(command.stamp) != self._time_ns:
            return
        self._time_ns += graph.TICK_PERIOD_NS
        self._left -= 1
        if self._left == 0:
            ticks = np.diff(self._times[_WARM_UP:])
            print(json.dumps({"tick_us": [1e6 * float(t) for t in ticks]}), flush=True)
            raise ExternalShutdownException
        self._send()


class Bridge(Node):
    """Answers the plant with the command of the tick before, and tells the controller."""

    def __init__(self) -> None:
        super().__init__(graph.DRIVE_BRIDGE)
        self._joints = JointState()
        self._joints.name = list(JOINT_NAMES)
        self._joints.position = array.array("d", range(12))
        self._joints.velocity = array.array("d", range(12))
        self._joints.effort = array.array("d", range(12))
        self._command = ServoCommand()
        self._answered = -graph.TICK_PERIOD_NS
        self._waiting = -1
        self._publisher = self.create_publisher(ServoCommand, graph.SERVO_COMMAND, qos.CONTROL)
        self._joint_publisher = self.create_publisher(JointState, graph.JOINT_STATES, qos.CONTROL)
        self.hot = [
            self.create_subscription(
                JointCommand, graph.JOINT_COMMAND, self._on_command, qos.CONTROL
            ),
            self.create_subscription(ServoState, graph.SERVO_STATE, self._on_state, qos.CONTROL),
        ]

    def quiet(self) -> None:
        pass

    def _on_command(self, command: JointCommand) -> None:
        self._answered = stamps.to_ns(command.stamp)
        if self._waiting >= 0:
            self._answer()

    def _on_state(self, state: ServoState) -> None:
        self._waiting = stamps.to_ns(state.stamp)
        if not _PIPELINED:
            self._tell()
        self._answer()

    def _tell(self) -> None:
        stamps.fill(self._joints.header.stamp, self._waiting)
        self._joint_publisher.publish(self._joints)

    def _answer(self) -> None:
        delay = graph.TICK_PERIOD_NS if _PIPELINED else 0
        if self._answered < self._waiting - delay:
            return
        if _PIPELINED:
            self._tell()
        stamps.fill(self._command.stamp, self._waiting)
        self._publisher.publish(self._command)
        self._waiting = -1


class Controller(Node):
    """Answers joint states when the IMU sample that belongs to them is there."""

    def __init__(self) -> None:
        super().__init__(graph.LOW_LEVEL_CONTROLLER)
        self._command = JointCommand()
        self._imu_ns = -1
        self._pending = -1
        self._publisher = self.create_publisher(JointCommand, graph.JOINT_COMMAND, qos.CONTROL)
        self.hot = [
            self.create_subscription(Imu, graph.IMU, self._on_imu, qos.CONTROL),
            self.create_subscription(JointState, graph.JOINT_STATES, self._on_joints, qos.CONTROL),
        ]

    def quiet(self) -> None:
        pass

    def _on_imu(self, imu: Imu) -> None:
        self._imu_ns = stamps.to_ns(imu.header.stamp)
        if self._pending >= 0:
            self._answer()

    def _on_joints(self, joints: JointState) -> None:
        self._pending = stamps.to_ns(joints.header.stamp)
        self._answer()

    def _answer(self) -> None:
        if self._imu_ns < self._pending - _IMU_PERIOD_NS:
            return
        stamps.fill(self._command.stamp, self._pending)
        self._publisher.publish(self._command)
        self._pending = -1


def relay_imu() -> None:
    """Read packets from the line and publish them."""
    node = Node(graph.VN200_DRIVER)
    publisher = node.create_publisher(Imu, graph.IMU, qos.CONTROL)
    imu = Imu()
    controller, line = os.openpty()
    os.set_blocking(controller, True)
    import tty

    tty.setraw(line)
    os.symlink(os.ttyname(line), LINE)
    buffer = b""
    while True:
        buffer += os.read(controller, 4096)
        while len(buffer) >= _IMU_BYTES:
            stamps.fill(imu.header.stamp, int.from_bytes(buffer[:8], "little"))
            buffer = buffer[_IMU_BYTES:]
            publisher.publish(imu)


def main() -> None:
    """Run one role."""
    role = sys.argv[1]
    starter.end_with_starter()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    if role == graph.VN200_DRIVER:
        relay_imu()
    node = {
        graph.PLANT: lambda: Plant(int(sys.argv[2])),
        graph.DRIVE_BRIDGE: Bridge,
        graph.LOW_LEVEL_CONTROLLER: Controller,
    }[role]()
    executor = WaitSetExecutor(node, node.hot, node.quiet)
    try:
        executor.spin()
    except (ExternalShutdownException, KeyboardInterrupt):
        pass


if __name__ == "__main__":
    main()
