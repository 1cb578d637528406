"""Outcome of what one operator has asked for: done, refused and why, at what time of day."""

from __future__ import annotations

import time


class Outcome:
    """Outcome of a request, part by part; any thread may read it.

    Attributes:
        time: of day when the last part was answered, HH:MM:SS, "" before.
    """

    def __init__(self) -> None:
        """Nothing has been asked for."""
        self._parts: dict[str, tuple[str, bool]] = {}
        self.time = ""

    @classmethod
    def refusal(cls, words: str) -> Outcome:
        """Return the outcome of a request that is refused at once, in words."""
        outcome = cls()
        outcome.refuse("", words)
        return outcome

    def wait(self, part: str) -> None:
        """Note that a part has been asked for."""
        self._parts = {**self._parts, part: (f"{part} ...", False)}

    def finish(self, part: str) -> None:
        """Note that a part is done."""
        self._note(part, f"{part}: done", is_refusal=False)

    def refuse(self, part: str, words: str) -> None:
        """Note in words that a part is not done, and why."""
        self._note(part, words, is_refusal=True)

    def clear(self) -> None:
        """Forget all parts: another request takes their place."""
        self._parts = {}

    def _note(self, part: str, words: str, *, is_refusal: bool) -> None:
        self.time = time.strftime("%H:%M:%S")
        self._parts = {**self._parts, part: (words, is_refusal)}

    @property
    def text(self) -> str:
        """All parts in words."""
        return "; ".join(words for words, _ in self._parts.values())

    @property
    def refused(self) -> bool:
        """True if any part is refused."""
        return any(is_refusal for _, is_refusal in self._parts.values())
