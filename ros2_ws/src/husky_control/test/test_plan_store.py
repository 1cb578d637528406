"""The planner's directory: whatever lies in it, and on a full disk, plans are made."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_plan import make_plan

from husky_control.planning.collocation.plan_store import PlanStore
from husky_control.planning.collocation.request import PlanRequest

KEY = "0123456789abcdef"
REQUEST = PlanRequest(slope=0.5, speed=0.3, friction=0.7, friction_margin=0.5, gait="trot")
"""What `make_plan` is the plan of."""


def test_a_plan_is_found_again(tmp_path: Path) -> None:
    store = PlanStore(tmp_path / "cache" / "plans")
    assert store.find(KEY, REQUEST) is None
    store.keep(KEY, make_plan())
    found = store.find(KEY, REQUEST)
    assert found is not None
    assert np.array_equal(found.thrust, make_plan().thrust)
    assert (store.dropped, store.problem) == (0, "")


def test_a_damaged_plan_is_dropped_and_can_be_kept_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = PlanStore(tmp_path)
    store.keep(KEY, make_plan())
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    for number, place in enumerate(np.random.default_rng(2).integers(0, len(whole), 50), 1):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << (number % 8)
        path.write_bytes(damaged)
        assert store.find(KEY, REQUEST) is None
        assert store.dropped == number
        assert list(tmp_path.iterdir()) == []
        store.keep(KEY, make_plan())
        assert store.find(KEY, REQUEST) is not None
    for record in caplog.records:
        assert record.getMessage().startswith(f"{path} ")
        assert "\n" not in record.getMessage()


@pytest.mark.parametrize(
    "other", [{"slope": 0.4}, {"speed": -0.3}, {"thrust_mode": "body_z"}, {"gait": "bound"}]
)
def test_a_plan_of_another_request_is_dropped(tmp_path: Path, other: dict[str, Any]) -> None:
    """Whole, but under a wrong name: nobody follows it."""
    store = PlanStore(tmp_path)
    store.keep(KEY, make_plan(**other))
    assert store.find(KEY, REQUEST) is None
    assert (store.dropped, list(tmp_path.iterdir())) == (1, [])


def test_a_disk_that_takes_nothing_is_done_without(
    tmp_path: Path, small_files: Any, caplog: pytest.LogCaptureFixture
) -> None:
    store = PlanStore(tmp_path / "plans")
    with small_files(1000):
        for _ in range(3):
            store.keep(KEY, make_plan())
    assert "File too large" in store.problem
    assert list((tmp_path / "plans").iterdir()) == []
    assert len([r for r in caplog.records if r.levelno == logging.WARNING]) == 1, "said once"
    store.keep(KEY, make_plan())
    assert store.problem == ""
    assert store.find(KEY, REQUEST) is not None


def test_a_directory_that_cannot_be_made_is_done_without(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = PlanStore(tmp_path / "file" / "plans")
    assert store.find(KEY, REQUEST) is None
    store.keep(KEY, make_plan())
    assert "Not a directory" in store.problem


def test_a_directory_in_a_plan_s_place_is_no_plan(tmp_path: Path) -> None:
    store = PlanStore(tmp_path)
    (tmp_path / f"{KEY}.npz").mkdir()
    assert store.find(KEY, REQUEST) is None
    store.keep(KEY, make_plan())
    assert store.problem
