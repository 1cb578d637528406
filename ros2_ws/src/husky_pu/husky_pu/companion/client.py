"""A companion computer's side of MAVLink 2, of bytes and time alone: no port, no thread, no ROS.

Bytes go in by `feed`, out by `take_output`; times are passed in. The autopilot is found by its
heartbeat, asked for its telemetry at the rates that are wanted, and lost when it is silent:

* by wall time on the robot: no message for `link_timeout` while telemetry flows;
* in lockstep by the stamps of the companion's own commands (`advance`), because a world that stands
  still has nothing to tell. A standing autopilot is asked for a sign of life once a second of wall
  time, and is lost when it gives none for `grace`.

In simulation, time in which this process did not run is no silence (`PatientClock`).
"""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.companion import command_requests as commands
from husky_pu.companion.flight_settings import FlightSettingRule, FlightSettings
from husky_pu.companion.telemetry import Report, Telemetry
from husky_pu.mavlink.dialect import ESC_INFO, ESC_STATUS, SetAttitudeTarget
from husky_pu.mavlink.frames import FrameReader, Message, signing_time
from husky_runtime.patient_clock import PatientClock

COMPONENT = 191
"""Ours: MAV_COMP_ID_ONBOARD_COMPUTER."""
_HEARTBEAT_PERIOD = 1.0
_BREAK = 0.05
"""Silence within a frame that ends it [s]; 280 bytes at 115200 baud take 25 ms."""
_PROBE_PERIOD = 1.0
_SILENCE = 0.2
"""Wall time without a byte before stamps may call the autopilot lost [s]."""
_HEARTBEAT_TIMEOUT = 3.0
"""The same as `link_timeout` while nothing but heartbeats comes [s]."""
_CONFLICTS, _CONFLICT_PERIOD = 5, 2.0
"""So many sequence numbers going back within so long are two senders of one id [s]."""


@dataclass(frozen=True)
class ClientConfig:
    """What is wanted of the connection.

    Attributes:
        source_system: our system id, 0 for the autopilot's.
        target_system: the autopilot's, 0 for the first that is heard.
        telemetry_rate: of attitude, attitude target, outputs [Hz].
        battery_rate: of battery and system status [Hz].
        link_timeout: silence after which the autopilot is lost [s].
        grace: the same in a lockstep world that stands, in wall time [s].
        lockstep: whether the autopilot's time is the stamps'.
        signing_key: 32 bytes, empty for no signing.
        rules: what parameters of the autopilot may be, by MAV_AUTOPILOT.
        longest_look: most that the time between two looks counts as silence [s].
    """

    fans: int
    source_system: int = 0
    target_system: int = 0
    telemetry_rate: float = 50.0
    battery_rate: float = 10.0
    link_timeout: float = 0.8
    grace: float = 3.0
    lockstep: bool = False
    signing_key: bytes = b""
    rules: Mapping[int, Sequence[FlightSettingRule]] = field(default_factory=dict)
    longest_look: float = math.inf


class MavlinkClient:
    """Talks with one autopilot.

    Attributes:
        telemetry: what it tells.
        settings: its parameters that are relied on.
        reader: finds frames, counts damage.
        connected: it is heard.
        target: its system and component, (0, 0) before it is found.
        connections: how often it has been found.
        losses: how often it fell silent.
        received: messages of it by type.
        missing: messages of it that were lost on the way, by their sequence numbers.
        foreign: messages of others; passed over.
        rejected_intervals: telemetry that it would not send at the wanted rate.
        signed: whether its frames carry a signature; then it takes only such.
    """

    def __init__(self, config: ClientConfig, unix_time: Callable[[], float] = time.time):
        """Begin without an autopilot; `unix_time` [s since 1970] stamps signatures alone."""
        self.config = config
        self.telemetry = Telemetry(config.fans)
        self.settings = FlightSettings(config.rules)
        self.connected = False
        self.target = (config.target_system, 1 if config.target_system else 0)
        self.connections = self.losses = self.missing = self.foreign = 0
        self.rejected_intervals = 0
        self.signed = False
        self.received: Counter[str] = Counter()
        self._unix_time = unix_time
        self._codec = mavlink.MAVLink(None, config.source_system or 1, COMPONENT)
        if config.signing_key:
            self._codec.signing.secret_key = config.signing_key
            self._codec.signing.sign_outgoing = True
        self.reader = FrameReader(self._codec)
        self._commands = commands.CommandRequests()
        self._intervals: list[commands.CommandRequest] = []
        self._output = bytearray()
        self._bundles: list[Report] = []
        self._fed_at = 0.0
        self._clock = PatientClock(config.longest_look)
        self._heard_at = self._probe_at = 0.0  # by that clock
        self._stamp_ns = self._heard_stamp_ns = -1
        self._heartbeat_at = float("-inf")
        self._telling = False  # telemetry flows, not heartbeats alone
        self._sequence = -1
        self._backwards: deque[float] = deque(maxlen=_CONFLICTS)
        self._own_id_heard = float("-inf")

    # Bytes --------------------------------------------------------------------------------------
    def feed(self, data: bytes, now: float) -> None:
        """Take bytes from the line; `now` is monotonic wall time [s]."""
        self._fed_at = now
        for message in self.reader.feed(data):
            self._take(message, now)

    def take_output(self) -> bytes:
        """Return the bytes to put on the line since the last call."""
        data = bytes(self._output)
        self._output.clear()
        return data

    def take_bundles(self) -> list[Report]:
        """Return the reports that have become complete since the last call."""
        bundles, self._bundles = self._bundles, []
        return bundles

    # Time ---------------------------------------------------------------------------------------
    def poll(self, now: float) -> None:
        """Do what is due: command retries, signs of life, the verdict that the link is lost."""
        if self.reader.pending and now - self._fed_at > _BREAK:
            self._fed_at = now
            for message in self.reader.give_up():
                self._take(message, now)
        if self.connected:
            self._watch(now)
            for name in self.settings.due(now):
                self._send(
                    mavlink.MAVLink_param_request_read_message(*self.target, name.encode(), -1)
                )
        for command in self._commands.due(now):
            self._send(
                mavlink.MAVLink_command_long_message(
                    *self.target, command.number, command.sent - 1, *command.parameters
                )
            )
        for command in self._intervals:
            if command.done(now) and not command.accepted and self.connected:
                self.rejected_intervals += 1
        self._intervals = [command for command in self._intervals if not command.done(now)]

    def heartbeat(self, now: float) -> None:
        """Send a heartbeat if one is due; call this from where control happens, and only there."""
        if now - self._heartbeat_at < _HEARTBEAT_PERIOD:
            return
        self._heartbeat_at = now
        if self.config.signing_key:
            signing = self._codec.signing
            signing.timestamp = max(signing.timestamp, signing_time(self._unix_time()))
        self._send(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                mavlink.MAV_AUTOPILOT_INVALID,
                0,
                0,
                mavlink.MAV_STATE_ACTIVE,
                3,
            )
        )

    def advance(self, stamp_ns: int) -> None:
        """The companion's time has come to this stamp [ns]; in lockstep it tells who is late."""
        if stamp_ns < self._stamp_ns:
            self._heard_stamp_ns = stamp_ns  # the world was reset
        self._stamp_ns = stamp_ns

    def closed(self, problem: str, now: float) -> None:
        """The line is gone: so is the autopilot."""
        self.reader.reset()
        self._output.clear()
        self._lose(problem, now)

    # What to say --------------------------------------------------------------------------------
    def command(
        self, number: int, *parameters: float, attempts: int = 3
    ) -> commands.CommandRequest:
        """Put a command on its way; what is missing of its seven parameters is 0."""
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        return self._commands.add(commands.CommandRequest(number, padded, attempts))

    def attitude_target(
        self,
        boot_ms: int,
        type_mask: int,
        wxyz: Sequence[float],
        rates: Sequence[float],
        thrust: float,
        thrust_body: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Send SET_ATTITUDE_TARGET.

        Args:
            boot_ms: the autopilot's time [ms].
            type_mask: what is to be ignored, and whether `thrust_body` holds.
            wxyz: rotation FRD to NED.
            rates: in FRD [rad/s].
            thrust: 0 to 1.
            thrust_body: in FRD, -1 to 1 each.
        """
        self._send(
            SetAttitudeTarget(
                boot_ms & 0xFFFFFFFF,
                *self.target,
                type_mask,
                list(wxyz),
                *rates,
                thrust,
                thrust_body=thrust_body,
            )
        )

    def actuator_target(self, boot_us: int, controls: Sequence[float]) -> None:
        """Send SET_ACTUATOR_CONTROL_TARGET of group 0: roll, pitch, yaw -1 to 1, thrust 0 to 1."""
        padded = [*controls, *[0.0] * (8 - len(controls))]
        self._send(
            mavlink.MAVLink_set_actuator_control_target_message(boot_us, 0, *self.target, padded)
        )

    def system_time(self, boot_ms: int) -> None:
        """Send SYSTEM_TIME: the autopilot's time [ms] to which we have come, in lockstep."""
        self._send(mavlink.MAVLink_system_time_message(0, boot_ms & 0xFFFFFFFF))

    def conflict(self, now: float) -> str:
        """Return who else uses our id or the autopilot's, "" for nobody."""
        if len(self._backwards) == _CONFLICTS and now - self._backwards[0] < _CONFLICT_PERIOD:
            return f"two autopilots speak as system {self.target[0]}"
        if now - self._own_id_heard < _CONFLICT_PERIOD:
            return f"another companion speaks as {self._codec.srcSystem}.{COMPONENT}"
        return ""

    def _send(self, message: Message) -> None:
        self._output += message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256

    # What is heard ------------------------------------------------------------------------------
    def _take(self, message: Message, now: float) -> None:
        source = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() == "HEARTBEAT" and _is_autopilot(message, source):
            wanted = self.config.target_system
            if source != self.target and not self.connected and wanted in (0, source[0]):
                self.target = source
        if source != self.target or not source[0]:
            self.foreign += 1
            if source == (self._codec.srcSystem, COMPONENT):
                self._own_id_heard = now
            return
        kind = message.get_type()
        self.received[kind] += 1
        self.signed = bool(message.get_header().incompat_flags & mavlink.MAVLINK_IFLAG_SIGNED)
        self._follow(message.get_seq(), now)
        boots = self.telemetry.boots
        if self.telemetry.note(message):
            self._bundles.append(self.telemetry.report)
        self._heard_at, self._heard_stamp_ns = self._clock.read(now), self._stamp_ns
        if kind == "COMMAND_ACK":
            self._acknowledged(message, now)
        elif kind in ("PARAM_VALUE", "PARAM_ERROR"):
            self.settings.note(message)
        elif kind not in ("HEARTBEAT", "STATUSTEXT"):
            self._telling = True
        if self.telemetry.warning:
            self._commands.text(self.telemetry.warning)
        if not self.connected or self.telemetry.boots != boots:
            self._begin(now)
        if kind == "HEARTBEAT" and self.settings.autopilot != self.telemetry.autopilot:
            self.settings.begin(self.telemetry.autopilot)

    def _begin(self, now: float) -> None:
        """An autopilot is there, or there again: ask it for its telemetry."""
        if not self.connected:
            self.connected = True
            self.connections += 1
            self._codec.srcSystem = self.config.source_system or self.target[0]
            self._probe_at = self._heard_at
        for command in self._intervals:
            command.fail("the autopilot was started again", now)
        self.settings.begin(self.telemetry.autopilot if self.received["HEARTBEAT"] else None)
        config = self.config
        wanted = [(number, config.telemetry_rate) for number in _TELEMETRY]
        wanted += [(number, config.battery_rate) for number in _BATTERY]
        self._intervals = [
            self.command(commands.SET_MESSAGE_INTERVAL, number, round(1e6 / rate), attempts=5)
            for number, rate in wanted
        ]

    def _follow(self, sequence: int, now: float) -> None:
        """Count what is missing between two messages."""
        gap = (sequence - self._sequence - 1) % 256 if self._sequence >= 0 else 0
        if gap < 128:
            self.missing += gap
        else:
            self._backwards.append(now)
        self._sequence = sequence

    def _acknowledged(self, message: Message, now: float) -> None:
        to = (message.target_system, message.target_component)
        if to[0] in (0, self._codec.srcSystem) and to[1] in (0, COMPONENT):
            self._commands.acknowledge(message.command, message.result, now)

    def _watch(self, now: float) -> None:
        patient_now = self._clock.read(now)
        silent = patient_now - self._heard_at
        timeout = self.config.link_timeout if self._telling else _HEARTBEAT_TIMEOUT
        if not self.config.lockstep:
            if silent > timeout:
                self._lose(f"silent for {silent:.1f} s", now)
            return
        behind = 1e-9 * (self._stamp_ns - self._heard_stamp_ns)
        if silent > _SILENCE and behind > timeout:
            self._lose(f"silent for {behind:.1f} s of simulated time", now)
        elif silent > self.config.grace:
            self._lose(f"no sign of life for {silent:.1f} s", now)
        elif silent > _PROBE_PERIOD and patient_now - self._probe_at > _PROBE_PERIOD:
            self._probe_at = patient_now
            self.command(
                commands.REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, attempts=1
            )

    def _lose(self, problem: str, now: float) -> None:
        self._commands.fail(f"no connection: {problem}", now)
        self._intervals.clear()
        if self.connected:
            self.connected = self._telling = False
            self.losses += 1
            self._sequence = -1


_TELEMETRY: tuple[int, ...] = (
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    ESC_STATUS,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
)
_BATTERY: tuple[int, ...] = (
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    ESC_INFO,
)


def _is_autopilot(heartbeat: Any, source: tuple[int, int]) -> bool:
    """Whether a heartbeat is an autopilot's: not a ground station's, a camera's, a companion's."""
    return bool(
        heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        and heartbeat.type not in (mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
        and source[1] == mavlink.MAV_COMP_ID_AUTOPILOT1
    )
