"""The console of the running robot, with an operator who has it open in a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from browser_page import BrowserPage, NoChromium, chromium
from served_bench import ServedBench

SILENCE = 2.0
"""How late a word of a browser may come that draws without a graphics processor [s]."""
_LONG = 20.0
"""Of simulated time, in which everything that the page shows or asks for has come [s]."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser; skipped where there is none.

    Of one file: as long as its driver is there an event loop runs in this thread, in which the
    tests of other files could start none.
    """
    try:
        with chromium() as browser:
            yield browser
    except NoChromium as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="module")
def console(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedBench]:
    """A console of the robot's own."""
    directory: Path = tmp_path_factory.mktemp("console")
    console = ServedBench(domain, directory, "husky_bringup.nodes.console")
    console.serve(silence=SILENCE)
    yield console
    console.close()


@pytest.fixture
def page(browser: Any, console: ServedBench) -> Iterator[BrowserPage]:
    """Its page, on which nothing goes wrong."""
    page = BrowserPage(browser, console.address)
    yield page
    page.close()
    assert not page.errors


@pytest.fixture
def shown(page: BrowserPage) -> Callable[..., None]:
    """Lets a robot's world go on until a condition holds, never faster than the page keeps up."""

    def shown(robot: Any, condition: Callable[[], Any], what: str) -> None:
        def holds() -> Any:
            page.keep_up()
            return condition()

        robot.until(holds, what, _LONG, step=0.2)

    return shown
