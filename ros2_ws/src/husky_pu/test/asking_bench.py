"""An autopilot that is asked message by message, and messages of zeros to ask it with."""

from pymavlink.dialects.v20 import common

from husky_description.robot import load_robot
from husky_pu.autopilot.autopilot import Autopilot, AutopilotConfig, SensorSample
from husky_pu.autopilot.imu import NO_ERRORS
from husky_pu.autopilot.mixer import Mixer
from husky_pu.mavlink import frames as mavlink_frames

MIXER = Mixer(load_robot())
ME, YOU = (255, 190), (1, 1)


def message_of(name, **fields):
    """A message of zeros to the flight controller, but for some fields."""
    kind = next(m for m in common.mavlink_map.values() if m.msgname == name)
    values = []
    for field in kind.fieldnames:
        place = kind.ordered_fieldnames.index(field)
        length = kind.array_lengths[place]
        is_text = kind.fieldtypes[kind.fieldnames.index(field)] == "char"
        zero = b"" if is_text else [0] * length if length else 0
        if field in ("target_system", "target_component"):
            zero = 1
        values.append(fields.get(field, zero))
    return kind(*values)


class AskingBench:
    """An autopilot at rest, and a ground station of another dialect."""

    def __init__(self, **config):
        self.autopilot = Autopilot(
            MIXER, AutopilotConfig(errors=NO_ERRORS, **config), lambda: 1.8e9
        )
        self.codec = common.MAVLink(None, *ME)
        self.reader = mavlink_frames.FrameReader(common.MAVLink(None))
        self.time_ns = 0
        self.tick(5)

    def tick(self, count=1):
        sample = SensorSample(
            0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (0.21, 0.0, 0.43), 101325.0, 25.0, 3.0
        )
        for _ in range(count):
            self.autopilot.tick(sample._replace(time_ns=self.time_ns))
            self.time_ns += 2_000_000

    def take(self):
        return self.reader.feed(self.autopilot.take_output("a"))

    def ask(self, message, ticks=1):
        """What comes by way of an answer: telemetry, which would come anyway, left out."""
        self.autopilot.receive(message.pack(self.codec), "a")
        self.tick(ticks)
        return [m for m in self.take() if m.get_type() not in TELEMETRY]

    def command(self, number, *parameters):
        fields = {f"param{i}": value for i, value in enumerate(parameters, 1)}
        answers = self.ask(message_of("COMMAND_LONG", command=number, **fields))
        return {m.get_type(): m for m in answers}


TELEMETRY = {
    "HEARTBEAT", "ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET", "SERVO_OUTPUT_RAW",
    "HIGHRES_IMU", "SYS_STATUS", "BATTERY_STATUS", "RC_CHANNELS", "EXTENDED_SYS_STATE",
    "SYSTEM_TIME",
}  # fmt: skip
