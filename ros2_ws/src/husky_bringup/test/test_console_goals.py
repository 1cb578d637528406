"""Goals that operators click: what of two halves of a click makes one, and who is told what."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("msgspec")

from husky_bringup.console import clicked_goals as module
from husky_bringup.console.clicked_goals import CLICK, GO_TO, NAVIGATION, STOP_GOING, ClickedGoals
from husky_bringup.console.frame_tree import Pose
from husky_bringup.console.operators import Ask, Operator, Operators, Rules
from husky_bringup.outcome import Outcome
from husky_bringup.teleop_mapping import JoystickLayout, Velocity
from husky_description.arrays import Array
from husky_description.rotation import about_z

RULES = Rules(Velocity(0.5, 0.3, 0.8), JoystickLayout(), silence=0.5)
RAY = ((0.0, 0.0, 2.0), (0.0, 0.6, -0.8))
ASKED = "go to: click on the ground ..."
LATE = module._LATE + 0.1


class Page:
    """Two operators before a picture whose clicks a test makes up.

    Attributes:
        goals: that the robot was sent to, as rays.
        stops: that were asked for.
        refusal: of the next goal, "" for none.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.callbacks = 100.0, list[Any]()
        self.rays, self.stops, self.refusal = list[Any](), list[Outcome](), ""
        monkeypatch.setattr(module.time, "monotonic", lambda: self.now)
        add, remove = self.callbacks.append, self.callbacks.remove
        scene: Any = SimpleNamespace(on_click=lambda: add, remove_click_callback=remove)
        self.goals = ClickedGoals(scene, self._go, self.stops.append)
        operators = Operators(RULES)
        self.operator, self.other = operators.join(), operators.join()

    def _go(self, origin: Array, direction: Array) -> Pose:
        if self.refusal:
            raise ValueError(self.refusal)
        self.rays.append((tuple(origin), tuple(direction)))
        return (1.0, -2.0, 0.0, *about_z(np.pi / 2))

    def press(
        self, value: str, operator: Operator | None = None, what: str = NAVIGATION, age: float = 0.0
    ) -> str:
        """Press a button; return what the operator is told after the node's next turn."""
        who = operator or self.operator
        self.goals.hear(who, Ask(what, value), age)
        return self.turn(who)

    def hit(self, origin: Any = RAY[0], direction: Any = RAY[1]) -> str:
        """Let viser tell a ray to whoever listens."""
        event = SimpleNamespace(ray_origin=origin, ray_direction=direction)
        for callback in self.callbacks:
            callback(event)
        return self.turn(self.operator)

    def turn(self, operator: Operator) -> str:
        self.goals.turn()
        return operator.outcome.text


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    return Page(monkeypatch)


@pytest.mark.parametrize("first", [CLICK, "ray"])
def test_a_click_after_go_to_is_one_goal(page: Page, first: str) -> None:
    """Whichever of its two words comes first."""
    assert page.press(GO_TO) == ASKED and page.goals.picker is page.operator
    both = [lambda: page.press(CLICK), page.hit]
    for each in both if first == CLICK else reversed(both):
        assert page.rays == []
        each()
        page.now += 0.3
    assert page.rays == [RAY] and not page.operator.outcome.refused
    assert page.operator.outcome.text == "going to 1.00, -2.00 m in map, heading 90 deg ..."
    page.press(CLICK)
    page.hit()
    assert len(page.rays) == 1 and page.callbacks == [] and page.goals.picker is None


@pytest.mark.parametrize("half", ["no word", "a late word", "somebody else's word", "an old word"])
def test_a_ray_without_the_operators_own_word_moves_nothing(page: Page, half: str) -> None:
    """His browser is asleep or late, or somebody else has clicked."""
    page.press(GO_TO)
    if half == "a late word":
        assert page.press(CLICK, age=LATE) == "click: came too late, ask again"
    elif half == "somebody else's word":
        page.press(CLICK, page.other)
    elif half == "an old word":  # he has turned the picture by the mouse
        page.press(CLICK)
        page.now += LATE
    page.hit()
    assert page.rays == [] and page.goals.picker is page.operator
    page.press(CLICK)
    assert page.rays == [RAY]


def test_a_click_before_go_to_is_none_of_it(page: Page) -> None:
    page.press(CLICK)
    page.hit()
    page.press(GO_TO)
    page.hit()
    assert page.rays == []
    assert page.press(GO_TO, page.other, age=LATE) == "go to: came too late, ask again"
    assert page.goals.picker is page.operator


@pytest.mark.parametrize(
    ("what", "value"), [("action", "emergency stop"), ("mode", "sit"), (NAVIGATION, STOP_GOING)]
)
def test_whatever_button_is_pressed_next_ends_it(page: Page, what: str, value: str) -> None:
    for who in (page.operator, page.other):
        page.press(GO_TO)
        page.press(value, who, what, age=0.0 if what == NAVIGATION else LATE)
        page.press(CLICK)
        page.hit()
        assert page.rays == [] and page.callbacks == []
    assert page.operator.outcome.text == f"go to: somebody has pressed {value}"


def test_go_to_pressed_again_ends_it_and_another_takes_it_over(page: Page) -> None:
    page.press(GO_TO)
    assert page.press(GO_TO) == "" and page.goals.picker is None
    page.press(GO_TO)
    assert page.press(GO_TO, page.other) == ASKED and page.goals.picker is page.other
    assert page.operator.outcome.refused


def test_a_click_is_not_waited_for_for_ever(page: Page) -> None:
    page.press(GO_TO)
    page.now += 29.0
    assert page.turn(page.operator) == ASKED
    page.now += 2.0
    assert page.turn(page.operator) == "go to: no click within 30 s"
    page.goals.turn()
    assert page.callbacks == [] and page.goals.picker is None


def test_a_place_that_is_none_is_told(page: Page) -> None:
    page.press(GO_TO)
    page.refusal = "there is no ground"
    page.press(CLICK)
    assert page.hit() == "go to: there is no ground" and page.operator.outcome.refused
    assert page.press("jump") == "there is nothing called navigation jump"


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        (None, RAY[1]),
        (RAY[0], "down"),
        ((0, 0), (0, 1)),
        (RAY[0], (0, 0, 0)),
        (RAY[0], (0, 0, 1e999)),
    ],
)
def test_what_is_no_ray_is_none(page: Page, origin: Any, direction: Any) -> None:
    page.press(GO_TO)
    page.press(CLICK)
    assert page.hit(origin, direction) == ASKED and page.rays == []


def test_a_stop_is_made_once_for_all_who_ask_for_it_at_once(page: Page) -> None:
    for who in (page.operator, page.other):
        page.goals.hear(who, Ask(NAVIGATION, STOP_GOING), 0.0)
    page.goals.turn()
    page.goals.turn()
    assert page.stops == [page.operator.outcome] and page.other.outcome is page.stops[0]
