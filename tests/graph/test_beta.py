"""Husky-beta's graph in lockstep: the servo bus alone is between its joints and the plant."""

import numpy as np
import pytest
from seen_robot import running

from husky_control.gait.table import GAITS
from husky_control.modes.table import modes_of
from husky_description.robot import load_robot
from husky_experiments.scripts import walk
from husky_msgs.msg import ModeTable
from husky_runtime import graph

pytestmark = pytest.mark.graph

GRACE = 5.0
"""Wall time after which nodes give each other up [s]: no test of a busy machine."""
SETTINGS = {
    graph.PLANT: {"robot": "beta", "grace": GRACE, "seed": 1},
    graph.SERVO_BRIDGE: {"robot": "beta", "grace": GRACE},
    graph.LOW_LEVEL_CONTROLLER: {"robot": "beta", "grace": GRACE, "stand.duration": 0.9},
}
JOINT = "front_left_knee"


@pytest.fixture(scope="module")
def session(domain, tmp_path_factory, graphs):
    graphs.end()
    with running(tmp_path_factory.mktemp("beta"), SETTINGS, record=False) as session:
        yield session


def stand_and_trot(session):
    """Stand up and trot; return the trajectory's digest."""
    session.enable_drives()
    session.advance(0.2)
    session.set_mode("stand_up", "stand", within=3.0)
    session.set_gait("trot")
    walk(session, 0.4, (0.1, 0.0, 0.0))
    assert session.state.mode == "walk", session.state.reason
    assert session.drives.operational and session.drives.short_cycles == 0
    return session.trajectory_sha256


def test_it_trots_and_does_so_again(session):
    """No topic of the plant's has to do with joints; a reset begins the same run anew."""
    session.start_again()
    digest = stand_and_trot(session)
    for topic in (graph.SERVO_STATE, graph.SERVO_COMMAND):
        assert session.count_publishers(topic) == 0
    session.start_again()
    assert stand_and_trot(session) == digest


def test_a_servo_that_is_lost_takes_the_torque_off_all(session):
    """The others hold still first, for as long as a fall needs."""
    session.inject(graph.PLANT_INJECT_FAULT, f"servo:{JOINT}", "unplug")
    assert session.advance(0.5, lambda: not session.drives.operational)
    assert JOINT in session.drives.reason and "no answer" in session.drives.reason
    session.advance(0.6)
    assert not any(drive.state == "operation enabled" for drive in session.drives.drives)
    session.inject(graph.PLANT_INJECT_FAULT, f"servo:{JOINT}", "")
    session.advance(1.0)
    assert all(drive.error == "" for drive in session.drives.drives)
    currents = np.array([drive.current for drive in session.drives.drives])
    assert not currents.any()


def test_what_it_can_be_asked_for_is_told_once_to_whoever_comes_later(session):
    """A world that starts again changes nothing of it."""
    heard = []
    session.subscribe(ModeTable, graph.MODE_TABLE, heard.append)
    session.wait_for(lambda: heard, "the table of modes")
    session.start_again()
    (table,) = heard
    own = modes_of(load_robot("beta"))
    assert [(m.name, m.meaning) for m in table.modes] == [(m.value, m.meaning) for m in own]
    requests = {mode.name: list(mode.requests) for mode in table.modes}
    assert requests["walk"] == ["stand", "damping", "emergency_stop"]
    assert "balance" in requests["stand"] and "wair" not in requests["stand"]
    assert list(table.gaits) == list(GAITS)
