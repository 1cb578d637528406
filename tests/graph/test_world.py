"""The world put back to time zero while the robot trots."""

import numpy as np
import pytest

from husky_description import graph
from husky_msgs.msg import ServoCommand

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("keyframe", ["sit", "stand"])
def test_reset_while_trotting(trotting, keyframe):
    """No torque of before acts in the new world; the controller is passive, the drives are off."""
    s = trotting.session
    trotting.watch()
    s.reset(keyframe)
    s.advance(0.3)
    times, kinds = trotting.kinds()
    assert times[0] == 0.0 and (kinds == ServoCommand.TORQUE_OFF).all()
    assert trotting.torque_ends(0.0) == 0.0
    assert trotting.mode == "passive" and not s.drives.operational, trotting.seen
    assert s.drives.reason == "the world has been reset"
    trotting.recover()


def test_emergency_stop_outlasts_a_reset(trotting):
    s = trotting.session
    trotting.trigger(graph.DRIVES_EMERGENCY_STOP)
    s.advance(0.2)
    s.reset()
    s.advance(0.1)
    assert "latched" in trotting.trigger(graph.DRIVES_ENABLE)
    trotting.recover()


def test_imu_after_a_reset(trotting):
    """Its time starts again too; the controller estimates as if nothing had been."""
    s = trotting.session
    s.reset()
    trotting.stand()
    truth = s.truth.pose.pose.position
    error = np.array(s.state.position) - (truth.x, truth.y, truth.z)
    assert np.abs(error).max() < 0.05, error
    for node in (graph.PLANT, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER):
        assert "lost" not in trotting.reported(node, "").message
