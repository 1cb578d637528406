"""A vectored force beside the wall clock."""

from contextlib import closing

import numpy as np
import pytest
from starvation import in_real_time

pytestmark = [pytest.mark.graph, pytest.mark.realtime]


def test_vectored_in_realtime(new_graph, commanding, held_unit):
    settings = held_unit(mounting="vectoring")
    with (
        new_graph(clock="realtime", **settings) as robot,
        closing(commanding(robot)) as companion,
    ):
        force = (24.0, 0.0, -16.0)

        def push() -> None:
            companion.arm()
            # A machine that is late by 20 ms makes a gap in the pulses, and then the speed
            # controllers want to see another second of low ones.
            _, made = companion.ask(force, 0.5)
            assert np.linalg.norm(made[-1]) > 10.0
            companion.pushes(force, 3.0)

        in_real_time(robot.session, push)
