"""Curves of the page, read back from what is drawn."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_bringup.console.plots import PERIOD, SPAN, Plot, colour_of, picture
from husky_bringup.console.server import PageServer


class Read:
    """A drawing as somebody sees it.

    Attributes:
        curves: times and values of each, by their colours; NaN between its pieces.
        legend: names, colours and newest values.
        levels: labels of the axis of values.
    """

    def __init__(self, html: str):
        root = ElementTree.fromstring(f"<all>{html}</all>")
        texts = [(each.attrib, float(each.text or "")) for each in root.iter("text")]
        levels = [(float(at["y"]) - 3, v) for at, v in texts if at["text-anchor"] == "end"]
        times = [(float(at["x"]), v) for at, v in texts if at["text-anchor"] == "middle"]
        self.levels = [value for _, value in levels]
        group = root.find("svg/g")
        assert group is not None
        move, fine = map(float, re.findall(r"[\d.]+", group.attrib["transform"]))
        time, value = (np.polyfit(*np.transpose(axis), 1) for axis in (times, levels))
        self.curves = {}
        for path in group.iter("path"):
            points = np.reshape([float(n) for n in re.findall(r"-?\d+", path.attrib["d"])], (-1, 2))
            x, y = (
                np.polyval(time, points[:, 0] * fine + move),
                np.polyval(value, points[:, 1] * fine),
            )
            self.curves[path.attrib["stroke"]] = x, y, path.attrib["d"].count("M")
        self.legend = [
            ((each[0].tail or "").strip(), each[0].attrib["style"].partition(":")[2], each[1].text)
            for each in root.findall("div/span")
        ]

    def of(self, name: str) -> tuple[np.ndarray, np.ndarray, int]:
        """Times, values and number of pieces of a curve."""
        return self.curves[next(colour for found, colour, _ in self.legend if found == name)]


@pytest.fixture
def plot(server: PageServer) -> Plot:
    return Plot(server.gui, "plot")


def read(plot: Plot) -> Read:
    plot.draw()
    return Read(plot._html.content)


def rows(*curves: np.ndarray, end: float = 40.0) -> np.ndarray:
    """Points of curves up to a time."""
    count = len(curves[0])
    return np.column_stack((end - PERIOD * np.arange(count)[::-1], *curves))


# What is drawn ------------------------------------------------------------------------------------
@pytest.mark.parametrize("scale", [1e-3, 1.0, 250.0, 1e6])
def test_a_curve_goes_through_its_points(scale: float) -> None:
    wave = scale * np.sin(np.arange(150) / 9.0)
    points = rows(wave, 0.3 * wave - scale)
    drawn = Read(picture(("a", "b"), points))
    for name, column in (("a", 1), ("b", 2)):
        times, values, pieces = drawn.of(name)
        np.testing.assert_allclose(times, points[:, 0], atol=0.02)
        np.testing.assert_allclose(values, points[:, column], atol=0.01 * scale)
        assert pieces == 1
    assert 3 <= len(drawn.levels) <= 8
    assert [text for _, _, text in drawn.legend] == [f"{points[-1, c]:.4g}" for c in (1, 2)]


def test_a_curve_is_interrupted_where_there_is_no_value() -> None:
    values = np.linspace(0.0, 1.0, 100)
    values[20:30] = values[50] = np.nan
    times, found, pieces = Read(picture(("a",), rows(values))).of("a")
    assert pieces == 3
    np.testing.assert_allclose(found, values[np.isfinite(values)], atol=0.01)
    assert len(times) == 89


@pytest.mark.parametrize("value", [0.0, 25.2, -3e5, math.nan, math.inf])
def test_what_does_not_change_is_drawn_too(value: float) -> None:
    drawn = Read(picture(("a",), rows(np.full(5, value))))
    assert len(drawn.levels) >= 2 and drawn.legend[0][2] == f"{value:.4g}"


def test_names_are_no_tags() -> None:
    evil = "<script>alert('1')</script>"
    html = picture((evil,), rows(np.zeros(2)))
    assert "<script" not in html and Read(html).legend[0][0] == evil


@given(
    st.lists(
        st.tuples(*[st.floats(-1e9, 1e9) | st.sampled_from([math.nan, math.inf, -math.inf])] * 2),
        min_size=1,
        max_size=20,
    )
)
def test_whatever_is_measured_is_a_picture(values: list[tuple[float, float]]) -> None:
    html = picture(("a", "b"), rows(*np.array(values).T))
    assert "nan" not in html.partition("</svg>")[0]
    ElementTree.fromstring(f"<all>{html}</all>")


def test_each_curve_has_a_colour_of_its_own() -> None:
    for count in (1, 3, 12, 30):
        colours = {colour_of(index, count) for index in range(count)}
        assert len(colours) == count
        assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in colours)


# Which points there are ---------------------------------------------------------------------------
def test_a_plot_is_seen_when_there_is_a_curve(plot: Plot) -> None:
    plot.add(1.0, {})
    plot.draw()
    assert not plot._folder.visible
    plot.add(12.0, {"left": 5.0, "right": -5.0})
    plot.add(13.0, {"left": 6.0, "right": -6.0})
    drawn = read(plot)
    assert plot._folder.visible and [name for name, _, _ in drawn.legend] == ["left", "right"]
    np.testing.assert_allclose(drawn.of("right")[0], [12.0, 13.0], atol=0.02)
    content = plot._html.content
    plot.add(14.0, {"left": 7.0, "right": -7.0})
    assert plot._html.content == content, "nothing changes before it is drawn"
    assert len(read(plot).of("left")[0]) == 3


def times_of(plot: Plot) -> list[float]:
    plot.draw()
    return [point[0] for point in plot._points]


def test_points_come_no_closer_than_the_period_and_hardly_later(plot: Plot) -> None:
    step = PERIOD / 7
    for index in range(300):
        plot.add(step * index, {"a": 1.0})
    ways = np.diff(times_of(plot))
    assert len(ways) > 30 and (ways > PERIOD - 1e-5).all() and (ways < PERIOD + step).all()


def test_points_at_the_period_are_all_taken_however_they_are_rounded(plot: Plot) -> None:
    times = [1000.0 + PERIOD * index for index in range(150)]
    for time in times:
        plot.add(time, {"a": 1.0})
    assert times_of(plot) == times


def test_a_plot_keeps_its_span(plot: Plot) -> None:
    for index in range(600):
        plot.add(PERIOD * index, {"a": float(index)})
    first, *_, last = times_of(plot)
    assert last == PERIOD * 599 and SPAN - PERIOD < last - first <= SPAN
    assert read(plot).legend[0][2] == "599"


def test_time_that_goes_back_starts_the_plot_anew(plot: Plot) -> None:
    for time in (15.0, 16.0, 10.5, 11.0):
        plot.add(time, {"a": time})
    assert times_of(plot) == [10.5, 11.0]
    np.testing.assert_allclose(read(plot).of("a")[1], [10.5, 11.0], atol=0.02)


def test_other_curves_start_the_plot_anew(plot: Plot) -> None:
    plot.add(11.0, {"a": 1.0})
    plot.draw()
    plot.add(11.001, {"b": 2.0, "c": 3.0})
    assert [name for name, _, _ in read(plot).legend] == ["b", "c"] and times_of(plot) == [11.001]
