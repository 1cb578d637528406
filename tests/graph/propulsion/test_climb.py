"""A short climb through the whole graph: the thrust is made by the vectored fans."""

import numpy as np
import pytest
from seen_robot import QUICKLY

from husky_experiments.climb_scripts import climb_onto, get_ready, go, has_fallen, true_place
from husky_experiments.incline_course import Course, climbing_settings
from husky_experiments.session import SessionError

pytestmark = [pytest.mark.graph, pytest.mark.slow]

COURSE = Course(30.0, approach=0.3, blend=0.8, length=4.0)
SPEED = 0.3


def test_climbs_and_stands_on_the_slope(new_graph):
    settings = climbing_settings(COURSE, seed=1, controller=QUICKLY)
    with new_graph(**settings) as robot:
        session = robot.session
        get_ready(session)
        assert climb_onto(session, COURSE, SPEED), session.state.reason
        before = true_place(session)
        assert go(session, COURSE, 2.0, SPEED), session.state.reason
        assert (true_place(session) - before) @ COURSE.uphill == pytest.approx(2.0 * SPEED, rel=0.2)
        force = session.fans.wrench.force
        # m g sin(30 deg - atan 0.32) is 16 N, for a body that is parallel to the slope.
        made = np.array([force.x, force.y, force.z])
        assert np.linalg.norm(made) == pytest.approx(16.1, abs=2.0)
        assert made[0] > 0.0 > made[2], "up the slope and into it"
        assert go(session, COURSE, 2.0, 0.0)
        before = true_place(session)
        assert go(session, COURSE, 0.6, 0.0)
        assert np.linalg.norm(true_place(session) - before) < 0.01
        assert not has_fallen(session, COURSE)
        with pytest.raises(SessionError, match="on an incline of 30 deg"):
            session.set_mode("stand")
