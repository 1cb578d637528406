"""A robot that is made up goes to where an operator clicks in the picture of a real browser."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from browser_page import BrowserPage
from console_process import ConsoleBench
from noting_robot import NotingRobot
from visualization_msgs.msg import Marker, MarkerArray

from husky_runtime import graph
from husky_runtime.nodes import qos

pytestmark = [pytest.mark.graph, pytest.mark.slow]

_TOP = -0.5
"""Of the ground [m]."""


@pytest.fixture(scope="module")
def console(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ConsoleBench]:
    console = ConsoleBench(domain, tmp_path_factory.mktemp("console"))
    ground = Marker(type=Marker.CUBE, ns="ground")
    ground.header.frame_id = graph.FRAME_ODOM
    ground.scale.x = ground.scale.y = 20.0
    ground.scale.z, ground.pose.position.z, ground.color.a = 0.1, _TOP - 0.05, 1.0
    publisher = console.node.create_publisher(MarkerArray, graph.TERRAIN, qos.LATCHED)
    publisher.publish(MarkerArray(markers=[ground]))
    console.serve(silence=2.0)
    yield console
    console.close()


def test_a_click_is_a_goal_and_a_drag_is_none(console: ConsoleBench, page: BrowserPage) -> None:
    """The row of the goal in the page, and what ends the waiting for a click."""
    robot, mouse = NotingRobot(console.node), page.page.mouse

    def go_on() -> None:
        for child, parent in ((graph.FRAME_ODOM, "map"), (graph.FRAME_BASE, graph.FRAME_ODOM)):
            console.move(0.0, child, parent)
        page.page.wait_for_timeout(50)

    def shown(condition: Any, what: str) -> None:
        console.wait(condition, what, go_on)

    def arm() -> None:
        page.press("go to", "goals")
        shown(lambda: page.lit("goals") == ["go to"], "that a click is waited for")

    def drag(way: float, height: float = 0.7) -> None:
        box = page.view.locator("canvas").first.bounding_box()
        assert box is not None
        x, y = box["x"] + 0.3 * box["width"], box["y"] + height * box["height"]
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + way, y, steps=4)
        mouse.up()

    with robot.navigator() as goals:
        shown(lambda: page.lit("gaits") == ["trot"], "the robot")
        shown(lambda: page.view.get_by_text("ground", exact=True).count(), "the ground")
        arm()
        drag(60.0)
        for _ in range(20):
            go_on()
        assert not goals and page.lit("goals") == ["go to"]
        drag(0.0)
        shown(lambda: goals, "a goal")
        place, turn = goals[0].pose.position, goals[0].pose.orientation
        assert place.z == pytest.approx(_TOP, abs=1e-4)  # of single precision
        heading = 2.0 * math.atan2(turn.z, turn.w)
        assert math.remainder(heading - math.atan2(place.y, place.x), math.tau) == pytest.approx(0)
        shown(lambda: page.lit("goals") == [], "the end of the waiting")
        page.press("stop going", "goals")
        shown(lambda: page.words("said").endswith("stop going: done"), "the end of the way")
        arm()
        drag(0.0, height=0.01)
        shown(lambda: page.words("said").endswith("go to: there is no ground"), "the sky")
        arm()
        page.page.locator("#stop").click()
        shown(lambda: page.lit("goals") == [], "that a stop ends the waiting")
        drag(0.0)
        for _ in range(20):
            go_on()
        assert len(goals) == 1
