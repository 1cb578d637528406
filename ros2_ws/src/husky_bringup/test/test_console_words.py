"""Words of the page: what a real server has been given to show."""

from __future__ import annotations

import colorsys
import re
from html.parser import HTMLParser

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st

from husky_bringup.console import panels
from husky_bringup.console.panels import Facts, Reports, table
from husky_bringup.console.server import PageServer

EVIL = "<script>alert('1')</script>&lt;\"'"


@pytest.fixture
def reports(server: PageServer) -> Reports:
    return Reports(server.gui)


class Cells(HTMLParser):
    """The cells of a table: their texts, and the colour of a row's first."""

    def __init__(self, html: str):
        super().__init__()
        self.rows: list[list[str]] = []
        self.colours: list[str] = []
        self.tags: set[str] = set()
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag == "td":
            self.rows[-1].append("")
            style = dict(attrs).get("style") or ""
            self.colours += re.findall("(?:^|;)color:(#[0-9a-f]{6})", style)

    def handle_data(self, data: str) -> None:
        self.rows[-1][-1] += data


# Facts --------------------------------------------------------------------------------------------
def test_facts_stand_in_the_order_of_their_topics_however_they_come(server: PageServer) -> None:
    facts = Facts(server.gui, ["first", "second", "third"])
    facts.draw()
    assert Cells(facts._html.content).rows == []
    facts.tell("third", [("e", "5")])
    facts.tell("first", [("a", "old"), ("b", "old")])
    facts.tell("second", [("c", "3")])
    facts.tell("first", [("z", "1"), ("b", "2")])
    facts.draw()
    assert Cells(facts._html.content).rows == [["z", "1"], ["b", "2"], ["c", "3"], ["e", "5"]]
    facts.tell("second", [])
    facts.draw()
    assert Cells(facts._html.content).rows == [["z", "1"], ["b", "2"], ["e", "5"]]


@given(
    st.lists(st.tuples(*[st.text(st.characters(exclude_categories=["Cs"])) | st.just(EVIL)] * 2))
)
def test_whatever_a_row_holds_is_read_as_text(rows: list[tuple[str, str]]) -> None:
    cells = Cells(table(rows))
    assert [tuple(row) for row in cells.rows] == rows
    assert cells.tags <= {"div", "table", "tr", "td"}


# Reports ------------------------------------------------------------------------------------------
def told(*names: str, level: bytes = DiagnosticStatus.OK, message: str = "fine") -> DiagnosticArray:
    values = [KeyValue(key="volt", value="24"), KeyValue(key=EVIL, value=EVIL)]
    return DiagnosticArray(
        status=[
            DiagnosticStatus(name=name, level=level, message=message, values=values)
            for name in names
        ]
    )


def shown(reports: Reports, now: float) -> Cells:
    reports.draw(now)
    return Cells(reports._summary.content)


@pytest.mark.parametrize(
    ("level", "word", "hues"),
    [
        (DiagnosticStatus.OK, "ok", (90, 150)),
        (DiagnosticStatus.WARN, "warning", (20, 50)),
        (DiagnosticStatus.ERROR, "error", (0, 10)),
        (DiagnosticStatus.STALE, "stale", None),
        (b"\x07", "stale", None),
        (b"\xff", "stale", None),
    ],
)
def test_a_level_has_its_word_and_its_colour(
    reports: Reports, level: bytes, word: str, hues: tuple[int, int] | None
) -> None:
    """Green, orange, red; grey for one that says nothing."""
    reports.tell(told("node", level=level), 0.0)
    cells = shown(reports, 1.0)
    assert cells.rows == [[word, "node", "fine"]]
    parts = [byte / 255 for byte in bytes.fromhex(cells.colours[0][1:])]
    hue, _, saturation = colorsys.rgb_to_hls(*parts)
    if hues is None:
        assert saturation < 0.1
    else:
        assert saturation > 0.4 and hues[0] <= 360 * hue <= hues[1]


def test_reports_stand_in_alphabetic_order_with_what_each_node_said_last(reports: Reports) -> None:
    reports.tell(told("b", "c"), 0.0)
    reports.tell(told("a"), 0.0)
    reports.tell(told("b", level=DiagnosticStatus.ERROR, message="hot"), 1.0)
    rows = shown(reports, 1.0).rows
    assert rows == [["ok", "a", "fine"], ["error", "b", "hot"], ["ok", "c", "fine"]]


def test_a_node_that_is_silent_for_too_long_is_stale_until_it_speaks(reports: Reports) -> None:
    limit = panels._SILENT
    reports.tell(told("node", "other", level=DiagnosticStatus.ERROR), 100.0)
    assert [row[0] for row in shown(reports, 100.0 + limit).rows] == ["error", "error"]
    reports.tell(told("other"), 103.0)
    rows = shown(reports, 101.0 + limit).rows
    assert rows == [["stale", "node", f"silent for {limit + 1:.0f} s"], ["ok", "other", "fine"]]
    reports.tell(told("node"), 102.0 + limit)
    assert shown(reports, 102.0 + limit).rows[0] == ["ok", "node", "fine"]


def test_whatever_a_report_holds_is_read_as_text(reports: Reports) -> None:
    reports.tell(told(EVIL, message=EVIL), 0.0)
    cells = shown(reports, 0.0)
    assert cells.rows == [["ok", EVIL, EVIL]] and "script" not in cells.tags
    values = Cells(reports._values[EVIL].content)
    assert values.rows == [["volt", "24"], [EVIL, EVIL]] and "script" not in values.tags


def test_values_are_those_of_the_last_report(reports: Reports) -> None:
    reports.tell(told("node"), 0.0)
    reports.draw(0.0)
    handle = reports._values["node"]
    again = told("node")
    again.status[0].values = [KeyValue(key="volt", value="23")]
    reports.tell(again, 1.0)
    reports.draw(1.0)
    assert reports._values["node"] is handle and Cells(handle.content).rows == [["volt", "23"]]


def test_no_more_reports_than_allowed_are_shown(
    reports: Reports, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(panels, "_MOST", 3)
    reports.tell(told("d", "c", "b", "a"), 0.0)
    reports.tell(told("b", "z", message="again"), 1.0)
    rows = [row[1:] for row in shown(reports, 1.0).rows]
    assert rows == [["b", "again"], ["c", "fine"], ["d", "fine"]]
    assert sorted(reports._values) == ["b", "c", "d"]
