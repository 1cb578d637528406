"""A run of tests that a signal ends tells what had failed until then, and what it was at."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path

from inner_run import inner_run

TESTS = """
import os
import signal

def test_wrong():
    assert 1 == 2

def test_in_which_it_is_told_to_end():
    os.kill(os.getpid(), signal.SIGTERM)

def test_after():
    pass
"""
AT_WORK = """
import os
import pathlib
import signal
import time

def test_that_takes_long():
    while not pathlib.Path("heard").exists():
        time.sleep(0.01)
    os.kill(os.getppid(), signal.SIGTERM)
    time.sleep(1000)
"""
WHO_HANDS_OUT = """

def _is_main():
    return "PYTEST_XDIST_WORKER" not in os.environ

@pytest.hookimpl(trylast=True)
def pytest_runtest_logstart():
    if _is_main():
        open("heard", "w").close()

def pytest_unconfigure():
    if _is_main():
        os.kill(os.getpid(), signal.SIGTERM)
"""


def test_a_run_that_is_told_to_end_tells_what_had_failed(tmp_path):
    shutil.copy(Path(__file__).parents[1] / "conftest.py", tmp_path)
    said = inner_run(tmp_path, {"test_it.py": TESTS}, code=128 + signal.SIGTERM)
    assert "E       assert 1 == 2" in said
    assert "FAILED tests/test_it.py::test_wrong" in said
    assert "ended by SIGTERM" in said
    assert "1 failed in" in said, "and goes no further"


def test_a_run_that_is_told_to_end_tells_what_it_was_at(tmp_path):
    """It is told twice, as by one signal for the whole group and one of who has started it."""
    conftest = (Path(__file__).parents[1] / "conftest.py").read_text()
    (tmp_path / "conftest.py").write_text(conftest + WHO_HANDS_OUT)
    options = ("-n", "2", "-p", "timeout")
    said = inner_run(tmp_path, {"test_it.py": AT_WORK}, *options, code=128 + signal.SIGTERM)
    assert " s: tests/test_it.py::test_that_takes_long\n" in said
    assert "ended by SIGTERM" in said and "Traceback" not in said
