"""Curves over the robot's time: the last seconds of what it measures."""

from __future__ import annotations

import colorsys
from collections import deque
from typing import Any

import numpy as np
from viser import GuiApi, uplot

SPAN = 10.0
"""Of the robot's time that a plot shows [s]."""
PERIOD = 0.05
"""Of the robot's time between two points, at least [s]."""
_SLACK = 1e-6
"""By how much a point may come early [s]."""
_HEIGHT = 200
"""Of a plot with its legend [pixels]."""


class Plot:
    """A plot of several curves that have their points at the same times.

    Nothing is to be seen of it until the first point, which says which curves there are.
    """

    def __init__(self, gui: GuiApi, title: str):
        """Show nothing yet; the plot will be where in the page it is made."""
        self._gui, self._folder = gui, gui.add_folder(title, visible=False)
        self._names: tuple[str, ...] = ()
        self._points: deque[tuple[float, ...]] = deque()
        self._shown: tuple[str, ...] = ()
        self._handle: Any = None
        self._fresh = False

    def add(self, time: float, values: dict[str, float]) -> None:
        """Add a point of each curve, unless the last one is too recent.

        Args:
            time: of the robot [s]; one before the last starts the plot anew.
            values: by the names of the curves; other names than before start it anew, too.
        """
        if not values:
            return
        names, last = tuple(values), self._points[-1][0] if self._points else time - SPAN
        if names != self._names or time < last:
            self._points.clear()
        elif time < last + PERIOD - _SLACK:
            return
        self._names = names
        self._points.append((time, *values.values()))
        while self._points[0][0] < time - SPAN:
            self._points.popleft()
        self._fresh = True

    def draw(self) -> None:
        """Bring the page up to date."""
        if not self._fresh:
            return
        self._fresh = False
        data = tuple(np.array(self._points, dtype=float).T)
        if self._shown == self._names:
            self._handle.data = data
            return
        if self._handle is not None:
            self._handle.remove()
        with self._folder:
            self._handle = self._gui.add_uplot(
                data, self._series(), scales={"x": uplot.Scale(time=False)}, height=_HEIGHT
            )
        self._folder.visible, self._shown = True, self._names

    def _series(self) -> tuple[uplot.Series, ...]:
        count = len(self._names)
        curves = [
            uplot.Series(label=name, stroke=colour_of(index, count), width=1.5)
            for index, name in enumerate(self._names)
        ]
        return (uplot.Series(label="t [s]"), *curves)


def colour_of(index: int, count: int) -> str:
    """Return a colour for one of several curves, as `#rrggbb`."""
    parts = colorsys.hls_to_rgb((index / count + 0.58) % 1.0, 0.45, 0.75)
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)
