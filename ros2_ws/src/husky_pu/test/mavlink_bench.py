"""An autopilot at rest, and somebody who talks MAVLink to it by another dialect."""

import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

from husky_description.robot import load_robot
from husky_pu.autopilot.autopilot import Autopilot, AutopilotConfig, SensorSample
from husky_pu.autopilot.imu import NO_ERRORS
from husky_pu.autopilot.mixer import Mixer

MIXER = Mixer(load_robot())
KEY = bytes(range(32))


class Bench:
    """An autopilot at rest and somebody who talks to it."""

    def __init__(self, unix_time=time.time, **config):
        config = AutopilotConfig(errors=NO_ERRORS, **config)
        self.autopilot = Autopilot(MIXER, config, unix_time)
        self.codec = dialect.MAVLink(None, 255, 190)
        self.parser = dialect.MAVLink(None)
        self.parser.robust_parsing = False  # raises at whatever is wrong
        self.time_ns = 0
        self.sample = SensorSample(
            0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (0.21, 0.0, 0.43), 101325.0, 25.0, 3.0
        )

    @property
    def logic(self):
        return self.autopilot.vehicle.logic

    @property
    def stream(self):
        return self.autopilot.vehicle.stream

    def tick(self, count=1):
        for _ in range(count):
            self.autopilot.tick(self.sample._replace(time_ns=self.time_ns))
            self.time_ns += 2_000_000
        return self

    def send(self, message, link="a", codec=None):
        codec = codec or self.codec
        self.autopilot.receive(message.pack(codec), link)
        codec.seq = (codec.seq + 1) % 256

    def take(self, link="a"):
        return self.parser.parse_buffer(self.autopilot.take_output(link)) or []

    def ask(self, message, kind, link="a"):
        self.send(message, link)
        answers = [m for m in self.take(link) if m.get_type() == kind]
        assert len(answers) == 1, answers
        return answers[0]

    def command(self, number, *parameters, kind="COMMAND_ACK"):
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        message = dialect.MAVLink_command_long_message(1, 1, number, 0, *padded)
        return self.ask(message, kind)

    def setpoint(self, thrust=0.0, stamp_ms=None, link="a", mask=7, q=(1.0, 0.0, 0.0, 0.0), **kw):
        stamp = self.time_ns // 1_000_000 if stamp_ms is None else stamp_ms
        rates = kw.get("rates", (0.0, 0.0, 0.0))
        self.send(
            dialect.MAVLink_set_attitude_target_message(stamp, 1, 1, mask, q, *rates, thrust),
            link,
        )

    def offboard(self):
        for _ in range(80):
            self.setpoint()
            self.tick(10)
        assert self.command(176, 1, 6).result == 0
        return self


def heartbeat():
    return dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)


def signed(key, timestamp):
    codec = dialect.MAVLink(None, 255, 190)
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp = timestamp
    return codec
