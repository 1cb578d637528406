"""A test that hangs where pytest-timeout cannot end it ends all the same, and is named."""

from __future__ import annotations

import re

from inner_run import inner_run

IN_A_LIBRARY = """
import ctypes

def test_it():
    mutex = ctypes.create_string_buffer(64)
    for _ in range(2):
        ctypes.PyDLL(None).pthread_mutex_lock(mutex)
"""
FIXTURE = """
import contextlib
import pathlib
import threading
import pytest

def hang():
    threading.Event().wait()

@pytest.fixture
def never_ends():
    yield
    hang()

@pytest.fixture
def never_ever_ends():
    yield
    with contextlib.ExitStack() as stack:
        stack.callback(hang)
        hang()

@pytest.fixture
def ends_the_second_time():
    yield
    if not pathlib.Path("tried").exists():
        pathlib.Path("tried").touch()
        hang()
"""
AFTER_A_FAILURE = f"""{FIXTURE}
def test_it(never_ends):
    assert False
"""
AGAIN = f"""{FIXTURE}
def test_it(never_ever_ends):
    assert False
"""
BEFORE_THE_SECOND_TRY = f"""{FIXTURE}
@pytest.mark.graph
def test_it(ends_the_second_time):
    assert pathlib.Path("tried").exists()
"""
OTHERS = "".join(f"def test_{n}():\n    pass\n" for n in range(3))


def test_tests_that_hang_end_and_the_others_are_run(tmp_path):
    hanging = {
        "library": IN_A_LIBRARY,
        "failed": AFTER_A_FAILURE,
        "again": AGAIN,
        "graph": BEFORE_THE_SECOND_TRY,
    }
    files = {f"test_{name}.py": text + OTHERS for name, text in hanging.items()}
    said = inner_run(tmp_path, files, "-n", "4", "-p", "timeout", "-o", "timeout=6", code=1)
    for name in ("library", "again"):
        crashed = rf"^worker '\w+' crashed while running 'tests/test_{name}.py::test_it'$"
        assert len(re.findall(crashed, said, re.MULTILINE)) == 1, said
        assert f" s: tests/test_{name}.py::test_it\n" in said
    assert said.count("NOT ENDED") == 2
    assert "in test_it\n" in said and "in hang\n" in said, "where they stood"
    assert "ERROR tests/test_failed.py::test_it - Failed: Timeout (>6.0s)" in said
    assert "SECOND TRY tests/test_graph.py::test_it\n" in said
    assert "4 failed, 13 passed, 1 error" in said, "two have failed before they hung"
