"""What nobody should send, sent to every topic of a trotting robot: it trots on.

The same to one with its fans, a radio and a planner, and to services: `propulsion/test_hostile`.
"""

import pytest
from hostile_stranger import Stranger

from husky_runtime import graph

pytestmark = pytest.mark.graph


def test_every_topic(trotting):
    stranger = Stranger(trotting)
    try:
        said = stranger.say_everything(
            {graph.JOINT_STATES, graph.IMU, graph.ODOMETRY, graph.CLOCK, graph.CMD_VEL}
        )
    finally:
        stranger.close()
    assert said > 200, f"only {said} messages: the mutations are gone"
