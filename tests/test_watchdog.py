"""A test that hangs where pytest-timeout cannot end it ends all the same, and is named."""

from __future__ import annotations

from inner_run import inner_run

IN_A_LIBRARY = """
import ctypes

def test_it():
    mutex = ctypes.create_string_buffer(64)
    for _ in range(2):
        ctypes.PyDLL(None).pthread_mutex_lock(mutex)
"""
FIXTURE = """
import threading
import pytest

@pytest.fixture
def never_ends():
    yield
    threading.Event().wait()
"""
AFTER_A_FAILURE = f"""{FIXTURE}
def test_it(never_ends):
    assert False
"""
BEFORE_THE_SECOND_TRY = f"""{FIXTURE}
@pytest.mark.graph
def test_it(never_ends):
    assert False
"""
OTHERS = "".join(f"def test_{n}():\n    pass\n" for n in range(3))


def test_tests_that_hang_end_and_the_others_are_run(tmp_path):
    hanging = {"library": IN_A_LIBRARY, "failed": AFTER_A_FAILURE, "again": BEFORE_THE_SECOND_TRY}
    files = {f"test_{name}.py": text + OTHERS for name, text in hanging.items()}
    said = inner_run(tmp_path, files, "-n", "3", "-p", "timeout", "-o", "timeout=6", code=1)
    for name in files:
        assert said.count(f"crashed while running 'tests/{name}::test_it'\n") == 1
        assert f" s: tests/{name}::test_it\n" in said
    assert "4 failed, 9 passed" in said, "one failed before it hung"
    assert said.count("in never_ends\n") == 2 and said.count("in test_it\n") == 1, "where it stood"
