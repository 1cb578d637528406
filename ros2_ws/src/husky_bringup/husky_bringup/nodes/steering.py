"""What operators in browsers ask of the robot, on its way to topics and services."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from functools import partial
from queue import Empty, Full, Queue
from typing import Any

import msgspec
from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from husky_bringup.console.operator_server import OperatorServer
from husky_bringup.console.operators import Ask, Operators, Rules
from husky_bringup.console.page import SILENT
from husky_bringup.console.panels import drives_in_words, fans_in_words
from husky_bringup.nodes.robot_operator import (
    COMMAND_RATE,
    RobotOperator,
    declare_layout,
    declare_limits,
)
from husky_bringup.teleop_mapping import Action
from husky_msgs.msg import ModeTable, PropulsionState
from husky_msgs.srv import SetFlightMode
from husky_runtime import graph
from husky_runtime.nodes.executor import wake
from husky_runtime.nodes.parameters import declare

SOURCES = (
    graph.MODE_TABLE,
    graph.CONTROLLER_STATE,
    graph.DRIVES_STATUS,
    graph.PROPULSION_STATE,
)
"""Topics of which it has to know."""
_WAITING = 32
"""Requests that wait for the node's thread."""
_LATE = 2.0
"""How old a request may be, other than an emergency stop [s]."""
_STOPS = (("action", Action.EMERGENCY_STOP.value), ("mode", "emergency_stop"))


class Steering:
    """Hears operators, and does what they want in the node's thread.

    Attributes:
        server: of the page.
    """

    def __init__(self, node: Node):
        """Declare what holds for operators, and serve them."""
        self._node = node
        limits, layout = declare_limits(node), declare_layout(node)
        what = "how long a browser's word to move counts, and how late it may come [s]"
        silence = declare(node, "silence", 0.5, what, lower=0.1, upper=2.0)
        self._robot = RobotOperator(node)
        self._operators = Operators(Rules(limits, layout, silence))
        self._asked: Queue[Ask] = Queue(_WAITING)
        self._stop_asked = threading.Event()
        self._table = ModeTable()
        self._fans: PropulsionState | None = None
        self._heard = 0.0
        self._askable = self._connect()
        self.server = OperatorServer(self._operators, self._ask)
        node.create_timer(1.0 / COMMAND_RATE, self._turn)

    def _connect(self) -> dict[tuple[str, str], Callable[[], None]]:
        """Return what each button does, but for those that carry a name."""
        robot, meet = self._robot, self._node.create_client
        disable = meet(Trigger, graph.DRIVES_DISABLE)
        arm = meet(SetBool, graph.PROPULSION_ARM)
        kill = meet(Trigger, graph.PROPULSION_KILL)
        self._flight_mode_client: Client = meet(SetFlightMode, graph.PROPULSION_SET_MODE)
        actions = {("action", each.value): each for each in Action}
        return {
            **{key: partial(robot.act, each) for key, each in actions.items()},
            ("drives", "enable"): robot.enable,
            ("drives", "disable"): lambda: robot.call(disable, Trigger.Request(), "disable drives"),
            ("drives", "reset faults"): robot.reset_faults,
            ("fans", "arm"): lambda: robot.call(arm, SetBool.Request(data=True), "arm"),
            ("fans", "disarm"): lambda: robot.call(arm, SetBool.Request(data=False), "disarm"),
            ("fans", "kill"): lambda: robot.call(kill, Trigger.Request(), "kill"),
        }

    def __len__(self) -> int:
        """Return how many operators there are."""
        return len(self._operators)

    # The server's thread ----------------------------------------------------------------------
    def _ask(self, ask: Ask, age: float) -> None:
        """Have something done by the node's thread; an emergency stop goes before all else."""
        if (ask.what, ask.value) in _STOPS:
            self._stop_asked.set()
        elif age > _LATE:
            self._robot.tell(f"{ask.value}: came too late, ask again")
        else:
            try:
                self._asked.put_nowait(ask)
            except Full:
                self._robot.tell(f"{ask.value}: too much is asked at once")
        wake(self._node)

    # The node's thread ------------------------------------------------------------------------
    def serve(self) -> bool:
        """Do what has been asked; return whether there was something."""
        did = False
        if self._stop_asked.is_set():
            self._stop_asked.clear()
            with contextlib.suppress(Empty):
                while True:
                    self._asked.get_nowait()
            self._do(Ask(*_STOPS[0]))
            did = True
        while not self._asked.empty():
            self._do(self._asked.get_nowait())
            did = True
        return did

    def _do(self, ask: Ask) -> None:
        button = self._askable.get((ask.what, ask.value))
        if ask.what in ("action", "mode") and ask.value != Action.NEXT_GAIT.value:
            self._operators.stop(time.monotonic())
        if button is not None:
            button()
        elif ask.what == "mode":
            self._robot.set_mode(ask.value)
        elif ask.what == "gait":
            self._robot.set_gait(ask.value)
        elif ask.what == "flight mode":
            request = SetFlightMode.Request(mode=ask.value)
            self._robot.call(self._flight_mode_client, request, ask.value)
        else:
            self._robot.tell(f"there is nothing called {ask.what} {ask.value}")

    def take(self, topic: str, message: Any, wall_time: float) -> None:
        """Take a message of one of `SOURCES`, at a wall time [s]."""
        if topic == graph.MODE_TABLE:
            self._table = message
            self._robot.gaits = list(message.gaits)
        elif topic == graph.CONTROLLER_STATE:
            self._robot.state, self._heard = message, wall_time
        elif topic == graph.DRIVES_STATUS:
            self._robot.drives = message
        else:
            self._fans = message

    def forget(self) -> None:
        """Nobody listens to the robot any more: what is known of it will be old."""
        self._robot.state = self._robot.drives = self._fans = None

    def _turn(self) -> None:
        """Send the velocity that an operator holds; tell all how things stand."""
        now = time.monotonic()
        self._robot.go_on(now)
        command = self._operators.command(now)
        if command is not None:
            self._robot.drive(command)
        told = self._tell(now) if len(self._operators) else {}  # who comes next is told no old news
        self.server.robot = msgspec.json.encode(told)

    def _tell(self, now: float) -> dict[str, Any]:
        state, drives, fans = self._robot.state, self._robot.drives, self._fans
        told: dict[str, Any] = {
            "said": self._robot.said,
            "gaits": list(self._table.gaits),
            "mode": "",
            "why": "no word from the controller",
        }
        if state is not None and now - self._heard < SILENT:
            told |= {"mode": state.mode, "why": state.reason, "gait": state.gait}
        possible = next((m.requests for m in self._table.modes if m.name == told["mode"]), ())
        told["modes"] = [
            {"name": mode.name, "meaning": mode.meaning, "possible": mode.name in possible}
            for mode in self._table.modes
        ]
        if drives is not None:
            told["drives"] = drives_in_words(drives)
        if fans is not None:
            told["fans"] = fans_in_words(fans)
        return told

    def close(self) -> None:
        """Stop the robot if it was being moved, and let the operators go."""
        moving = self._operators.command(time.monotonic()) is not None
        self.server.close()
        if moving:
            self._robot.halt()
