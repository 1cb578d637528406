"""The emulated VN-200 on a bench without noise."""

import dataclasses

from husky_description.robot import load_robot
from husky_drivers.vn200.binary import IMU_LAYOUT
from husky_drivers.vn200.imu import ImuFigures
from husky_drivers.vn200.protocol import Checksum, encode_ascii
from husky_drivers.vn200.stream import BinaryPacket, StreamParser
from husky_sim.devices.vn200.device import Vn200Device, Vn200Options

FIGURES = ImuFigures.of(load_robot().imu)
SILENT = dataclasses.replace(
    FIGURES,
    gyro_noise_density=0.0,
    accel_noise_density=0.0,
    gyro_bias=0.0,
    accel_bias=0.0,
    tilt_error=0.0,
    heading_error=0.0,
)
LEVEL = ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
PERIOD = 1_250_000


class Bench:
    """A device at its own baud rate, and a host that reads everything."""

    def __init__(self, figures=SILENT, seed=0, **options):
        self.device = Vn200Device(figures, seed, Vn200Options(**options))
        self.tick = 0

    def say(self, body, checksum=Checksum.XOR):
        """Return the lines of the answer to a request such as "VNRRG,1"."""
        return self.send(encode_ascii(body, checksum))

    def send(self, data):
        self.device.feed(data)
        return self.device.take_output().decode("latin-1").split("\r\n")[:-1]

    def run(self, ticks, pose=LEVEL):
        """Return the output of so many samples."""
        output = b""
        for _ in range(ticks):
            self.tick += 1
            self.device.sample(self.tick * PERIOD, *pose)
            output += self.device.take_output()
        return output

    def stream(self):
        """Set the driver's output up."""
        self.say("VNWRG,06,0")
        self.say("VNWRG,05,921600")
        assert self.say("VNWRG,75,1,1,01,0131") == ["$VNWRG,75,1,1,01,0131*76"]
        return self


def packets(data):
    return [m.values for m in StreamParser(IMU_LAYOUT).feed(data) if isinstance(m, BinaryPacket)]
