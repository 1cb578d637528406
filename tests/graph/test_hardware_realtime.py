"""The robot's side alone, by `bringup.sh --hardware`, against devices that are emulated elsewhere.

World and drives run in one ROS domain, the robot in another: an EtherCAT cable and the serial line
of the VN-200 are all that joins them. Nobody tells the robot that it is simulated; it goes by the
wall clock, which runs slower for all of them (`slow_clock`).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from own_network import own_network
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ros_domain import held_domain
from seen_robot import QUICKLY
from slow_clock import slow_clock
from std_srvs.srv import Trigger

from husky_bringup.bringup import leave_out
from husky_bringup.processes import Processes
from husky_bringup.system import simulated_robot
from husky_msgs.msg import ControllerState, DriveStatusArray
from husky_msgs.srv import SetMode
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.timeout(900)]

_RATE = 0.2
"""Of the clock: with it two busy processors suffice."""
_PATIENCE = 240.0
"""Wall time after which nothing more is expected [s]."""
_ATTEMPTS = 5
_RECOVERY = 0.6 / _RATE
"""Wall time in which drives that have left OP come back: every 0.5 s by their clock [s]."""
_ENDS = ("stand", "damping", "emergency_stop")
"""Modes in which standing up ends, well or not."""
_ROBOTS_OWN = (graph.DRIVE_BRIDGE, graph.VN200_DRIVER, graph.LOW_LEVEL_CONTROLLER)
_LENIENT = {
    "low_level_controller.safety.joint_age": 25.0,
    "low_level_controller.safety.imu_age": 0.1,
    "drive_bridge.command_timeout": 0.03,
    **{f"{graph.LOW_LEVEL_CONTROLLER}.{name}": value for name, value in QUICKLY.items()},
}
"""Without a real-time kernel ticks come late now and then."""


class Ear:
    """A node in a domain, which keeps the newest message of each topic, and calls services."""

    def __init__(self, domain: int, topics: dict[str, type]):
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("ear", context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.heard: dict[str, Any] = {}
        for topic, kind in topics.items():
            self.node.create_subscription(kind, topic, self._keeper(topic), 1)

    def _keeper(self, topic: str) -> Callable[[Any], None]:
        return lambda message: self.heard.__setitem__(topic, message)

    def until(self, done: Callable[[], bool], awaited: str) -> None:
        end = time.monotonic() + _PATIENCE
        while not done():
            self._executor.spin_once(0.05)
            assert time.monotonic() < end, f"{awaited} was awaited; heard {self.heard}"

    def call(self, kind: type, name: str, **request: Any) -> Any:
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, f"service {name}")
        answer = client.call_async(kind.Request(**request))
        self.until(answer.done, f"an answer of {name}")
        self.node.destroy_client(client)
        return answer.result()

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


def al_states(world: Ear) -> list[str]:
    """AL states of the drives, as the far side of the cable tells them."""
    for status in world.heard[graph.DIAGNOSTICS].status:
        if status.name == graph.DRIVE_SEGMENT:
            return {v.key: v.value for v in status.values}["al_states"].split()
    return []


@pytest.fixture(scope="module")
def clock(tmp_path_factory):
    return slow_clock(tmp_path_factory.mktemp("clock"), _RATE)


@pytest.fixture(scope="module")
def world(clock, tmp_path_factory) -> Iterator[tuple[Ear, Path]]:
    """Run the far end of the wires; yield an ear in its domain, and the file that names them."""
    directory = tmp_path_factory.mktemp("world")
    with own_network(), held_domain("the world's") as domain:
        settings = {graph.PLANT: {"bus": "soem", "catch_up": 1.0, "seed": 1}}
        specs = leave_out(simulated_robot("realtime", settings), _ROBOTS_OWN)
        environment = {**clock, "ROS_DOMAIN_ID": str(domain)}
        with Processes(logs=directory / "logs", environment=environment) as processes:
            processes.start_all(specs)
            topics = {graph.GROUND_TRUTH: Odometry, graph.DIAGNOSTICS: DiagnosticArray}
            ear = Ear(domain, topics)
            ear.until(lambda: graph.GROUND_TRUTH in ear.heard, "the world")
            ear.until(lambda: graph.DIAGNOSTICS in ear.heard and al_states(ear) != [], "drives")
            port = graph.serial_port("vn200", domain)
            file = directory / "hardware.yaml"
            file.write_text(
                "drives: {interface: ecat0, frame_timeout: 0.02, priority: 10}\n"
                f"vn200: {{port: {port}}}\n"
            )
            yield ear, file
            ear.close()


@pytest.fixture(scope="module")
def robot_domain():
    with held_domain("the robot's") as domain:
        yield domain


def bringup(clock, domain: int, *words: object) -> list[Any]:
    command = [sys.executable, "-m", "husky_bringup.bringup", *map(str, words)]
    return [command, {**os.environ, **clock, "ROS_DOMAIN_ID": str(domain)}]


def test_a_dry_run_names_each_device_and_leaves_the_drives_in_init(world, clock, robot_domain):
    ear, file = world
    command, environment = bringup(clock, robot_domain, "--hardware", file, "--dry-run")
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    drives = [line for line in done.stdout.splitlines() if "Gold Twitter, vendor 0x" in line]
    assert len(drives) == 12
    assert "front_left_knee: Gold Twitter, vendor 0x0000009A, product 0x00030924" in drives[2]
    assert drives[2].endswith("serial number 3, PREOP")
    assert "VN-200" in done.stdout and "firmware 1.1.0.1" in done.stdout
    ear.heard.pop(graph.DIAGNOSTICS)
    ear.until(lambda: graph.DIAGNOSTICS in ear.heard and al_states(ear) == ["INIT"] * 12, "INIT")


def test_nothing_is_started_while_a_device_is_missing(world, clock, robot_domain, tmp_path):
    _, file = world
    other = tmp_path / "hardware.yaml"
    port = "/dev/no-such-imu"
    other.write_text(file.read_text().partition("vn200")[0] + f"vn200: {{port: {port}}}\n")
    command, environment = bringup(clock, robot_domain, "--hardware", other)
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"MISSING  vn200 on {port}" in done.stdout
    assert done.stderr.splitlines()[-1] == f"error: nothing is started without vn200 on {port}"
    assert "starting" not in done.stdout


@contextlib.contextmanager
def running(command: list[str], environment: dict[str, str], log: Path) -> Iterator[None]:
    with log.open("w") as output:
        process = subprocess.Popen(command, env=environment, stdout=output, stderr=output)
    try:
        end = time.monotonic() + _PATIENCE
        while "ready: 3 nodes" not in log.read_text():
            assert process.poll() is None and time.monotonic() < end, log.read_text()
            time.sleep(0.2)
        yield
    finally:
        process.terminate()
        code = process.wait(timeout=60.0)
        print(log.read_text()[-4000:])
    assert code == 143, log.read_text()
    assert "Traceback" not in log.read_text(), log.read_text()


def mode_of(robot: Ear) -> str:
    state = robot.heard.get(graph.CONTROLLER_STATE)
    return str(state.mode) if state is not None else ""


def enable(robot: Ear) -> None:
    """Enable the drives, which takes a moment after a reset."""
    end = time.monotonic() + _PATIENCE
    while (answer := robot.call(Trigger, graph.DRIVES_ENABLE)).success is False:
        assert time.monotonic() < end, answer.message
        print(f"not enabled: {answer.message}")
        if "not off" not in answer.message:
            robot.call(Trigger, graph.DRIVES_RESET_FAULTS)
        time.sleep(_RECOVERY)
    robot.heard.pop(graph.DRIVES_STATUS, None)
    robot.until(lambda: reason_of(robot) not in ("unheard", "enabling"), "enabled drives")


def reason_of(robot: Ear) -> str:
    status = robot.heard.get(graph.DRIVES_STATUS)
    return str(status.reason) if status is not None else "unheard"


def stand_up(robot: Ear) -> None:
    """Enable the drives and stand up as an operator does, again where a tick came late."""
    said = []
    for _ in range(_ATTEMPTS):
        enable(robot)
        said.append(robot.heard[graph.DRIVES_STATUS].reason)
        answer = robot.call(SetMode, graph.SET_MODE, mode="stand_up")
        said.append(answer.message)
        if answer.success:
            robot.heard.pop(graph.CONTROLLER_STATE, None)
            robot.until(lambda: mode_of(robot) in _ENDS, "the end of standing up")
            if mode_of(robot) == "stand":
                return
            reasons = [robot.heard[t].reason for t in (graph.CONTROLLER_STATE, graph.DRIVES_STATUS)]
            said.append(" / ".join(reasons))
        robot.call(Trigger, graph.DRIVES_DISABLE)
        robot.call(SetMode, graph.SET_MODE, mode="passive")
        robot.call(Trigger, graph.DRIVES_RESET_FAULTS)
    raise AssertionError(f"it does not stand: {said}")


def test_it_stands_up_and_stops_over_cable_and_serial_line(world, clock, robot_domain, tmp_path):
    ear, file = world
    settings = [w for name, value in _LENIENT.items() for w in ("--set", f"{name}={value}")]
    command, environment = bringup(clock, robot_domain, "--hardware", file, *settings)

    def height() -> float:
        return float(ear.heard[graph.GROUND_TRUTH].pose.pose.position.z)

    topics = {graph.CONTROLLER_STATE: ControllerState, graph.DRIVES_STATUS: DriveStatusArray}
    robot = Ear(robot_domain, topics)
    with contextlib.closing(robot), running(command, environment, tmp_path / "log"):
        robot.until(lambda: set(_ROBOTS_OWN) <= set(robot.node.get_node_names()), "the nodes")
        assert not {graph.PLANT, graph.DRIVE_SEGMENT} & set(robot.node.get_node_names())
        stand_up(robot)
        ear.until(lambda: height() > 0.5, "a world in which it stands")
        ear.until(lambda: al_states(ear) == ["OP"] * 12, "drives in OP")
        robot.call(Trigger, graph.DRIVES_EMERGENCY_STOP)
        robot.until(lambda: not robot.heard[graph.DRIVES_STATUS].operational, "no torque")
        assert robot.heard[graph.DRIVES_STATUS].reason == "emergency stop"
        ear.until(lambda: height() < 0.25, "a world in which it lies")
