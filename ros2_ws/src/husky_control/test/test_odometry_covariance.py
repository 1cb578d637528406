"""Covariances of the odometry: what they say of a way whose error is known."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_control.estimation.odometry_covariance import LOOSE, OdometryCovariance

NONE = np.zeros((6, 6))
ATTITUDE = np.array((3e-6, 3e-6, 2.7e-5))
RATE = np.full(3, 1e-6)
DT = 0.02


def updated(covariance, rotation=None, filtered=NONE, place_counts=True, velocity_counts=True):
    covariance.update(
        np.eye(3) if rotation is None else rotation,
        filtered,
        filtered,
        ATTITUDE,
        RATE,
        place_counts=place_counts,
        velocity_counts=velocity_counts,
    )
    return covariance


def test_a_wrong_heading_carries_away_sideways():
    """Against simulated headings: errors of rms sigma and time T, first order, over 200 s."""
    speed, heading = 0.5, 1.1
    sigma, time, steps = math.sqrt(ATTITUDE[2]), 10.0, 10_000
    rng = np.random.default_rng(0)
    error, place = sigma * rng.standard_normal(400), np.zeros(400)
    for _ in range(steps):
        error += DT * (-error / time) + sigma * math.sqrt(2 * DT / time) * rng.standard_normal(400)
        place += speed * error * DT
    covariance = OdometryCovariance()
    velocity = speed * np.array((math.cos(heading), math.sin(heading), 0.0))
    for _ in range(steps):
        covariance.walk(velocity, ATTITUDE[2], DT)
    across = np.array((-math.sin(heading), math.cos(heading)))
    told = across @ updated(covariance).pose[:2, :2] @ across
    # 400 draws know a variance to 7 %; the random walk leaves out the first T seconds.
    assert told == pytest.approx(np.var(place), rel=0.25)


def test_a_way_is_known_less_well_the_longer_it_is():
    covariance = OdometryCovariance()
    told = []
    for _ in range(3):
        for _ in range(500):
            covariance.walk(np.array((0.5, 0.0, 0.0)), 0.0, DT)
        told.append(updated(covariance).pose[0, 0])
    assert told[0] == pytest.approx(5.0 * 0.01**2)
    assert told == pytest.approx([told[0], 2 * told[0], 3 * told[0]])


@given(
    st.lists(st.tuples(*[st.floats(-2.0, 2.0)] * 3, st.booleans()), max_size=20),
    st.tuples(*[st.floats(-math.pi, math.pi)] * 3),
    st.floats(0.0, 1.0),
    st.booleans(),
    st.booleans(),
)
@settings(max_examples=100, deadline=None)
def test_it_is_a_covariance_whatever_was_walked(pieces, angles, variance, place, velocity):
    """Symmetric, positive definite, and no less than the filter's own."""
    covariance = OdometryCovariance()
    for x, y, z, rising in pieces:
        covariance.walk(np.array((x, y, z)), ATTITUDE[2], DT, rising=rising)
    rotation = Rotation.from_euler("xyz", angles).as_matrix()
    updated(covariance, rotation, variance * np.eye(6), place, velocity)
    for matrix in (covariance.pose, covariance.twist):
        np.testing.assert_array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix).min() > 0.0
    least = variance if place else LOOSE
    assert np.linalg.eigvalsh(covariance.pose[:3, :3]).min() >= least - 1e-12


def test_a_robot_that_falls_says_so():
    fallen = updated(OdometryCovariance(), velocity_counts=False)
    assert np.diag(fallen.twist)[:3] == pytest.approx([LOOSE] * 3)
    assert np.diag(fallen.pose)[:3].max() < 1e-6
