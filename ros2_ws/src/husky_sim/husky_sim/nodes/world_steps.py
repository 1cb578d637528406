"""Ticks that somebody has asked a paused world for, and the answer that he waits for."""

from __future__ import annotations

from husky_msgs.srv import StepWorld
from husky_runtime import graph
from husky_runtime.nodes import stamps
from husky_runtime.nodes.service_desk import Deferred

MOST_TICKS = 30_000
"""Longest step that may be asked for: 60 s of simulated time."""


class WorldSteps:
    """One step at a time, of ticks `left`; others are heard meanwhile, and may end it."""

    def __init__(self) -> None:
        """No step is under way."""
        self.left = 0
        self._asked = 0
        self._answer: Deferred | None = None
        self._reason = ""

    @property
    def under_way(self) -> bool:
        """Whether somebody waits for an answer."""
        return self._answer is not None

    def refusal(self, ticks: int) -> str:
        """Return why a step cannot begin, or ""."""
        if not 1 <= ticks <= MOST_TICKS:
            longest = MOST_TICKS * graph.TICK_PERIOD
            return f"ticks is {ticks}, it must be 1 to {MOST_TICKS} ({longest:g} s)"
        if self.under_way:
            return f"a step is under way: {self._done} of {self._asked} ticks are done"
        return ""

    def begin(self, ticks: int, response: StepWorld.Response) -> Deferred:
        """Ask for a step; return its answer."""
        self.left = self._asked = ticks
        self._reason = ""
        self._answer = Deferred(response)
        return self._answer

    def count(self) -> None:
        """A tick has been done."""
        self.left = max(0, self.left - 1)

    def end(self, reason: str) -> None:
        """Do no more of the ticks asked for."""
        if self.left > 0:
            self._reason = f"ended by {reason} after {self._done} of {self._asked} ticks"
            self.left = 0

    def answer(self, time_ns: int, trajectory_sha256: str) -> None:
        """Answer who waits: the world has settled at this time [ns]."""
        if self._answer is None:
            return
        answer, self._answer = self._answer, None
        response = answer.response
        response.success, response.message = not self._reason, self._reason
        stamps.fill(response.stamp, time_ns)
        response.trajectory_sha256 = trajectory_sha256
        answer.complete()

    @property
    def _done(self) -> int:
        return self._asked - self.left
