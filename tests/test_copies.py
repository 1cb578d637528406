"""Tests that are marked `in_a_copy`: what the copy does, and what it leaves alone."""

import gc
import os
from collections.abc import Iterator

import pytest

_STARTED_IN = os.getpid()


class _Circle:
    """Only the garbage collector ends it."""

    def __init__(self, ended: list[int]) -> None:
        self.ended, self.itself = ended, self

    def __del__(self) -> None:
        self.ended.append(os.getpid())


@pytest.fixture
def ended() -> Iterator[list[int]]:
    """Processes in which an object without a reference has been collected."""
    gc.disable()
    processes: list[int] = []
    _Circle(processes)
    yield processes
    gc.enable()
    gc.collect()
    assert processes == [_STARTED_IN]


@pytest.mark.in_a_copy
def test_objects_of_the_process_are_not_collected_in_its_copy(ended: list[int]) -> None:
    assert os.getpid() != _STARTED_IN
    gc.collect()
    assert not ended
