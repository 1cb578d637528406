"""A real client: MAVSDK (4 or later) reads, sets, is refused, flies OFFBOARD and disarms."""

import threading
import time

import pytest

pytest.importorskip("mavsdk.plugins.action.action")

import mavsdk
from mavsdk.plugins.action.action import Action, ActionError
from mavsdk.plugins.offboard.offboard import Attitude, Offboard, OffboardError
from mavsdk.plugins.param.param import Param
from mavsdk.plugins.telemetry.telemetry import Telemetry

from husky_description.robot import load_robot
from husky_pu.autopilot import Autopilot, SensorSample
from husky_pu.failsafes import FlightMode
from husky_pu.flight_parameters import TABLE
from husky_pu.mavlink_ports import UdpPort
from husky_pu.mixer import Mixer

pytestmark = pytest.mark.graph


class Device(threading.Thread):
    """An autopilot at rest in real time behind a UDP port."""

    def __init__(self, station):
        super().__init__(daemon=True)
        self.autopilot = Autopilot(Mixer(load_robot()))
        self.port = UdpPort(0, station)
        self.autopilot.server.open_link(self.port.station)
        self.ended = threading.Event()

    def run(self):
        at_rest = SensorSample(
            0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (0.21, 0.0, 0.43), 101325.0, 25.0, 2.0
        )
        start, tick = time.monotonic(), 0
        while not self.ended.wait(0.001):
            for link, data in self.port.read():
                self.autopilot.receive(data, link)
            while 0.002 * tick < time.monotonic() - start:
                self.autopilot.tick(at_rest._replace(time_ns=2_000_000 * tick))
                tick += 1
            for link in self.autopilot.server.links:
                data = self.autopilot.take_output(link)
                if data:
                    self.port.write(link, data)


def until(accept, what, seconds=30.0):
    end = time.monotonic() + seconds
    while not accept():
        assert time.monotonic() < end, what
        time.sleep(0.02)


def test_mavsdk():
    probe = UdpPort(0)
    number = probe.port
    probe.close()
    kind = mavsdk.ComponentType.COMPANION_COMPUTER
    client = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
    client.add_any_connection(f"udpin://127.0.0.1:{number}")
    device = Device(f"127.0.0.1:{number}")
    device.start()
    logic = device.autopilot.vehicle.logic
    try:
        system = client.first_autopilot(30.0)
        assert system is not None
        action, offboard = Action(system), Offboard(system)
        parameters, telemetry = Param(system), Telemetry(system)

        assert parameters.get_param_float("COM_OF_LOSS_T") == 1.0
        parameters.set_param_int("NAV_RCL_ACT", 6)
        assert parameters.get_param_int("NAV_RCL_ACT") == 6
        listed = parameters.get_all_params()
        assert len(listed.float_params) + len(listed.int_params) == len(TABLE)

        until(lambda: telemetry.battery().voltage_v > 24.0, "battery")
        until(lambda: device.autopilot.vehicle.time_ns > 1_000_000_000, "a second of rest")
        with pytest.raises(ActionError):
            action.arm()  # no sticks
        with pytest.raises(OffboardError):
            offboard.start()  # no setpoint
        offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.0))
        until(lambda: device.autopilot.vehicle.stream.accepted > 5, "a stream")
        offboard.start()
        assert logic.mode is FlightMode.OFFBOARD
        action.arm()
        until(telemetry.armed, "armed")
        offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.3))
        until(lambda: logic.thrust > 0.29, "thrust")
        action.disarm()
        until(lambda: not logic.armed, "disarmed")
        until(lambda: not telemetry.armed(), "disarmed, as told")
        assert device.autopilot.vehicle.stream.refused == 0
        assert device.autopilot.server.damaged == 0
    finally:
        client.destroy()
        device.ended.set()
        device.join(5.0)
        device.port.close()
