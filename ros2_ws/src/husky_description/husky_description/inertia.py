"""Principal inertia of simple homogeneous solids about their centre of mass."""

from collections.abc import Sequence

import numpy as np

from husky_description.arrays import Array
from husky_description.parameters import frozen


def box_inertia(mass: float, size: Sequence[float] | Array) -> Array:
    """Box with edges `size` [m] (3,): inertia [kg m^2] (3,)."""
    x, y, z = (float(edge) ** 2 for edge in size)
    return frozen(mass / 12.0 * np.array([y + z, x + z, x + y]))


def tube_inertia(mass: float, inner: float, outer: float, length: float, axis: int) -> Array:
    """Tube of radii `inner`, `outer` and `length` [m] along `axis`: inertia [kg m^2] (3,)."""
    across = mass * (3.0 * (inner**2 + outer**2) + length**2) / 12.0
    inertia = np.full(3, across)
    inertia[axis] = mass * (inner**2 + outer**2) / 2.0
    return frozen(inertia)


def cylinder_inertia(mass: float, radius: float, length: float, axis: int) -> Array:
    """Solid cylinder of `radius` and `length` [m] along `axis`: inertia [kg m^2] (3,)."""
    return tube_inertia(mass, 0.0, radius, length, axis)
