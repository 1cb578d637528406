"""No test hangs for ever, and a run that is ended says which tests it was at.

pytest-timeout ends a test from within: not one that stands in a library's code, nor the end of a
fixture after a failure, for a failure stops its clock. Then the process says where each of its
threads stands, and ends; pytest-xdist names the test, counts it as failed, and goes on without it.
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
        self._error = os.dup(2)  # the tests' own is caught
        self._timeout = float(config.getini("timeout") or 0.0)
        self._since: dict[str, float] = {}  # when each test has begun that has not ended

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

    @pytest.hookimpl(trylast=True)
    def pytest_exception_interact(self, node: Any) -> None:
        """Go on after a failure, at which pytest stops this clock too."""
        if isinstance(node, pytest.Item):
            self._watch(node)

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
