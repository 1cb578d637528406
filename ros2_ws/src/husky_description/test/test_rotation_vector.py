"""Rotation vectors of quaternions against SciPy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.rotation import to_rotation_vector

ANGLES = (0.0, 1e-12, 1e-6, 0.3, 1.7, 3.1)
"""Below half a turn, where the vector is one alone [rad]."""


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("sign", (1.0, -1.0))
def test_is_the_axis_times_the_angle(angle, sign):
    """Of a quaternion and of its opposite, which is the same rotation."""
    for axis in np.random.default_rng(1).normal(size=(20, 3)):
        vector = angle * axis / np.linalg.norm(axis)
        quaternion = sign * Rotation.from_rotvec(vector).as_quat()
        made = to_rotation_vector(tuple(quaternion.tolist()))
        np.testing.assert_allclose(made, vector, rtol=1e-12, atol=1e-15)
