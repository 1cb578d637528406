"""No test hangs for ever, and a run that is ended says which tests it was at.

pytest-timeout ends a test from within, but a failure stops its clock, for whoever wants to look at
it in a debugger; here the ends of the fixtures have what is left of it. Where it cannot end a test,
because that stands in a library's code or hangs again, the process says where each of its threads
stands, and ends; pytest-xdist names the test, counts it as failed, and goes on without it.
"""

from __future__ import annotations

import faulthandler
import os
import time
from collections.abc import Iterator
from typing import Any

import pytest

_PATIENCE = 1.5
"""Of what a test may take by pytest-timeout."""


class Watchdog:
    """A plugin of pytest, in each worker and in who hands out the tests."""

    def __init__(self, config: pytest.Config):
        """Watch, by pytest-timeout's settings."""
        from pytest_timeout import get_env_settings

        self._error = os.dup(2)  # the tests' own is caught
        self._timeout = get_env_settings(config).timeout or 0.0
        self._since: dict[str, float] = {}  # when each test has begun that has not ended
        self._fails = False  # just now

    def _watch(self, item: pytest.Item) -> None:
        marker = item.get_closest_marker("timeout")
        period = _PATIENCE * (marker.args[0] if marker else self._timeout)
        if period > 0.0:
            faulthandler.dump_traceback_later(period, exit=True, file=self._error)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Watch a test from the begin of its fixtures to their end."""
        self._watch(item)
        try:
            return (yield)
        finally:
            faulthandler.cancel_dump_traceback_later()

    @pytest.hookimpl(wrapper=True)
    def pytest_exception_interact(self, node: Any) -> Iterator[None]:
        """Go on after a failure, at which pytest stops both clocks."""
        self._fails = True
        try:
            return (yield)
        finally:
            self._fails = False
            if isinstance(node, pytest.Item):
                self._watch(node)

    @pytest.hookimpl(tryfirst=True)
    def pytest_timeout_cancel_timer(self, item: pytest.Item) -> bool | None:
        """Stop pytest-timeout's clock at the end of the test only."""
        return True if self._fails else None

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Note that a test begins, here or in a worker."""
        self._since[nodeid] = time.monotonic()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """Note that it has ended."""
        self._since.pop(nodeid, None)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Name the tests that have begun and not ended."""
        for test, begin in self._since.items():
            passed = time.monotonic() - begin
            terminalreporter.line(f"NOT ENDED after {passed:.0f} s: {test}")
