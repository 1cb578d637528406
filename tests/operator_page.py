"""The page of operators in headless Chromium, without a robot: its state is scripted."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

import msgspec

from husky_bringup.console.operator_server import OperatorServer
from husky_bringup.console.operators import Ask, Operator, Operators, Rules
from husky_bringup.console.told import tell
from husky_bringup.outcome import Outcome
from husky_bringup.robot_state import Known
from husky_bringup.teleop_mapping import JoystickLayout, Velocity
from husky_control.modes.table import ModeMachine, modes_of
from husky_description.robot import load_robot
from husky_msgs.msg import (
    ControllerMode,
    ControllerState,
    DriveStatusArray,
    ModeTable,
    PropulsionState,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SIZES = ((390, 844), (844, 390), (820, 560), (1440, 900))
"""Of screens: telephone, upright and on its side; tablet; desk [pixels]."""
_RULES = Rules(Velocity(0.5, 0.3, 0.8), JoystickLayout(), silence=2.0)
_UPRIGHT, _ON_ITS_BACK = [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]
_LAST_WORD = 0.05
"""Age of the controller's last word, unless it is silent [s]."""


@cache
def table_of(robot: str) -> ModeTable:
    """Return the modes of one of our robots, as its controller tells them."""
    modes = modes_of(load_robot(robot))
    machine = ModeMachine(lambda condition: True, modes)
    rows = [
        ControllerMode(
            name=mode.value, meaning=mode.meaning, requests=list(machine.allowed_requests(mode))
        )
        for mode in modes
    ]
    return ModeTable(modes=rows, gaits=["trot", "crawl", "bound", "pronk"])


def known(
    robot: str,
    mode: str,
    reason: str = "",
    *,
    fallen: bool = False,
    stopped: bool = False,
    silence: float = _LAST_WORD,
    simulated: bool = False,
) -> Known:
    """Return what is known of one of our robots in a mode."""
    orientation = _ON_ITS_BACK if fallen else _UPRIGHT
    state = ControllerState(mode=mode, reason=reason, gait="trot", orientation=orientation)
    drives = DriveStatusArray(emergency_stop=stopped, operational=not stopped)
    return Known(state, drives, table_of(robot), silence, simulated)


_LONG = "body is tilted by 0.91 rad (limit 0.80), left hind knee at its torque limit for 0.5 s"


def states_of(robot: str) -> dict[str, Known]:
    """Return each state that the banner tells apart, with reasons short and long."""
    flying = "quadrotor" if robot == "beta" else "fly"
    return {
        "lying": known(robot, "passive"),
        "standing": known(robot, "stand", "body raised"),
        "walking": known(robot, "walk", "walk requested", simulated=True),
        "stopped": known(robot, "emergency_stop", _LONG, stopped=True),
        "fallen": known(robot, "damping", _LONG, fallen=True, simulated=True),
        "silent": known(robot, "stand", silence=123.0),
        "flying": known(robot, flying, "the flight controller lands by itself"),
        "other": known(robot, "stand_up", "stand_up requested"),
    }


class ScriptedConsole:
    """The server of operators in this process, before a robot that a test makes up.

    Attributes:
        asked: what operators have asked for, in order.
        answer: outcome that whoever asks is told.
    """

    def __init__(self) -> None:
        """Serve."""
        self.asked: list[str] = []
        self.answer = Outcome()
        self.operators = Operators(_RULES)
        with ThreadPoolExecutor(1) as pool:  # playwright's event loop is that of this thread
            self.server = pool.submit(OperatorServer, self.operators, self._ask).result()

    def _ask(self, operator: Operator, ask: Ask, age: float) -> None:
        self.asked.append(ask.value)
        operator.outcome = self.answer

    def tell(self, robot: Known, *, fans: bool = True) -> None:
        """Tell pages of a robot."""
        state = PropulsionState(connected=True, mode="STABILIZED") if fans else None
        self.server.robot = msgspec.json.encode(tell(robot, state))

    def close(self) -> None:
        """End."""
        self.server.close()


class OperatorPage:
    """The page, opened by an operator."""

    def __init__(self, browser: Browser, console: ScriptedConsole, size: tuple[int, int]):
        """Open it at a size [pixels]."""
        self.page: Page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.page.goto(f"http://127.0.0.1:{console.server.port}/", wait_until="commit")
        self.until("!document.body.classList.contains('lost')")

    def until(self, condition: str) -> None:
        """Wait until an expression in the page is true."""
        self.page.wait_for_function(f"() => {condition}", polling=20, timeout=30e3)

    def until_in(self, kind: str) -> None:
        """Wait until the banner is of a kind of state."""
        self.until(f"document.body.dataset.kind === {kind!r}")

    def words(self, place: str) -> str:
        """Return what is written at a place, by its id."""
        return self.page.locator(f"#{place}").text_content() or ""

    def box(self, place: str) -> dict[str, float]:
        """Return where a part of the page is on the screen [pixels]."""
        rect = "({left, top, right, bottom, height}) => ({left, top, right, bottom, height})"
        script = f"part => ({rect})(part.getBoundingClientRect())"
        return dict(self.page.locator(f"#{place}").evaluate(script))

    @contextmanager
    def holding(self, place: str, right: float = 0.0, down: float = 0.0) -> Iterator[None]:
        """Hold the mouse down in the middle of a part, then moved from there [pixels]."""
        box, mouse = self.box(place), self.page.mouse
        x, y = 0.5 * (box["left"] + box["right"]), 0.5 * (box["top"] + box["bottom"])
        mouse.move(x, y)
        mouse.down()
        if right or down:
            mouse.move(x + right, y + down)
        try:
            yield
        finally:
            mouse.up()

    def wait(self, duration: float) -> None:
        """Let the page live for a while [s]."""
        self.page.wait_for_timeout(1e3 * duration)


_COVERED = """(id) => {
    const part = document.getElementById(id);
    const { left, top, right, bottom } = part.getBoundingClientRect();
    const inset = 4; // corners are round
    const points = [[(left + right) / 2, (top + bottom) / 2]];
    for (const x of [left + inset, right - inset])
        for (const y of [top + inset, bottom - inset]) points.push([x, y]);
    return points.filter(([x, y]) => document.elementFromPoint(x, y) !== part);
}"""
_OUT_OF_REACH = """() => [...document.querySelectorAll("main button, main input, main .stick")]
    .filter((part) => part.offsetParent !== null)
    .filter((part) => {
        part.scrollIntoView({ block: "nearest", inline: "nearest" });
        const { left, top, right, bottom } = part.getBoundingClientRect();
        const at = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
        return !(at && (part === at || part.contains(at)));
    }).map((part) => part.id || part.textContent)"""


def stands_whole(page: Page, place: str = "stop") -> dict[str, float]:
    """Return where a button is [pixels]; it is whole on the screen, and nothing is over it."""
    script = "part => { const r = part.getBoundingClientRect(); return r.toJSON(); }"
    box = page.locator(f"#{place}").evaluate(script)
    size = page.viewport_size
    assert size is not None
    assert box["left"] >= 0 and box["top"] >= 0 and box["height"] >= 88
    assert box["right"] <= size["width"] and box["bottom"] <= size["height"]
    assert page.evaluate(_COVERED, place) == [], f"{place} is covered"
    return dict(box)


def out_of_reach(page: Page) -> list[str]:
    """Return the controls that cannot be scrolled to where a pointer reaches them."""
    return list(page.evaluate(_OUT_OF_REACH))


def assert_the_stop_is_whole_on_each_screen(page: Page) -> None:
    """Both buttons of the stop, on screens of all `SIZES`; the stop stays while others scroll."""
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        place = stands_whole(page)
        stands_whole(page, "cut")
        assert out_of_reach(page) == []
        assert stands_whole(page) == place


def eventually(condition: Any, what: str, patience: float = 10.0) -> None:
    """Wait until a condition of this process holds [s of wall time]."""
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, f"waited for {what}"
        time.sleep(0.01)
