"""The plan: interpolation, cycles, files."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_control.plan import MeshError, Plan, PlanFileError, load_plan, slope_rotation
from husky_control.rotation_vector import (
    rotation_from_vector,
    vector_from_rotation,
    vector_rate,
)

POINTS = 12
PERIOD = 0.4
SPEED = 0.3


def motion(time: np.ndarray) -> dict[str, np.ndarray]:
    """A smooth body motion whose derivatives are known."""
    w = 2.0 * math.pi / PERIOD
    wave, slope, bend = np.cos(w * time), -w * np.sin(w * time), -(w**2) * np.cos(w * time)
    zero = np.zeros_like(time)
    turn = Rotation.from_rotvec(np.outer(0.1 * wave, [0.0, 1.0, 0.0]))
    return {
        "position": np.stack([SPEED * time, 0.01 * wave, 0.5 + 0.02 * wave], axis=1),
        "velocity": np.stack([SPEED + zero, 0.01 * slope, 0.02 * slope], axis=1),
        "acceleration": np.stack([zero, 0.01 * bend, 0.02 * bend], axis=1),
        "rotation": turn.as_matrix(),
        "angular_velocity": np.stack([zero, 0.1 * slope, zero], axis=1),
        "angular_acceleration": np.stack([zero, 0.1 * bend, zero], axis=1),
    }


def make_plan(points: int = POINTS, **changes: object) -> Plan:
    half = np.linspace(0.0, PERIOD / 2, points // 2 + 1)
    time = np.concatenate([half, PERIOD / 2 + half])
    first = np.arange(len(time)) < len(half)
    stance = np.where(first[:, None], [True, False, False, True], [False, True, True, False])
    force = np.zeros((len(time), 4, 3))
    force[..., 2] = 37.0 * stance
    fields: dict[str, object] = {
        "slope": 0.5,
        "speed": SPEED,
        "friction": 0.7,
        "friction_margin": 0.5,
        "thrust_mode": "vector",
        "gait": "trot",
        "period": PERIOD,
        "duty": 0.5,
        "touchdown_phase": np.array([0.0, 0.5, 0.5, 0.0]),
        "height": 0.5,
        "mass": 7.6,
        "thrust_limit": 76.0,
        "center_of_mass": np.array([-0.005, 0.0, -0.015]),
        "time": time,
        "foot_force": force,
        "thrust": np.stack([20.0 * time, 0.0 * time, 1.0 + time], axis=1),
        "stance": stance,
        "foothold": np.array(
            [[0.2, 0.1, 0.0], [0.26, -0.1, 0.0], [-0.14, 0.1, 0.0], [-0.2, -0.1, 0.0]]
        ),
        "mesh_error": MeshError(1e-6, 2e-6, 3e-6, 4e-6),
        "cost": 1.5,
        **motion(time),
        **changes,
    }
    return Plan(**fields)  # type: ignore[arg-type]


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
    with np.load(path) as archive:
        fields = dict(archive)
    meta = json.loads(str(fields["meta"]))
    meta.update({k: v for k, v in changes.items() if not isinstance(v, np.ndarray)})
    fields.update({k: v for k, v in changes.items() if isinstance(v, np.ndarray)})
    fields["meta"] = np.array(json.dumps({k: v for k, v in meta.items() if v is not None}))
    np.savez(path, **fields)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"version": 99}, "version 99.*version 1"),
        ({"format": "other"}, "'other'"),
        ({"cost": None}, "cost"),
        ({"thrust": np.zeros((2, 3))}, "thrust has shape"),
        ({"thrust_mode": "rocket"}, "rocket"),
        ({"time": np.zeros(14)}, "period"),
        ({"foothold": np.full((4, 3), np.nan)}, "foothold"),
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


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04broken"])
def test_any_other_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "plan.npz"
    path.write_bytes(content)
    with pytest.raises(PlanFileError, match="not a plan"):
        load_plan(path)


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
