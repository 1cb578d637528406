"""The console's page in headless Chromium: what is pressed, held and read on it, how it looks."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from scipy import ndimage

from husky_description.arrays import Array

if TYPE_CHECKING:  # its import takes a second of each worker of a test run, whatever is run
    from playwright.sync_api import Browser, ConsoleMessage, Locator

VARIABLE = "HUSKY_CHROMIUM"
"""Of the environment: which Chromium to use."""
NEEDED = (
    "no Chromium: sudo apt install chromium, or python -m playwright install chromium "
    f"({VARIABLE} names another one)"
)
SIZE = (1000, 752)
"""Of the page [pixels]: without a graphics processor each of the picture's takes its time."""
_NAMES = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = ("--use-gl=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""There need be no graphics processor."""
_PATIENCE = 150e3
"""Wall time after which the page counts as hung [ms]."""
_REGRIP = 5e3
"""Wall time after which an operator who is not heard lets the stick go and takes it anew [ms]."""
_LET_GO = 1e3
"""For which he lets it go [ms]."""
_KEEPING_UP = 0.8
"""How late a word of the page may be before the world waits for it [s of wall time]."""
_REDRAWING = 500.0
"""Wall time in which the page is drawn at another size [ms]."""
_DARK = 90
"""A channel of the robot's pixels, at most; ground and sky are lighter."""
_GAP = 2
"""Pixels between parts of the robot that belong together."""
_ALIKE = 40
"""By how much less the channels of two colours differ that count as one."""


class NoChromium(Exception):
    """There is none on this machine."""


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """Run a browser without a window.

    Raises:
        NoChromium: with words on what to install.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        found = (shutil.which(name) for name in _NAMES)
        program = os.environ.get(VARIABLE) or next(filter(None, found), None)
        if program is None and not Path(driver.chromium.executable_path).exists():
            raise NoChromium(NEEDED)
        browser = driver.chromium.launch(
            executable_path=program, args=_OPTIONS, chromium_sandbox=os.geteuid() != 0
        )
        with contextlib.closing(browser):
            yield browser


@dataclass(frozen=True)
class Silhouette:
    """Where the robot is in the picture [pixels]; all are zero where there is none."""

    left: int
    right: int
    top: int
    bottom: int

    @property
    def height(self) -> int:
        """How tall it is."""
        return self.bottom - self.top

    @property
    def middle(self) -> float:
        """How far to the right it is."""
        return 0.5 * (self.left + self.right)


def silhouette(image: Array) -> Silhouette:
    """Return where the largest dark thing of a picture (rows, columns, 3) is."""
    dark = image.max(axis=2) < _DARK
    joined = ndimage.binary_dilation(dark, iterations=_GAP)
    parts, count = ndimage.label(joined)
    if not count:
        return Silhouette(0, 0, 0, 0)
    largest = 1 + int(np.bincount(parts[dark], minlength=count + 1)[1:].argmax())
    rows, columns = np.nonzero(dark & (parts == largest))
    return Silhouette(int(columns.min()), int(columns.max()), int(rows.min()), int(rows.max()))


def pixels_of(colour: str, image: Array) -> int:
    """Return how many pixels (rows, columns, 3) have about a colour, `#rrggbb`."""
    wanted = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)])
    return int((np.abs(image.astype(int) - wanted).max(axis=2) < _ALIKE).sum())


class BrowserPage:
    """A page that an operator has open.

    Attributes:
        page: playwright's.
        errors: of its scripts, and what it could not load.
    """

    def __init__(self, browser: Browser, address: str, size: tuple[int, int] = SIZE):
        """Open it; it need not have heard of the robot yet."""
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.page.set_default_timeout(_PATIENCE)
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._hear)
        self.page.goto(address, wait_until="commit")
        self.view = self.page.frame_locator("#view")
        self.page.locator("body:not(.lost)").wait_for()
        self.view.get_by_role("tab").first.wait_for()

    def close(self) -> None:
        """Close it."""
        self.page.close()

    # The operator's part ----------------------------------------------------------------------
    def press(self, name: str, row: str = "actions") -> None:
        """Press a button of a row, by its words, once the page keeps up: it counts for 2 s."""
        self.keep_up()
        button = self.page.locator(f"#{row}").get_by_role("button", name=name, exact=True)
        _click(button)

    @contextlib.contextmanager
    def stick(self, ahead: float, left: float = 0.0) -> Iterator[Callable[[], None]]:
        """Hold the stick meanwhile, by shares of its way.

        Yields:
            What the simulation goes on with while the stick is held: it lets the page keep up with
            the world, and takes the stick anew when its words were too late all the same.
        """
        from playwright.sync_api import TimeoutError

        mouse = self.page.mouse

        def hold() -> None:
            box = self.page.locator("#move").bounding_box()
            assert box is not None
            reach = 0.5 * box["width"]
            x, y = box["x"] + reach, box["y"] + reach
            mouse.move(x, y)
            mouse.down()
            mouse.move(x - reach * left, y - reach * ahead)

        def go_on() -> None:
            self.keep_up()
            with contextlib.suppress(TimeoutError):
                self._wait("text.startsWith('you drive')", _REGRIP)
                return
            mouse.up()
            self.page.wait_for_timeout(_LET_GO)  # or the page does not say so
            hold()

        hold()
        try:
            yield go_on
        finally:
            mouse.up()

    def keep_up(self) -> None:
        """Wait until the page's words are hardly late."""
        self._wait(f"(/(\\d+) ms/.exec(text) || [0, 0])[1] < {1e3 * _KEEPING_UP}")

    def _wait(self, condition: str, patience: float = _PATIENCE) -> None:
        """Wait until the line on the connection fulfils a condition."""
        text = "document.getElementById('link').textContent"
        function = f"() => {{ const text = {text}; return {condition} }}"
        self.page.wait_for_function(function, polling=50, timeout=patience)

    def words(self, place: str) -> str:
        """Return what is written at a place, by its id."""
        return self.page.locator(f"#{place}").text_content() or ""

    def names(self, row: str) -> list[str]:
        """Return the names on the buttons of a row."""
        return self.page.locator(f"#{row} button").all_text_contents()

    def lit(self, row: str) -> list[str]:
        """Return the names of those buttons of a row that are as the robot is."""
        return self.page.locator(f"#{row} button[aria-pressed=true]").all_text_contents()

    # The panel --------------------------------------------------------------------------------
    def turn_to(self, tab: str) -> None:
        """Turn to a tab."""
        _click(self.view.get_by_role("tab", name=tab, exact=True))

    def click(self, button: str) -> None:
        """Press a button of the panel."""
        _click(self.view.get_by_role("button", name=button, exact=True))

    def choose(self, label: str, option: str) -> None:
        """Choose something from a list, which must have it."""
        _click(self.row(label).get_by_role("combobox"))
        _click(self.view.get_by_role("option", name=option, exact=True))

    def options(self, label: str) -> list[str]:
        """Return what a list has."""
        combobox = self.row(label).get_by_role("combobox")
        _click(combobox)
        options = self.view.get_by_role("option").all_text_contents()
        combobox.press("Escape")
        return options

    def tick(self, label: str, on: bool) -> None:
        """Set a check box."""
        box = self.row(label).get_by_role("checkbox")
        if box.is_checked() != on:
            _click(box)

    def write(self, label: str, text: str) -> None:
        """Write something into a field."""
        self.row(label).locator("input:not([type=hidden])").fill(text, force=True)

    def row(self, label: str) -> Locator:
        """Return an input with its label: not all of viser's labels are tied to one."""
        words = re.compile(rf"^\s*{re.escape(label)}\s*$")
        root = 'xpath=ancestor::div[contains(@class, "mantine-Flex-root")][1]'
        return self.view.locator("label").filter(has_text=words).locator(root)

    def plots(self) -> Locator:
        """Return the plots in which there is a curve."""
        return self.view.locator("svg").filter(has=self.view.locator("g path[stroke]"))

    # Its look ---------------------------------------------------------------------------------
    def robot(self) -> Silhouette:
        """Return where the robot is in the picture."""
        return silhouette(self.look(self.view.locator("canvas").first))

    def look(self, what: Locator) -> Array:
        """Return how a part of the page looks (rows, columns, 3), also one that is replaced now.

        A screenshot of the part alone would wait until it has stood still for a while.
        """
        self._close_notice()
        what.evaluate("part => part.scrollIntoView({block: 'center'})")
        box = what.bounding_box()
        assert box is not None
        return _pixels(self.page.screenshot(clip=box))

    def look_closer(self, right: float, down: float, nearer: int) -> None:
        """Turn the picture by the mouse [pixels], and go nearer [notches of its wheel]."""
        mouse, box = self.page.mouse, self.view.locator("canvas").first.bounding_box()
        assert box is not None
        x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + right, y + down, steps=4)
        mouse.up()
        for _ in range(nearer):
            mouse.wheel(0, -100)

    def save(self, file: Path, size: tuple[int, int], *, panel: bool = False) -> None:
        """Save how the page looks at a size [pixels], or its panel beside the robot."""
        self._close_notice()
        self.page.set_viewport_size({"width": size[0], "height": size[1]})
        self.page.wait_for_timeout(_REDRAWING)
        image = Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")
        robot = self.view.locator("canvas").first.bounding_box()
        assert robot is not None
        if panel:
            image = image.crop((round(robot["width"]), 0, image.width, round(robot["height"])))
        image.save(file, optimize=True)

    def _hear(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def _close_notice(self) -> None:
        """Close viser's word, over the picture, that there is no graphics processor."""
        notice = self.view.get_by_role("alert")
        if notice.count():
            _click(notice.get_by_role("button"))
            notice.wait_for(state="detached")


def _click(what: Locator) -> None:
    """Click on something where it is, however busy the page is with its picture."""
    what.click(force=True, no_wait_after=True)


def _pixels(png: bytes) -> Array:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
