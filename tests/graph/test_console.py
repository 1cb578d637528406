"""The page of the console beside the walking robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from node_bench import values_of
from page_client import PageClient
from served_bench import ServedBench

from husky_bringup.console.robot_look import link_meshes
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


def test_a_robot_whose_legs_carry_nothing(
    robot: Any, console: ServedBench, page: PageClient
) -> None:
    """It has no margin to the edge of its support, and tells of its mode all the same."""
    robot.until(lambda: ">passive</td>" in page.text(), "the mode", within=20.0, step=0.1)
    assert not any(robot.session.state.contact) and math.isnan(robot.session.state.static_margin)
    report = console.wait_for_report(lambda each: values_of(each)["messages"] != "0", "a report")
    assert report["refused_messages"] == "0"


def test_a_robot_that_walks(trotting: Any, page: PageClient) -> None:
    """Its links from the description, where it goes, forces, ground, plots, words, reports."""

    def shown(condition: Any, what: str) -> None:
        trotting.until(condition, what, within=20.0, step=0.1)

    links = {f"/scene/{name}/look" for name in link_meshes(build_urdf(load_robot("carbon")))[0]}
    shown(lambda: links <= set(page.nodes), "the links")
    begin = page.positions[BODY][0]
    shown(lambda: page.positions[BODY][0] > begin + 0.2, "the way of the robot")
    drawn = {f"/scene/{graph.FRAME_ODOM}/drawn/{what}" for what in _DRAWN}
    shown(lambda: drawn <= set(page.nodes), "what the controller draws")
    assert f"/scene/{graph.FRAME_WORLD}/ground/boxes_ground" in page.nodes
    assert page.positions["/scene"][0] < -begin, "the picture follows"
    shown(lambda: ">walk</td>" in page.text(), "the mode")
    shown(lambda: all(name in page.text() for name in _REPORTING), "the reports")
    plots = [props for props in page.gui.values() if "series" in props]
    curves = [[each["label"] for each in plot["series"][1:]] for plot in plots]
    assert ["roll", "pitch", "yaw"] in curves
    assert curves.count(list(load_robot("carbon").joint_names)) == 2, "angles and torques"


_DRAWN = ("arrows_foot_force", "balls_foothold", "lines_way")
_REPORTING = (graph.PLANT, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER, graph.VN200_DRIVER)
