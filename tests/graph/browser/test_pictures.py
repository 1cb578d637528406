"""Makes the documents' pictures of the console, where `HUSKY_PICTURES` names a directory."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

_DIRECTORY = os.environ.get("HUSKY_PICTURES")
pytestmark = [
    pytest.mark.graph,
    pytest.mark.slow,
    pytest.mark.skipif(_DIRECTORY is None, reason="HUSKY_PICTURES names no directory"),
]

_SIZE, _TALL = (1280, 800), (1280, 1290)
"""Of the page [pixels], and where the whole panel is to be seen."""
_STEP, _PAUSE = 0.02, 0.1
"""By which the world goes on meanwhile, and wall time between two steps [s]."""
_WAY = 0.4
"""For which the robot walks before [m]."""


@pytest.fixture
def save(page: Any) -> Callable[..., None]:
    """Saves how the page looks while a robot's world goes on."""

    def save(robot: Any, name: str, size: tuple[int, int] = _SIZE, **options: Any) -> None:
        assert _DIRECTORY is not None
        saved = threading.Event()

        def go_on() -> None:  # slowly: the page has to follow
            while not saved.wait(_PAUSE):
                robot.session.advance(_STEP)

        with ThreadPoolExecutor(1) as pool:
            world = pool.submit(go_on)
            try:
                page.save(Path(_DIRECTORY) / f"{name}.png", size, **options)
            finally:
                saved.set()
            world.result()

    return save


def test_carbon_walks_by_the_stick(standing: Any, page: Any, shown: Any, save: Any) -> None:
    shown(standing, lambda: page.robot().height > 0, "the robot")
    page.look_closer(right=-25, down=25, nearer=2)
    begin = standing.session.truth.pose.pose.position.x
    with page.stick(ahead=0.9, left=0.3) as holding:

        def has_gone() -> bool:
            holding()
            return standing.session.truth.pose.pose.position.x > begin + _WAY

        shown(standing, has_gone, "its way")
        save(standing, "console")
    shown(standing, lambda: standing.mode == "stand", "that it stops")


def test_curves(trotting: Any, page: Any, shown: Any, save: Any) -> None:
    page.turn_to("Plots")
    shown(trotting, lambda: page.plots().count() >= 5, "the plots")
    trotting.session.advance(10.0)
    save(trotting, "console_plots", _TALL, panel=True)
