"""The pinhole of depth images, against independent formulas."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_drivers.d435.frames import OPTICAL_ROTATION, Deprojection, DepthFrame, Intrinsics

PINHOLE = Intrinsics(8, 6, 7.0, 9.0, 3.2, 2.9)


def frame_of(depth, unit=1e-3, intrinsics=PINHOLE):
    return DepthFrame(0, 0.0, intrinsics, unit, depth)


@pytest.mark.parametrize("unit", [1e-3, 1e-4, 0.00125])
def test_points_fall_on_their_pixels_at_their_depth(unit):
    """Projected with `k` and with `p`, whose last column is zero, they are where they came from."""
    generator = np.random.default_rng(3)
    depth = generator.integers(1, 65536, (6, 8)).astype(np.uint16)
    depth[generator.random(depth.shape) < 0.4] = 0
    points = Deprojection(PINHOLE).points(frame_of(depth, unit))
    assert points.dtype == np.float32
    rows, columns = np.nonzero(depth)
    k = np.reshape(PINHOLE.camera_matrix, (3, 3))
    p = np.reshape(PINHOLE.projection_matrix, (3, 4))
    for matrix, seen in ((k, points), (p, np.column_stack([points, np.ones(len(points))]))):
        u, v, z = matrix @ seen.T
        np.testing.assert_allclose(u / z, columns, atol=1e-5)
        np.testing.assert_allclose(v / z, rows, atol=1e-5)
        np.testing.assert_allclose(z, depth[rows, columns] * unit, rtol=1e-6)


def test_an_image_without_depth_has_no_points():
    points = Deprojection(PINHOLE).points(frame_of(np.zeros((6, 8), np.uint16)))
    assert points.shape == (0, 3)


def test_optical_axes_are_those_of_rep_103():
    """x is to the right, -y of ROS; y is down, -z; z is along the view, x."""
    rotation = Rotation.from_quat(OPTICAL_ROTATION)
    np.testing.assert_allclose(
        rotation.as_matrix(), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-15
    )
    rpy = Rotation.from_euler("xyz", [-math.pi / 2, 0.0, -math.pi / 2])
    assert (rotation * rpy.inv()).magnitude() == pytest.approx(0.0, abs=1e-12)


@given(st.floats(0.2, 2.8), st.floats(0.2, 2.8), st.integers(1, 1280), st.integers(1, 720))
def test_the_outer_edges_of_the_image_are_those_of_the_field(across, down, width, height):
    """Pixels have their centres at whole numbers, so that the edges are half a pixel beyond."""
    i = Intrinsics.of_field(width, height, (across, down))
    for focal, centre, count, angle in (
        (i.fx, i.cx, width, across),
        (i.fy, i.cy, height, down),
    ):
        left, right = math.atan((-0.5 - centre) / focal), math.atan((count - 0.5 - centre) / focal)
        assert right - left == pytest.approx(angle)
        assert left == pytest.approx(-right)


@pytest.mark.parametrize(
    ("unit", "depth", "millimetres"),
    [
        (1e-3, [0, 1, 65535], [0, 1, 65535]),
        (float(np.float32(1e-3)), [0, 1, 65535], [0, 1, 65535]),
        (1e-4, [0, 4, 6, 65535], [0, 0, 1, 6554]),
        (0.01, [0, 1, 6553, 6554], [0, 10, 65530, 0]),
    ],
)
def test_depth_in_millimetres(unit, depth, millimetres):
    """Depth beyond 16 bits, or nearer than half a millimetre, is none."""
    image = frame_of(np.array([depth], np.uint16), unit).millimetres()
    assert image.dtype == np.uint16
    assert image.tolist() == [millimetres]
