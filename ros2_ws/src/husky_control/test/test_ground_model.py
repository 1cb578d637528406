"""The compliant ground of T27 against points computed by hand, and its smooth form against it."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from ground_model import (
    f_rom_on_ground,
    friction_coefficient,
    ground_force,
    ground_forces,
    smooth_ground_force,
)
from scipy.integrate import solve_ivp

from husky_control.planning.reduced_order import (
    VELOCITY,
    foot_positions,
    foot_velocities,
    standing_state,
)
from husky_control.planning.rom_parameters import rom_parameters
from husky_description.ground import GROUND_PRESETS, GroundModel, ground_preset
from husky_description.robot import load_robot

ROBOT = load_robot()
PARAMETERS = rom_parameters(ROBOT)
LAB = GROUND_PRESETS["lab"]
# Round numbers, to follow by hand.
PLAIN = GroundModel(1000.0, 10.0, 0.5, 0.8, 2.0, 0.1, 0.002, "", "")


# ------------------------------------------------------------------------- T27 as printed


def test_a_foot_in_the_air_feels_nothing():
    np.testing.assert_array_equal(ground_force([0.0, 0.0, 1e-9], [1.0, -2.0, -3.0], PLAIN), 0.0)


@pytest.mark.parametrize(
    ("height", "velocity", "force"),
    [
        # 1000 * 0.01
        (-0.010, [0.0, 0.0, 0.0], [0.0, 0.0, 10.0]),
        # 10 + 10 * 0.2, as it sinks
        (-0.010, [0.0, 0.0, -0.2], [0.0, 0.0, 12.0]),
        # 10 - 10 * 0.4, as it leaves
        (-0.010, [0.0, 0.0, 0.4], [0.0, 0.0, 6.0]),
        # Far above the Stribeck velocity: -(0.5 * 10) - 2 * 1, and the other way
        (-0.010, [1.0, -1.0, 0.0], [-7.0, 7.0, 10.0]),
        # At it: s = 0.5 + 0.3 / e = 0.610364, -(s * 10) - 2 * 0.1
        (-0.010, [0.1, 0.0, 0.0], [-6.303638, 0.0, 10.0]),
        # The very surface counts as contact: the damper alone
        (0.0, [0.0, 0.0, -0.5], [0.0, 0.0, 5.0]),
        # Printed so: a foot that leaves fast is pulled, and pushed along its slide
        (-0.001, [1.0, 0.0, 1.0], [4.5 - 2.0, 0.0, -9.0]),
    ],
)
def test_points_by_hand(height, velocity, force):
    np.testing.assert_allclose(ground_force([0.3, -0.2, height], velocity, PLAIN), force, atol=1e-6)


def test_friction_goes_from_static_to_coulomb():
    assert friction_coefficient(0.0, PLAIN) == PLAIN.friction_static
    assert friction_coefficient(10.0, PLAIN) == pytest.approx(PLAIN.friction_coulomb)
    assert friction_coefficient(-0.1, PLAIN) == pytest.approx(0.5 + 0.3 * math.exp(-1.0))


# ---------------------------------------------------------------------------- smooth form


def test_deep_and_fast_the_smooth_form_is_the_printed_one():
    for velocity in ([1.0, -2.0, -0.1], [-1.0, 0.5, 0.1]):
        point = [0.0, 0.0, -0.01]
        np.testing.assert_allclose(
            smooth_ground_force(point, velocity, PLAIN),
            ground_force(point, velocity, PLAIN),
            rtol=1e-4,
        )


def test_smooth_points_by_hand():
    # Half of the transition width: 3 / 4 - 2 / 8 = 1 / 2 of 1000 * 0.001, and of the viscous 2 * 1
    force = smooth_ground_force([0.0, 0.0, -0.001], [1.0, 0.0, 0.0], PLAIN)
    np.testing.assert_allclose(force, [-0.5 * 0.5 - 0.5 * 2.0, 0.0, 0.5], rtol=1e-6)
    # Creep at a tenth of the Stribeck velocity
    force = smooth_ground_force([0.0, 0.0, -0.01], [0.01, 0.0, 0.0], PLAIN)
    holding = (0.5 + 0.3 * math.exp(-0.01)) * math.tanh(0.1) * 10.0 + 2.0 * 0.01
    np.testing.assert_allclose(force, [-holding, 0.0, 10.0], rtol=1e-12)


def test_the_smooth_form_never_pulls_and_never_jumps():
    rng = np.random.default_rng(4)
    for _ in range(200):
        point, velocity = rng.uniform(-0.004, 0.001, 3), rng.uniform(-2.0, 2.0, 3)
        assert smooth_ground_force(point, velocity, PLAIN)[2] >= 0.0
    velocity = [0.3, -0.2, -1.0]
    depths = np.linspace(-1e-4, 0.004, 4101)
    forces = np.array([smooth_ground_force([0.0, 0.0, -d], velocity, PLAIN) for d in depths])
    # 1 um of depth: no more than the slope of spring and step, below 2e4 N/m together.
    assert np.abs(np.diff(forces, axis=0)).max() < 0.02
    assert not forces[depths <= 0.0].any()


def test_both_forms_are_the_same_for_casadi():
    rng = np.random.default_rng(5)
    p, v = ca.SX.sym("p", 3), ca.SX.sym("v", 3)
    for law in (ground_force, smooth_ground_force):
        for ground in GROUND_PRESETS.values():
            function = ca.Function("g", [p, v], [law(p, v, ground)])
            for _ in range(50):
                point, velocity = rng.uniform(-0.003, 0.002, 3), rng.uniform(-0.01, 0.01, 3)
                expected = law(point, velocity, ground)
                value = np.array(function(point, velocity)).ravel()
                np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12)


def test_derivatives_of_the_smooth_form():
    rng, step = np.random.default_rng(6), 1e-7
    p, v = ca.SX.sym("p", 3), ca.SX.sym("v", 3)
    both = ca.vertcat(p, v)
    jacobian = ca.Function("j", [p, v], [ca.jacobian(smooth_ground_force(p, v, PLAIN), both)])
    for _ in range(20):
        point = np.concatenate((rng.uniform(-0.004, -0.0005, 3), rng.uniform(-0.05, 0.02, 3)))
        numeric = np.empty((3, 6))
        for k, change in enumerate(np.eye(6) * step):
            ahead, behind = point + change, point - change
            difference = smooth_ground_force(ahead[:3], ahead[3:], PLAIN)
            difference = difference - smooth_ground_force(behind[:3], behind[3:], PLAIN)
            numeric[:, k] = difference / (2 * step)
        # Second derivatives up to 1e6 N/m^2 and 1e-14 of rounding in 10 N over the step.
        np.testing.assert_allclose(np.array(jacobian(point[:3], point[3:])), numeric, atol=1e-4)


# ------------------------------------------------------------------- under the whole model


@pytest.mark.parametrize("smooth", [False, True])
def test_forces_on_all_feet_over_a_raised_plane(smooth):
    law = smooth_ground_force if smooth else ground_force
    x = standing_state(PARAMETERS, ROBOT.stand_height)
    x[VELOCITY] = 0.02, -0.01, -0.1
    height = 0.004
    forces = ground_forces(x, PARAMETERS, LAB, height=height, smooth=smooth)
    feet, rates = foot_positions(x, PARAMETERS), foot_velocities(x, PARAMETERS)
    for leg in range(4):
        point = feet[leg] - [0.0, 0.0, height]
        np.testing.assert_array_equal(forces[3 * leg : 3 * leg + 3], law(point, rates[leg], LAB))
    symbol = ca.SX.sym("x", 42)
    value = ground_forces(symbol, PARAMETERS, LAB, height=height, smooth=smooth)
    function = ca.Function("g", [symbol], [value])
    np.testing.assert_allclose(np.array(function(x)).ravel(), forces, rtol=1e-12)


@pytest.mark.parametrize("name", GROUND_PRESETS)
@pytest.mark.parametrize("law", [ground_force, smooth_ground_force])
def test_springs_carry_the_robot_at_their_depth(name, law):
    """At m g / 4 k1 of depth, at rest, four feet carry the weight: 2.3, 3.7 and 186 mm."""
    ground = ground_preset(name)
    weight = -PARAMETERS.mass * PARAMETERS.gravity[2]
    depth = weight / (4.0 * ground.stiffness)
    force = law([0.0, 0.0, -depth], [0.0, 0.0, 0.0], ground)
    np.testing.assert_allclose(4.0 * force, [0.0, 0.0, weight], rtol=1e-12)
    assert depth == pytest.approx(
        {"lab": 0.00233, "thesis_results": 0.00373}.get(name, 0.186), rel=0.01
    )


def test_the_model_comes_to_rest_on_the_ground():
    """Set down with its legs held, on the lab's ground, it sinks and leans as its springs say."""
    x, symbol = standing_state(PARAMETERS, ROBOT.stand_height), ca.SX.sym("x", 42)
    rate = f_rom_on_ground(symbol, np.zeros(12), np.zeros(3), PARAMETERS, LAB, smooth=True)
    function = ca.Function("f", [symbol], [rate])
    slope = ca.Function("j", [symbol], [ca.jacobian(rate, symbol)])
    # Stiff: friction over the Stribeck velocity is a damper of 1e4 N s/m, 7e4 per s when it leans.
    motion = solve_ivp(
        lambda t, y: np.array(function(y)).ravel(),
        (0.0, 1.5),
        x,
        method="BDF",
        jac=lambda t, y: np.array(slope(y)),
        rtol=1e-8,
        atol=1e-10,
    )
    end = motion.y[:, -1]
    weight = -PARAMETERS.mass * PARAMETERS.gravity[2]
    feet = foot_positions(end, PARAMETERS)
    # Moments about the feet: those at the hips' distance from the centre of mass carry the rest.
    front, hind = PARAMETERS.hip_position[0, 0], -PARAMETERS.hip_position[2, 0]
    share = np.array([hind, hind, front, front]) / (2.0 * (front + hind))
    # It leans by 0.1 mm over 0.4 m, which moves the centre of mass by 0.1 mm; it creeps as slowly.
    np.testing.assert_allclose(-feet[:, 2] * LAB.stiffness, share * weight, rtol=2e-3)
    forces = ground_forces(end, PARAMETERS, LAB, smooth=True).reshape(4, 3)
    np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.0, weight], atol=1e-2)


# -------------------------------------------------------------------------------- presets


def test_presets_are_those_of_the_thesis_and_the_lab():
    assert set(GROUND_PRESETS) == {"lab", "thesis_model", "thesis_results"}
    model, results = GROUND_PRESETS["thesis_model"], GROUND_PRESETS["thesis_results"]
    assert (model.stiffness, model.damping, model.transition_width) == (100.0, 1e3, 1e-3)
    assert (model.friction_static, model.friction_coulomb) == (1.8, 1.0)
    assert (results.friction_static, results.friction_coulomb) == (0.7, 0.7)
    assert (LAB.stiffness, LAB.damping, LAB.stribeck_velocity) == (8000.0, 250.0, 1e-3)
    assert (LAB.friction_static, LAB.friction_coulomb, LAB.friction_viscous) == (0.6, 0.54, 0.85)
    for preset in GROUND_PRESETS.values():
        assert preset.source and preset.doubt


def test_bad_ground():
    with pytest.raises(ValueError, match="ground is 'moon', it must be one of lab, thesis_model"):
        ground_preset("moon")
    for name, value, allowed in (
        ("stiffness", 0.0, "> 0"),
        ("damping", -1.0, ">= 0"),
        ("friction_static", math.nan, ">= 0"),
        ("stribeck_velocity", 0.0, "> 0"),
        ("transition_width", math.inf, "> 0"),
    ):
        with pytest.raises(ValueError, match=f"{name} must be finite and {allowed}, not {value}"):
            replace(LAB, **{name: value})
    with pytest.raises(ValueError, match=r"position must have shape \(3,\), not \(2,\)"):
        ground_force([0.0, 0.0], [0.0, 0.0, 0.0], LAB)
    with pytest.raises(ValueError, match=r"velocity must have shape \(3,\), not \(4,\)"):
        smooth_ground_force([0.0, 0.0, 0.0], np.zeros(4), LAB)
