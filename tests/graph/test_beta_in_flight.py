"""Husky-beta in the air, its whole graph in lockstep, as somebody else's ground station sees it."""

import re
import subprocess
import sys

import pytest
from node_bench import environment

from husky_experiments.morph_scripts import become_perched, become_splayed, land, take_off
from husky_experiments.scripts import stand_up
from husky_experiments.session import Session
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.slow]

SETTINGS = {graph.PLANT: {"robot": "beta", "body": "robot_with_unit", "seed": 1}}
CLIMB = 3.0
"""From the take-off to a hold [s]."""
PATIENCE = 20.0
"""Time of the flight within which all must have been read [s]."""
QUADROTOR, PX4, ACTIVE, ARMED, IN_AIR = 2, 12, 4, 128, 2


@pytest.fixture
def flying(domain, tmp_path, graphs):
    """A session of the robot in its hold over the perch's place."""
    graphs.end()
    session = Session(tmp_path / "run", SETTINGS, record=False)
    try:
        stand_up(session)
        session.advance(1.0)
        become_perched(session)
        become_splayed(session)
        take_off(session)
        session.advance(CLIMB)
        yield session
    finally:
        codes = session.close()
    assert not any(codes.values()), codes


class GroundStation:
    """MAVProxy on the flight controller's UDP port."""

    def __init__(self, port, directory):
        self._log = directory / "mavproxy"
        command = [sys.executable, "-m", "MAVProxy.mavproxy", f"--master=udpout:127.0.0.1:{port}"]
        command += [f"--state-basedir={directory}", "--default-modules=link"]
        with self._log.open("w") as output:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=output, stderr=output, text=True,
                cwd=directory, env=environment(PYTHONUNBUFFERED="1"),
            )  # fmt: skip

    @property
    def said(self):
        return self._log.read_text()

    def newest(self, message):
        """Ask for the newest of a kind of message; return its last answer's integers, by name."""
        self._process.stdin.write(f"status {message}\n")
        self._process.stdin.flush()
        answers = re.findall(rf"{message} \{{(.*?)\}}", self.said)
        pairs = re.findall(r"(\w+) : (-?\d+)", answers[-1]) if answers else ()
        return {name: int(value) for name, value in pairs}

    def close(self):
        self._process.kill()
        self._process.wait()
        print(self.said)


def test_mavproxy_reads_the_flying_robot_as_a_quadrotor(flying, domain, tmp_path):
    """Its kind, that it is armed and in the air, four pulses as high as a hover takes."""
    session = flying
    station = GroundStation(18570 + domain, tmp_path)

    def read(message, holds, what):
        told = session.advance(PATIENCE, lambda: holds(station.newest(message)))
        assert told, f"not {what}: {station.newest(message)}"
        return station.newest(message)

    try:
        kind = read("HEARTBEAT", lambda m: m.get("type") == QUADROTOR, "a quadrotor")
        assert (kind["autopilot"], kind["system_status"]) == (PX4, ACTIVE)
        assert kind["base_mode"] & ARMED
        read("EXTENDED_SYS_STATE", lambda m: m.get("landed_state") == IN_AIR, "in the air")
        outputs = read("SERVO_OUTPUT_RAW", lambda m: "servo4_raw" in m, "pulses")
        pulses = [outputs[f"servo{fan}_raw"] for fan in range(1, 9)]
        assert min(pulses[:4]) > 1300 and max(pulses[:4]) < 2000 and not any(pulses[4:])
        assert "OFFBOARD" in station.said
        land(session)
        read("EXTENDED_SYS_STATE", lambda m: m.get("landed_state") == 1, "on the ground")
    finally:
        station.close()
