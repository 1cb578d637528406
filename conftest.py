"""What holds for every test: a property is judged by its examples, not by how long one takes; a
signal ends the run as it ends any script.
"""

import contextlib
import os
import resource
import signal
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

settings.register_profile("patient", settings(), deadline=None)
settings.load_profile("patient")


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
        starter.asked_to_end.set()
        pytest.exit(f"ended by {signal.Signals(number).name}", returncode=128 + number)

    for number in starter.ending_signals():
        signal.signal(number, end)


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
