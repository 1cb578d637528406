"""A failed test of processes is run once more in a fresh graph; the end tells of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from inner_run import inner_run

BENCH = """
import pathlib
import pytest

@pytest.fixture(scope="module")
def number():
    "Which graph it is; a file keeps count."
    count = pathlib.Path("starts")
    count.write_text(count.read_text() + "x" if count.exists() else "x")
    yield len(count.read_text())
    pathlib.Path("ends").open("a").write("x")
"""
ONCE = """
@pytest.mark.graph
def test_unlucky_{0}(number):
    assert pathlib.Path("tried_{0}").exists() or pathlib.Path("tried_{0}").touch(), "too late"
"""


def outcome(root: Path, text: str, *options: str, code: int = 0) -> str:
    """Run tests of one file in a worker; return what is said."""
    return inner_run(root, {"test_it.py": BENCH + text}, "-n", "1", *options, code=code)


def test_the_second_try_has_a_fresh_graph(tmp_path):
    text = """
@pytest.mark.graph
def test_first(number):
    assert number == 1

@pytest.mark.graph
def test_unlucky(number):
    assert number == 2, "the first graph"

@pytest.mark.graph
def test_goes_on_with_that(number):
    assert number == 2
"""
    said = outcome(tmp_path, text)
    assert "3 passed" in said
    assert "SECOND TRY tests/test_it.py::test_unlucky\n" in said
    assert "  AssertionError: the first graph\n" in said
    assert "  assert 1 == 2\n" in said, "all that the first try said"
    assert (tmp_path / "ends").read_text() == "xx", "the first graph has ended too"


def test_a_start_is_tried_again_too(tmp_path):
    text = """
@pytest.fixture
def started(number):
    assert number == 2, "does not start"

@pytest.mark.graph
def test_it(started):
    pass
"""
    said = outcome(tmp_path, text)
    assert "1 passed" in said
    assert "SECOND TRY tests/test_it.py::test_it\n" in said
    assert "  AssertionError: does not start\n" in said


def test_a_second_failure_fails_and_says_both(tmp_path):
    text = """
@pytest.mark.graph
def test_it(number):
    assert number > 2, f"graph {number}"
"""
    said = outcome(tmp_path, text, code=1)
    assert "1 failed" in said and "SECOND TRY" not in said
    assert "graph 1" in said and "graph 2" in said and "graph 3" not in said


def test_pure_code_is_judged_once(tmp_path):
    said = outcome(tmp_path, ONCE.format("a").replace("@pytest.mark.graph", ""), code=1)
    assert "1 failed" in said and "SECOND TRY" not in said


@pytest.mark.parametrize("number, code", [(3, 0), (4, 1)])
def test_more_than_three_are_no_accident(tmp_path, number, code):
    said = outcome(tmp_path, "".join(map(ONCE.format, range(number))), code=code)
    assert f"{number} passed" in said
    assert said.count("SECOND TRY") == number
    assert ("FAILED: 4 second tries" in said) == (code == 1)


def test_what_is_left_out_is_said(tmp_path):
    text = "".join(
        f"\n@pytest.mark.{marker}\ndef test_{marker}():\n    pass\n"
        for marker in ("graph", "docker", "realtime", "slow")
    )
    said = outcome(tmp_path, text, "-m", "not (docker or bare or realtime or slow)")
    assert "1 passed" in said
    assert re.search(r"^left out: 3 tests .*; scripts/test.sh --all runs them$", said, re.MULTILINE)
