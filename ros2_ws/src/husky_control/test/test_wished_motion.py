"""A wished velocity, against a body whose acceleration follows with a lag."""

import numpy as np
import pytest

from husky_control.flight.wished_motion import LAG, RAMP, WishedMotion

DT = 0.002


@pytest.mark.parametrize("wish", [(0.5, 0.0), (-0.3, 0.4)])
def test_a_body_with_that_lag_stays_at_its_place(wish):
    motion, place = WishedMotion(), np.zeros(2)
    body, velocity, acceleration = np.zeros(2), np.zeros(2), np.zeros(2)
    furthest = 0.0
    for tick in range(4000):
        place += DT * motion.advance(wish if tick < 2000 else (0.0, 0.0), DT)
        acceleration += (motion.push - acceleration) * DT / LAG
        velocity += acceleration * DT
        body += velocity * DT
        furthest = max(furthest, float(np.abs(place - body).max()))
        if tick == 1999:
            np.testing.assert_allclose(motion.velocity, wish)
    assert furthest < 0.005
    assert not motion.moves and not motion.push.any()
    assert np.abs(place).max() > 1.0


def test_it_is_ramped_and_ends_at_once_when_it_is_told():
    motion = WishedMotion()
    motion.advance((1.0, 0.0), DT)
    assert motion.push[0] == pytest.approx(RAMP) and motion.moves
    motion.reset()
    assert not motion.moves
