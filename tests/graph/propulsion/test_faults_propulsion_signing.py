"""Signed MAVLink, and whoever has another key."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from husky_runtime import graph

pytestmark = pytest.mark.graph

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
DISARM = mavlink.MAVLink_command_long_message(
    1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.0
)
"""By force."""


def test_wrong_signing_key(new_graph, stranger, tmp_path, record_property):
    """The bridge finds nobody and says why; with the right key it does; strangers are not heard."""
    key = tmp_path / "key"
    key.write_text(OTHER_KEY.hex())
    settings = {
        graph.PLANT: {"body": "unit", "keyframe": "stand"},
        graph.FLIGHT_CONTROLLER: {"signing_key": KEY.hex(), "parameters": "COM_ARM_WO_RC=1"},
        graph.PIXHAWK_BRIDGE: {"signing_key": str(key)},
    }
    with new_graph(**settings) as robot:
        s = robot.session
        s.advance(2.0)
        robot.reported(graph.PIXHAWK_BRIDGE, "not signed with our key")
        assert s.propulsion is None or not s.propulsion.connected
        # It may have come up late, by the world's clock: its heartbeats come once a second.
        robot.until(
            lambda: robot.told(graph.FLIGHT_CONTROLLER, "frames_badly_signed") > 0,
            "heartbeats that are badly signed", within=3.0, step=0.5,
        )  # fmt: skip

        s.kill(graph.PIXHAWK_BRIDGE)
        key.write_text(KEY.hex())
        s.start(graph.PIXHAWK_BRIDGE)
        connected = lambda: s.propulsion is not None and s.propulsion.connected  # noqa: E731
        robot.reported(graph.PIXHAWK_BRIDGE, "")  # it is up: in simulated time nobody waits for it
        robot.until(connected, "the unit", within=5.0, step=0.1)
        s.arm()
        before = robot.told(graph.FLIGHT_CONTROLLER, "frames_badly_signed")
        stranger(255, 190).say(*[DISARM] * 10)
        stranger(255, 190, OTHER_KEY).say(*[DISARM] * 10)
        s.advance(0.5)
        assert s.propulsion.armed, "somebody without the key has disarmed it"
        assert robot.told(graph.FLIGHT_CONTROLLER, "frames_badly_signed") - before == 20
        stranger(255, 190, KEY).say(DISARM)
        robot.until(lambda: not s.propulsion.armed, "obedience", within=0.5)
