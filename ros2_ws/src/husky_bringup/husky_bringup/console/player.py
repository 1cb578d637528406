"""Plays a record to the page, and the controls with which that is done."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from husky_bringup.console.page import Page
from husky_bringup.console.panels import table
from husky_bringup.console.record import Record, Recorded
from husky_bringup.console.server import PageServer
from husky_runtime import graph

_SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
"""Of the record's time to that of who looks."""
_STEP = 0.01
"""Of the slider [s]."""
_JUMP = 2.0
"""A step of time that is longer is no playing on, but a look at another time [s]."""
_HELD = 0.4
"""Wall time for which the time stands after somebody has moved the slider [s]."""
_LONGEST = 1.0
"""Wall time of one turn that counts, at most [s]: while nobody looks there are none."""
_SLOWER = 6
"""Turns to one in which the slider follows the time."""
_EDGE, _WIDTH = 15, 560
"""Of the panel: from the left and lower edges of the picture; its own [pixels of CSS]."""
_STAYS = (graph.ROBOT_DESCRIPTION, graph.TERRAIN)
"""Topics whose messages the page keeps, whatever time it shows."""


class Player:
    """Takes a page through the time of a record.

    Attributes:
        time: of the record that is shown [s].
        failures: what could not be shown, messages for the most part.
    """

    def __init__(
        self, server: PageServer, page: Page, record: Record, decode: Callable[[str, bytes], Any]
    ):
        """Stand at the begin of the record, with the controls in a panel of their own.

        Args:
            server: of the page.
            page: that shows the record, and nothing else.
            record: that is played.
            decode: returns the message of a topic; raises an error where there is none.
        """
        self._page, self._record, self._decode = page, record, decode
        self.time = self._wanted = record.start
        self.failures, self._why = 0, ""
        self._shown = math.inf  # nothing yet
        self._kept: dict[str, bytes] = {}
        self._plays, self._last, self._held_until, self._turn = False, 0.0, 0.0, 0
        self._length = max(round(record.end - record.start, 2), _STEP)
        gui, self._inputs = server.gui, server.inputs
        panel = gui.add_panel()
        with panel.add_tab(str(record.path)):
            self._slider: Any = gui.add_slider("time [s]", 0.0, self._length, _STEP, 0.0)
            self._button = gui.add_button("play")
            self._speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1")
            self._notes = gui.add_html("")
        panel.float(x=_EDGE, y=-_EDGE, width=_WIDTH)
        self._presses: deque[Any] = deque()  # of threads of viser's
        self._button.on_click(self._presses.append)
        self._set = 0.0

    def turn(self, wall_time: float) -> None:
        """Go on by the wall time since the last turn, if it plays, and bring the page up to date.

        Args:
            wall_time: of now [s].
        """
        passed, self._last = min(wall_time - self._last, _LONGEST), wall_time
        while self._presses:
            self._presses.popleft()
            self._press()
        if self._was_moved():
            self._wanted = self._record.start + self._set
            self._held_until = wall_time + _HELD
        elif self._plays and wall_time > self._held_until:
            speed = self._speed.value  # likewise
            self._wanted = self.time + passed * float(speed if speed in _SPEEDS else 1.0)
            self._plays = self._wanted < self._record.end
        known = math.nextafter(self._record.read_to, -math.inf)
        self.time = min(self._wanted, self._record.end, known)
        self._show()
        self._turn = (self._turn + 1) % _SLOWER
        if self._turn == 0:
            self._draw_controls()

    def _was_moved(self) -> bool:
        """Whether somebody has moved the slider; to what there is, if it was to something else."""
        with self._inputs:
            moved = self._slider.value  # whatever a client has sent
            if moved == self._set:
                return False
            self._set = min(max(moved, 0.0), self._length) if math.isfinite(moved) else self._set
            self._slider.value = self._set
        return True

    def _follow(self) -> None:
        """Have the slider follow the time, unless it is being moved just now."""
        with self._inputs:
            if self._slider.value == self._set:
                self._set = round(self.time - self._record.start, 2)
                self._slider.value = self._set

    def _press(self) -> None:
        """Play or pause; what has come to its end begins again."""
        if not self._plays and self._wanted >= self._record.end:
            self._wanted = self.time = self._record.start
        self._plays = not self._plays

    def _show(self) -> None:
        """Have the page show the time."""
        if 0.0 <= self.time - self._shown <= _JUMP:
            news = self._record.between(self._shown, self.time)
        else:
            self._page.forget()
            news = self._record.standing(self.time)
        self._shown = self.time
        for each in news:
            self._attempt(partial(self._tell, each))
        self._attempt(partial(self._page.draw, self.time, self.time))

    def _tell(self, each: Recorded) -> None:
        """Give the page a message, unless it is one that it has."""
        if each.topic in _STAYS:
            if self._kept.get(each.topic) is each.data:
                return
            self._kept[each.topic] = each.data
        self._page.take(each.topic, self._decode(each.topic, each.data), each.time)

    def _attempt(self, act: Callable[[], None]) -> None:
        """Do something; what cannot be shown does not end the page."""
        try:
            act()
        except Exception as error:
            self.failures += 1
            self._why = str(error)

    def _draw_controls(self) -> None:
        """Bring the controls up to date."""
        if self._plays:
            self._follow()
        label = "pause" if self._plays else "play"
        if self._button.label != label:
            self._button.label = label
        rows = [("left out", text) for text in self._record.left_out]
        if self._record.read_to < self._record.end:
            read = (self._record.read_to - self._record.start) / self._length
            rows.append(("read", f"{100.0 * read:.0f} %"))
        if self.failures:
            rows.append(("failures", f"{self.failures}, the last: {self._why}"))
        content = table(rows)
        if content != self._notes.content:
            self._notes.content = content
