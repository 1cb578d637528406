"""Husky-beta in a browser: the page knows nothing of it but what it tells of itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from operator_page import assert_the_stop_is_whole_on_each_screen
from seen_robot import GRACE

from husky_control.gait.table import GAITS
from husky_control.modes.table import Mode, modes_of
from husky_description.robot import load_robot
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow]

_SETTINGS = {
    graph.PLANT: {"robot": "beta", "grace": GRACE, "seed": 1},
    graph.SERVO_BRIDGE: {"robot": "beta", "grace": GRACE},
    graph.LOW_LEVEL_CONTROLLER: {"robot": "beta", "grace": GRACE, "stand.duration": 0.9},
}


@pytest.fixture(scope="module")
def beta(new_graph: Any) -> Iterator[Any]:
    with new_graph(**_SETTINGS) as robot:
        yield robot


def test_it_has_modes_of_its_own_and_stands_up(beta: Any, page: Any, shown: Any) -> None:
    shown(beta, lambda: page.lit("modes") == ["passive"], "the mode")
    modes = [mode.value for mode in modes_of(load_robot("beta")) if mode != Mode.EMERGENCY_STOP]
    assert page.names("modes") == [mode.replace("_", " ") for mode in modes]
    assert page.names("gaits") == [gait.replace("_", " ") for gait in GAITS]
    assert "splay" in modes and "wair" not in modes
    shown(beta, lambda: page.view.get_by_text("husky beta").count() > 0, "its name")
    shown(beta, lambda: page.robot().height > 0, "the robot")
    lying = page.robot()
    shown(beta, lambda: page.words("state") == "lying", "the word of it")
    page.press("stand up")
    shown(beta, lambda: page.lit("modes") == ["stand"], "that it stands")
    assert beta.stands
    shown(beta, lambda: page.robot().height > 1.3 * lying.height, "a taller robot")
    assert_the_stop_is_whole_on_each_screen(page.page)
