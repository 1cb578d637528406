"""Nodes that die or stand still while the robot trots."""

import pytest
from node_faults import *  # noqa: F403

from husky_runtime import graph

pytestmark = pytest.mark.graph


@pytest.mark.slow  # in one process: husky_drivers' test_master_stops; the way down: test_settling
def test_emergency_stop_without_controller(trotting, record_property):
    s = trotting.session
    stopped = trotting.watch()
    s.kill(graph.LOW_LEVEL_CONTROLLER)
    assert not trotting.trigger(graph.DRIVES_EMERGENCY_STOP)
    s.advance(0.8)
    record_property("reaction_s", trotting.put_down(stopped))
    assert s.drives.emergency_stop and s.drives.reason == "emergency stop", trotting.seen
    s.start(graph.LOW_LEVEL_CONTROLLER)
    s.wait_for(
        lambda: "latched" in trotting.trigger(graph.DRIVES_ENABLE),
        "refusal: emergency stop latched",
    )
    trotting.recover()
