"""What the flight controller does with each kind of message, and what it answers: one table.

`ANSWERS` has every kind that it carries out, or that MAVLink has an answer for. Whatever else is
addressed to it in so many words is answered with a status text "<kind>: not supported", but for
`UNANSWERED`, which call for none. So nobody has to wait for a time-out to learn that there is
neither a mission nor a log here.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.autopilot.commands import CommandHandler
from husky_pu.autopilot.mavlink_link import MavlinkLink
from husky_pu.autopilot.mavlink_setpoints import read_setpoint
from husky_pu.autopilot.telemetry import Vehicle

Answer = Callable[["MavlinkAnswers", Any, Hashable, MavlinkLink], None]
"""Acts on a message that came by a link of a name."""

_NOBODYS_PASSKEY = 2
"""CHANGE_OPERATOR_CONTROL_ACK: passkey or its encryption not supported."""
_NOWHERE = 2**31 - 1
"""A coordinate that is not known [1e-7 deg, mm]."""
_RESPOND = int(mavlink.SERIAL_CONTROL_FLAG_RESPOND)
_REPLY = int(mavlink.SERIAL_CONTROL_FLAG_REPLY)
_SHELL = int(mavlink.SERIAL_CONTROL_DEV_SHELL)
_NO_SHELL = b"there is no shell here\n"
_SERIAL_SIZE, _LOG_SIZE = 70, 90


class MavlinkAnswers:
    """Acts on messages that are for the flight controller."""

    def __init__(
        self,
        vehicle: Vehicle,
        warn: Callable[[str, str], bool],
        send_texts: Callable[[], None],
        streaming: Callable[[], Iterable[MavlinkLink]],
    ):
        """Answer for a vehicle.

        Args:
            vehicle: whom it answers for.
            warn: says a text about a topic to all links, not too often.
            send_texts: sends what the flight logic has to say.
            streaming: returns the links of all who are told what is new.
        """
        self._vehicle = vehicle
        self._warn = warn
        self._send_texts = send_texts
        self._streaming = streaming
        self._commands = CommandHandler(vehicle.logic, vehicle.parameters)

    def answer(self, message: Any, name: Hashable, link: MavlinkLink) -> None:
        """Act on a message of any kind."""
        kind = message.get_type()
        answer = ANSWERS.get(kind)
        if answer is not None:
            answer(self, message, name, link)
        elif getattr(message, "target_system", 0) and kind not in UNANSWERED:
            self._warn(kind, f"{kind}: not supported")

    # Control ------------------------------------------------------------------------------------
    def _setpoint(self, message: Any, name: Hashable, link: MavlinkLink) -> None:
        stream = self._vehicle.stream
        source = (name, message.get_srcSystem(), message.get_srcComponent())
        try:
            setpoint = read_setpoint(message)
        except (ValueError, OverflowError) as error:
            stream.refused += 1
            self._warn("setpoint", f"Setpoint refused: {error}")
            return
        if not stream.accept(setpoint, source, 1e-9 * self._vehicle.time_ns):
            self._warn("contested", "Setpoints from a second source refused")

    def _command_long(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        values = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self._acknowledge(m, link, m.command, self._commands.handle(m.command, values, link))

    def _command_int(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        values = (m.param1, m.param2, m.param3, m.param4, float(m.x), float(m.y), m.z)
        self._acknowledge(m, link, m.command, self._commands.handle(m.command, values, link))

    def _set_mode(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        # It has no answer of its own; ArduPilot acknowledges it by its message's number.
        result = self._commands.set_mode(m.base_mode, m.custom_mode)
        self._acknowledge(m, link, m.get_msgId(), result)

    def _acknowledge(self, m: Any, link: MavlinkLink, number: int, result: int) -> None:
        self._send_texts()  # why, before the bare result
        link.send(
            mavlink.MAVLink_command_ack_message(
                number, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
            )
        )

    def _rc_override(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        fields = [getattr(m, f"chan{index}_raw") for index in range(1, 19)]
        self._vehicle.input.override(fields, 1e-9 * self._vehicle.time_ns)

    def _manual_control(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        if m.target == int(self._vehicle.parameters["MAV_SYS_ID"]):
            self._warn("MANUAL_CONTROL", "MANUAL_CONTROL: use RC_CHANNELS_OVERRIDE")

    def _operator_control(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.send(
            mavlink.MAVLink_change_operator_control_ack_message(
                m.get_srcSystem(), m.control_request, _NOBODYS_PASSKEY
            )
        )

    # Time ---------------------------------------------------------------------------------------
    def _timesync(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        if m.tc1 == 0:
            link.send(mavlink.MAVLink_timesync_message(self._vehicle.time_ns, m.ts1))

    def _ping(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        if m.target_system == 0:
            link.send(
                mavlink.MAVLink_ping_message(
                    m.time_usec, m.seq, m.get_srcSystem(), m.get_srcComponent()
                )
            )

    # Parameters ---------------------------------------------------------------------------------
    def _param_list(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.parameters.request_list(m)

    def _param_read(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.parameters.request_read(m)

    def _param_set(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        self._tell_set(m, link, link.parameters.set)

    def _param_ext_list(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.parameters.request_extended_list(m)

    def _param_ext_read(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.parameters.request_extended_read(m)

    def _param_ext_set(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        self._tell_set(m, link, link.parameters.set_extended)

    def _tell_set(self, m: Any, link: MavlinkLink, set_: Callable[[Any], str]) -> None:
        """Set a parameter; say why not, or tell the others, whose lists are old now."""
        before = self._vehicle.parameters.keepings
        problem = set_(m)
        if problem:
            self._warn("parameter", problem)
        if self._vehicle.parameters.keepings != before:
            for other in self._streaming():
                if other is not link:
                    other.parameters.tell(m.param_id)

    # Files and logs -----------------------------------------------------------------------------
    def _file_transfer(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.transfer(bytes(m.payload), (m.get_srcSystem(), m.get_srcComponent()))

    def _log_list(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    def _log_data(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.send(mavlink.MAVLink_log_data_message(m.id, m.ofs, 0, [0] * _LOG_SIZE))

    # Missions: there is one of no items ---------------------------------------------------------
    def _mission_list(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.send(
            mavlink.MAVLink_mission_count_message(
                m.get_srcSystem(), m.get_srcComponent(), 0, m.mission_type
            )
        )

    def _mission_current(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        self._warn("mission", f"Mission item {m.seq}: there is no mission")
        self._send_texts()
        link.send_once(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _mission_count(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        supported = m.count == 0  # which clears it
        result = mavlink.MAV_MISSION_ACCEPTED if supported else mavlink.MAV_MISSION_UNSUPPORTED
        _acknowledge_mission(m, link, result)

    def _mission_other(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        _acknowledge_mission(m, link, _MISSION_RESULTS[m.get_type()])

    # What there is not --------------------------------------------------------------------------
    def _global_origin(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        self._warn("origin", "SET_GPS_GLOBAL_ORIGIN: there is no position here")
        link.send(
            mavlink.MAVLink_gps_global_origin_message(
                _NOWHERE, _NOWHERE, _NOWHERE, self._vehicle.boot_us
            )
        )

    def _terrain_check(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.send(mavlink.MAVLink_terrain_report_message(m.lat, m.lon, 0, 0.0, 0.0, 0, 0))

    def _serial_control(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        if m.flags & _REPLY:
            return
        shell = m.device == _SHELL
        if not shell:
            self._warn("SERIAL_CONTROL", f"SERIAL_CONTROL: there is no port {m.device} here")
        # A message without data asks whether there is any: a shell's client does so often.
        data = _NO_SHELL if shell and m.count else b""
        if data or m.flags & _RESPOND:
            link.send(
                mavlink.MAVLink_serial_control_message(
                    m.device, _REPLY, 0, 0, len(data), list(data.ljust(_SERIAL_SIZE, b"\0"))
                )
            )

    def _setup_signing(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        self._warn("signing", "SETUP_SIGNING: the key is the node's signing_key")


def _acknowledge_mission(m: Any, link: MavlinkLink, result: int) -> None:
    link.send(
        mavlink.MAVLink_mission_ack_message(
            m.get_srcSystem(), m.get_srcComponent(), result, getattr(m, "mission_type", 0)
        )
    )


_MISSION_RESULTS = {
    "MISSION_CLEAR_ALL": mavlink.MAV_MISSION_ACCEPTED,
    "MISSION_REQUEST": mavlink.MAV_MISSION_INVALID_SEQUENCE,
    "MISSION_REQUEST_INT": mavlink.MAV_MISSION_INVALID_SEQUENCE,
    "MISSION_REQUEST_PARTIAL_LIST": mavlink.MAV_MISSION_UNSUPPORTED,
    "MISSION_WRITE_PARTIAL_LIST": mavlink.MAV_MISSION_UNSUPPORTED,
    "MISSION_ITEM": mavlink.MAV_MISSION_UNSUPPORTED,
    "MISSION_ITEM_INT": mavlink.MAV_MISSION_UNSUPPORTED,
}
ANSWERS: dict[str, Answer] = {
    "SET_ATTITUDE_TARGET": MavlinkAnswers._setpoint,
    "SET_ACTUATOR_CONTROL_TARGET": MavlinkAnswers._setpoint,
    "COMMAND_LONG": MavlinkAnswers._command_long,
    "COMMAND_INT": MavlinkAnswers._command_int,
    "SET_MODE": MavlinkAnswers._set_mode,
    "RC_CHANNELS_OVERRIDE": MavlinkAnswers._rc_override,
    "MANUAL_CONTROL": MavlinkAnswers._manual_control,
    "CHANGE_OPERATOR_CONTROL": MavlinkAnswers._operator_control,
    "TIMESYNC": MavlinkAnswers._timesync,
    "PING": MavlinkAnswers._ping,
    "PARAM_REQUEST_LIST": MavlinkAnswers._param_list,
    "PARAM_REQUEST_READ": MavlinkAnswers._param_read,
    "PARAM_SET": MavlinkAnswers._param_set,
    "PARAM_EXT_REQUEST_LIST": MavlinkAnswers._param_ext_list,
    "PARAM_EXT_REQUEST_READ": MavlinkAnswers._param_ext_read,
    "PARAM_EXT_SET": MavlinkAnswers._param_ext_set,
    "FILE_TRANSFER_PROTOCOL": MavlinkAnswers._file_transfer,
    "LOG_REQUEST_LIST": MavlinkAnswers._log_list,
    "LOG_REQUEST_DATA": MavlinkAnswers._log_data,
    "MISSION_REQUEST_LIST": MavlinkAnswers._mission_list,
    "MISSION_SET_CURRENT": MavlinkAnswers._mission_current,
    "MISSION_COUNT": MavlinkAnswers._mission_count,
    **dict.fromkeys(_MISSION_RESULTS, MavlinkAnswers._mission_other),
    "SET_GPS_GLOBAL_ORIGIN": MavlinkAnswers._global_origin,
    "TERRAIN_CHECK": MavlinkAnswers._terrain_check,
    "SERIAL_CONTROL": MavlinkAnswers._serial_control,
    "SETUP_SIGNING": MavlinkAnswers._setup_signing,
}
"""What is done with a kind of message."""

UNANSWERED = frozenset(
    (
        # Answers themselves: to answer them would go on for ever.
        "COMMAND_ACK",
        "MISSION_ACK",
        "PARAM_ERROR",
        "LOGGING_ACK",
        # Nothing to do, and no answer is foreseen: there are no logs; rates go by commands.
        "LOG_ERASE",
        "LOG_REQUEST_END",
        "REQUEST_DATA_STREAM",
        # Streams that tell a state to whoever wants it.
        "GIMBAL_DEVICE_ATTITUDE_STATUS",
        "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE",
        "GLOBAL_POSITION_SENSOR",
    )
)
"""Kinds that are addressed to somebody and are not answered."""
