"""The plan: interpolation, cycles, files."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_plan import PERIOD, SPEED, make_plan, motion
from scipy.spatial.transform import Rotation

from husky_control.planning.plan import MeshError, Plan, PlanFileError, load_plan, slope_rotation
from husky_control.rotation import (
    rotation_from_vector,
    vector_from_rotation,
    vector_rate,
)
from husky_runtime.stored_file import read_sealed, seal, write_sealed


def worst_interpolation(points: int) -> float:
    plan = make_plan(points)
    worst = 0.0
    for time in np.linspace(0.0, PERIOD, 101)[:-1]:
        truth, sample = motion(np.array([time])), plan.at(time)
        for name in ("position", "velocity", "rotation", "angular_velocity"):
            worst = max(worst, float(np.abs(getattr(sample, name) - truth[name][0]).max()))
    return worst


def test_between_points_the_motion_is_cubic_and_of_fourth_order() -> None:
    coarse, fine = worst_interpolation(16), worst_interpolation(32)
    assert coarse < 5e-4
    assert 11.0 < coarse / fine < 22.0  # 2^4 = 16


def test_at_its_points_the_plan_is_itself_and_inputs_are_linear_between() -> None:
    plan = make_plan()
    sample = plan.at(float(plan.time[3]))
    assert np.allclose(sample.position, plan.position[3], atol=1e-12)
    assert np.allclose(sample.rotation, plan.rotation[3], atol=1e-12)
    middle = plan.at(0.5 * float(plan.time[3] + plan.time[4]))
    assert np.allclose(middle.thrust, 0.5 * (plan.thrust[3] + plan.thrust[4]))


def test_a_switch_belongs_to_the_stance_after_it() -> None:
    plan = make_plan()
    assert plan.at(PERIOD / 2 - 1e-6).stance.tolist() == [True, False, False, True]
    assert plan.at(PERIOD / 2).stance.tolist() == [False, True, True, False]
    assert plan.at(PERIOD / 2).foot_force[1, 2] == 37.0


def test_cycles_repeat_one_stride_further() -> None:
    plan = make_plan()
    here, later = plan.at(0.13), plan.at(0.13 + 3 * PERIOD)
    assert np.allclose(later.position - here.position, [3 * plan.stride, 0.0, 0.0])
    assert np.allclose(later.rotation, here.rotation)
    assert np.allclose(plan.at(-0.1).position[0], SPEED * -0.1)


def test_a_foot_stays_where_it_stands_and_swings_a_stride_ahead() -> None:
    plan = make_plan()
    stride = plan.stride
    first = plan.foothold_at(0.01)
    assert np.allclose(first[0], plan.foothold[0])
    assert np.allclose(plan.foothold_at(PERIOD / 2 - 0.01), first)
    assert np.allclose(plan.foothold_at(PERIOD / 2 + 0.01)[0], plan.foothold[0] + [stride, 0, 0])
    assert np.allclose(plan.foothold_at(PERIOD - 0.01)[1], plan.foothold[1])


def test_saved_and_loaded_is_the_same(tmp_path: Path) -> None:
    plan = make_plan()
    plan.save(tmp_path / "cycle.plan")
    again = load_plan(tmp_path / "cycle.plan")
    for field in dataclasses.fields(Plan):
        before, after = getattr(plan, field.name), getattr(again, field.name)
        if isinstance(before, np.ndarray):
            assert before.dtype == after.dtype
            np.testing.assert_array_equal(before, after)
        else:
            assert before == after


def rewrite(path: Path, **changes: object) -> None:
    """As another program would that knows of the checksum."""
    with np.load(io.BytesIO(read_sealed(path))) as archive:
        fields = dict(archive)
    meta = json.loads(str(fields["meta"]))
    meta.update({k: v for k, v in changes.items() if not isinstance(v, np.ndarray)})
    fields.update({k: v for k, v in changes.items() if isinstance(v, np.ndarray)})
    fields["meta"] = np.array(json.dumps({k: v for k, v in meta.items() if v is not None}))
    content = io.BytesIO()
    np.savez(content, **fields)
    write_sealed(path, content.getvalue())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"version": 99}, "version 99.*version 2"),
        ({"format": "other"}, "'other'"),
        ({"cost": None}, "cost"),
        ({"thrust": np.zeros((2, 3))}, "thrust has shape"),
        ({"thrust_mode": "rocket"}, "rocket"),
        ({"time": np.zeros(14)}, "period"),
        ({"foothold": np.full((4, 3), np.nan)}, "foothold"),
        ({"mass": math.nan}, "mass is nan"),
        ({"period": "long"}, "a plan that cannot be"),
    ],
)
def test_a_file_that_is_no_plan_says_why(
    tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    path = tmp_path / "plan.npz"
    make_plan().save(path)
    rewrite(path, **changes)
    with pytest.raises(PlanFileError, match=words):
        load_plan(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04broken", b"{}", b"[1, 2"])
@pytest.mark.parametrize("sealed", [False, True])
def test_any_other_file_is_refused(tmp_path: Path, content: bytes, sealed: bool) -> None:
    path = tmp_path / "plan.npz"
    path.write_bytes(seal(content) if sealed else content)
    with pytest.raises(PlanFileError, match=r"plan\.npz .*(not a plan|checksum)"):
        load_plan(path)


def test_a_plan_without_a_checksum_is_to_be_planned_again(tmp_path: Path) -> None:
    """As version 1 of the format wrote it."""
    path = tmp_path / "plan.npz"
    make_plan().save(path)
    path.write_bytes(read_sealed(path))
    with np.load(path) as archive:
        assert "position" in archive
    with pytest.raises(PlanFileError, match=r"checksum.*plan it again"):
        load_plan(path)


def test_every_byte_of_a_plan_counts(tmp_path: Path) -> None:
    """One flipped bit, in any byte, and any length that is not the whole: never another plan."""
    path = tmp_path / "plan.npz"
    make_plan().save(path)
    whole = path.read_bytes()
    bits = np.random.default_rng(1).integers(0, 8, len(whole))
    with path.open("r+b", buffering=0) as file:
        for place, bit in enumerate(bits):
            os.pwrite(file.fileno(), bytes([whole[place] ^ (1 << bit)]), place)
            with pytest.raises(PlanFileError, match=re.escape(str(path))):
                load_plan(path)
            os.pwrite(file.fileno(), whole[place : place + 1], place)
        assert load_plan(path).cost == make_plan().cost
        for length in reversed(range(len(whole))):
            file.truncate(length)
            with pytest.raises(PlanFileError, match=re.escape(str(path))):
                load_plan(path)
    path.write_bytes(whole + b"\0")
    with pytest.raises(PlanFileError, match="checksum"):
        load_plan(path)


def test_a_plan_is_written_whole_or_not_at_all(tmp_path: Path, small_files: Any) -> None:
    path = tmp_path / "plan.npz"
    make_plan().save(path)
    with small_files(1000), pytest.raises(OSError, match="File too large"):
        make_plan(cost=2.0).save(path)
    assert load_plan(path).cost == 1.5
    assert list(tmp_path.iterdir()) == [path], "nothing is left behind"


def test_arrays_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        make_plan().position[0, 0] = 1.0


def test_the_slope_frame_rises_along_x() -> None:
    rotation = slope_rotation(math.radians(30.0))
    assert np.allclose(rotation @ [1.0, 0.0, 0.0], [math.cos(math.pi / 6), 0.0, 0.5])
    assert np.allclose(rotation @ rotation.T, np.eye(3))


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-3, 1.0, 3.0])
def test_rotation_vectors_against_scipy(angle: float) -> None:
    vector = angle * np.array([0.6, -0.48, 0.64])
    rotation = rotation_from_vector(vector)
    assert np.allclose(rotation, Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
    assert np.allclose(vector_from_rotation(rotation), vector, atol=1e-9)
    omega, step = np.array([0.3, -0.2, 0.5]), 1e-6
    ahead = vector_from_rotation(rotation @ rotation_from_vector(step * omega))
    behind = vector_from_rotation(rotation @ rotation_from_vector(-step * omega))
    assert np.allclose(vector_rate(vector, omega), (ahead - behind) / (2 * step), atol=1e-6)


def test_mesh_error_is_within_or_not() -> None:
    assert MeshError(1e-3, 0.0, 0.0, 0.0).within(1e-3)
    assert not MeshError(0.0, 0.0, 0.0, 2e-3).within(1e-3)
