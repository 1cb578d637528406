"""What a run leaves out, said at its end in one line."""

from __future__ import annotations

from typing import Any

import pytest

MARKERS = ("docker", "bare", "realtime", "slow")
"""Of tests that only `scripts/test.sh --all` runs."""


class LeftOut:
    """A plugin of pytest, in each worker and in who hands out the tests."""

    def __init__(self, config: pytest.Config):
        """Nothing is left out yet."""
        self._config = config
        self._count = 0

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        """Count them."""
        marked = [one for one in items if any(map(one.get_closest_marker, MARKERS))]
        self._count += len(marked)
        if hasattr(self._config, "workeroutput"):
            self._config.workeroutput["left_out"] = self._count

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Hear it from a worker: each collects all."""
        self._count = max(self._count, getattr(node, "workeroutput", {}).get("left_out", 0))

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Tell what has not been judged, and how to have it judged."""
        skipped = terminalreporter.stats.get("skipped", [])
        starved = sum("not judged" in str(report.longrepr) for report in skipped)
        if starved:
            terminalreporter.line(f"not judged, since this machine is too busy: {starved} tests")
        if self._count and self._config.option.markexpr:
            names = f"{', '.join(MARKERS[:-1])} or {MARKERS[-1]}"
            terminalreporter.line(
                f"left out: {self._count} tests marked {names}; scripts/test.sh --all runs them"
            )
