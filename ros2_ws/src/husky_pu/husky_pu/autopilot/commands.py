"""MAVLink commands to the flight controller: COMMAND_LONG, COMMAND_INT and SET_MODE."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.autopilot.failsafes import FlightMode
from husky_pu.autopilot.flight import FlightLogic
from husky_pu.autopilot.flight_parameters import FlightParameters
from husky_pu.autopilot.mavlink_link import MavlinkLink
from husky_pu.autopilot.state import Severity
from husky_pu.autopilot.telemetry import MAIN_MODES
from husky_pu.mavlink.dialect import PROTOCOL_VERSION

FORCE = 21196
"""Parameter 2 of arm and disarm that passes over the checks."""
_CUSTOM_MODE = 1
_WRITE, _RESET = 1.0, 2.0
"""First parameter of PREFLIGHT_STORAGE."""

ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
REJECTED = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)


class CommandHandler:
    """Carries commands out and says how that went (MAV_RESULT)."""

    def __init__(self, logic: FlightLogic, parameters: FlightParameters):
        """Command this flight logic and these parameters."""
        self._logic = logic
        self._parameters = parameters
        self._table: dict[int, Callable[[Sequence[float], MavlinkLink], int]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_DO_FLIGHTTERMINATION: self._terminate,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._request_capabilities,
            mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: self._request_version,
            mavlink.MAV_CMD_PREFLIGHT_STORAGE: self._store,
        }

    def handle(self, number: int, parameters: Sequence[float], channel: MavlinkLink) -> int:
        """Return the result of a command.

        Args:
            number: MAV_CMD.
            parameters: seven of them.
            channel: the link it came by.
        """
        handler = self._table.get(number)
        return handler(parameters, channel) if handler is not None else UNSUPPORTED

    def set_mode(self, base_mode: int, custom_mode: int) -> int:
        """Return the result of SET_MODE."""
        return self._mode(base_mode, custom_mode >> 16 & 0xFF)

    def _arm_disarm(self, p: Sequence[float], channel: MavlinkLink) -> int:
        force = p[1] == FORCE
        if p[0] == 1.0:
            return REJECTED if self._logic.arm(force=force) else ACCEPTED
        if p[0] == 0.0:
            self._logic.disarm(force=force)
            return ACCEPTED
        return DENIED

    def _set_mode(self, p: Sequence[float], channel: MavlinkLink) -> int:
        if not (math.isfinite(p[0]) and math.isfinite(p[1])):
            return DENIED
        return self._mode(int(p[0]), int(p[1]))

    def _mode(self, base_mode: int, main_mode: int) -> int:
        if not base_mode & _CUSTOM_MODE:
            self._say(f"Base mode {base_mode} denied: bit 1, custom, must be set")
            return DENIED
        for mode in FlightMode:
            if MAIN_MODES[mode] == main_mode:
                return REJECTED if self._logic.set_mode(mode) else ACCEPTED
        allowed = ", ".join(f"{number} {mode.value}" for mode, number in MAIN_MODES.items())
        self._say(f"Mode {main_mode} denied; allowed: {allowed}")
        return DENIED

    def _terminate(self, p: Sequence[float], channel: MavlinkLink) -> int:
        if p[0] not in (0.0, 1.0):
            return DENIED
        return REJECTED if self._logic.terminate(p[0] == 1.0) else ACCEPTED

    def _set_interval(self, p: Sequence[float], channel: MavlinkLink) -> int:
        number = _message_id(p[0])
        if number < 0 or not math.isfinite(p[1]):
            return DENIED
        return ACCEPTED if channel.set_interval(number, p[1]) else DENIED

    def _get_interval(self, p: Sequence[float], channel: MavlinkLink) -> int:
        number = _message_id(p[0])
        if number < 0:
            return DENIED
        channel.send(mavlink.MAVLink_message_interval_message(number, channel.get_interval(number)))
        return ACCEPTED

    def _request_message(self, p: Sequence[float], channel: MavlinkLink) -> int:
        number = _message_id(p[0])
        if number == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self._get_interval(p[1:], channel)
        return ACCEPTED if number >= 0 and channel.send_once(number) else DENIED

    def _request_capabilities(self, p: Sequence[float], channel: MavlinkLink) -> int:
        channel.send_once(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return ACCEPTED

    def _request_version(self, p: Sequence[float], channel: MavlinkLink) -> int:
        channel.send_once(PROTOCOL_VERSION)
        return ACCEPTED

    def _store(self, p: Sequence[float], channel: MavlinkLink) -> int:
        """Write all parameters (what is set is always written), or reset them."""
        if p[0] == _WRITE and self._parameters.outlasting:
            return ACCEPTED
        if p[0] == _WRITE:
            self._say("Parameters are not stored: no parameter_file")
            return DENIED
        if p[0] != _RESET:
            return DENIED
        if self._logic.armed:
            self._say("Parameters are reset only while disarmed")
            return REJECTED
        self._parameters.forget()
        return ACCEPTED

    def _say(self, text: str) -> None:
        self._logic.texts.append((Severity.WARNING, text))


def _message_id(parameter: float) -> int:
    """Return the id of a message, -1 for none."""
    whole = math.isfinite(parameter) and parameter == int(parameter)
    return int(parameter) if whole and 0 <= parameter <= 0xFFFF else -1
