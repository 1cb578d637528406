"""Requests of the navigator to the robot, over services that take note of them."""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.task import Future

from husky_msgs.msg import PropulsionState
from husky_navigation.following.robot_wish import FlightHeights, Wish
from husky_navigation.nodes.robot_commands import RobotCommands

HEIGHTS = FlightHeights(0.75, 0.3)
FLIES = Wish("quadrotor", fans=True, heights=HEIGHTS)


class Service:
    """A client, whose requests are answered from a type's defaults; refused, or without results."""

    def __init__(self, kind: Any) -> None:
        self._kind, self.requests = kind, list[Any]()

    def service_is_ready(self) -> bool:
        return True

    def call_async(self, request: Any) -> Future:
        self.requests.append(request)
        future = Future()
        future.set_result(self._kind.Response())
        return future


class Robot:
    """A node, and what is asked of it by name of the service's type."""

    def __init__(self) -> None:
        self.services: dict[str, Service] = {}
        self.commands = RobotCommands(self, lambda: None)  # type: ignore[arg-type]
        self.time = 0.0

    def create_publisher(self, *_: object) -> Robot:
        return self

    def publish(self, _: object) -> None:
        """Take a velocity."""

    def create_client(self, kind: Any, _: str) -> Service:
        return self.services.setdefault(kind.__name__, Service(kind))

    def asked(self, kind: str) -> int:
        return len(self.services[kind].requests)

    def follow(self, wish: Wish, mode: str) -> None:
        self.time += 1.0
        self.commands.follow(wish, mode, self.time)


@pytest.mark.parametrize(("mode", "asks"), [("splay", True), ("quadrotor", False), ("wair", False)])
def test_a_pilot_who_has_taken_over_keeps_the_robot(mode: str, asks: bool) -> None:
    robot = Robot()
    for state in (
        PropulsionState(connected=True, armed=True, mode="STABILIZED"),
        PropulsionState(connected=True, armed=False, mode="OFFBOARD"),
    ):
        robot.commands.hear(state)
        robot.follow(Wish("wair", fans=True) if mode == "wair" else FLIES, mode)
    assert (robot.asked("SetFlightMode"), robot.asked("SetBool")) == (asks, asks)


def test_heights_are_set_anew_for_each_flight() -> None:
    robot = Robot()
    for _ in range(3):
        robot.follow(FLIES, "quadrotor")
    assert robot.asked("SetParameters") == 1
    robot.follow(Wish("walk"), "perch")
    robot.follow(FLIES, "splay")
    assert robot.asked("SetParameters") == 2


def test_a_landing_that_was_asked_for_is_known_until_the_next_mode() -> None:
    robot = Robot()
    robot.follow(FLIES, "quadrotor")
    assert not robot.commands.lands
    robot.follow(Wish("stand"), "quadrotor")
    robot.follow(FLIES, "quadrotor")
    assert robot.commands.lands
    robot.follow(Wish("stand"), "splay")
    assert not robot.commands.lands
