"""Buttons that stop are whole on every screen, in every state; words are told to whom they concern.

There is no robot behind: its states are scripted. With a robot: `test_*_in_the_browser.py`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from operator_page import (
    SIZES,
    OperatorPage,
    ScriptedConsole,
    eventually,
    known,
    out_of_reach,
    stands_whole,
    states_of,
)

from husky_bringup.outcome import Outcome

pytestmark = pytest.mark.slow

_PICTURES = os.environ.get("HUSKY_PICTURES_OF_STATES")
"""Directory for a picture of each state at each size."""
_REFUSAL = "stand up: refused, stand_up refused: the body is tilted too far"


@pytest.fixture(scope="module")
def scripted() -> Iterator[ScriptedConsole]:
    scripted = ScriptedConsole()
    yield scripted
    scripted.close()


@pytest.fixture
def console(scripted: ScriptedConsole) -> ScriptedConsole:
    scripted.asked.clear()
    scripted.answer = Outcome()
    scripted.tell(known("carbon", "stand"))
    return scripted


@pytest.fixture
def operator(browser: Any, console: ScriptedConsole) -> Iterator[OperatorPage]:
    operator = OperatorPage(browser, console, (820, 560))
    operator.until_in("standing")
    yield operator
    operator.page.close()


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("robot", ["carbon", "beta"])
def test_the_stop_is_whole_and_stays_where_it_is(
    browser: Any, console: ScriptedConsole, robot: str, size: tuple[int, int]
) -> None:
    """In each state, with short words and long ones, wherever the page is scrolled to."""
    console.answer = Outcome.refusal(f"{_REFUSAL}; {_REFUSAL}")
    operator = OperatorPage(browser, console, size)
    page, places = operator.page, []

    def look() -> None:
        places.append((stands_whole(page), stands_whole(page, "cut")))

    look()
    for name, state in states_of(robot).items():
        console.tell(state)
        operator.until_in(name)
        look()
        if _PICTURES:
            page.screenshot(path=Path(_PICTURES) / f"{robot}_{size[0]}x{size[1]}_{name}.png")
    operator.page.get_by_role("button", name="sit down", exact=True).click()
    operator.until("document.getElementById('said').textContent.length > 100")
    look()
    with operator.holding("move", down=-30.0):
        operator.until("document.getElementById('obstacle').textContent")
        look()
        if _PICTURES:
            page.screenshot(path=Path(_PICTURES) / f"{robot}_{size[0]}x{size[1]}_refused.png")
    assert out_of_reach(page) == []
    page.evaluate("document.querySelector('main').scrollTo(0, 1e6); scrollTo(0, 1e6)")
    look()
    assert page.evaluate("[scrollX, scrollY]") == [0, 0]
    page.evaluate(f"socket.onmessage = null; lose('{_REFUSAL}; {_REFUSAL}')")
    look()
    assert all(place == places[0] for place in places)
    page.close()


def test_cut_acts_when_it_is_held(console: ScriptedConsole, operator: OperatorPage) -> None:
    """Neither a shorter press nor several of the stop cut the power; by the page's own clock."""
    page, cut = operator.page, operator.page.locator("#cut")
    page.clock.install(time=0)
    page.clock.pause_at(1.0)
    for _ in range(3):
        with operator.holding("cut"):
            page.clock.run_for(450)
            operator.until("document.querySelector('#cut.holding i').clientWidth > 10")
    page.locator("#stop").dblclick()
    with operator.holding("cut"):
        page.mouse.move(10, 10)  # it slips off
        page.clock.run_for(2000)
    eventually(lambda: console.asked == ["emergency stop"] * 2, "both presses of the stop")
    with operator.holding("cut"):
        page.clock.run_for(450)
        assert cut.evaluate("cut => cut.matches('.holding')") and "cut" not in console.asked
        page.clock.run_for(100)
        eventually(lambda: "cut" in console.asked, "a cut")
        page.clock.run_for(2000)
    cut.focus()
    page.keyboard.down("Enter")
    page.clock.run_for(550)
    page.keyboard.up("Enter")
    eventually(lambda: len(console.asked) == 4, "a cut by the keyboard")
    assert console.asked[2:] == ["cut"] * 2


def test_a_refusal_is_told_to_who_caused_it(
    browser: Any, console: ScriptedConsole, operator: OperatorPage
) -> None:
    other = OperatorPage(browser, console, (390, 844))
    console.answer = Outcome.refusal(_REFUSAL)
    operator.page.locator("#actions").get_by_role("button", name="stand up").click()
    operator.until("document.getElementById('said').textContent")
    assert operator.words("said") == f"{console.answer.time} {_REFUSAL}"
    assert operator.page.locator("#said.refused").count() == 1
    other.wait(0.5)
    assert other.words("said") == ""
    other.page.close()


def test_a_stick_tells_why_it_moves_nothing(
    browser: Any, console: ScriptedConsole, operator: OperatorPage
) -> None:
    with operator.holding("move", down=-30.0):
        operator.until("document.getElementById('link').textContent.startsWith('you drive')")
        assert operator.words("obstacle") == ""
        other = OperatorPage(browser, console, (390, 844))
        with other.holding("turn", right=30.0):
            other.until("document.getElementById('obstacle').textContent.includes('somebody')")
            assert "somebody else drives" in other.words("next")
        other.page.close()
        console.tell(known("carbon", "passive"))
        operator.until("document.getElementById('obstacle').textContent.includes('it lies')")
    assert operator.words("obstacle") == ""
    with operator.holding("turn", right=30.0):
        assert operator.words("obstacle") == "it lies: press Stand up"
        assert operator.words("next") == "this moves nothing: it lies: press Stand up"
    console.tell(known("carbon", "walk", silence=9.0))
    operator.until_in("silent")
    with operator.holding("move", down=-30.0):
        assert "9 s" in operator.words("obstacle")


def test_a_stop_that_cannot_be_sent_is_told(browser: Any) -> None:
    console = ScriptedConsole()
    console.tell(known("carbon", "stand"))
    operator = OperatorPage(browser, console, (844, 390))
    operator.until_in("standing")
    place = stands_whole(operator.page)
    console.close()
    operator.until("document.body.classList.contains('lost')")
    operator.page.locator("#stop").click()
    assert "emergency stop: not sent, no connection" in operator.words("said")
    with operator.holding("move", down=-30.0):
        assert operator.words("obstacle") == "no connection to the robot"
    assert operator.words("state") == "no connection"
    assert stands_whole(operator.page) == place
    operator.page.close()
