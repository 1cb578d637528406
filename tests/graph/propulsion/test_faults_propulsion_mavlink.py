"""What is not MAVLink, or not for us, on the flight controller's ports while the robot trots."""

import os
import random

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from husky_experiments.scripts import stop_walking
from husky_runtime import graph

pytestmark = pytest.mark.graph


def setpoint(time, thrust):
    """All the thrust there is, stamped as the companion's would be."""
    return mavlink.MAVLink_set_actuator_control_target_message(
        round(1e6 * time), 0, 1, 1, [0.0, 0.0, 0.0, thrust, 0.0, 0.0, 0.0, 0.0]
    )


def heartbeat(kind=mavlink.MAV_TYPE_QUADROTOR, autopilot=mavlink.MAV_AUTOPILOT_PX4):
    """As an autopilot's."""
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 0, 3)


def damaged(time, peer, seed):
    """Random bytes, frames cut short, frames with a flipped bit."""
    rng = random.Random(seed)
    for _ in range(5):
        yield rng.randbytes(rng.randint(1, 300))
        frame = peer.pack(setpoint(time, 1.0))
        yield frame[: rng.randint(1, len(frame) - 1)]
        spoilt = bytearray(peer.pack(setpoint(time, 1.0)))
        spoilt[rng.randint(1, len(spoilt) - 1)] ^= 1 << rng.randint(0, 7)
        yield bytes(spoilt)


@pytest.mark.slow  # in one process: husky_pu's `test_any_bytes_are_survived_...`; here: the line
def test_garbage_on_the_udp_port(assisted, stranger, record_property):
    s, robot, peer = assisted.session, assisted.robot, stranger(255, 190)
    before = robot.told(graph.FLIGHT_CONTROLLER, "frames_damaged")
    began = assisted.watch()
    for step in range(20):
        for data in damaged(s.time, peer, step):
            peer.send(data)
        s.advance(0.05)
    record_property("rise_n", assisted.rise(began))
    record_property("heights_m", assisted.trots_on())
    assert assisted.helps(began), assisted.seen
    assert robot.told(graph.FLIGHT_CONTROLLER, "frames_damaged") - before > 20


def test_garbage_on_the_serial_line(assisted, stranger, domain, record_property):
    """Damaged bytes may swallow setpoints; the ones that follow get through."""
    s, robot, peer = assisted.session, assisted.robot, stranger(255, 190)
    before = robot.told(graph.FLIGHT_CONTROLLER, "frames_damaged")
    line = os.open(graph.serial_port("pixhawk", domain), os.O_WRONLY | os.O_NOCTTY)
    began = assisted.watch()
    try:
        for step in range(20):
            for data in damaged(s.time, peer, step):
                os.write(line, data)
            s.advance(0.05)
    finally:
        os.close(line)
    record_property("rise_n", assisted.rise(began))
    record_property("heights_m", assisted.trots_on())
    assert assisted.helps(began), assisted.seen
    assert robot.told(graph.FLIGHT_CONTROLLER, "frames_damaged") - before > 20
    assert s.propulsion.connected and s.propulsion.armed, assisted.seen


def test_second_sender_of_our_ids(assisted, stranger, record_property):
    """Who claims to be the flight controller is passed over, a second companion refused."""
    s, robot = assisted.session, assisted.robot
    autopilot, companion = stranger(1, 1), stranger(1, 191)
    before = {key: robot.told(graph.FLIGHT_CONTROLLER, key) for key in _COUNTERS}
    began = assisted.watch()
    for _ in range(20):
        autopilot.say(heartbeat(), setpoint(s.time, 1.0))
        companion.say(setpoint(s.time, 1.0))
        s.advance(0.05)
    record_property("rise_n", assisted.rise(began))
    record_property("heights_m", assisted.trots_on())
    assert assisted.helps(began), assisted.seen
    after = {key: robot.told(graph.FLIGHT_CONTROLLER, key) for key in _COUNTERS}
    assert after["impostors"] - before["impostors"] == 40
    assert after["setpoints_contested"] - before["setpoints_contested"] == 20
    assert s.propulsion.armed, assisted.seen


@pytest.mark.slow  # in one process: husky_pu's test_mavlink_peers
def test_a_crowd_on_the_udp_port(assisted, stranger, record_property):
    """400 peers: a new ground station is served at once, and the companion's stream flows on."""
    s = assisted.session
    began = assisted.watch()
    crowd = [stranger(255, 1 + number % 250) for number in range(400)]
    station = stranger(254, 190)
    for _ in range(3):
        for number, peer in enumerate(crowd, 1):
            peer.say(heartbeat(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID))
            if number % 50 == 0:  # more than the port's buffer holds would be lost
                s.advance(0.01)
        station.say(heartbeat(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID))
        s.advance(0.3)
        station.hear("ATTITUDE_QUATERNION")
    record_property("rise_n", assisted.rise(began))
    record_property("heights_m", assisted.trots_on())
    assert assisted.helps(began), assisted.seen


@pytest.mark.slow
def test_armed_by_a_stranger_while_a_share_stands(assisted, stranger):
    """Arming asks for no thrust: the share has to be set again, and thrust then begins at zero."""
    s, robot = assisted.session, assisted.robot
    stop_walking(s)
    s.arm(False)
    robot.until(lambda: not s.propulsion.armed, "the disarmed unit", within=3.0)
    s.advance(1.0)
    station = stranger(255, 190)
    began = assisted.watch()
    station.say(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, _FORCE, 0, 0, 0, 0, 0))
    robot.until(lambda: s.propulsion.armed, "the armed unit", within=2.0)
    s.advance(3.0)
    assert s.propulsion.armed and s.propulsion.mode == "OFFBOARD", assisted.seen
    times, thrusts = assisted.thrusts()
    total = thrusts[times > began + 1.0].sum(axis=1)  # the rotors have run down by then
    assert total.max() < 1.0, f"{total.max():.1f} N though nobody asks; {assisted.seen}"
    assisted.assist()
    times, thrusts = assisted.thrusts()
    assert (np.diff(thrusts.sum(axis=1)) / np.diff(times)).max() < 80.0  # N/s
    assisted.trot()


_FORCE = 21196
_COUNTERS = ("impostors", "setpoints_contested")
