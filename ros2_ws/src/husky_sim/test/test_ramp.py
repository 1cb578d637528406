"""The surface of a ramp: continuous, tangent, of the lengths it says."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_sim.ramp import Ramp

slopes = st.floats(0.0, math.pi / 2)


@settings(max_examples=40)  # each is of 4001 points
@given(slopes, st.floats(0.05, 3.0))
def test_it_is_smooth_and_its_lengths_are_lengths(slope, blend):
    ramp = Ramp(slope, approach=1.0, blend=blend, length=2.0, top=1.5)
    places = np.linspace(-0.5, ramp.slope_end + ramp.arc + 2.0, 4001)
    points = np.array([ramp.at(place) for place in places])
    steps = np.diff(points[:, :2], axis=0)
    step = places[1] - places[0]
    # A chord of an arc is shorter by step^2 / (24 radius^2); a kink would turn at once.
    np.testing.assert_allclose(np.hypot(*steps.T), step, rtol=(step / blend) ** 2 / 8 + 1e-9)
    assert np.abs(np.diff(points[:, 2])).max() <= step / blend + 1e-9
    middle = (points[1:, 2] + points[:-1, 2]) / 2
    np.testing.assert_allclose(np.arctan2(steps[:, 1], steps[:, 0]), middle, atol=step / blend)


def test_where_it_goes():
    ramp = Ramp(math.radians(90), approach=1.0, blend=0.5, length=3.0, top=2.0)
    assert ramp.at(-2.0) == (-2.0, 0.0, 0.0)
    assert ramp.at(1.0) == (1.0, 0.0, 0.0)
    assert ramp.at(ramp.slope_start) == pytest.approx((1.5, 0.5, math.pi / 2))
    assert ramp.at(ramp.slope_end) == pytest.approx((1.5, 3.5, math.pi / 2))
    assert ramp.at(ramp.slope_end + ramp.arc + 1.0) == pytest.approx((3.0, 4.0, 0.0))


@given(slopes)
def test_facets_join_and_stay_close(slope):
    ramp = Ramp(slope)
    facets = ramp.facets()
    starts, ends = zip(*facets, strict=True)
    assert starts[0] == pytest.approx((ramp.approach, 0.0))
    assert np.array(ends[:-1]) == pytest.approx(np.array(starts[1:]))
    angles = [math.atan2(end[1] - start[1], end[0] - start[0]) for start, end in facets]
    assert np.abs(np.diff(angles)).max() <= math.radians(3.0) + 1e-6
    assert ends[-1] == pytest.approx(ramp.at(ramp.slope_end + ramp.arc + ramp.top)[:2])


def test_without_arcs_it_has_a_kink():
    ramp = Ramp(0.5, approach=1.0, blend=0.0, length=2.0)
    assert len(ramp.facets()) == 2
    assert ramp.at(2.0) == pytest.approx((1 + math.cos(0.5), math.sin(0.5), 0.5))
    assert ramp.at(4.0) == pytest.approx((2 + 2 * math.cos(0.5), 2 * math.sin(0.5), 0.0))


@pytest.mark.parametrize(("name", "value"), [("slope", -0.1), ("slope", 1.6), ("length", -1.0)])
def test_what_cannot_be_built_is_refused(name, value):
    with pytest.raises(ValueError, match=f"ramp {name} is {value}"):
        Ramp(**{"slope": 0.3, name: value})
