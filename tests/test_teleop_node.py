"""The process `teleop` at a terminal, before a controller that notes what it is asked."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("husky_msgs")

import rclpy
from noting_robot import NotingRobot
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Joy

from husky_runtime import graph
from husky_runtime.nodes import qos

pytestmark = pytest.mark.graph


class Bench:
    """A robot and a teleop process with a terminal, in a ROS domain of their own."""

    def __init__(self, *, terminal: bool = True):
        domain = 1 + os.getpid() % 19  # of no graph: tests/ros_domain.py
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("robot", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.joystick = self.node.create_publisher(Joy, graph.JOY, qos.COMMAND)
        self.robot = NotingRobot(self.node)
        self.master, self.slave = pty.openpty()
        self.before = termios.tcgetattr(self.slave)
        self.seen = ""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "husky_bringup.nodes.teleop"],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stdin=self.slave if terminal else subprocess.DEVNULL,
            stdout=self.slave,
            stderr=self.slave,
            start_new_session=True,
            preexec_fn=(lambda: os.close(os.open(os.ttyname(0), os.O_RDWR))) if terminal else None,
        )
        self.until(
            lambda: (
                self.node.count_publishers(graph.CMD_VEL) == 1
                and self.robot.states.get_subscription_count() == 1
                and self.joystick.get_subscription_count() == 1
            ),
            "teleop",
        )
        self.spin(0.5)  # its clients meet the services

    def spin(self, duration: float) -> None:
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self.executor_once()

    def executor_once(self) -> None:
        self.executor.spin_once(timeout_sec=0.02)
        if select.select([self.master], [], [], 0.0)[0]:
            self.seen += os.read(self.master, 4096).decode()

    def until(self, predicate: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + 30.0
        while not predicate():
            assert self.process.poll() is None, self.seen
            assert time.monotonic() < deadline, f"waited for {what}, saw {self.seen!r}"
            self.executor_once()

    def type(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def test_an_operator_at_the_keyboard(bench: Bench) -> None:
    robot = bench.robot
    bench.type("u")
    bench.until(lambda: robot.calls == [graph.DRIVES_ENABLE, "stand_up"], "standing up")
    bench.until(lambda: "stand (trot)" in bench.seen, "the status line")
    assert not robot.velocities, "nothing is sent unasked"

    bench.type("w")
    bench.until(lambda: robot.calls[-1] == "walk", "walking")
    bench.until(lambda: (0.5, 0.0, 0.0) in robot.velocities, "a velocity")
    bench.until(lambda: robot.velocities[-1] == (0.0, 0.0, 0.0), "the dead-man stop")
    bench.spin(1.0)
    robot.velocities.clear()
    bench.spin(0.5)
    assert not robot.velocities, "silent after the stop"

    bench.type("g")
    bench.until(lambda: robot.calls[-1] == "gait crawl", "the next gait")
    robot.state.velocity_limit = (0.05, 0.02, 0.1)
    bench.spin(0.5)
    bench.type("wq")
    bench.until(lambda: (0.05, 0.0, 0.1) in robot.velocities, "what the gait allows")
    bench.type(" ")
    bench.until(lambda: robot.calls[-1] == "stand", "a stop")
    bench.type("j")
    bench.until(lambda: robot.calls[-1] == "sit", "sitting")
    bench.type(" ")
    bench.spin(0.3)
    assert robot.calls[-1] == "sit", "a stop does not make a sitting robot rise"
    bench.type("x")
    stopped = {"emergency_stop", graph.DRIVES_EMERGENCY_STOP}
    bench.until(lambda: set(robot.calls[-2:]) == stopped, "the emergency stop of both")
    robot.state.reason = "tilt of 0.9 rad"
    bench.until(lambda: "emergency_stop: tilt of 0.9 rad" in bench.seen, "the reason")
    bench.type("r")
    recovered = {"passive", graph.DRIVES_RESET_FAULTS}
    bench.until(lambda: set(robot.calls[-2:]) == recovered, "recovery of both")

    bench.type("t")
    bench.until(lambda: robot.calls[-1] == "righting", "righting")
    bench.type("t")
    bench.until(lambda: "righting: refused, already in righting\r\n" in bench.seen, "why not")
    bench.type("CCn")
    bench.until(lambda: robot.calls[-1] == "reset '' -1", "a new world")
    assert graph.DRIVES_CUT not in robot.calls, "a key that is not held"
    cut = {"emergency_stop", graph.DRIVES_CUT}

    def hold_the_key() -> bool:
        bench.type("C")
        return set(robot.calls[-2:]) == cut

    bench.until(hold_the_key, "no power")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_end_stops_the_robot_and_restores_the_terminal(
    bench: Bench, number: signal.Signals
) -> None:
    robot = bench.robot
    robot.state.mode = "walk"
    bench.type("a")
    bench.until(lambda: (0.0, 0.3, 0.0) in robot.velocities, "a velocity")
    bench.process.send_signal(number)
    assert bench.process.wait(30.0) == 0
    assert termios.tcgetattr(bench.slave) == bench.before
    end = time.monotonic() + 5.0
    while robot.velocities[-1] != (0.0, 0.0, 0.0):
        assert time.monotonic() < end, robot.velocities
        bench.executor.spin_once(timeout_sec=0.05)


def test_a_joystick_without_a_terminal() -> None:
    bench = Bench(terminal=False)
    try:
        robot = bench.robot
        robot.state.mode = "stand"
        held = Joy(axes=[0.0, 1.0, 0.0, -1.0, 0.0], buttons=[0, 0, 0, 0, 1])

        def push() -> bool:
            bench.joystick.publish(held)
            return (0.5, 0.0, pytest.approx(-0.8)) in robot.velocities and bool(robot.calls)

        bench.until(push, "a velocity and walking")
        assert robot.calls == ["walk"]
        bench.spin(0.6)  # the joystick is silent
        robot.velocities.clear()
        bench.spin(0.5)
        assert not robot.velocities
    finally:
        bench.close()
