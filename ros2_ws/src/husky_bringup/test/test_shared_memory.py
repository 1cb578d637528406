"""Segments of the dead are swept, those of the living and of newcomers are not."""

import fcntl
import os
import time

import pytest

from husky_bringup.shared_memory import sweep

SEGMENT = "fastrtps_0123456789abcdef"
OTHERS = (
    "fastrtps_port7411",
    "fastrtps_port7411_el",
    "sem.fastrtps_port7411_mutex",
    "fastrtps_fedcba9876543210x_el",
    "lttng-ust-wait-6",
)


@pytest.fixture
def shm(tmp_path):
    """With a segment that is a minute old, and files that are none of ours."""
    for name in (SEGMENT, f"{SEGMENT}_el", *OTHERS):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time.time() - 60.0,) * 2)
    return tmp_path


def names(directory):
    return {path.name for path in directory.iterdir()}


def test_of_a_dead_participant(shm):
    assert sweep(shm) == [SEGMENT]
    assert names(shm) == set(OTHERS)
    assert sweep(shm) == []


def test_of_a_dead_participant_whose_segment_is_gone(shm):
    (shm / SEGMENT).unlink()
    assert sweep(shm) == [SEGMENT]
    assert names(shm) == set(OTHERS)


def test_of_one_that_lives(shm):
    before = names(shm)
    with (shm / f"{SEGMENT}_el").open("ab") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert sweep(shm) == []
        assert names(shm) == before
    assert sweep(shm) == [SEGMENT]


def test_of_one_that_has_just_come(shm):
    """It may not have its lock yet."""
    os.utime(shm / f"{SEGMENT}_el")
    assert sweep(shm) == []


def test_where_there_is_no_shared_memory(tmp_path):
    assert sweep(tmp_path / "nowhere") == []
