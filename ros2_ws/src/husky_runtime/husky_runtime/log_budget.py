"""How many lines a node may say of a thing that changes again and again."""

from __future__ import annotations

LINES, PERIOD = 20, 60.0
"""So many lines, twice what a start takes, and another set of them after so long [s]."""


class LogBudget:
    """Lets some lines pass in a minute and counts the rest: a loose plug must not fill the disk."""

    def __init__(self) -> None:
        """Nothing has been said."""
        self._begun = 0.0
        self._said = LINES
        self._held = 0

    def line(self, text: str, now: float) -> str | None:
        """Return what is to be said, with how much was not; None for nothing.

        Args:
            text: a line.
            now: wall time that never jumps back [s].
        """
        if self._said >= LINES and (now - self._begun >= PERIOD or not self._begun):
            self._begun, self._said = now, 0
        if self._said >= LINES:
            self._held += 1
            return None
        self._said += 1
        held, self._held = self._held, 0
        return f"{text} (changes before it that are not logged: {held})" if held else text
