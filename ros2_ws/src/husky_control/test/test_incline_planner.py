"""Plans of gait cycles on slopes, against rigid-body physics integrated by SciPy in the world."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from full_model import full_formulation, full_problem
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from husky_control.planning.collocation.mesh import check_on_finer_mesh
from husky_control.planning.collocation.planner import PlanFailure, Planner
from husky_control.planning.collocation.request import PlanRequest, machine_of, steady_forces
from husky_control.planning.collocation.schedule import make_schedule
from husky_control.planning.collocation.solve import Solver
from husky_control.planning.plan import Plan, load_plan
from husky_control.planning.reduced_order import ROTATION
from husky_description.robot import load_robot

MACHINE = machine_of(load_robot())
WEIGHT = float(MACHINE.rom.mass * np.linalg.norm(MACHINE.rom.gravity))


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(MACHINE)


def request(degrees: float, **changes: object) -> PlanRequest:
    return PlanRequest(slope=math.radians(degrees), gait="climb", **changes)  # type: ignore[arg-type]


def integrate(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Newton and Euler in the world under the plan's forces; position and rotation at the end."""
    world, inertia = plan.world_from_slope, MACHINE.rom.inertia
    start = plan.at(0.0)
    attitude = Rotation.from_matrix(world @ start.rotation).as_quat()
    y = np.concatenate(
        [world @ start.position, attitude, world @ start.velocity, start.angular_velocity]
    )

    def rate(time: float, y: np.ndarray) -> np.ndarray:
        sample = plan.at(min(time, plan.period - 1e-9))
        rotation, omega = Rotation.from_quat(y[3:7]).as_matrix(), y[10:13]
        pushes = sample.foot_force[sample.stance] @ world.T
        arms = sample.foothold[sample.stance] @ world.T - y[:3]
        force = np.array([0.0, 0.0, -WEIGHT]) + world @ sample.thrust + pushes.sum(axis=0)
        moment = rotation.T @ np.cross(arms, pushes).sum(axis=0) - np.cross(omega, inertia @ omega)
        x, yy, z, w = y[3:7]
        p, q, r = omega
        turning = 0.5 * np.array(
            [
                w * p + yy * r - z * q,
                w * q - x * r + z * p,
                w * r + x * q - yy * p,
                -x * p - yy * q - z * r,
            ]
        )
        return np.concatenate(
            [y[7:10], turning, force / MACHINE.rom.mass, np.linalg.solve(inertia, moment)]
        )

    for begin, end in ((0.0, 0.5 * plan.period), (0.5 * plan.period, plan.period)):
        y = solve_ivp(rate, (begin, end - 1e-12), y, rtol=1e-8, atol=1e-10, max_step=0.02).y[:, -1]
    return world.T @ y[:3], world.T @ Rotation.from_quat(y[3:7]).as_matrix()


def check_physics(plan: Plan) -> None:
    position, rotation = integrate(plan)
    expected = plan.at(plan.period)
    assert np.allclose(position, expected.position, atol=5e-5)  # cubics' errors, grown in a cycle
    assert np.allclose(rotation, expected.rotation, atol=2e-4)
    for time in np.linspace(0.0, plan.period, 61)[:-1]:
        sample = plan.at(float(time))
        assert np.linalg.norm(sample.thrust) <= plan.thrust_limit * (1.0 + 1e-5) + 1e-9
        for leg in range(4):
            f = sample.foot_force[leg]
            if not sample.stance[leg]:
                assert not f.any()
                continue
            usable = (1.0 - plan.friction_margin) * plan.friction
            assert f[2] >= 0.0
            assert math.hypot(f[0], f[1]) <= usable * f[2] + 1e-4 * WEIGHT


def and_slow(quick: tuple[int, ...], slow: tuple[int, ...]) -> list[Any]:
    """Return values as pytest's parameters, the latter ones slow."""
    return [*quick, *(pytest.param(value, marks=pytest.mark.slow) for value in slow)]


@pytest.mark.parametrize("degrees", and_slow((0, 45, 90, -30), (10, 20, 30, 60, 75)))
def test_vectored_plans_obey_physics(planner: Planner, degrees: float) -> None:
    plan = planner.plan(request(degrees))
    check_physics(plan)
    assert plan.mesh_error.within(1e-4)
    least = WEIGHT * np.linalg.norm(steady_forces(plan.slope, 0.35)[0])
    mean = np.linalg.norm(np.trapezoid(plan.thrust, plan.time, axis=0)) / plan.period
    assert mean >= least - 1e-3
    assert mean <= least + 0.02 * WEIGHT  # no more fan than friction asks for


@pytest.mark.parametrize("degrees", and_slow((0, 45), (20, 30)))
def test_plans_with_thrust_along_body_z_obey_physics(planner: Planner, degrees: float) -> None:
    plan = planner.plan(request(degrees, thrust_mode="body_z"))
    check_physics(plan)
    axis = plan.rotation[:, :, 2]
    assert np.allclose(np.cross(axis, plan.thrust), 0.0, atol=1e-6)
    assert np.all(np.einsum("ij,ij->i", axis, plan.thrust) >= -1e-6)
    pitch = math.degrees(math.asin(float(-plan.rotation[0, 2, 0])))
    if degrees >= 30:
        assert pitch > degrees  # a body that is less pitched than the slope never helps


@pytest.mark.parametrize(("gait", "speed"), [("trot", -0.2), ("bound", 0.3), ("crawl", 0.04)])
def test_other_gaits_of_the_table_obey_physics(planner: Planner, gait: str, speed: float) -> None:
    plan = planner.plan(
        PlanRequest(slope=0.2, speed=speed, gait=gait, intervals=24, friction_margin=0.3)
    )
    check = plan.foot_force[~plan.stance]
    assert not check.any()
    assert plan.mesh_error.within(1e-3)
    total = np.trapezoid(plan.foot_force.sum(axis=1) + plan.thrust, plan.time, axis=0)
    up = WEIGHT * np.array([math.sin(0.2), 0.0, math.cos(0.2)])
    assert np.allclose(total / plan.period, up, atol=1e-3 * WEIGHT)


def test_a_free_period_is_chosen_within_its_bounds(planner: Planner) -> None:
    plan = planner.plan(request(30, period=(0.25, 0.6)))
    assert 0.25 - 1e-6 <= plan.period <= 0.6
    check_physics(plan)


def test_a_warm_start_is_the_same_plan(planner: Planner) -> None:
    planner.plan(request(40))
    before = planner.warm_starts
    warm, solution = planner.solve(request(42), fresh=True)
    assert planner.warm_starts == before + 1
    cold, _ = Planner(MACHINE).solve(request(42))
    assert solution is not None
    assert warm.cost == pytest.approx(cold.cost, rel=1e-6)
    assert np.allclose(warm.thrust, cold.thrust, atol=0.05)
    assert np.allclose(warm.foothold, cold.foothold, atol=1e-4)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"thrust_mode": "none"}, "45.0 deg.*needs 32.3 N.*0.0 N"),
        ({"thrust_limit": 20.0}, "allowed are 20.0 N"),
    ],
)
def test_too_little_thrust_is_named_at_once(
    planner: Planner, changes: dict[str, object], words: str
) -> None:
    with pytest.raises(PlanFailure, match=words) as failure:
        planner.plan(request(45, **changes))
    assert (failure.value.reason, failure.value.constraint) == ("infeasible", "thrust")
    assert failure.value.violations[0].unit == "N"


def test_constraints_that_exclude_each_other_are_named() -> None:
    """Legs spread so far that the body would lie on the ground, but not that short."""
    machine = dataclasses.replace(MACHINE, leg_sideways=(1.0, 1.2))
    with pytest.raises(PlanFailure) as failure:
        Planner(machine, compiled=False).plan(request(10, intervals=8))
    assert failure.value.reason == "infeasible"
    assert failure.value.constraint in ("leg_angle", "leg_length")
    assert str(failure.value).startswith(f"infeasible: {failure.value.constraint} by ")


def test_a_limited_direction_of_the_thrust_pitches_the_body(planner: Planner) -> None:
    plan = planner.plan(request(45, thrust_tilt=1.0))
    axis = plan.rotation[:, :, 2]
    size = np.linalg.norm(plan.thrust, axis=1)
    along = np.einsum("ij,ij->i", axis, plan.thrust)
    assert np.all(along >= math.cos(1.0) * size - 2e-3 * WEIGHT)  # the rounded cone
    assert -plan.rotation[0, 2, 0] > 0.05


def test_plans_are_kept_on_disk(tmp_path: Path) -> None:
    first = Planner(MACHINE, tmp_path)
    plan, solution = first.solve(request(15))
    assert solution is not None
    again, nothing = Planner(MACHINE, tmp_path).solve(request(15))
    assert nothing is None
    assert np.array_equal(plan.thrust, again.thrust)
    (file,) = tmp_path.glob("*.npz")
    damaged = bytearray(file.read_bytes())
    damaged[damaged.index(b"PK\x01\x02") + 8] ^= 1  # one bit: "encrypted"
    file.write_bytes(damaged)
    planner = Planner(MACHINE, tmp_path)
    anew, solved = planner.solve(request(15))
    assert solved is not None
    assert planner.store is not None
    assert planner.store.dropped == 1
    assert np.array_equal(load_plan(file).thrust, anew.thrust), "made anew, and kept"
    _, other = Planner(MACHINE, tmp_path).solve(request(15, friction_margin=0.4))
    assert other is not None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"slope": 2.0}, "slope is 2.0.*1.571"),
        ({"speed": math.nan}, "speed"),
        ({"friction": 0.0}, "friction"),
        ({"friction_margin": 1.0}, "friction_margin"),
        ({"thrust_mode": "up"}, "up.*vector"),
        ({"gait": "gallop"}, "gallop.*trot"),
        ({"period": (0.5, 0.2)}, "period"),
        ({"intervals": 2}, "intervals"),
        ({"thrust_limit": -1.0}, "thrust_limit"),
    ],
)
def test_requests_out_of_range_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        PlanRequest(**changes)  # type: ignore[arg-type]


def test_least_force_at_rest_is_that_of_the_cone() -> None:
    thrust, ground = steady_forces(math.radians(45.0), 0.35)
    assert math.hypot(ground[0], ground[1]) == pytest.approx(0.35 * ground[2])
    assert np.allclose(thrust + ground, [math.sin(math.pi / 4), 0.0, math.cos(math.pi / 4)])
    assert thrust[0] > 0.0 > thrust[2]  # up the slope and into it
    assert not steady_forces(math.radians(10.0), 0.35)[0].any()


@pytest.mark.parametrize("degrees", and_slow((30,), (0,)))
def test_the_whole_state_of_the_thesis(degrees: float) -> None:
    """T26 with joint accelerations, ground forces and thrust as inputs, one periodic cycle."""
    form = full_formulation(MACHINE)
    solver = Solver(form, compiled=False)
    asked = request(degrees, intervals=8)
    schedule = make_schedule(asked.gait_row, 8)
    problem, guess = full_problem(MACHINE, asked, schedule, form)
    solution = solver.solve(problem, guess)
    check = check_on_finer_mesh(solution, solver.functions)
    assert np.abs(check.error).max() < 1e-3
    assert check.excess["friction"] < 1e-4 * WEIGHT
    rotation = solution.state[-1, ROTATION].reshape(3, 3)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4)  # stays on SO(3) by itself
    thrust = WEIGHT * np.linalg.norm(solution.input[:, 24:27].mean(axis=0))
    least = WEIGHT * np.linalg.norm(steady_forces(asked.slope, 0.35)[0])
    assert least - 0.1 <= thrust <= least + 0.03 * WEIGHT
