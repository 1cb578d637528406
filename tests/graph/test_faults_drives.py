"""Drives that fail while the robot trots."""

from typing import Any

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from seen_robot import STOP_TILT, STOP_TIME

from husky_description.robot import load_robot
from husky_msgs.msg import DriveStatus, ServoCommand
from husky_msgs.srv import ApplyWrench
from husky_runtime import graph

pytestmark = pytest.mark.graph

JOINTS = load_robot().joint_names
KNEE = JOINTS[2]


def put_down_without(
    robot: Any, failed: float, joint: str, brakes_for: float = 0.0, most: float = 2.0 * STOP_TILT
) -> float:
    """One drive is lost, the others put the robot down, then all is off.

    Args:
        robot: it.
        failed: time of the failure [s].
        joint: whose drive is lost.
        brakes_for: time in which the lost drive brakes its own motor [s].
        most: tilt in the end [deg].

    Returns:
        Time from the failure until the drive had left position control [s].
    """
    s, index = robot.session, JOINTS.index(joint)
    s.advance(0.8)
    times, kinds = robot.kinds()
    lost = times[(kinds[:, index] != ServoCommand.POSITION) & (times >= failed)]
    assert len(lost), f"{joint} is not lost; last seen: {robot.seen}"
    after = times - lost[0]
    gone = after > brakes_for - 1e-9
    assert (kinds[gone, index] == ServoCommand.TORQUE_OFF).all(), "a drive that is lost stays off"
    others = np.delete(kinds, index, axis=1)
    assert (others[(after > 0.003) & (after < 0.5)] == ServoCommand.POSITION).all(), "they settle"
    assert (others[after > STOP_TIME] == ServoCommand.TORQUE_OFF).all(), "and are off after that"
    assert robot.tilt < most and robot.height < 0.25, f"{robot.tilt:.0f} deg; {robot.seen}"
    assert not s.drives.operational and joint in s.drives.reason, robot.seen
    assert robot.mode == "damping" and "not operational" in s.state.reason, robot.seen
    return float(lost[0] - failed)


def state_of(robot: Any, joint: str) -> DriveStatus:
    """Newest state of a joint's drive."""
    return next(drive for drive in robot.session.drives.drives if drive.joint == joint)


def test_drive_fault(trotting, record_property):
    s = trotting.session
    failed = trotting.watch()
    s.inject(graph.DRIVES_INJECT_FAULT, KNEE, "fault:2310")
    reaction = put_down_without(trotting, failed, KNEE)
    record_property("reaction_s", reaction)
    assert reaction <= 2 * graph.TICK_PERIOD
    drive = state_of(trotting, KNEE)
    assert (drive.state, drive.error_code) == ("fault", 0x2310), drive
    assert not trotting.trigger(graph.DRIVES_RESET_FAULTS)
    s.advance(0.6)
    assert state_of(trotting, KNEE).state == "fault", "a fault whose cause lasts cannot be reset"
    assert KNEE in trotting.trigger(graph.DRIVES_ENABLE)
    s.inject(graph.DRIVES_INJECT_FAULT, KNEE, "")
    trotting.recover()


@pytest.mark.slow  # in one process: `sto` in husky_sim's test_segment
def test_safe_torque_off(trotting, record_property):
    s = trotting.session
    failed = trotting.watch()
    s.inject(graph.DRIVES_INJECT_FAULT, KNEE, "sto")
    reaction = put_down_without(trotting, failed, KNEE)
    record_property("reaction_s", reaction)
    assert reaction <= 2 * graph.TICK_PERIOD
    assert state_of(trotting, KNEE).safe_torque_off
    s.set_mode("passive")
    s.advance(0.1)
    assert f"safe torque off: {KNEE}" in trotting.trigger(graph.DRIVES_ENABLE)
    s.inject(graph.DRIVES_INJECT_FAULT, KNEE, "")
    trotting.recover()


@pytest.mark.slow  # in one process: husky_sim's test_drive_faults
def test_following_error(trotting, record_property):
    """A blow twists a hip with more than its drive has: the joint leaves its window."""
    s = trotting.session
    failed = trotting.watch()
    request = ApplyWrench.Request(body="front_left_hip", duration=0.3)
    request.wrench.torque.x = 13.0
    assert s.call(graph.PLANT_APPLY_WRENCH, request).success
    hip = JOINTS[0]
    record_property("reaction_s", put_down_without(trotting, failed, hip, 0.1, most=180.0))
    drive = state_of(trotting, hip)
    assert (drive.state, drive.error_code) == ("fault", 0x8611), drive
    trotting.recover()


def test_drive_off_the_bus(trotting, record_property):
    """Frames come back short: none is believed, the other drives put the robot down."""
    s = trotting.session
    losses = trotting.told(graph.LOW_LEVEL_CONTROLLER, "peer_losses")
    failed = trotting.watch()
    s.inject(graph.DRIVES_INJECT_FAULT, KNEE, "silent")
    with s.unheard(graph.LOW_LEVEL_CONTROLLER):  # it has no joint states to tick by
        s.advance(0.9)
    record_property("reaction_s", trotting.torque_ends(failed, within=STOP_TIME + 0.05))
    trotting.all_off(failed)
    assert s.drives.working_counter < s.drives.expected_working_counter, trotting.seen
    assert KNEE in s.drives.reason, trotting.seen
    for node in (graph.PLANT, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER):
        assert "lost" not in trotting.reported(node, "").message, "nobody is blamed for it"
    s.inject(graph.DRIVES_INJECT_FAULT, KNEE, "")
    trotting.trigger(graph.DRIVES_RESET_FAULTS)
    trotting.until(lambda: trotting.mode == "damping", "damping after the gap", within=1.0)
    assert trotting.told(graph.LOW_LEVEL_CONTROLLER, "peer_losses") == losses, "the IMU is there"
    trotting.recover()


def test_emergency_stop(trotting, record_property):
    s = trotting.session
    stopped = trotting.watch()
    assert not trotting.trigger(graph.DRIVES_EMERGENCY_STOP)
    s.advance(0.8)
    record_property("reaction_s", trotting.put_down(stopped))
    assert s.drives.emergency_stop and trotting.mode == "damping", trotting.seen
    s.set_mode("passive")
    assert "latched" in trotting.trigger(graph.DRIVES_ENABLE)
    trotting.recover()


def test_cut(trotting, record_property):
    """Category 0: torque is gone with the next frame, whatever becomes of the robot."""
    s = trotting.session
    stopped = trotting.watch()
    assert not trotting.trigger(graph.DRIVES_CUT)
    s.advance(0.8)
    record_property("reaction_s", trotting.torque_ends(stopped, within=0.006))
    assert s.drives.emergency_stop and s.drives.reason == "cut", trotting.seen
    s.set_mode("passive")
    assert "latched" in trotting.trigger(graph.DRIVES_ENABLE)
    trotting.recover()


def deactivate(robot: Any, **transition: Any) -> bool:
    """Ask the bridge to give the drives up; return whether it did."""
    down = Transition(**(transition or {"id": Transition.TRANSITION_DEACTIVATE}))
    return bool(
        robot.ask(ChangeState, f"/{graph.DRIVE_BRIDGE}/change_state", transition=down).success
    )


def test_deactivation_under_load(trotting, record_property):
    """Refused while the drives carry the robot; forced, the controller's mode follows."""
    s = trotting.session
    assert not deactivate(trotting)
    assert not deactivate(trotting, id=Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert not deactivate(trotting, label="shutdown")
    s.advance(0.5)
    assert trotting.mode == "walk" and trotting.height > 0.5, trotting.seen
    s.set_parameter(graph.DRIVE_BRIDGE, "deactivate_under_load", True)
    since = trotting.watch()
    assert deactivate(trotting)
    s.wait_for(lambda: trotting.mode == "settle", "settle without another tick")
    assert s.state.reason == "the drive bridge is not active", trotting.seen
    with s.unheard(graph.DRIVE_BRIDGE):
        s.advance(0.3)
    record_property("reaction_s", trotting.torque_ends(since, within=0.1))
    assert not s.drives.active and not s.drives.operational
    s.set_parameter(graph.DRIVE_BRIDGE, "deactivate_under_load", False)
    s.kill(graph.DRIVE_BRIDGE)
    s.start(graph.DRIVE_BRIDGE)
    trotting.recover()
