"""Which autopilot answers on a line: asked for its version, told nothing else.

It is no companion's dialogue: no rate is set, no parameter read, nothing armed. An autopilot that
sends heartbeats unasked, as on a serial line, is spoken to only after the first.
"""

from __future__ import annotations

import select
import termios
import time
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.companion import command_requests as commands
from husky_pu.companion.client import COMPONENT
from husky_pu.companion.link import MavlinkPort, opener
from husky_pu.mavlink.frames import FrameReader, Message, signing_time

_HEARTBEAT_PATIENCE, _VERSION_PATIENCE = 3.0, 2.0
"""Wall time for the first heartbeat, one of which comes each second, and for the version [s]."""
_ASK_PERIOD = 0.5
_NAMES = {mavlink.MAV_AUTOPILOT_PX4: "PX4", mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: "ArduPilot"}
_RELEASES = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc", 255: ""}
"""Ends of a version by its last byte (FIRMWARE_VERSION_TYPE)."""


def probe_pixhawk(connection: str, signing_key: bytes = b"") -> str:
    """Return what autopilot answers, with its system id and firmware version.

    Args:
        connection: as of `husky_pu.companion.link.opener`.
        signing_key: 32 bytes; with it only signed frames count.

    Raises:
        OSError: the line cannot be opened, or no autopilot is heard on it.
        ValueError: the connection is none.
    """
    try:
        port = opener(connection)()
    except termios.error as error:
        raise OSError(str(error)) from error
    try:
        return _Question(port, signing_key).ask(connection)
    finally:
        port.close()


class _Question:
    """The question for a version, on an open port."""

    def __init__(self, port: MavlinkPort, signing_key: bytes):
        self._port = port
        self._codec = mavlink.MAVLink(None, 1, COMPONENT)
        if signing_key:
            self._codec.signing.secret_key = signing_key
            self._codec.signing.sign_outgoing = True
            self._codec.signing.timestamp = signing_time(time.time())
        self._reader = FrameReader(self._codec)

    def ask(self, connection: str) -> str:
        """Wait for a heartbeat, then for the version; describe the autopilot."""
        if connection.startswith("udpout:"):  # nobody answers there before we have spoken
            self._send(mavlink.MAVLink_ping_message(0, 0, 0, 0))
        heartbeat = self._await("HEARTBEAT", _HEARTBEAT_PATIENCE)
        if heartbeat is None:
            refused = self._reader.counters.refused
            more = f" ({refused} frames that are not signed with the key)" if refused else ""
            raise OSError(f"no autopilot is heard{more}")
        system = heartbeat.get_srcSystem()
        self._codec.srcSystem = system
        armed = heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        end, version = time.monotonic() + _VERSION_PATIENCE, None
        while version is None and time.monotonic() < end:
            self._send(
                mavlink.MAVLink_command_long_message(
                    *(system, 1, commands.REQUEST_MESSAGE, 0),
                    *(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0),
                )
            )
            version = self._await("AUTOPILOT_VERSION", _ASK_PERIOD)
        name = _NAMES.get(heartbeat.autopilot, f"autopilot {heartbeat.autopilot}")
        told = "firmware unknown" if version is None else f"firmware {_firmware(version)}"
        return f"{name}, system {system}, {told}, {'ARMED' if armed else 'disarmed'}"

    def _send(self, message: Message) -> None:
        self._port.write(message.pack(self._codec))
        self._codec.seq = (self._codec.seq + 1) % 256

    def _await(self, kind: str, patience: float) -> Any:
        """Return the next message of a type that an autopilot sends, None when none comes [s]."""
        end = time.monotonic() + patience
        while (left := end - time.monotonic()) > 0:
            ready, _, _ = select.select([self._port.fileno()], [], [], left)
            for message in self._reader.feed(self._port.read()) if ready else ():
                from_autopilot = message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
                if message.get_type() == kind and from_autopilot:
                    return message
        return None


def _firmware(version: Any) -> str:
    """Return a firmware version as its vendor writes it, and the board."""
    number = version.flight_sw_version
    parts = (number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF)
    text = ".".join(map(str, parts)) + _RELEASES.get(number & 0xFF, "")
    return f"{text}, uid 0x{version.uid:X}" if version.uid else text
