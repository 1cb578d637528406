"""What the robot says of itself in words: its state, and what each node reports."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from viser import GuiApi

from husky_msgs.msg import DriveStatusArray, NavigatorState, PropulsionState

_LEVELS = {
    DiagnosticStatus.OK: ("ok", "#2b8a3e"),
    DiagnosticStatus.WARN: ("warning", "#e67700"),
    DiagnosticStatus.ERROR: ("error", "#c92a2a"),
    DiagnosticStatus.STALE: ("stale", "#868e96"),
}
_SILENT = 5.0
"""Wall time after which a node that has told nothing counts as stale [s]."""
_MOST = 100
"""Reports that are shown."""
_STYLE = "font-size:0.85em;padding:0 0.9em"

Row = tuple[str, str]
"""What is told, and how it is."""


def drives_in_words(message: DriveStatusArray) -> str:
    """Return how the joints' drives stand."""
    if message.emergency_stop:
        return "EMERGENCY STOP"
    return "enabled" if message.operational else f"not enabled: {message.reason}"


def fans_in_words(message: PropulsionState) -> str:
    """Return how the fans stand."""
    armed = "armed" if message.armed else "disarmed"
    return f"{armed}, {message.mode}" if message.connected else "not connected"


def navigation_in_words(message: NavigatorState) -> list[Row]:
    """Return what the navigator does, what is left of its way, and how the last one has ended."""
    way = f"{message.distance_left:.1f} m, {message.time_left:.0f} s"
    rows = [
        ("navigator", f"{message.phase}, {message.leg}" if message.leg else message.phase),
        ("way left", f"{way}, {message.energy_left / 1e3:.1f} kJ" if message.goals_left else ""),
        ("last navigation", message.outcome),
        ("refused to it", message.refusal),
    ]
    return [(name, value) for name, value in rows if value]


def table(rows: Iterable[Row]) -> str:
    """Return rows as HTML; whatever they hold is text."""
    cells = "".join(
        f'<tr><td style="opacity:0.65;padding-right:0.8em;white-space:nowrap;vertical-align:top">'
        f"{escape(name)}</td><td>{escape(value)}</td></tr>"
        for name, value in rows
    )
    return f'<div style="{_STYLE}"><table>{cells}</table></div>'


class Facts:
    """A table of facts that nodes tell, by topic; each topic has its rows once it is heard."""

    def __init__(self, gui: GuiApi, order: Sequence[str]):
        """Tell nothing yet; the table will be where in the page it is made.

        Args:
            gui: of the page.
            order: all topics, in the order in which they are told.
        """
        self._html = gui.add_html("")
        self._rows: dict[str, list[Row]] = {topic: [] for topic in order}

    def tell(self, topic: str, rows: list[Row]) -> None:
        """Replace the rows of a topic."""
        self._rows[topic] = rows

    def clear(self) -> None:
        """Tell nothing."""
        self._rows = {topic: [] for topic in self._rows}

    def draw(self) -> None:
        """Bring the page up to date."""
        content = table(row for rows in self._rows.values() for row in rows)
        if content != self._html.content:
            self._html.content = content


class Reports:
    """What each node has reported last: its level in colour, its message, its values."""

    def __init__(self, gui: GuiApi):
        """Show nothing yet; the reports will be where in the page they are made."""
        self._gui = gui
        self._summary, self._folder = gui.add_html(""), gui.add_folder("values")
        self._values: dict[str, Any] = {}
        self._last: dict[str, tuple[DiagnosticStatus, float]] = {}

    def tell(self, message: DiagnosticArray, now: float) -> None:
        """Take reports, at a wall time [s]."""
        for status in message.status:
            if status.name in self._last or len(self._last) < _MOST:
                self._last[status.name] = status, now

    def clear(self) -> None:
        """Forget what has been reported."""
        self._last.clear()

    def draw(self, now: float) -> None:
        """Bring the page up to a wall time [s]."""
        lines = []
        for name, (status, told) in sorted(self._last.items()):
            stale = now - told > _SILENT
            level = DiagnosticStatus.STALE if stale else status.level
            text = f"silent for {now - told:.0f} s" if stale else status.message
            lines.append(_line(name, level, text))
            self._draw_values(name, status)
        content = f'<div style="{_STYLE}"><table>{"".join(lines)}</table></div>'
        if content != self._summary.content:
            self._summary.content = content

    def _draw_values(self, name: str, status: DiagnosticStatus) -> None:
        content = table((each.key, each.value) for each in status.values)
        if name not in self._values:
            with self._folder, self._gui.add_folder(name, expand_by_default=False):
                self._values[name] = self._gui.add_html(content)
        elif content != self._values[name].content:
            self._values[name].content = content


def _line(name: str, level: bytes, text: str) -> str:
    word, colour = _LEVELS.get(level, _LEVELS[DiagnosticStatus.STALE])
    return (
        f'<tr><td style="color:{colour};font-weight:600;padding-right:0.8em">{word}</td>'
        f'<td style="padding-right:0.8em;white-space:nowrap">{escape(name)}</td>'
        f"<td>{escape(text)}</td></tr>"
    )
