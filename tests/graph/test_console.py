"""The page of the console beside the walking robot."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from operator_client import OperatorClient
from page_client import PageClient
from seen_robot import STOP_TIME
from served_bench import ServedBench

from husky_bringup.console.description import read_description
from husky_bringup.console.operator_server import VIEW
from husky_control.gait.table import GAITS
from husky_description.robot import load_robot
from husky_description.urdf import build_urdf
from husky_runtime import graph

pytestmark = pytest.mark.graph

BODY = "/scene/torso"


@pytest.fixture(scope="module")
def console(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedBench]:
    console = ServedBench(domain, tmp_path_factory.mktemp("console"), "husky_bringup.nodes.console")
    console.serve(silence=2.0)  # of a machine that is slow
    yield console
    console.close()


@pytest.fixture
def beside(graph_of_module: Any, console: ServedBench) -> Iterator[None]:
    """The world waits for the console as it does for the robot's nodes."""
    with graph_of_module.beside(console.process):
        yield


@pytest.fixture
def page(console: ServedBench) -> PageClient:
    console.clients.append(PageClient(console.address + VIEW))
    return console.clients[-1]


@pytest.fixture
def operator(console: ServedBench) -> OperatorClient:
    console.clients.append(OperatorClient(console.address))
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


def test_an_operator_stands_the_robot_up_walks_and_is_lost(
    robot: Any, console: ServedBench, operator: OperatorClient
) -> None:
    def shown(condition: Any, what: str) -> None:
        robot.until(condition, what, within=20.0, step=0.1)

    def stands() -> bool:
        if operator.state["said"].endswith("is not there"):  # not discovered by the console yet
            operator.ask("action", "stand up")
        return bool(operator.robot["mode"] == "stand")

    def possible() -> set[str]:
        return {mode["name"] for mode in operator.robot.get("modes", ()) if mode["possible"]}

    shown(lambda: operator.robot.get("mode") == "passive", "the mode")
    assert operator.robot["gaits"] == list(GAITS) and "fans" not in operator.robot
    with robot.beside(console.process, lambda: operator.state):
        operator.ask("action", "stand up")
        shown(stands, "standing")
    assert {"walk", "sit"} < possible() and "stand_up" not in possible()
    with operator.holding(stick=(1.0, 0.0, 0.0), speed=0.6):
        shown(lambda: list(robot.session.state.commanded_velocity) == [0.3, 0.0, 0.0], "0.3 m/s")
        assert robot.mode == "walk" and operator.state["driver"] == "you"
        operator.break_off()
        shown(lambda: list(robot.session.state.commanded_velocity) == [0.0, 0.0, 0.0], "zero")
    robot.until(lambda: robot.mode == "stand", "stand", within=4.0)


@pytest.mark.slow
@pytest.mark.usefixtures("beside")
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


@pytest.mark.slow
@pytest.mark.usefixtures("beside")
def test_a_parameter_is_set_by_the_page(trotting: Any, console: ServedBench) -> None:
    """Who looks on another page sees it too; what is out of range is refused with the range."""
    page, other = PageClient(console.address + VIEW), PageClient(console.address + VIEW)
    console.clients += [page, other]

    def shown(condition: Any, what: str) -> None:
        def seen() -> bool:
            # The bench's node is asked first; the page waits for its answers, too.
            console.executor.spin_once(timeout_sec=0.0)
            return bool(condition())

        trotting.until(seen, what, within=20.0, step=0.1)

    def find(of: PageClient, label: str) -> str:
        found = [uuid for uuid, props in of.gui.items() if props.get("label") == label]
        return found[0] if len(found) == 1 else ""

    def choose(label: str, value: Any) -> None:
        shown(lambda: find(page, label), label)
        page.say(type="GuiUpdateMessage", uuid=find(page, label), updates={"value": value})

    choose("names", "gait.trot.swing_height")
    node = graph.absolute(graph.LOW_LEVEL_CONTROLLER)
    shown(lambda: node in page.gui[find(page, "node")].get("options", ()), node)
    choose("node", node)
    height = "swing_height [m]"
    for value, said in (
        (0.07, f"{node}.gait.trot.swing_height = 0.07"),
        (0.5, "out of range"),
        (0.08, f"{node}.gait.trot.swing_height = 0.08"),
    ):
        choose(height, value)
        shown(lambda said=said: any(said in html for html in page.contents()), said)
    shown(lambda: other.gui[find(other, height)].get("value") == 0.08, "the same")


def test_an_emergency_stop_beside_pages_that_do_not_read(
    trotting: Any, console: ServedBench, page: PageClient, record_property: Any
) -> None:
    """The stop begins within 0.1 s of simulated time."""
    stalled, operator = OperatorClient(console.address), OperatorClient(console.address)
    console.clients += [stalled, operator]
    trotting.until(lambda: tells(page, "walk"), "the page", within=20.0, step=0.1)
    for each in (stalled, operator):
        trotting.until(lambda e=each: e.state, "a word", within=20.0, step=0.1)
    with page.held(), stalled.held():
        trotting.session.advance(0.5)
        stopped = trotting.watch()
        operator.ask("action", "emergency stop")
        with trotting.beside(console.process):
            trotting.advance(0.9)
        record_property("reaction_s", trotting.put_down(stopped, within=STOP_TIME + 0.1))
    assert trotting.session.drives.emergency_stop, trotting.seen
    operator.ask("action", "recover")
    trotting.until(lambda: trotting.mode == "passive", "passive", within=20.0, step=0.1)
    trotting.recover()


_DRAWN = {
    *(f"/scene/{graph.FRAME_ODOM}/drawn/{what}" for what in ("arrows_foot_force", "lines_way")),
    f"/scene/{graph.FRAME_ODOM}/drawn/balls_foothold",
    f"/scene/{graph.FRAME_WORLD}/ground/boxes_ground",
}
_REPORTING = (graph.PLANT, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER, graph.VN200_DRIVER)
