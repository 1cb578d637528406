"""The same seed gives the same trajectory over the processes, whatever the wall clock does."""

import signal
import threading
import time

import pytest

from husky_bringup.scripts import push, walk
from husky_description import graph

pytestmark = pytest.mark.graph


def script(robot) -> str:
    """Stand up, trot, be pushed, each at its tick; return the digest of the trajectory."""
    s = robot.session
    s.set_parameter(graph.LOW_LEVEL_CONTROLLER, "stand.duration", 2.0)
    s.set_parameter(graph.LOW_LEVEL_CONTROLLER, "stand.joint_speed", 1.0)
    s.advance(0.2)
    assert robot.trigger(graph.DRIVES_ENABLE) == "", robot.seen
    s.advance(0.6)
    s.set_mode("stand_up")
    s.advance(4.0)
    assert robot.mode == "stand", robot.seen
    s.set_gait("trot")
    walk(s, 0.4, (0.3, 0.0, 0.0))
    assert robot.mode == "walk", robot.seen
    push(s, (0.0, 2.0))
    walk(s, 0.4, (0.3, 0.1, 0.0))
    assert robot.mode == "walk" and s.truth.pose.pose.position.x > 0.05, robot.seen
    return s.trajectory_sha256


@pytest.fixture(scope="module")
def digest(graph_of_module):
    """Of the first run."""
    graph_of_module.start_again()
    return script(graph_of_module)


def test_after_a_reset_with_stalls(digest, robot):
    """Nodes that stand still for less than the grace period are waited for."""

    def stall() -> None:
        for node in (graph.LOW_LEVEL_CONTROLLER, graph.DRIVE_BRIDGE, graph.VN200_DRIVER) * 3:
            time.sleep(0.1)
            robot.session.processes.kill(node, signal.SIGSTOP)
            time.sleep(0.05)
            robot.session.processes.kill(node, signal.SIGCONT)

    thread = threading.Thread(target=stall)
    thread.start()
    try:
        assert script(robot) == digest
    finally:
        thread.join()


def test_another_seed(digest, robot):
    robot.session.reset(seed=2)
    assert script(robot) != digest


def test_in_new_processes(digest, robot, new_graph):
    """The plant's memory of the first run is not what makes runs alike."""
    for spec in robot.session.specs:
        assert robot.session.processes.end(spec.name) == {spec.name: 0}
    with new_graph() as another:
        assert script(another) == digest
