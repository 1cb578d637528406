"""A kernel that is called without a look at its arguments' types."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from husky_description.compiled import Compiled


class Spring(NamedTuple):
    """A spring and what it does."""

    force: np.ndarray  # (n,) N, written
    stiffness: float  # N/m


@njit(cache=True)  # compiling takes 2 s
def press(spring, way):
    """Write the force of a spring pressed by a way (n,) [m]."""
    spring.force[:] = spring.stiffness * way
    return spring.force.sum()


def test_it_is_the_same_kernel_and_is_compiled_once():
    called = Compiled(press)
    for stiffness in (2.0, 3.0):
        spring = Spring(np.zeros(3), stiffness)
        assert called.call(spring, np.ones(3)) == press(spring, np.ones(3)) == 3.0 * stiffness
    assert len(press.signatures) == 1


def test_what_is_no_array_of_such_numbers_is_refused():
    called = Compiled(press)
    spring = Spring(np.zeros(3), 1.0)
    called.call(spring, np.ones(3))
    for wrong in ([1.0], np.ones(3, dtype=np.float32), None):
        with pytest.raises((TypeError, ValueError)):
            called.call(spring, wrong)
    with pytest.raises(TypeError):
        called.call(spring)
