"""Husky-beta in the air, its whole graph in lockstep, as somebody else's ground station sees it."""

import pytest
from mavproxy import MavProxy
from pymavlink.dialects.v20 import common as mavlink
from seen_robot import running

from husky_experiments.morph_scripts import become_perched, become_splayed, land, take_off
from husky_experiments.scripts import stand_up
from husky_pu.autopilot.mavlink_ports import default_port
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow]

SETTINGS = {graph.PLANT: {"robot": "beta", "body": "robot_with_unit", "seed": 1}}
CLIMB = 3.0
"""From the take-off to a hold [s]."""
PATIENCE = 20.0
"""Time of the flight within which all must have been read [s]."""


@pytest.fixture
def flying(domain, tmp_path, graphs):
    """A session of the robot in its hold over the perch's place."""
    graphs.end()
    with running(tmp_path / "run", SETTINGS, record=False) as session:
        stand_up(session)
        session.advance(1.0)
        become_perched(session)
        become_splayed(session)
        take_off(session)
        session.advance(CLIMB)
        yield session


def test_mavproxy_reads_the_flying_robot_as_a_quadrotor(flying, domain, tmp_path):
    """Its kind, that it is armed and in the air, four pulses [us] as high as a hover takes."""
    session = flying
    station = MavProxy(default_port(domain), tmp_path)

    def read(message, what, **fields):
        """Return a message as soon as it says what is expected."""
        told = session.advance(PATIENCE, lambda: fields.items() <= station.ask(message).items())
        assert told, f"not {what}: {station.ask(message)}"
        return station.ask(message)

    try:
        kind = read("HEARTBEAT", "a quadrotor", type=mavlink.MAV_TYPE_QUADROTOR)
        assert kind["autopilot"] == mavlink.MAV_AUTOPILOT_PX4
        assert kind["system_status"] == mavlink.MAV_STATE_ACTIVE
        assert kind["base_mode"] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        assert station.heard("OFFBOARD")
        in_air, on_ground = mavlink.MAV_LANDED_STATE_IN_AIR, mavlink.MAV_LANDED_STATE_ON_GROUND
        read("EXTENDED_SYS_STATE", "in the air", landed_state=in_air)
        outputs = read("SERVO_OUTPUT_RAW", "pulses", servo5_raw=0)
        pulses = [outputs[f"servo{fan}_raw"] for fan in range(1, 9)]
        assert min(pulses[:4]) > 1300 and max(pulses[:4]) < 2000 and not any(pulses[4:])
        land(session)
        read("EXTENDED_SYS_STATE", "on the ground", landed_state=on_ground)
    finally:
        station.close()
