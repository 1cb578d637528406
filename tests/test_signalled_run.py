"""A run of tests that a signal ends tells what had failed until then."""

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


def test_a_run_that_is_told_to_end_tells_what_had_failed(tmp_path):
    shutil.copy(Path(__file__).parents[1] / "conftest.py", tmp_path)
    said = inner_run(tmp_path, {"test_it.py": TESTS}, code=128 + signal.SIGTERM)
    assert "E       assert 1 == 2" in said
    assert "FAILED tests/test_it.py::test_wrong" in said
    assert "ended by SIGTERM" in said
    assert "1 failed in" in said, "and goes no further"
