"""Curves over the robot's time: the last seconds of what it measures, as drawings (SVG).

viser's own plots let the view of time slip when data comes while they are being made, and show no
values but under the mouse.
"""

from __future__ import annotations

import colorsys
import math
from collections import deque
from collections.abc import Iterable
from html import escape

import numpy as np
from viser import GuiApi

from husky_description.arrays import Array

SPAN = 10.0
"""Of the robot's time that a plot shows [s]."""
PERIOD = 0.05
"""Of the robot's time between two points, at least [s]."""
_SLACK = 1e-6
"""By how much a point may come early [s]."""

_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 400, 150, 42, 16
"""Of a drawing, and what labels take of it, in units of its own."""
_FINE = 4
"""Parts of such a unit in which curves are given, in whole numbers."""
_LABELS = 5
"""Labels beside the axis of values, about."""
_TIMES = 2.0
"""Between two labels of time [s]."""


class Plot:
    """A plot of several curves that have their points at the same times.

    Nothing is to be seen of it until the first point, which says which curves there are.
    """

    def __init__(self, gui: GuiApi, title: str):
        """Show nothing yet; the plot will be where in the page it is made."""
        self._folder = gui.add_folder(title, visible=False)
        with self._folder:
            self._html = gui.add_html("")
        self._names: tuple[str, ...] = ()
        self._points: deque[tuple[float, ...]] = deque()
        self._fresh = False

    def add(self, time: float, values: dict[str, float]) -> None:
        """Add a point of each curve, unless the last one is too recent.

        Args:
            time: of the robot [s]; one before the last starts the plot anew.
            values: by the names of the curves, NaN for none; other names start the plot anew, too.
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

    def clear(self) -> None:
        """Have no point, and show nothing until there is one."""
        self._points.clear()
        self._fresh = self._folder.visible = False

    def draw(self) -> None:
        """Bring the page up to date."""
        if self._fresh:
            self._fresh = False
            self._html.content = picture(self._names, np.array(self._points))
            self._folder.visible = True


def picture(names: tuple[str, ...], points: Array) -> str:
    """Return curves with axes, and a legend with their newest values, as HTML.

    Args:
        names: of the curves.
        points: for each time a row: time [s], then a value of each curve (n, 1 + curves).
    """
    times, values = points[:, 0], points[:, 1:]
    begin, scale = times[-1] - SPAN, (_WIDTH - _LEFT) / SPAN
    low, high = _range(values)
    step = _step(high - low)
    height = (_HEIGHT - _BOTTOM) / (high - low)
    colours = [colour_of(index, len(names)) for index in range(len(names))]
    x, y = scale * (times - begin), height * (high - values)
    curves = [
        _curve(np.column_stack((x, c)), colour) for c, colour in zip(y.T, colours, strict=True)
    ]
    labels = [_level(height * (high - v), v, step) for v in _multiples(low, high, step)]
    labels += [
        f'<text x="{_LEFT + scale * (t - begin):.0f}" y="{_HEIGHT - 4}" text-anchor="middle">{t:g}'
        "</text>"
        for t in _multiples(begin + 0.5, times[-1] - 0.5, _TIMES)
    ]
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" style="width:100%;font-size:10px;'
        f'overflow:visible" fill="currentColor">{"".join(labels)}<g transform="translate({_LEFT}) '
        f'scale({1 / _FINE})" fill="none" stroke-width="{1.3 * _FINE}">{"".join(curves)}</g></svg>'
        f"{_legend(names, values[-1], colours)}"
    )


def colour_of(index: int, count: int) -> str:
    """Return a colour for one of several curves, as `#rrggbb`."""
    parts = colorsys.hls_to_rgb((index / count + 0.58) % 1.0, 0.45, 0.75)
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)


def _range(values: Array) -> tuple[float, float]:
    """Return between which values to draw: all that there are, and some room."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    room = max(0.05 * (high - low), 1e-3 * max(abs(low), abs(high)), 1e-3)
    return low - room, high + room


def _step(span: float) -> float:
    """Return the distance of labels that are round numbers."""
    rough = span / _LABELS
    decade = 10.0 ** math.floor(math.log10(rough))
    return next(decade * factor for factor in (1, 2, 5, 10) if decade * factor >= rough)


def _multiples(low: float, high: float, step: float) -> Array:
    """Return the multiples of a step between two values."""
    return np.arange(math.ceil(low / step), math.floor(high / step) + 1, dtype=float) * step


def _level(y: float, value: float, step: float) -> str:
    """Return a line across at a value, with its label."""
    digits = max(0, -math.floor(math.log10(step)))
    line = f'<path d="M{_LEFT} {y:.1f}H{_WIDTH}" stroke="currentColor" stroke-opacity="0.15"/>'
    return (
        f'{line}<text x="{_LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{value:.{digits}f}</text>'
    )


def _curve(points: Array, colour: str) -> str:
    """Return a curve through points (n, 2); it is interrupted where there is none."""
    # As a list's text: formatting each point would take ten times as long.
    path = "".join(f"M{str(piece)[1:-1]}" for piece in _pieces(_FINE * points))
    return f'<path d="{path.replace(",", "")}" stroke="{colour}"/>'


def _pieces(points: Array) -> Iterable[list[int]]:
    """Return the pieces of a curve between points that are not finite, in whole numbers."""
    finite = np.isfinite(points[:, 1])
    parts = [points]
    if not finite.all():
        turns = np.flatnonzero(np.diff(finite)) + 1
        parts = np.split(points, turns)[0 if finite[0] else 1 :: 2]
    return (np.rint(part).astype(int).ravel().tolist() for part in parts)


def _legend(names: tuple[str, ...], values: Array, colours: list[str]) -> str:
    """Return names in their colours, with values."""
    entries = "".join(
        f'<span style="white-space:nowrap"><span style="color:{colour}">&#9632;</span> '
        f"{escape(name)} <b>{value:.4g}</b></span> "
        for name, value, colour in zip(names, values, colours, strict=True)
    )
    style = "display:flex;flex-wrap:wrap;gap:0 0.9em;font-size:0.75em;padding:0 0.6em 0.4em"
    return f'<div style="{style}">{entries}</div>'
