"""Integration of the reduced-order model: it stays on SO(3) and is of order 4."""

import numpy as np
import pytest
from rom_integration import integrate_rom, rom_step
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from husky_control.planning.reduced_order import (
    ANGULAR_VELOCITY,
    f_rom,
    standing_state,
    unpack_state,
)
from husky_control.planning.rom_parameters import rom_parameters
from husky_description.robot import load_robot

PARAMETERS = rom_parameters(load_robot())


def rate(time, x):
    """Forces and joint accelerations that vary with time."""
    u_g = np.tile([3.0, -2.0, 15.0], 4) * np.cos(5.0 * time + np.arange(12.0))
    u_l = np.tile([2.0, -1.0, 0.3], 4) * np.sin(6.0 * time)
    return f_rom(x, u_l, u_g, np.array([5.0, 1.0, -3.0]), PARAMETERS)


def tumbling():
    x = standing_state(PARAMETERS, 0.5)
    x[ANGULAR_VELOCITY] = 3.0, -5.0, 2.0
    return x


def test_it_stays_on_so3_for_long():
    """Ten seconds of tumbling in coarse steps: products of rotations, nothing but rounding."""
    _, states = integrate_rom(rate, tumbling(), 10.0, 1000)
    for x in states[::50]:
        rotation = unpack_state(x).rotation
        # A thousand products, each rounded by a few 1e-16.
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-13)
        assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-13)


def test_the_motion_is_that_of_scipy():
    """The nine entries integrated as plain numbers by SciPy, with a tolerance of 1e-12."""
    x = tumbling()
    reference = solve_ivp(rate, (0.0, 0.5), x, rtol=1e-12, atol=1e-12, method="DOP853").y[:, -1]
    _, states = integrate_rom(rate, x, 0.5, 500)
    # Order 4 with 1 ms steps at 6 rad/s leaves 1e-10.
    np.testing.assert_allclose(states[-1], reference, atol=1e-9)
    rotation = unpack_state(reference).rotation
    # The exact flow stays on SO(3); the tolerance over the whole way is left.
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-10)


def test_it_is_of_order_four():
    x = tumbling()
    ends = [integrate_rom(rate, x, 0.4, steps)[1][-1] for steps in (10, 20, 320)]
    coarse, fine = (np.abs(end - ends[-1]).max() for end in ends[:2])
    # Half the step, a sixteenth of the error; less than 2^3.5 would be order 3.
    assert 2.0**3.5 < coarse / fine < 2.0**5.5


def test_constant_spin_is_exact_in_one_step():
    """About a principal axis the exponential is the motion itself."""
    x = standing_state(PARAMETERS, 0.5)
    x[ANGULAR_VELOCITY] = 0.0, 2.0, 0.0  # y is one: the robot is the same left and right
    zero = np.zeros(12)
    end = rom_step(lambda t, y: f_rom(y, zero, zero, np.zeros(3), PARAMETERS), 0.0, x, 0.3)
    expected = Rotation.from_euler("y", 0.6).as_matrix()
    np.testing.assert_allclose(unpack_state(end).rotation, expected, atol=1e-15)


def test_bad_input():
    x = tumbling()
    for duration, steps in ((0.0, 10), (1.0, 0)):
        with pytest.raises(ValueError, match="duration must be > 0 s and steps >= 1"):
            integrate_rom(rate, x, duration, steps)
    with pytest.raises(ValueError, match=r"x must have shape \(42,\), not \(41,\)"):
        integrate_rom(rate, x[:41], 1.0, 10)
    with (
        np.errstate(over="ignore", invalid="ignore"),
        pytest.raises(ValueError, match=r"the motion diverges at .* steps of 0.1 s are too long"),
    ):
        integrate_rom(lambda t, y: 1e200 * y**2, x, 1.0, 10)
