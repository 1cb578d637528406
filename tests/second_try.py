"""A second try for tests that start processes, as ROS 2's own CI has it
(`colcon test --retest-until-pass 2`).

Such a test shares the machine with everybody: one that fails is run once more, in a fresh graph. A
second failure fails, and where many fail no more are tried again: then it is the code. Tests of
pure code, which are not marked `graph`, are never run again.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from _pytest.runner import runtestprotocol

MOST = 3
"""Tests that may need a second try in one run: more of them are no accident."""


class SecondTry:
    """A plugin of pytest, in each worker and in who hands out the tests."""

    def __init__(self) -> None:
        """Nothing has failed yet."""
        self._first: dict[str, str] = {}  # what the first try said, by test; in a worker
        self._passed: dict[str, str] = {}  # the same of those whose second try has passed

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> Any:
        """Run a test of processes; if it fails, end all that it stood on and run it again."""
        if item.get_closest_marker("graph") is None or item.nodeid in self._first:
            return None
        if len(self._first) > MOST:
            return None
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        failed = [report for report in reports if report.failed]
        if failed:
            self._first[item.nodeid] = "\n".join(report.longreprtext for report in failed)
            _tear_down(item)
            # From the outside, so that it gets a time limit of its own.
            item.ihook.pytest_runtest_protocol(item=item, nextitem=nextitem)
            return True
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Iterator[None]:
        """Tell with the second try what the first one said."""
        report: Any = yield
        if item.nodeid in self._first:
            report.first_try = self._first[item.nodeid]
            report.sections.append(("first try", report.first_try))
        return report

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note a test that has passed at the second try."""
        if report.when == "call" and report.passed and hasattr(report, "first_try"):
            self._passed[report.nodeid] = report.first_try

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Fail a run in which too much has needed a second try."""
        if len(self._passed) > MOST and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Name those tests, each with what was wrong the first time."""
        if not self._passed:
            return
        terminalreporter.section("passed at the second try")
        for test, said in self._passed.items():
            terminalreporter.line(f"SECOND TRY {test}")
            for line in said.splitlines():
                if line.startswith("E  "):
                    terminalreporter.line(f"  {line.removeprefix('E').strip()}")
        if len(self._passed) > MOST:
            terminalreporter.line(f"FAILED: {len(self._passed)} second tries, {MOST} may be")


def _tear_down(item: pytest.Item) -> None:
    """End all fixtures; a broken graph need not end well."""
    try:
        item.session._setupstate.teardown_exact(None)
    except pytest.exit.Exception:
        raise
    except (Exception, pytest.fail.Exception, BaseExceptionGroup):
        pass
