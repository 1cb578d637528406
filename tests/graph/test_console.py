"""The page of the console beside the walking robot."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from page_client import PageClient
from served_bench import ServedBench

from husky_bringup.console.description import read_description
from husky_description.robot import load_robot
from husky_description.urdf import build_urdf
from husky_runtime import graph

pytestmark = pytest.mark.graph

BODY = "/scene/torso"


@pytest.fixture(scope="module")
def console(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedBench]:
    console = ServedBench(domain, tmp_path_factory.mktemp("console"), "husky_bringup.nodes.console")
    console.serve()
    yield console
    console.close()


@pytest.fixture
def page(console: ServedBench) -> PageClient:
    console.clients.append(PageClient(console.address))
    return console.clients[-1]


def tells(page: PageClient, text: str) -> bool:
    """Whether a table of the page has a cell of this text."""
    return any(f">{text}</td>" in html for html in page.contents())


def test_a_robot_whose_legs_carry_nothing(
    robot: Any, console: ServedBench, page: PageClient
) -> None:
    """It has no margin to the edge of its support, and tells of its mode all the same."""
    robot.until(lambda: tells(page, "passive"), "the mode", within=20.0, step=0.1)
    assert not any(robot.session.state.contact) and math.isnan(robot.session.state.static_margin)
    report = console.wait_for_report(lambda each: each.name == graph.CONSOLE, "a report")
    assert report["messages"] != "0" == report["refused_messages"]


def test_a_robot_that_walks(trotting: Any, page: PageClient) -> None:
    """Its links from the description, where it goes, forces, ground, plots, words, reports."""

    def shown(condition: Any, what: str) -> None:
        trotting.until(condition, what, within=20.0, step=0.1)

    links = {f"/scene/{name}/look" for name in read_description(build_urdf(load_robot())).looks}
    shown(lambda: links <= set(page.nodes), "the links")
    begin = page.positions[BODY][0]
    shown(lambda: page.positions[BODY][0] > begin + 0.2, "the way of the robot")
    shown(lambda: page.positions["/scene"][0] < -begin - 0.1, "that the picture follows")
    shown(lambda: set(page.nodes) >= _DRAWN, "what the controller draws, and the ground")
    shown(lambda: tells(page, "walk"), "the mode")
    shown(lambda: all(tells(page, name) for name in _REPORTING), "the reports")

    def curves() -> list[list[str]]:
        plots = [html for html in page.contents() if "<svg" in html]
        return [re.findall(r"</span> (\S+) <b>", html) for html in plots]

    joints = list(load_robot("carbon").joint_names)
    shown(lambda: curves().count(joints) == 2, "angles and torques")
    assert ["roll", "pitch"] in curves()


_DRAWN = {
    *(f"/scene/{graph.FRAME_ODOM}/drawn/{what}" for what in ("arrows_foot_force", "lines_way")),
    f"/scene/{graph.FRAME_ODOM}/drawn/balls_foothold",
    f"/scene/{graph.FRAME_WORLD}/ground/boxes_ground",
}
_REPORTING = (graph.PLANT, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER, graph.VN200_DRIVER)
