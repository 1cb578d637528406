"""What all figures share: colours, axes with units, bands of the modes, thinning of long lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import ControllerStates
from husky_runtime import graph

LEG_COLOURS = ("#1f6fb4", "#d1495b", "#1b998b", "#e08e0b")
"""Front left, front right, hind left, hind right: left cool, right warm."""
FAN_COLOURS = (*LEG_COLOURS, "#7b4fa6", "#7a5c3e", "#6b8e23", "#808080")
"""As many as a robot may have fans; of four they are the legs'."""
TRUTH = "#222222"
ESTIMATE = "#1f6fb4"
DESIRED = "#e07a00"

TIME = "time [s]"
PARTS = ("whole recording", "a closer look")
"""Titles of the two halves of a figure that shows both."""

_BANDS = {
    "stand_up": "#fff3d6",
    "stand": "#ececec",
    "walk": "#e3f3e6",
    "position_trot": "#e3f3e6",
    "sit": "#e9e4f5",
    "perch": "#fbe3ea",
    "splay": "#dcecf8",
    "balance": "#f3ecd9",
    "leap": "#dcecf8",
    "fly": "#d3f0ee",
    "quadrotor": "#d3f0ee",
    "settle": "#ffeedd",
    "damping": "#ffe0cc",
    "emergency_stop": "#ffd6d6",
}
"""Background of each mode; passive stays white."""
_INK = "#333333"
_POINTS = 1600
"""Bins of a long line: about one for each pixel of a wide axis."""
_DPI = 110
_CLOSE_LOOK = 2.0
"""Length of the closer look at a few steps [s]."""
_STEPPING = ("walk", "position_trot", "wair", "tread")
"""Modes in which the legs step."""


@dataclass(frozen=True)
class Band:
    """A time in which mode and gait stay the same."""

    start: float  # s
    end: float  # s
    mode: str
    gait: str

    @property
    def label(self) -> str:
        """The gait while walking, else the mode."""
        return self.gait if self.mode == "walk" else self.mode.replace("_", " ")


def bands(states: ControllerStates) -> list[Band]:
    """Return the times of constant mode (and gait, while walking)."""
    if not len(states):
        return []
    keys = [
        (mode, gait if mode == "walk" else "")
        for mode, gait in zip(states.mode, states.gait, strict=True)
    ]
    starts = [0, *(i for i in range(1, len(keys)) if keys[i] != keys[i - 1])]
    ends = [*starts[1:], len(keys) - 1]
    return [
        Band(float(states.time[first]), float(states.time[last]), *keys[first])
        for first, last in zip(starts, ends, strict=True)
    ]


def make_figure(
    rows: int, columns: int, title: str, size: tuple[float, float] = (13.0, 8.0), **grid: Any
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of a size [inches] and its axes (rows, columns), styled.

    What else is given goes to `Figure.subplots`.
    """
    figure = Figure(figsize=size, dpi=_DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold", color=_INK)
    axes: NDArray[Any] = figure.subplots(rows, columns, squeeze=False, **grid)
    for axis in axes.flat:
        style(axis)
    return figure, axes


def style(axis: Axes) -> None:
    """Give an axis the common look."""
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axis.spines[side].set_color("#999999")
    axis.tick_params(labelsize=8, color="#999999", labelcolor=_INK)
    axis.grid(True, color="#d5d5d5", linewidth=0.5)
    axis.set_axisbelow(True)


def label(axis: Axes, y: str = "", x: str = "", title: str = "") -> None:
    """Name the axes (with unit) and what they show."""
    if y:
        axis.set_ylabel(y, fontsize=9, color=_INK)
    if x:
        axis.set_xlabel(x, fontsize=9, color=_INK)
    if title:
        axis.set_title(title, fontsize=9.5, loc="left", color=_INK, pad=13)


def label_rows(axes: Sequence[Axes] | NDArray[Any], names: Sequence[str], title: str = " ") -> None:
    """Name axes above each other (with unit), the time below the last, a title above the first."""
    last = len(names) - 1
    for row, (axis, name) in enumerate(zip(axes, names, strict=True)):
        label(axis, name, TIME if row == last else "", "" if row else title)


def legend(figure: Figure, entries: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
    """Explain lines at the top right of a figure, clear of the data.

    Args:
        figure: that gets the legend.
        entries: name and line style (as for `Axes.plot`) of each.
    """
    handles = [Line2D([], [], **{"linewidth": 2.0, **look}) for _, look in entries]
    figure.legend(
        handles,
        [name for name, _ in entries],
        loc="upper right",
        ncols=len(entries),
        fontsize=9,
        frameon=False,
        handlelength=1.8,
        columnspacing=1.4,
        bbox_to_anchor=(1.0, 1.005),
    )


def leg_entries(legs: Sequence[str], **look: Any) -> list[tuple[str, dict[str, Any]]]:
    """Return the legend's entries of the legs, or of fans by their names."""
    return [
        (name.replace("_", " "), {"color": colour, **look})
        for name, colour in zip(legs, FAN_COLOURS[: len(legs)], strict=True)
    ]


def shade(axis: Axes, spans: list[Band], names: bool = True) -> None:
    """Draw the modes behind an axis, their names above it where there is room."""
    low, high = axis.get_xlim()
    for band in spans:
        start, end = max(band.start, low), min(band.end, high)
        if end <= start:
            continue
        colour = _BANDS.get(band.mode)
        if colour is not None:
            axis.axvspan(start, end, color=colour, zorder=-5, linewidth=0)
        if names and (end - start) > 0.012 * len(band.label) * (high - low):
            axis.annotate(
                band.label,
                ((start + end) / 2.0, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(0, 2),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=7,
                color="#666666",
            )


def line(
    axis: Axes, time: Array, values: Array, colour: str, name: str = "", **options: Any
) -> None:
    """Draw values over time; a long line keeps the extremes of each bin."""
    thin_time, thin_values = thin(time, values)
    axis.plot(
        thin_time,
        thin_values,
        **{"color": colour, "linewidth": 1.0, **options},
    )


def thin(time: Array, values: Array, bins: int = _POINTS) -> tuple[Array, Array]:
    """Return fewer points that look the same: least and greatest value of each bin.

    Args:
        time: (n,).
        values: (n,).
        bins: of equal sample count; shorter lines are returned as they are.
    """
    size = len(time) // bins
    if size < 3:
        return time, values
    count = len(time) // size * size
    blocks = values[:count].reshape(-1, size)
    pairs = np.sort(np.column_stack((blocks.argmin(axis=1), blocks.argmax(axis=1))), axis=1)
    index = (pairs + np.arange(len(blocks))[:, None] * size).ravel()
    index = np.concatenate((index, np.arange(count, len(time))))
    return time[index], values[index]


def finish(
    figure: Figure,
    entries: Sequence[tuple[str, Mapping[str, Any]]],
    directory: Path,
    name: str,
) -> Path:
    """Explain a figure's lines, as `legend` does, and write it, as `save` does."""
    legend(figure, entries)
    return save(figure, directory, name)


def save(figure: Figure, directory: Path, name: str) -> Path:
    """Write a figure as PNG and return its path."""
    path = directory / f"{name}.png"
    figure.savefig(path)
    return path


def each_leg(axes: NDArray[Any], legs: tuple[str, ...]) -> Iterator[tuple[int, Axes, str, str]]:
    """Yield index, axis, name in words and colour of each leg."""
    for index, (axis, name, colour) in enumerate(zip(axes, legs, LEG_COLOURS, strict=True)):
        yield index, axis, name.replace("_", " "), colour


# Times of a recording --------------------------------------------------------------------------
def modes_of(recording: Recording) -> list[Band]:
    """Return the times of constant mode, none where the controller was not recorded."""
    return bands(recording.controller) if recording.has(graph.CONTROLLER_STATE) else []


def span_of(recording: Recording) -> tuple[float, float]:
    """Return first and last time [s]."""
    return recording.start, max(recording.end, recording.start + graph.TICK_PERIOD)


def close_look(recording: Recording) -> tuple[float, float]:
    """Return two seconds in the middle of the longest walk, or of the whole recording.

    A walk is any time in which the legs step: also up a slope, or in ropes.
    """
    walks = [band for band in modes_of(recording) if band.mode in _STEPPING]
    longest = max(walks, key=lambda band: band.end - band.start, default=None)
    start, end = (longest.start, longest.end) if longest else span_of(recording)
    if end - start <= _CLOSE_LOOK:
        return start, end
    middle = (start + end) / 2.0
    return middle - _CLOSE_LOOK / 2.0, middle + _CLOSE_LOOK / 2.0


def frame(axis: Axes, span: tuple[float, float], modes: list[Band], names: bool = True) -> None:
    """Set the time range and draw the modes behind it."""
    axis.set_xlim(*span)
    shade(axis, modes, names)


def frame_rows(recording: Recording, axes: Sequence[Axes] | NDArray[Any]) -> None:
    """Frame axes above each other to a whole recording, with the modes' names above the first."""
    span, modes = span_of(recording), modes_of(recording)
    for row, axis in enumerate(axes):
        frame(axis, span, modes, names=row == 0)
