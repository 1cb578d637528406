"""The plane under the feet and its statics: frames, force formulas, the estimate of the slope."""

import math

import numpy as np
import pytest

from husky_control.incline.statics import (
    Incline,
    axial_thrust,
    feet_normal,
    gravity_in_plane,
    least_thrust,
    load_direction,
    load_slope,
    plane_from_world,
    thrust_for_load,
    turn_towards,
)
from husky_description.gravity import GRAVITY

MASS = 7.6
UP = np.array([0.0, 0.0, 1.0])
LEFT = np.array([0.0, 1.0, 0.0])
FEET = np.array([[0.2, 0.14, 0.0], [0.2, -0.14, 0.0], [-0.2, 0.14, 0.0], [-0.2, -0.14, 0.0]])
SLOPES = [0.0, 10.0, 30.0, 45.0, 60.0, 90.0]


def normal_of(degrees):
    """Outward normal of a slope that rises along x."""
    slope = math.radians(degrees)
    return np.array([-math.sin(slope), 0.0, math.cos(slope)])


def on_slope(points, degrees):
    """Points of level ground, on a slope instead."""
    return points @ plane_from_world(normal_of(degrees))


@pytest.mark.parametrize("degrees", SLOPES)
def test_the_frame_lies_on_the_plane(degrees):
    plane = plane_from_world(normal_of(degrees))
    np.testing.assert_allclose(plane @ plane.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(plane @ normal_of(degrees), UP, atol=1e-12)
    slope = math.radians(degrees)
    uphill = np.array([math.cos(slope), 0.0, math.sin(slope)])
    np.testing.assert_allclose(plane @ uphill, [1.0, 0.0, 0.0], atol=1e-12)
    expected = [-GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope)]
    np.testing.assert_allclose(gravity_in_plane(plane), expected, atol=1e-12)


def test_a_frame_under_an_overhang_is_refused():
    with pytest.raises(ValueError, match=r"its z must be above -0\.9"):
        plane_from_world(-UP)


@pytest.mark.parametrize(
    ("degrees", "ratio", "force"),
    # Worked out by hand for 6.32 kg: m g (sin a - t cos a) / sqrt(1 + t^2).
    [(45.0, 0.7, 10.77), (45.0, 0.35, 26.89), (45.0, 0.0, 43.83), (60.0, 0.35, 40.42)],
)
def test_the_least_force_is_the_one_of_the_closed_form(degrees, ratio, force):
    gravity = gravity_in_plane(plane_from_world(normal_of(degrees)))
    thrust = least_thrust(gravity, 6.32, ratio)
    assert np.linalg.norm(thrust) == pytest.approx(force, abs=0.02)
    # Up the slope and into it.
    assert thrust[0] > 0.0 and thrust[2] <= 0.0


@pytest.mark.parametrize("degrees", [30.0, 45.0, 75.0, 90.0])
@pytest.mark.parametrize("ratio", [0.2, 0.35, 0.55])
def test_with_it_the_feet_bear_the_wanted_ratio_and_no_smaller_force_does(degrees, ratio):
    gravity = gravity_in_plane(plane_from_world(normal_of(degrees)))
    thrust = least_thrust(gravity, MASS, ratio)
    x, y = load_slope(-MASS * gravity - thrust, 10.0)
    assert (x, y) == (pytest.approx(ratio), pytest.approx(0.0, abs=1e-12))
    size = float(np.linalg.norm(thrust))
    for angle in np.linspace(0.0, 2.0 * np.pi, 60):
        other = 0.999 * size * np.array([math.cos(angle), 0.0, math.sin(angle)])
        support = -MASS * gravity - other
        assert support[2] <= 0.0 or support[0] / support[2] > ratio


def test_legs_alone_do_on_gentle_slopes():
    gravity = gravity_in_plane(plane_from_world(normal_of(15.0)))
    assert not least_thrust(gravity, MASS, 0.32).any()
    assert not axial_thrust(gravity, MASS, 0.32, UP).any()


@pytest.mark.parametrize("degrees", [20.0, 45.0, 80.0])
def test_turning_the_load_says_the_same_of_one_plane(degrees):
    normal = normal_of(degrees)
    plane = plane_from_world(normal)
    thrust = thrust_for_load(load_direction([normal, normal], 0.32), MASS)
    np.testing.assert_allclose(
        plane @ thrust, least_thrust(gravity_in_plane(plane), MASS, 0.32), atol=1e-9
    )


def test_where_the_ground_bends_the_load_lies_between_the_normals():
    direction = load_direction([UP, normal_of(45.0)], 0.32)
    np.testing.assert_allclose(direction, normal_of(22.5), atol=1e-9)
    # A gentle bend leaves the steep side its ratio.
    direction = load_direction([normal_of(20.0), normal_of(30.0)], 0.32)
    np.testing.assert_allclose(direction, normal_of(30.0 - math.degrees(math.atan(0.32))))


@pytest.mark.parametrize(("degrees", "pitch"), [(30.0, 45.0), (45.0, 60.0)])
def test_a_fixed_axis_must_lean_uphill(degrees, pitch):
    gravity = gravity_in_plane(plane_from_world(normal_of(degrees)))
    lean = math.radians(pitch)
    axis = np.array([math.sin(lean), 0.0, math.cos(lean)])
    thrust = axial_thrust(gravity, MASS, 0.35, axis)
    assert load_slope(-MASS * gravity - thrust, 10.0)[0] == pytest.approx(0.35)
    # A body parallel to the slope pushes away from it, and is not asked to.
    assert not axial_thrust(gravity, MASS, 0.35, UP).any()


def test_the_load_slope_is_limited():
    assert load_slope(np.array([50.0, 0.0, 10.0]), 0.5) == pytest.approx((0.5, 0.0))
    assert load_slope(np.array([3.0, 4.0, -5.0]), 0.5) == pytest.approx((0.3, 0.4))


@pytest.mark.parametrize("degrees", SLOPES)
def test_the_slope_is_the_plane_of_the_feet(degrees):
    incline = Incline()
    incline.reset(on_slope(FEET, degrees))
    assert math.degrees(incline.slope) == pytest.approx(degrees, abs=1e-6)


def test_feet_that_span_no_plane_are_refused_and_do_not_disturb():
    line = np.outer(np.arange(4.0), [1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="span no plane"):
        feet_normal(line)
    incline = Incline()
    incline.reset(on_slope(FEET, 30.0))
    standing = np.ones(4, dtype=bool)
    incline.tick(line, standing, ~standing, LEFT, 0.1, 0.002)
    assert math.degrees(incline.slope) == pytest.approx(30.0, abs=1e-6)


def test_the_slope_follows_noisy_feet_within_a_degree():
    rng = np.random.default_rng(1)
    incline = Incline()
    incline.reset(FEET)
    standing = np.array([True, False, False, True])
    slopes = []
    for tick in range(1000):
        if tick % 85 == 0:
            standing = ~standing
        feet = on_slope(FEET, 20.0) + rng.normal(0.0, 0.003, FEET.shape)
        incline.tick(feet, standing, np.zeros(4, dtype=bool), LEFT, 0.15, 0.002)
        slopes.append(math.degrees(incline.slope))
    assert np.abs(np.array(slopes[500:]) - 20.0).max() < 1.0


RADIUS = 1.5
"""Of ground that bends upward from the level [m]."""


def on_arc(along):
    """Point of the bending ground, and its slope [rad], a way along it [m]; flat before zero."""
    angle = max(0.0, along) / RADIUS
    point = (min(0.0, along) + RADIUS * math.sin(angle), 0.0, RADIUS * (1.0 - math.cos(angle)))
    return np.array(point), angle


def walk_on_arc(incline, start, end, step=0.1, noise=0.0):
    """Trot by steps of each foot [m]; ways along the arc of the feet's last landings (4,)."""
    rng = np.random.default_rng(0)
    ways = np.array([start + 0.4, start + 0.4, start, start])
    across = np.array([[0.0, y, 0.0] for y in FEET[:, 1]])
    feet = np.array([on_arc(way)[0] for way in ways]) + across
    incline.reset(feet)
    pair = 0
    while (end - ways[3]) * step > 0.0:
        legs = [(0, 3), (1, 2)][pair]
        for leg in legs:
            ways[leg] += step
            feet[leg] = on_arc(ways[leg])[0] + across[leg] + rng.normal(0.0, noise, 3)
        touchdown = np.isin(np.arange(4), legs)
        for tick in range(85):
            landing = touchdown if tick == 0 else np.zeros(4, dtype=bool)
            incline.tick(feet, np.ones(4, dtype=bool), landing, LEFT, 0.15, 0.002)
        pair = 1 - pair
    return ways


@pytest.mark.parametrize(("start", "end"), [(0.0, 0.6), (1.0, 0.3)])
def test_the_bend_of_the_ground_is_learnt_up_and_down(start, end):
    incline = Incline()
    step = math.copysign(0.1, end - start)
    ways = walk_on_arc(incline, start, end, step)
    for way, normal in zip(ways, incline.normals, strict=True):
        np.testing.assert_allclose(normal, normal_of(math.degrees(on_arc(way)[1])), atol=0.025)


def test_the_curvature_of_the_ground_is_that_of_the_arc():
    incline = Incline()
    walk_on_arc(incline, 0.3, 1.2)
    # Belief in straight ground takes a little of it.
    assert incline.curvature == pytest.approx(1.0 / RADIUS, rel=0.15)
    incline.reset(FEET)
    assert incline.curvature == 0.0


def test_noise_of_the_feet_bends_no_plane():
    incline = Incline()
    walk_on_arc(incline, -3.0, -0.5, noise=0.003)
    for ground in incline.grounds():
        # What is within the tolerance of the plane is the plane.
        np.testing.assert_array_equal(ground, incline.normal)


def test_ground_that_bends_has_three_normals():
    incline = Incline()
    walk_on_arc(incline, 0.0, 0.6)
    plane, front, hind = incline.grounds()
    assert hind[2] > plane[2] > front[2]


def test_turning_towards_a_vector_stops_there():
    turned = turn_towards(UP, normal_of(60.0), math.radians(10.0))
    np.testing.assert_allclose(turned, normal_of(10.0), atol=1e-12)
    np.testing.assert_array_equal(turn_towards(UP, normal_of(5.0), 0.2), normal_of(5.0))
