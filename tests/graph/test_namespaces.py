"""Two robots in one ROS domain, each in a namespace of its own, started as a user starts them."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from husky_experiments.recordings.recording import Recording
from husky_msgs.msg import ControllerState
from husky_msgs.srv import SetMode
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.diagnostics import PERIOD

pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[2]
OF_ALL = ("/rosout", "/parameter_events")
"""Topics of ROS that have no namespace."""
NODES = {graph.PLANT, graph.DRIVE_BRIDGE, graph.VN200_DRIVER, graph.LOW_LEVEL_CONTROLLER}
WHILE = 0.5
"""In which one world goes on while the other is looked at [s]."""
_PATIENCE = 120.0
_ASK_AGAIN = 5.0
"""Wall time after which a request is made again [s]; none of them does more by that."""


def bringup(namespace: str, *options: str) -> list[str]:
    """The command line that starts a robot."""
    quickly = ("stand.duration=0.8", "stand.joint_speed=5.0", "grace=20.0")
    settings = [f"{graph.LOW_LEVEL_CONTROLLER}.{each}" for each in quickly]
    settings += [f"{node}.grace=20.0" for node in (graph.PLANT, graph.DRIVE_BRIDGE)]
    settings += [f"{node}.{PERIOD}=0.2" for node in NODES]
    settings.append(f"{graph.PLANT}.start_paused=true")
    chosen = [word for each in settings for word in ("--set", each)]
    script = str(ROOT / "scripts/bringup.sh")
    return [script, "--namespace", namespace, "--time", "lockstep", *chosen, *options]


class Operator:
    """Who operates one robot: all names are relative, as in any node below its namespace."""

    def __init__(self, context: Context, namespace: str):
        self.node = Node("operator", namespace=namespace, context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.state: ControllerState | None = None
        self.truth: Odometry | None = None
        self.reports: dict[str, int] = {}
        self.answer: Any = None
        self.clients: dict[str, Client] = {}
        subscribe = self.node.create_subscription
        subscribe(ControllerState, graph.CONTROLLER_STATE, self._on_state, qos.STATUS)
        subscribe(Odometry, graph.GROUND_TRUTH, self._on_truth, qos.STATUS)
        subscribe(DiagnosticArray, graph.DIAGNOSTICS, self._on_report, qos.STATUS)

    def _on_state(self, state: ControllerState) -> None:
        self.state = state

    def _on_truth(self, truth: Odometry) -> None:
        self.truth = truth

    def _on_report(self, report: DiagnosticArray) -> None:
        self.reports[report.status[0].name] = stamps.to_ns(report.header.stamp)

    def __str__(self) -> str:
        """What was seen last."""
        return f"{self.mode}, reports of {self.reports}, last answer {self.answer}"

    @property
    def mode(self) -> str:
        return self.state.mode if self.state is not None else ""

    @property
    def height(self) -> float:
        return self.truth.pose.pose.position.z if self.truth is not None else float("nan")

    @property
    def time(self) -> float:
        """Of the truth that was told last [s]."""
        return stamps.to_ns(self.truth.header.stamp) / 1e9 if self.truth is not None else 0.0

    def until(self, predicate: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + _PATIENCE
        while not predicate():
            assert time.monotonic() < deadline, f"waited for {what}; {self}"
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, kind: Any, service: str, **fields: Any) -> Any:
        """Ask until there is an answer: the first one to a new client may be lost."""
        if service not in self.clients:
            self.clients[service] = self.node.create_client(kind, service)
        client = self.clients[service]
        self.until(client.service_is_ready, service)
        asked: list[Future] = []
        again = 0.0

        def answered() -> bool:
            nonlocal again
            if time.monotonic() > again:
                again = time.monotonic() + _ASK_AGAIN
                asked.append(client.call_async(kind.Request(**fields)))
            return any(future.done() for future in asked)

        self.until(answered, f"an answer of {service}")
        self.answer = next(future.result() for future in asked if future.done())
        return self.answer

    def pause(self, paused: bool) -> None:
        """Let the world stand still, or go on."""
        assert self.call(SetBool, graph.PLANT_PAUSE, data=paused).success

    def stand(self) -> None:
        self.until(lambda: self.mode == "passive", "the controller")
        self.until(
            lambda: self.call(Trigger, graph.DRIVES_ENABLE).message == "enabled", "the drives"
        )
        self.until(lambda: self.call(SetMode, graph.SET_MODE, mode="stand_up").success, "stand_up")
        self.until(lambda: self.mode == "stand", "standing")


@pytest.fixture(scope="module")
def robots(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The operators of both robots; the first one's bag, and the processes that end it."""
    directory = tmp_path_factory.mktemp("robots")
    commands = [
        bringup("robot1", "--record", str(directory / "bag")),
        bringup("/fleet/robot2"),
    ]
    context = Context()
    rclpy.init(context=context)
    with contextlib.ExitStack() as stack:
        outputs = [stack.enter_context((directory / f"{i}.log").open("w")) for i in (1, 2)]
        started = [
            subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
            for command, output in zip(commands, outputs, strict=True)
        ]
        operators = [Operator(context, name) for name in ("/robot1", "/fleet/robot2")]
        try:
            yield *operators, directory / "bag", started
        finally:
            for process in started:
                process.terminate()
            codes = [process.wait(_PATIENCE) for process in started]
            for operator in operators:
                operator.node.destroy_node()
            rclpy.shutdown(context=context)
        assert codes == [128 + signal.SIGTERM] * 2
        said = "".join((directory / f"{i}.log").read_text() for i in (1, 2))
        assert "Traceback" not in said, said[-5000:]


def test_one_stands_up_and_the_other_does_not_hear_of_it(robots: Any) -> None:
    """A world stands still while nobody looks at it: it takes a processor."""
    first, second, _, _ = robots
    first.pause(False)
    first.stand()
    first.pause(True)
    second.pause(False)
    second.until(lambda: second.mode == "passive" and second.truth is not None, "the second robot")
    assert first.height > 0.5 and second.height < 0.4
    second.stand()
    assert second.height > 0.5
    second.pause(True)


def test_names_are_below_the_namespaces(robots: Any) -> None:
    """Topics, services and actions, and who has them."""
    node = robots[0].node
    found: dict[str, set[str]] = {}
    for name, namespace in node.get_node_names_and_namespaces():
        if not name.startswith("_"):  # hidden
            found.setdefault(namespace, set()).add(name)
    assert found["/robot1"] == {*NODES, graph.RECORDER, "operator"}
    assert found["/fleet/robot2"] == {*NODES, "operator"}
    names = [name for name, _ in node.get_topic_names_and_types() if name not in OF_ALL]
    names += [name for name, _ in node.get_service_names_and_types()]
    outside = [name for name in names if not name.startswith(("/robot1/", "/fleet/robot2/"))]
    assert outside == []
    every_robot = (graph.CLOCK, graph.JOINT_STATES, graph.JOINT_COMMAND, graph.IMU, graph.SET_MODE)
    for namespace in ("/robot1", "/fleet/robot2"):
        assert {graph.absolute(name, namespace) for name in every_robot} <= set(names)
    for name in names:
        ends = [
            *node.get_publishers_info_by_topic(name),
            *node.get_subscriptions_info_by_topic(name),
        ]
        for end in ends:
            assert name.startswith(f"{end.node_namespace}/"), f"{end.node_name} has {name}"


def test_each_has_its_own_time(robots: Any) -> None:
    """One world stands still, the other goes on."""
    first, second, _, _ = robots
    second.reports.clear()
    second.until(lambda: second.reports.keys() == NODES, "reports of the second robot")
    second.reports.clear()
    second.until(lambda: second.reports.keys() == NODES, "reports of a world that stands still")
    (now,) = set(second.reports.values())
    begun = first.time
    first.pause(False)
    first.until(lambda: first.time > begun + WHILE, "the time of the first")
    second.reports.clear()
    second.until(lambda: second.reports.keys() == NODES, "reports of the second robot")
    assert set(second.reports.values()) == {now}


def test_an_emergency_stop_stops_one(robots: Any) -> None:
    first, second, _, _ = robots
    assert first.call(Trigger, graph.DRIVES_EMERGENCY_STOP).success
    first.until(lambda: first.mode == "damping", "damping of the first")
    first.pause(True)
    begun = second.time
    second.pause(False)
    second.until(lambda: second.time > begun + WHILE, "the time of the second")
    assert second.mode == "stand" and second.height > 0.5
    second.pause(True)


def test_a_second_one_of_that_name_is_refused(robots: Any, domain: int) -> None:
    again = subprocess.run(bringup("robot1"), capture_output=True, text=True, timeout=_PATIENCE)
    (line,) = again.stderr.splitlines()
    assert again.returncode == 1
    assert f"this robot runs already in ROS domain {domain}, namespace /robot1: " in line


def test_a_recorder_keeps_its_own_robot(robots: Any) -> None:
    _, _, bag, (process, _) = robots
    process.terminate()
    process.wait(_PATIENCE)
    recording = Recording(bag)
    heard = {name for name, count in recording.counts.items() if count}
    assert heard - set(OF_ALL) and "/rosout" in heard
    assert {name for name in heard if not name.startswith("/robot1/")} <= set(OF_ALL)
    assert "stand" in recording.controller.mode
    assert recording.base.position[:, 2].max() > 0.5


def test_what_is_no_namespace_is_refused() -> None:
    told = subprocess.run(
        [ROOT / "scripts/bringup.sh", "--namespace", "robot-1"], capture_output=True, text=True
    )
    assert told.returncode == 2
    assert "'robot-1' is no namespace: letters, digits and _" in told.stderr
