"""The other end of a companion's line."""

import struct

from pymavlink.dialects.v20 import common as mavlink

PARAMETERS = {
    "COM_OF_LOSS_T": 1.0,
    "COM_OBL_RC_ACT": 4,
    "NAV_RCL_ACT": 3,
    "RC_MAP_ROLL": 1,
    "RC_MAP_PITCH": 2,
    "RC_MAP_THROTTLE": 3,
    "RC_MAP_YAW": 4,
    "RC_MAP_OFFB_SW": 5,
    "RC_MAP_ARM_SW": 6,
    "RC_MAP_KILL_SW": 7,
    "MC_AIRMODE": 0,
    "COM_RC_IN_MODE": 3,
    "COM_RC_LOSS_T": 0.5,
    "COM_LOW_BAT_ACT": 2,
    "BAT1_N_CELLS": 6,
    "MPC_THR_MAX": 1.0,
    "FD_FAIL_R": 0,
    "FD_FAIL_P": 0,
    "PWM_MAIN_DISARM": 1000,
}
"""Of a PX4 that is set up for the robot: whole numbers are INT32, the others REAL32."""


class ScriptedAutopilot:
    """An autopilot in a few lines, on pymavlink's own parser: answers, and tells what it is told.

    Attributes:
        heard: every message that it has parsed.
        results: MAV_RESULT by command, accepted for others.
        deaf: acknowledgements that it still swallows.
        refusal: text that goes before an answer that is not yes.
        parameters: by name; what is not there is not answered.
    """

    baud = 921600

    def __init__(self, system=1, component=1, key=b"", autopilot=mavlink.MAV_AUTOPILOT_PX4):
        self.codec = mavlink.MAVLink(None, system, component)
        self.codec.robust_parsing = True
        if key:
            self.codec.signing.secret_key = key
            self.codec.signing.sign_outgoing = True
            self.codec.signing.timestamp = 1
        self.autopilot = autopilot
        self.heard = []
        self.results = {}
        self.deaf = 0
        self.refusal = ""
        self.parameters = dict(PARAMETERS)
        self.armed = False
        self.mode = 7
        self.state = mavlink.MAV_STATE_STANDBY
        self.boot_ms = 0
        self.output = bytearray()

    def send(self, message):
        self.output += message.pack(self.codec)
        self.codec.seq = (self.codec.seq + 1) % 256

    def take_output(self):
        data, self.output = bytes(self.output), bytearray()
        return data

    def feed(self, data):
        for message in self.codec.parse_buffer(data) or []:
            self.heard.append(message)
            if message.get_type() == "COMMAND_LONG":
                self.answer(message)
            elif message.get_type() == "PARAM_REQUEST_READ":
                self.tell(message.param_id)

    def tell(self, name):
        """Send a parameter as PX4 does, an integer's bytes in the float field."""
        value = self.parameters.get(name)
        if value is None:
            return
        whole = isinstance(value, int)
        field = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
        kind = mavlink.MAV_PARAM_TYPE_INT32 if whole else mavlink.MAV_PARAM_TYPE_REAL32
        self.send(mavlink.MAVLink_param_value_message(name.encode(), field, kind, 1, 0))

    def answer(self, command):
        if self.deaf > 0:
            self.deaf -= 1
            return
        result = self.results.get(command.command, mavlink.MAV_RESULT_ACCEPTED)
        if result == mavlink.MAV_RESULT_ACCEPTED:
            if command.command == 400:
                self.armed = bool(command.param1)
            elif command.command == 176:
                self.mode = int(command.param2)
        elif self.refusal:
            self.text(self.refusal)
        self.send(
            mavlink.MAVLink_command_ack_message(
                command.command,
                result,
                0,
                0,
                command.get_srcSystem(),
                command.get_srcComponent(),
            )
        )

    def of(self, kind):
        return [message for message in self.heard if message.get_type() == kind]

    def text(self, text, severity=mavlink.MAV_SEVERITY_CRITICAL, number=0):
        self.send(mavlink.MAVLink_statustext_message(severity, text.encode(), number))

    def heartbeat(self):
        self.send(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_QUADROTOR,
                self.autopilot,
                1 | self.armed << 7,
                self.mode << 16,
                self.state,
                3,
            )
        )

    def telemetry(self, boot_ms, pwm=(1100, 1200, 1300, 1400), q=(1.0, 0.0, 0.0, 0.0)):
        self.boot_ms = boot_ms
        self.send(mavlink.MAVLink_attitude_quaternion_message(boot_ms, *q, 0, 0, 0))
        self.send(mavlink.MAVLink_attitude_target_message(boot_ms, 0, list(q), 0, 0, 0, 0.25))
        low = 1000 * boot_ms % 2**32
        self.send(mavlink.MAVLink_servo_output_raw_message(low, 0, *pwm, 0, 0, 0, 0))

    def battery(self, voltages, current, remaining=50):
        cells = [*voltages, *[65535] * (10 - len(voltages))]
        self.send(
            mavlink.MAVLink_battery_status_message(
                0, 0, 0, 32767, cells, current, -1, -1, remaining
            )
        )
