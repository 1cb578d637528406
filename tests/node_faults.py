"""Nodes that die or stand still while the robot trots, and the robot's way back to its feet.

The same for nodes that are processes (tests/graph) and for nodes in containers (tests/docker), of
whichever the fixture `trotting` has.
"""

import signal
import threading
import time

import pytest
from seen_robot import GRACE

from husky_runtime import graph


def test_controller_killed(trotting, record_property):
    s = trotting.session
    died = trotting.watch()
    s.kill(graph.LOW_LEVEL_CONTROLLER)
    s.advance(0.9)
    record_property("reaction_s", trotting.put_down(died))
    assert not s.drives.operational and s.drives.reason == "no joint command", trotting.seen
    trotting.reported(graph.DRIVE_BRIDGE, "low_level_controller is lost")
    s.start(graph.LOW_LEVEL_CONTROLLER)
    trotting.recover()


def test_drive_bridge_killed(trotting, record_property):
    s = trotting.session
    died = trotting.watch()
    s.kill(graph.DRIVE_BRIDGE)
    s.advance(0.5)
    record_property("reaction_s", trotting.torque_ends(died, within=0.1))
    trotting.reported(graph.PLANT, "drive_bridge is lost")
    s.start(graph.DRIVE_BRIDGE)
    trotting.until(
        lambda: trotting.mode == "damping" and s.drives is not None,
        "damping after the gap, and news of the new drives",
        within=1.0,
    )
    assert not s.drives.operational, trotting.seen
    trotting.recover()


def test_imu_driver_killed(trotting, record_property):
    s = trotting.session
    others = (graph.PLANT, graph.DRIVE_BRIDGE)
    losses = [trotting.told(node, "peer_losses") for node in others]
    died = trotting.watch()
    s.kill(graph.VN200_DRIVER)
    trotting.until(lambda: trotting.mode == "settle", "settle", within=0.1)
    assert "IMU" in s.state.reason
    s.advance(0.7)
    record_property("reaction_s", trotting.settled(died))
    trotting.reported(graph.LOW_LEVEL_CONTROLLER, "vn200_driver is lost")
    after = [trotting.told(node, "peer_losses") for node in others]
    assert after == losses, f"{others} blame somebody who only waited for the IMU himself"
    s.start(graph.VN200_DRIVER)
    trotting.reported(graph.VN200_DRIVER, "streaming", "stale")
    trotting.recover()


def test_plant_killed(trotting, record_property):
    s = trotting.session
    s.kill(graph.PLANT)
    trotting.reported(graph.DRIVE_BRIDGE, "no cycle")
    s.start(graph.PLANT)
    start = trotting.watch()
    s.advance(0.3)
    times, kinds = trotting.kinds()
    assert times[0] == start == 0.0 and (kinds == 0).all(), "a new world starts without torque"
    assert trotting.torque_ends(start, within=0.1) == 0.0
    assert trotting.mode == "passive" and not s.drives.operational, trotting.seen
    trotting.recover()


def test_controller_stalled_beyond_grace(trotting, record_property):
    s = trotting.session
    stalled = trotting.watch()
    s.processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGSTOP)
    with s.unheard(graph.LOW_LEVEL_CONTROLLER):
        s.advance(0.9)
    record_property("reaction_s", trotting.put_down(stalled))
    trotting.reported(graph.DRIVE_BRIDGE, "low_level_controller is lost")
    s.processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGCONT)
    trotting.until_damped()
    trotting.recover()


@pytest.mark.slow  # it waits for longer than the grace period
def test_all_nodes_paused(trotting):
    """The plant, which waits for the bridge, runs again before the bridge does."""
    s = trotting.session
    others = (graph.PLANT, graph.VN200_DRIVER, graph.LOW_LEVEL_CONTROLLER)
    judges = (graph.PLANT, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER)
    losses = [trotting.told(node, "peer_losses") for node in judges]
    s.processes.kill(graph.DRIVE_BRIDGE, signal.SIGSTOP)

    def pause():
        time.sleep(0.2)  # the plant waits, and no message that nobody repeats is under way
        for node in others:
            s.processes.kill(node, signal.SIGSTOP)
        time.sleep(GRACE + 0.5)
        for node in (*others, graph.DRIVE_BRIDGE):
            s.processes.kill(node, signal.SIGCONT)
            time.sleep(0.05)

    pausing = threading.Thread(target=pause)
    pausing.start()
    s.advance(0.5)
    pausing.join()
    assert trotting.mode == "walk" and s.drives.operational, trotting.seen
    assert [trotting.told(node, "peer_losses") for node in judges] == losses
