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
from husky_bringup.console.operators import Ask, Operator, Operators, Rules
from husky_bringup.console.told import tell
from husky_bringup.nodes.robot_operator import (
    COMMAND_RATE,
    RobotOperator,
    declare_layout,
    declare_limits,
)
from husky_bringup.outcome import Outcome
from husky_bringup.teleop_mapping import Action
from husky_msgs.msg import PropulsionState
from husky_msgs.srv import SetFlightMode
from husky_runtime import graph
from husky_runtime.nodes.executor import wake
from husky_runtime.nodes.one_clock import longest_look
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
"""How old a request may be, other than a stop [s]."""
_STOPS = {
    ("action", Action.CUT.value): Action.CUT,
    ("action", Action.EMERGENCY_STOP.value): Action.EMERGENCY_STOP,
    ("mode", "emergency_stop"): Action.EMERGENCY_STOP,
}
"""Requests that always count, and before all others."""


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
        self._robot = RobotOperator(node, limits)
        self._operators = Operators(Rules(limits, layout, silence, longest_look(node)))
        self._asked: Queue[tuple[Operator, Ask]] = Queue(_WAITING)
        self._stops_asked: dict[Action, Operator] = {}
        self._stops_lock = threading.Lock()
        self._fans: PropulsionState | None = None
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
    def _ask(self, operator: Operator, ask: Ask, age: float) -> None:
        """Have something done by the node's thread; a stop goes before all else."""
        stop = _STOPS.get((ask.what, ask.value))
        if stop is not None:
            with self._stops_lock:
                self._stops_asked[stop] = operator
        elif age > _LATE:
            operator.outcome = Outcome.refusal(f"{ask.value}: came too late, ask again")
        else:
            try:
                self._asked.put_nowait((operator, ask))
            except Full:
                operator.outcome = Outcome.refusal(f"{ask.value}: too much is asked at once")
        wake(self._node)

    # The node's thread ------------------------------------------------------------------------
    def serve(self) -> bool:
        """Do what has been asked; return whether there was something."""
        with self._stops_lock:
            stops, self._stops_asked = self._stops_asked, {}
        if stops:
            with contextlib.suppress(Empty):
                while True:
                    self._asked.get_nowait()
        for action, operator in sorted(stops.items(), key=lambda each: each[0] is not Action.CUT):
            self._do(operator, Ask("action", action.value))
        did = bool(stops)
        while not self._asked.empty():
            self._do(*self._asked.get_nowait())
            did = True
        return did

    def _do(self, operator: Operator, ask: Ask) -> None:
        """Do what an operator asks for, who alone is told how it goes."""
        button = self._askable.get((ask.what, ask.value))
        if ask.what in ("action", "mode") and ask.value != Action.NEXT_GAIT.value:
            self._operators.stop(time.monotonic())
        operator.outcome = self._robot.outcome = Outcome()
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
            self._robot.outcome.refuse("", f"there is nothing called {ask.what} {ask.value}")

    def take(self, topic: str, message: Any) -> None:
        """Take a message of one of `SOURCES`."""
        if topic == graph.MODE_TABLE:
            self._robot.table = message
            self._robot.gaits = list(message.gaits)
        elif topic == graph.CONTROLLER_STATE:
            self._robot.hear(message)
        elif topic == graph.DRIVES_STATUS:
            self._robot.drives = message
        else:
            self._fans = message

    def forget(self) -> None:
        """Nobody has listened to the robot up to now: what is known of it is old."""
        self._fans = None
        self._robot.forget()

    def _turn(self) -> None:
        """Send the velocity that an operator holds; tell all how things stand."""
        self._robot.go_on()
        command = self._operators.command(time.monotonic())
        driver = self._operators.driver
        if command is not None and driver is not None:
            self._robot.outcome = driver.outcome
            self._robot.drive(command)
        told: dict[str, Any] = {}  # who comes next is told no old news
        if len(self._operators):
            told = tell(self._robot.known(), self._fans)
        self.server.robot = msgspec.json.encode(told)

    def close(self) -> None:
        """Stop the robot if it was being moved, and let the operators go."""
        moving = self._operators.command(time.monotonic()) is not None
        self.server.close()
        if moving:
            self._robot.halt()
