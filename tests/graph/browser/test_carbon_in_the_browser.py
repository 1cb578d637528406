"""Husky Carbon stood up, driven, stopped and looked at by an operator in a browser."""

from __future__ import annotations

from typing import Any

import pytest
from browser_page import pixels_of
from operator_page import assert_the_stop_is_whole_on_each_screen
from rcl_interfaces.srv import GetParameters

from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow]

_SPEED = 0.25
"""Of the stick at full deflection: half of the fastest, as long as nobody changes that [m/s]."""
_WAY = 0.5
"""For which the robot walks [m]."""
_GREEN, _RED = "#2b8a3e", "#c92a2a"
"""Of a level, where all is well and where nothing is."""
_FEW = 20
"""Pixels of a word."""


def test_it_stands_up_by_its_button(robot: Any, page: Any, shown: Any) -> None:
    """Its silhouette gets taller."""
    shown(robot, lambda: page.lit("modes") == ["passive"], "the mode")
    shown(robot, lambda: page.robot().height > 0, "the robot")
    sitting = page.robot()
    shown(robot, lambda: page.words("state") == "lying", "the word of it")
    assert page.words("next") == "press Stand up"
    page.press("stand up")
    shown(robot, lambda: page.lit("modes") == ["stand"], "that it stands")
    assert robot.stands and robot.height > 0.5
    assert "enabled" in page.words("drives")
    shown(robot, lambda: page.words("state") == "standing", "the word of it")
    shown(robot, lambda: page.robot().height > 1.7 * sitting.height, "a taller robot")


def test_the_stop_is_whole_on_each_screen(robot: Any, page: Any, shown: Any) -> None:
    """Beside the robot's own picture; in every state: `test_operator_layout.py`."""
    shown(robot, lambda: page.lit("modes"), "the mode")
    assert_the_stop_is_whole_on_each_screen(page.page)


def test_it_walks_while_the_stick_is_held(standing: Any, page: Any, shown: Any) -> None:
    """It goes through the picture, and is back in its middle when the picture follows it."""
    page.choose("fixed frame", graph.FRAME_ODOM)
    page.tick("follow the robot", True)
    shown(standing, lambda: page.robot().height > 0, "the robot")
    standing.session.advance(0.5)
    before, begin = page.robot(), standing.session.truth.pose.pose.position.x
    page.tick("follow the robot", False)
    with page.stick(ahead=1.0) as holding:

        def has_gone() -> bool:
            holding()
            return standing.session.truth.pose.pose.position.x > begin + _WAY

        shown(standing, has_gone, "its way")
        speed = standing.session.state.commanded_velocity
        assert standing.mode == "walk" and "you drive" in page.words("link")
    assert list(speed) == pytest.approx([_SPEED, 0.0, 0.0], abs=0.02)
    shown(standing, lambda: standing.mode == "stand", "that it stops")
    shown(
        standing, lambda: page.robot().middle > before.middle + 50, "the robot further to the right"
    )
    page.tick("follow the robot", True)
    shown(
        standing, lambda: abs(page.robot().middle - before.middle) < 25, "the robot in the middle"
    )


@pytest.mark.parametrize("how", ["button", "key", "key in the picture", "CUT held"])
def test_an_emergency_stop(standing: Any, page: Any, shown: Any, how: str) -> None:
    """The robot sinks, also in the picture; or falls, when the power is cut."""
    shown(standing, lambda: page.lit("modes") == ["stand"], "the mode")
    shown(standing, lambda: page.robot().height > 0, "the robot")
    stood = page.robot()
    if how == "button":
        page.press("EMERGENCY STOP", row="end")
    elif how == "CUT held":
        page.page.locator("#cut").focus()
        page.page.keyboard.down("Enter")
        shown(standing, lambda: standing.session.drives.reason == "cut", "that it is cut")
        page.page.keyboard.up("Enter")
    else:
        if how == "key in the picture":
            page.turn_to("Robot")  # which has the focus then
        page.page.keyboard.press("x")
    shown(standing, lambda: standing.session.drives.emergency_stop, "the emergency stop")
    shown(standing, lambda: page.words("drives").endswith("EMERGENCY STOP"), "the word of it")
    shown(standing, lambda: page.words("next") == "press Recover", "the next step")
    shown(standing, lambda: page.robot().height < 0.8 * stood.height, "a robot that lies")
    page.press("recover")
    shown(standing, lambda: page.lit("modes") == ["passive"], "passive")
    standing.recover()


def test_a_parameter_on_its_tab(standing: Any, page: Any, shown: Any) -> None:
    """The node has the value that is typed, and the tab says so."""
    name, node = "gait.trot.swing_height", graph.absolute(graph.LOW_LEVEL_CONTROLLER)
    label = "swing_height [m]"

    def has() -> float:
        answer = standing.ask(GetParameters, f"{node}/get_parameters", names=[name])
        return float(answer.values[0].double_value)

    page.turn_to("Parameters")
    page.write("names", name)
    page.click("look again")
    shown(standing, lambda: node in page.options("node"), "the node")
    page.choose("node", node)
    shown(standing, lambda: page.row(label).count() == 1, "the parameter")
    before = has()
    for value in (before + 0.03, before):
        page.write(label, f"{value:.2f}")
        shown(standing, lambda v=value: has() == pytest.approx(v), "the value")
        said = page.view.get_by_text(f"{node}.{name} = {value:.2f}")
        shown(standing, lambda s=said: s.count() == 1, "the word of it")


def test_reports_in_colour(robot: Any, page: Any, shown: Any) -> None:
    """A node is green while all is well, red when it has lost its device."""
    page.turn_to("Diagnostics")
    name = page.view.get_by_text(graph.VN200_DRIVER, exact=True)
    row = page.view.locator("tr").filter(has=name)

    def is_of(colour: str, words: str) -> bool:
        if row.count() != 1 or words not in row.text_content():
            return False
        return pixels_of(colour, page.look(row.locator("td").first)) > _FEW

    shown(robot, lambda: is_of(_GREEN, "streaming"), "green")
    robot.session.inject(graph.PLANT_INJECT_FAULT, "imu", "unplug")
    shown(robot, lambda: is_of(_RED, "no port"), "red")
    robot.session.inject(graph.PLANT_INJECT_FAULT, "imu", "")
    shown(robot, lambda: is_of(_GREEN, "streaming"), "green again")


def test_curves(trotting: Any, page: Any, shown: Any) -> None:
    """They are drawn, in the colours of their legend."""
    page.turn_to("Plots")
    plots = page.plots()
    shown(trotting, lambda: plots.count() >= 5, "the plots")
    attitude = plots.first.locator("g path")
    of = "(all, name) => all.map((each) => each.getAttribute(name))"
    shown(
        trotting,
        lambda: all(d.count(" ") > 20 for d in attitude.evaluate_all(of, "d")),
        "points of curves",
    )
    colours = attitude.evaluate_all(of, "stroke")
    assert len(colours) == 2

    def shows_both() -> bool:  # never while the plot is being replaced
        look = page.look(plots.first)
        return all(pixels_of(each, look) > 1e-3 * look[..., 0].size for each in colours)

    shown(trotting, shows_both, f"curves in {colours}")
