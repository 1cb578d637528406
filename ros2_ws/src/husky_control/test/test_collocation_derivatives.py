"""Derivatives and sparsity of the assembled problem against finite differences; compiled code."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_control.planning.collocation import compiled
from husky_control.planning.collocation.local_functions import make_local_functions
from husky_control.planning.collocation.problem import Constraint, Formulation, Problem
from husky_control.planning.collocation.rodrigues import (
    rodrigues_rate,
    rotation_from_rodrigues,
)
from husky_control.planning.collocation.transcription import Transcription, pack_numbers
from husky_control.rotation import rotation_from_vector
from husky_runtime.stored_file import SEAL_LENGTH, read_sealed

STEP = 1e-6


def formulation(scheme: str, free_duration: bool) -> Formulation:
    """Everything a formula may use, entangled."""
    return Formulation(
        name="tangle",
        state_names=("a", "b", "c"),
        input_names=("u", "v"),
        dynamics=lambda s: ca.vertcat(
            s.state[1] * ca.cos(s.time) + s.static[0] * s.input[0],
            ca.sin(s.state[0] * s.state[2]) + s.data[0] * s.input[1] ** 2,
            s.parameter[0] * s.state[0] * s.input[0] / (1.0 + s.duration),
        ),
        running_cost=lambda s: (
            s.state[0] ** 2 * s.input[1] + ca.exp(s.static[0] * s.state[1]) + s.time * s.input[0]
        ),
        final_cost=lambda e: e.last[0] * e.first[1] * e.static[0] + e.duration**2,
        path=(
            Constraint("one", lambda s: s.state[0] * s.input[0] * s.static[0], (0.0,), (1.0,)),
            Constraint(
                "two",
                lambda s: ca.vertcat(s.state[2] ** 3 + s.time * s.data[0], s.input[1] * s.duration),
                (0.0, -math.inf),
                (1.0, 1.0),
            ),
        ),
        boundary=(
            Constraint(
                "loop",
                lambda e: e.last - e.first * e.duration * e.static[0],
                (0.0,) * 3,
                (0.0,) * 3,
            ),
        ),
        static_names=("s",),
        parameter_names=("p",),
        data_names=("d",),
        free_duration=free_duration,
        scheme=scheme,
    )


def problem_of(form: Formulation) -> Problem:
    duration = (0.5, 1.5) if form.free_duration else (0.8, 0.8)
    grid = np.array([0.0, 0.2, 0.5, 0.6, 1.0])
    data = np.array([[0.3], [-0.4], [0.5], [0.9]])
    return Problem(form, grid, duration, (2,), np.array([1.3]), data)


@pytest.fixture(params=[("lobatto", False), ("lobatto", True), ("euler", False), ("euler", True)])
def case(request: pytest.FixtureRequest) -> tuple[Transcription, np.ndarray, np.ndarray]:
    form = formulation(*request.param)
    problem = problem_of(form)
    program = Transcription(problem, make_local_functions(form))
    w = np.random.default_rng(3).uniform(0.4, 1.0, program.layout.size)
    return program, w, pack_numbers(problem, program.layout)


def differences(function: Any, w: np.ndarray) -> np.ndarray:
    columns = []
    for i in range(len(w)):
        step = np.zeros_like(w)
        step[i] = STEP
        columns.append((function(w + step) - function(w - step)) / (2 * STEP))
    return np.stack(columns, axis=-1)


Case = tuple[Transcription, np.ndarray, np.ndarray]


def test_gradient(case: Case) -> None:
    program, w, p = case
    exact = np.array(program.gradient(w, p)[1]).ravel()
    assert np.allclose(exact, differences(lambda x: float(program.values(x, p)[0]), w), atol=1e-7)


def test_jacobian_and_its_sparsity(case: Case) -> None:
    program, w, p = case
    matrix = program.jacobian(w, p)[1]
    rows = differences(lambda x: np.array(program.values(x, p)[1]).ravel(), w)
    assert np.allclose(np.array(matrix), rows, atol=1e-7)
    pattern = np.array(ca.DM(matrix.sparsity(), 1.0)) > 0
    assert not np.abs(rows[~pattern]).max() > 1e-9
    assert pattern.mean() < 0.5


def test_hessian_of_the_lagrangian(case: Case) -> None:
    program, w, p = case
    factor = 0.7
    multipliers = np.random.default_rng(4).normal(size=sum(program.layout.rows))

    def slope(x: np.ndarray) -> np.ndarray:
        gradient = np.array(program.gradient(x, p)[1]).ravel()
        return factor * gradient + np.array(program.jacobian(x, p)[1]).T @ multipliers

    upper = np.array(program.hessian(w, p, factor, multipliers))
    assert np.all(np.tril(upper, -1) == 0.0)
    assert np.allclose(upper + np.triu(upper, 1).T, differences(slope, w), atol=2e-6)


def square(name: str) -> Any:
    x = ca.SX.sym("x", 2)
    return ca.Function(name, [x], [ca.sumsqr(x) * ca.sin(x[0])])


def test_compiled_code_says_the_same_and_is_found_again(tmp_path: Path) -> None:
    if compiled.find_compiler() is None:
        pytest.skip("no C compiler here")
    plain = square("f")
    (quick,) = compiled.compile_functions("test", [plain], tmp_path)
    assert quick.class_name() == "External"
    assert float(quick([0.3, 0.4])) == pytest.approx(float(plain([0.3, 0.4])), abs=1e-15)
    (library,) = tmp_path.glob("*.so")
    before = library.stat().st_mtime_ns
    compiled.compile_functions("test", [square("f")], tmp_path)
    assert [p.stat().st_mtime_ns for p in tmp_path.glob("*.so")] == [before]
    compiled.compile_functions("test", [square("g")], tmp_path)
    assert len(list(tmp_path.glob("*.so"))) == 2


@pytest.mark.parametrize("damage", ["a bit", "cut short", "empty", "no checksum"])
def test_damaged_code_is_compiled_anew_not_run(
    tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    """A bit of a constant, say: the library still loads, and its derivatives are wrong."""
    if compiled.find_compiler() is None:
        pytest.skip("no C compiler here")
    x = ca.SX.sym("x")
    plain = ca.Function("f", [x], [1.2345678 * ca.sin(x) + x])
    compiled.compile_functions("test", [plain], tmp_path)
    (library,) = tmp_path.glob("*.so")
    whole = bytearray(library.read_bytes())
    constant = whole.index(np.float64(1.2345678).tobytes())
    flipped = bytearray(whole)
    flipped[constant + 6] ^= 0x08
    contents = {
        "a bit": flipped,
        "cut short": whole[:4000],
        "empty": b"",
        "no checksum": whole[:-SEAL_LENGTH],
    }
    library.unlink()  # a new file: the loader knows the old one
    library.write_bytes(contents[damage])
    (quick,) = compiled.compile_functions("test", [plain], tmp_path)
    assert quick.class_name() == "External"
    assert float(quick(0.3)) == pytest.approx(float(plain(0.3)), abs=1e-15)
    assert len(read_sealed(library)) > 4000
    assert "compiled anew" in caplog.text


def test_without_a_compiler_it_is_slower_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(compiled, "find_compiler", lambda: None)
    plain = square("f")
    with caplog.at_level(logging.WARNING):
        assert compiled.compile_functions("test", [plain], tmp_path) == [plain]
    assert "slower" in caplog.text


def test_a_compiler_that_fails_is_no_reason_to_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(compiled, "find_compiler", lambda: "/bin/false")
    plain = square("f")
    with caplog.at_level(logging.WARNING):
        assert compiled.compile_functions("test", [plain], tmp_path) == [plain]
    assert "slower" in caplog.text
    assert not list(tmp_path.glob("*.so"))


def test_the_cache_follows_the_user(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert compiled.cache_directory() == tmp_path / "husky"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert compiled.cache_directory() == Path.home() / ".cache" / "husky"


def test_rodrigues_parameters_are_the_rotation_and_its_rate() -> None:
    vector = np.array([0.5, -1.0, 0.8])
    rotation = rotation_from_vector(vector)
    sigma = Rotation.from_matrix(rotation).as_mrp()
    assert np.allclose(rotation_from_rodrigues(sigma), rotation)
    omega = np.array([0.3, 0.7, -0.2])
    ahead, behind = (
        Rotation.from_matrix(rotation @ rotation_from_vector(sign * STEP * omega)).as_mrp()
        for sign in (1.0, -1.0)
    )
    assert np.allclose(rodrigues_rate(sigma, omega), (ahead - behind) / (2 * STEP), atol=1e-8)
