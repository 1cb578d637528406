"""What holds for every test: a property is judged by its examples, not by how long one takes; a
signal ends the run as it ends any script.
"""

import contextlib
import gc
import os
import resource
import signal
import traceback
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

settings.register_profile("patient", settings(), deadline=None)
settings.load_profile("patient")

os.register_at_fork(after_in_child=gc.freeze)
"""A copy of a test process does not collect what earlier tests have left: an object with threads,
as a ROS node, ends a process that has not got these."""

_ended_by: list[int] = []
"""Signals that have ended this run."""
_FINISHES = pytest.StashKey[bool]()
"""Of the configuration: whether the run is over but for its last words."""


def pytest_configure(config: pytest.Config) -> None:
    """Let signals end the run by its fixtures' ends, with one line and exit code 128 + n.

    It also ends with whoever has started it, as what it starts ends with it.
    """
    try:
        from husky_runtime import starter
    except ImportError:  # not in the environment of the workspace, where pure parts are tested too
        return
    if hasattr(config, "workerinput"):  # of pytest-xdist: its main process ends it
        return
    starter.end_with_starter()
    os.environ[starter.VARIABLE] = starter.identity()

    def end(number: int, frame: object) -> None:
        starter.asked_to_end.append(number)
        _ended_by.append(number)
        if not config.stash.get(_FINISHES, False):
            pytest.exit(f"ended by {signal.Signals(number).name}")

    for number in starter.ending_signals():
        signal.signal(number, end)


def pytest_collection_finish() -> None:
    """Let tests use compiled functions as nodes do, once their modules have imported numba."""
    with contextlib.suppress(ImportError):  # as above
        from husky_runtime.numba_cache import seal_numba_cache

        seal_numba_cache()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> Iterator[None]:
    """Give a run that a signal ends its exit code once it has told what had failed until then.

    A second signal does not break that off.
    """
    session.config.stash[_FINISHES] = True
    yield
    if _ended_by:
        session.exitstatus = 128 + _ended_by[-1]


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


@contextlib.contextmanager
def _small_files(limit: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def small_files() -> Callable[[int], contextlib.AbstractContextManager[None]]:
    """A full disk, for whoever has no disk to fill: no file grows beyond a length (EFBIG)."""
    return _small_files


@pytest.fixture
def record_property(record_property: Callable[[str, object], None]) -> Callable[[str, Any], None]:
    """Records numbers of NumPy as plain ones: what is recorded goes from worker to worker."""
    return lambda name, value: record_property(name, np.asarray(value).tolist())
