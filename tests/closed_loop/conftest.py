"""Robots in one process; a test may get a copy of one as its fixture has left it."""

import os
import sys
import traceback
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # which import mode importlib does not


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is marked `in_a_copy` in a copy of this process.

    Whatever it does to the robot of a fixture, the next test finds that robot as it was: standing
    up or taking off is simulated once.
    """
    if pyfuncitem.get_closest_marker("in_a_copy") is None:
        return None
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            names = pyfuncitem._fixtureinfo.argnames
            pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names})
        except BaseException:
            os.write(writer, traceback.format_exc().encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as told:
        failure = told.read()
    _, status = os.waitpid(child, 0)
    if failure or status:
        pytest.fail(failure or f"the copy has ended with status {status}", pytrace=False)
    return True
