"""The running graph as a test sees it: what moves, what is said, and how to break and mend it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from starvation import Beside
from std_srvs.srv import Trigger

from husky_experiments.hearing import waiting
from husky_experiments.scripts import walk
from husky_experiments.session import Session, SessionError
from husky_msgs.msg import ServoCommand, ServoState
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

GRACE = 2.0
"""Wall time after which the nodes give up a silent peer in these tests [s]."""
STOP_TIME = 0.6
"""No joint may get a torque later than this after a stop, or its command source's death [s]."""
STOP_TILT = 20.0
"""Tilt of the body that a stop on level ground may end in [deg]."""
QUICKLY = {"stand.duration": 0.8, "stand.joint_speed": 5.0}
"""Parameters of the controller: it stands up in 1 s instead of 3."""
SETTINGS = {
    graph.PLANT: {"grace": GRACE, "seed": 1},
    graph.DRIVE_BRIDGE: {"grace": GRACE},
    graph.LOW_LEVEL_CONTROLLER: {"grace": GRACE, **QUICKLY},
}
"""Parameters of a graph that is to be broken."""
_SPEED = 0.3
_WARM_UP = 0.6
"""After so long a trot from standing is as it will be: nearly two of its periods [s]."""
_GOING_ON = 0.2
"""Of a trot under way: the command is the usual one again [s]."""


@contextlib.contextmanager
def running(directory: Path, settings: Mapping[str, Any], **options: Any) -> Iterator[Session]:
    """Start a graph; at its end each node ends as it should, and none has failed unseen."""
    session = Session(directory, settings, **options)
    try:
        yield session
    finally:
        codes = session.close()
    logs = {log.stem: log.read_text(errors="replace") for log in directory.glob("logs/*.log")}
    for name, code in codes.items():
        # What a node that crashed or hung at its end did last, faulthandler has written there.
        assert code == 0, f"{codes}, {name} says:\n{logs[name][-5000:]}"
    for name, text in logs.items():
        assert "Traceback" not in text, f"{name} says:\n{text[-3000:]}"


class Tap:
    """Keeps every message of a topic of every tick, without waking up for each."""

    def __init__(self, node: Node, kind: type, topic: str, reliable: bool = False):
        how = qos.STATUS if reliable else qos.CONTROL
        profile = QoSProfile(depth=4000, reliability=how.reliability)
        self._node = node
        self._subscription = node.create_subscription(kind, topic, lambda message: None, profile)
        self.messages: list[Any] = []

    def drain(self) -> list[Any]:
        """Fetch what has come; return all messages since `clear`."""
        self.messages.extend(waiting(self._subscription))
        return self.messages

    def clear(self) -> None:
        """Forget everything so far."""
        self.drain()
        self.messages.clear()

    def close(self) -> None:
        """Keep nothing any more."""
        self._node.destroy_subscription(self._subscription)


class Robot:
    """The running graph as a test sees it: from outside, in simulated time."""

    def __init__(self, session: Session):
        self.session = session
        # not in the session's executor: nobody wakes up for its messages
        self._ear = Node("ear", context=session.context)
        self._taps: list[Tap] = []
        self._states = self.tap(ServoState, graph.SERVO_STATE)
        self._commands = self.tap(ServoCommand, graph.SERVO_COMMAND)
        self.reports: dict[str, DiagnosticStatus] = {}
        self._refusal = ""
        self._beside: Beside | None = None
        self._told: Callable[[], object] = lambda: ""
        session.subscribe(DiagnosticArray, graph.DIAGNOSTICS, self._on_diagnostics)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            self.reports[status.name] = status

    def tap(self, kind: type, topic: str, reliable: bool = False) -> Tap:
        """Return a tap on a topic; one that is not of every tick may be heard reliably."""
        self._taps.append(Tap(self._ear, kind, topic, reliable))
        return self._taps[-1]

    def close_taps(self) -> None:
        """Close all taps but the robot's own: whoever has made them has gone."""
        while len(self._taps) > 2:
            self._taps.pop().close()

    def close(self) -> None:
        """Leave the graph; its nodes run on."""
        self._ear.destroy_node()

    # What is seen ---------------------------------------------------------------------------
    @property
    def mode(self) -> str:
        """Mode of the controller, "" before it has spoken."""
        return self.session.state.mode if self.session.state is not None else ""

    @property
    def seen(self) -> str:
        """What was seen last, for failures."""
        s = self.session
        mode = f"{s.state.mode} ({s.state.reason})" if s.state is not None else "silent"
        drives = "silent"
        if s.drives is not None:
            states = sorted({drive.state for drive in s.drives.drives})
            drives = f"{', '.join(states)} ({s.drives.reason})"
        reports = {name: status.message for name, status in self.reports.items()}
        return (
            f"t {s.time:.3f} s, mode {mode}, drives {drives}, height {self.height:.3f} m, "
            f"last refusal {self._refusal!r}, {reports} {self._told()}"
        )

    @property
    def height(self) -> float:
        """True height of the base [m], nan when it has not been told."""
        truth = self.session.truth
        return truth.pose.pose.position.z if truth is not None else float("nan")

    @property
    def tilt(self) -> float:
        """True angle of the body's z axis from up [deg]."""
        q = self.session.truth.pose.pose.orientation
        return math.degrees(2.0 * math.asin(min(1.0, math.hypot(q.x, q.y))))

    @property
    def stands(self) -> bool:
        """Whether the robot stands on its feet and all is well, as `recover` leaves it."""
        s = self.session
        return s.drives is not None and s.drives.operational and self.mode == "stand"

    @property
    def trots(self) -> bool:
        """Whether the robot walks and all is well."""
        drives = self.session.drives
        upright = 0.5 < self.height < 0.6
        return drives is not None and drives.operational and self.mode == "walk" and upright

    def torques(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and the largest motor current at each [A], since `watch`."""
        messages = self._states.drain()
        times = np.array([stamps.to_ns(m.stamp) / 1e9 for m in messages])
        return times, np.array([np.abs(m.current).max() for m in messages])

    def commands(self) -> list[ServoCommand]:
        """Return the servo commands since `watch`."""
        return self._commands.drain()

    def kinds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and the kinds of servo command (n, 12), since `watch`."""
        messages = self._commands.drain()
        times = np.array([stamps.to_ns(m.stamp) / 1e9 for m in messages])
        return times, np.array([m.kind for m in messages]).reshape(-1, 12)

    def watch(self) -> float:
        """Look at torques and commands from now on; return the time now [s]."""
        self._states.clear()
        self._commands.clear()
        return self.session.time

    def torque_ends(self, since: float, within: float = STOP_TIME) -> float:
        """Return how long after a stop, or the end of a command source, the last torque acted [s].

        That must not be later than `within`.
        """
        times, currents = self.torques()
        assert len(times) > 20 and times[-1] > since + within + 0.05, "the tap heard too little"
        loaded = times[(currents > 0.0) & (times > since)]
        ends = float(loaded[-1] - since) if len(loaded) else 0.0
        assert ends <= within + 1e-9, f"a torque {ends:.3f} s after its source has died"
        return ends

    def put_down(self, since: float, within: float = STOP_TIME) -> float:
        """Return `torque_ends` of a stop that has put the robot down upright, on its perch."""
        ends = self.torque_ends(since, within)
        assert self.tilt < STOP_TILT and self.height < 0.25, f"{self.tilt:.0f} deg; {self.seen}"
        return ends

    def settled(self, since: float) -> float:
        """Return how long after a fault the joints were damped, the robot put down upright [s]."""
        times, kinds = self.kinds()
        damped = times[(kinds == ServoCommand.VELOCITY).all(axis=1) & (times >= since)]
        assert len(damped), f"the joints are not damped; last seen: {self.seen}"
        assert self.mode == "damping" and self.tilt < STOP_TILT and self.height < 0.25, self.seen
        took = float(damped[0] - since)
        assert took <= STOP_TIME + 0.03, f"damped after {took:.3f} s"
        return took

    def all_off(self, since: float) -> float:
        """Return how long after a fault all power stages were off for good [s]."""
        times, kinds = self.kinds()
        on = times[(kinds != ServoCommand.TORQUE_OFF).any(axis=1) & (times >= since)]
        assert len(times) and not kinds[-1].any(), f"power is on; last seen: {self.seen}"
        return float(on[-1] + graph.TICK_PERIOD - since) if len(on) else 0.0

    # What is done ---------------------------------------------------------------------------
    @contextlib.contextmanager
    def beside(self, process: Any, told: Callable[[], object] = lambda: "") -> Iterator[None]:
        """Let the world wait for a process beside the graph too, as far as `advance` moves it.

        Args:
            process: as `subprocess` has it.
            told: what it has told last, for failures.
        """
        self._beside, self._told = Beside(process.pid), told
        try:
            yield
        finally:
            self._beside, self._told = None, lambda: ""

    def advance(self, duration: float) -> None:
        """Let the world go on for a while [s]."""
        if self._beside is not None:
            self._beside.advance(self.session, duration)
        else:
            self.session.advance(duration)

    def until(
        self, predicate: Callable[[], bool], what: str, within: float, step: float = 0.01
    ) -> float:
        """Advance, step by step, until a predicate holds; return the time that took [s]."""
        start = self.session.time
        while not predicate():
            if self.session.time >= start + within - 1e-9:
                pytest.fail(f"waited {within} s for {what}; last seen: {self.seen}")
            self.advance(step)
        return self.session.time - start

    def until_damped(self) -> None:
        """Advance little by little until a controller that was lost damps the joints."""
        self._reported("damping")
        drives = self.session.drives
        assert not drives.operational and not drives.emergency_stop, self.seen

    def _reported(self, mode: str) -> None:
        """Advance little by little until the controller reports a mode.

        The world does not wait for a controller that was lost, and may be far ahead of it.
        """

        def reported() -> bool:
            with self.session.unheard(graph.LOW_LEVEL_CONTROLLER):
                self.session.advance(0.02)
            return self.mode == mode

        with self._telling_what_is_seen():
            self.session.wait_for(reported, f"the mode {mode}")

    @contextlib.contextmanager
    def _telling_what_is_seen(self) -> Iterator[None]:
        try:
            yield
        except SessionError as error:
            raise SessionError(f"{error}; {self.seen}") from error

    def reported(self, node: str, *texts: str) -> DiagnosticStatus:
        """Wait until a node says one of these on /diagnostics; the world stands still meanwhile."""
        self.reports.pop(node, None)

        def said() -> bool:
            return node in self.reports and any(t in self.reports[node].message for t in texts)

        try:
            self.session.wait_for(said, f"{' or '.join(texts)} of {node} on {graph.DIAGNOSTICS}")
        except SessionError as error:
            pytest.fail(f"{error}; last seen: {self.seen}")
        return self.reports[node]

    def told(self, node: str, key: str) -> int:
        """Return a counter of a node's next report on /diagnostics."""
        values = self.reported(node, "").values
        return int(next(entry.value for entry in values if entry.key == key))

    def trigger(self, service: str) -> str:
        """Call a service that takes nothing; return "" or why it refused."""
        response = self.session.call(service, Trigger.Request())
        self._refusal = "" if response.success else str(response.message)
        return self._refusal

    def ask(self, kind: Any, service: str, **fields: Any) -> Any:
        """Call any service of the graph as a stranger to the session; return its answer."""
        context = self.session.context
        node, executor = Node("asker", context=context), SingleThreadedExecutor(context=context)
        executor.add_node(node)
        client = node.create_client(kind, service)
        assert client.wait_for_service(60.0), f"there is no {service}; {self.seen}"
        future = client.call_async(kind.Request(**fields))
        executor.spin_until_future_complete(future, timeout_sec=60.0)
        assert future.done(), f"{service} does not answer; {self.seen}"
        executor.shutdown()
        node.destroy_node()
        return future.result()

    def enable(self) -> None:
        """What an operator does after a fault: passive, reset faults, enable."""
        s = self.session
        s.release_velocity()
        s.advance(0.04)  # until the controller has reported its mode of now
        self.until(lambda: self.mode not in ("", "settle"), "a settled robot", within=1.0)
        if self.mode != "passive":
            s.set_mode("passive")
            self._reported("passive")
        self.until(self._may_enable, "drives that can be enabled", within=2.0)
        assert self.mode == "passive", self.seen

    def stand(self) -> None:
        """Enable the drives and stand up."""
        self.enable()
        with self._telling_what_is_seen():
            self.session.set_mode("stand_up")
        self.until(lambda: self.mode == "stand", "stand", within=10.0, step=0.05)
        assert self.height > 0.5, self.seen

    def recover(self) -> None:
        """The way back from a fault: enable where the robot lies, set it on its feet, stand up.

        Wherever it lies, a reset of the world puts it back.
        """
        self.enable()
        self.start_again()
        self.stand()

    def _may_enable(self) -> bool:
        """Reset faults and enable, as far as the drives have come."""
        s = self.session
        # Asked, not read from /drives/status: an answer is of this very tick.
        answer = s.call(graph.DRIVES_ENABLE, Trigger.Request())
        if answer.message == "enabled":
            s.advance(0.04)
            return s.drives is not None and bool(s.drives.operational)
        if "nodes publish" in answer.message:  # a dead node is listed until its lease is over
            s.wait_for(
                lambda: "nodes publish" not in self.trigger(graph.DRIVES_ENABLE),
                f"one node at {graph.JOINT_COMMAND}",
            )
        elif not answer.success and "not off" not in answer.message:
            self.trigger(graph.DRIVES_RESET_FAULTS)
        s.advance(0.1)
        return False

    def trot(self) -> None:
        """Trot for a while, from standing or on."""
        duration = _GOING_ON if self.trots else _WARM_UP
        self.session.set_gait("trot")
        walk(self.session, duration, (_SPEED, 0.0, 0.0))
        assert self.mode == "walk", self.seen

    def start_again(self) -> None:
        """Put the world back and heal all devices; start nodes that are missing."""
        s = self.session
        for spec in s.specs:
            if not s.processes.running(spec.name):
                s.start(spec.name)
        s.inject(graph.DRIVES_INJECT_FAULT, "", "")
        s.inject(graph.PLANT_INJECT_FAULT, "imu", "")
        s.reset(seed=1)
