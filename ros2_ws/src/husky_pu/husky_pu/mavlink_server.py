"""The flight controller's side of MAVLink 2: several links, of bytes and time alone.

A reply goes to the link that asked, streams go to every link that has spoken. What is addressed to
others is ignored; what claims to come from the flight controller itself is counted and ignored.

In lockstep a setpoint with stamp s acts in the first tick at or after s + 10 ms that is a multiple
of 10 ms, however early it came, and what changes the state (arming, modes, parameters) and stands
before it in the companion's stream acts with it. So a run does not depend on when bytes arrive.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.autopilot_state import Severity
from husky_pu.commands import CommandHandler
from husky_pu.mavlink_link import MavlinkLink
from husky_pu.mavlink_setpoints import (
    SETPOINT_PERIOD_NS,
    HeldMessages,
    changes_state,
    is_setpoint,
    read_setpoint,
    stamp_of,
)
from husky_pu.telemetry import Message, Vehicle

_FUTURE_NS = 2 * SETPOINT_PERIOD_NS
"""A stamp further ahead than this is of a time before a reset [ns]."""
_COMPANION_NS = 100_000_000
"""So long after its last setpoint a link still counts as the companion's [ns]."""
_FORGET_NS = 10_000_000_000
"""Silence after which a link is dropped [ns]."""
_MAX_LINKS = 16
_TEXT_PERIOD_NS = 1_000_000_000
"""Between two status texts about the same trouble [ns]."""
_TEXT_SIZE = 50


class MavlinkServer:
    """Speaks for a vehicle.

    Attributes:
        stamp_ns: newest stamp of a setpoint that has come, good or bad [ns], -1 before the first.
        impostors: messages from our own system and component id.
        foreign: messages addressed to others.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        lockstep: bool = False,
        signing_key: bytes = b"",
        unix_time: Callable[[], float] = time.time,
    ):
        """Start without a link.

        Args:
            vehicle: whom it speaks for.
            lockstep: hold setpoints until their time, see the module.
            signing_key: 32 bytes; with one, frames that are not signed with it are refused.
            unix_time: stamps signatures [s since 1970]; nothing else.
        """
        self._lockstep = lockstep
        self._key = signing_key
        self._unix_time = unix_time
        self._links: dict[Hashable, MavlinkLink] = {}
        self._opened = 0
        self._closed_counts = [0, 0]
        self.impostors = self.foreign = 0
        self.restart(vehicle)

    def restart(self, vehicle: Vehicle) -> None:
        """The vehicle has started again; links stay, with their default streams."""
        self._vehicle = vehicle
        self._commands = CommandHandler(vehicle.logic)
        self.stamp_ns = -1
        self._companion: Hashable = None
        self._held = HeldMessages()
        self._told: dict[str, int] = {}
        self._refused_told = 0
        self._count = 0
        p = vehicle.parameters
        self._own = (int(p["MAV_SYS_ID"]), int(p["MAV_COMP_ID"]))
        for link in self._links.values():
            link.restart(vehicle)
            link.heard_ns = min(link.heard_ns, 0)

    # Links --------------------------------------------------------------------------------------
    def open_link(self, name: Hashable) -> None:
        """Stream to a link though nobody has spoken on it, for good."""
        link = self._link(name)
        if link is not None:
            link.streaming = link.permanent = True

    def close_link(self, name: Hashable) -> None:
        """Forget a link."""
        link = self._links.pop(name, None)
        if link is not None:
            counters = link.reader.counters
            self._closed_counts[0] += counters.damaged
            self._closed_counts[1] += counters.refused

    @property
    def links(self) -> list[Hashable]:
        """Names of the links there are."""
        return list(self._links)

    @property
    def damaged(self) -> int:
        """Frames with a bad checksum or none, on all links."""
        counts = (link.reader.counters.damaged for link in self._links.values())
        return self._closed_counts[0] + sum(counts)

    @property
    def unsigned(self) -> int:
        """Frames refused because they were not signed with our key, on all links."""
        counts = (link.reader.counters.refused for link in self._links.values())
        return self._closed_counts[1] + sum(counts)

    def take_output(self, name: Hashable) -> bytes:
        """Return the bytes to put on a link since the last call."""
        link = self._links.get(name)
        return link.take_output() if link is not None else b""

    def _link(self, name: Hashable) -> MavlinkLink | None:
        """Return a link, a new one if need be; None when there are too many."""
        link = self._links.get(name)
        if link is None and len(self._links) < _MAX_LINKS:
            self._opened += 1
            link = MavlinkLink(self._vehicle, self._opened, self._key, self._unix_time)
            link.heard_ns = self._vehicle.time_ns
            self._links[name] = link
        return link

    # Bytes in -----------------------------------------------------------------------------------
    def receive(self, data: bytes, name: Hashable) -> None:
        """Take any bytes from a link."""
        link = self._link(name)
        if link is not None:
            for message in link.feed(data):
                self._sort(message, name, link)

    def _sort(self, message: Any, name: Hashable, link: MavlinkLink) -> None:
        """Drop what is not for us; in lockstep hold what has its time."""
        if (message.get_srcSystem(), message.get_srcComponent()) == self._own:
            self.impostors += 1
            self._warn("impostor", f"Another sender uses our id {self._own[0]}.{self._own[1]}")
            return
        link.streaming = True
        link.heard_ns = self._vehicle.time_ns
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system not in (0, self._own[0]) or component not in (0, self._own[1]):
            self.foreign += 1
            return
        if is_setpoint(message):
            stamp = stamp_of(message)
            if self._lockstep and stamp > self._vehicle.time_ns + _FUTURE_NS:
                return  # of a time before a reset
            self.stamp_ns = max(self.stamp_ns, stamp)
            self._companion = name
            if self._lockstep:
                self._held.push(name, message)
                return
        elif name == self._companion and self._companion_takes_part and changes_state(message):
            self._held.push(name, message)
            return
        self._take(message, name, link)

    @property
    def _companion_takes_part(self) -> bool:
        return self._lockstep and self._vehicle.time_ns - self.stamp_ns <= _COMPANION_NS

    def release(self, *, standstill: bool = False) -> None:
        """Let act what has been held and whose time has come.

        Args:
            standstill: time stands still, so commands act now; setpoints wait for their time.
        """
        if not self._held:
            return
        if standstill:
            ready = self._held.commands()
        elif self._companion_takes_part:
            ready = self._held.due(self._vehicle.time_ns)
        else:
            ready = self._held.everything()
        for name, message in ready:
            link = self._links.get(name)
            if link is not None:
                self._take(message, name, link)

    def _take(self, message: Any, name: Hashable, link: MavlinkLink) -> None:
        taker = _TAKERS.get(message.get_type())
        if taker is not None:
            taker(self, message, name, link)

    # Bytes out ----------------------------------------------------------------------------------
    def tick(self) -> None:
        """Send what is due after a tick of control."""
        v = self._vehicle
        v.damaged = self.damaged
        unsigned = self.unsigned
        if unsigned > self._refused_told and self._warn(
            "unsigned", f"{unsigned} frames refused: bad signature"
        ):
            self._refused_told = unsigned
        self._send_texts()
        made: dict[int, Message] = {}
        for name, link in list(self._links.items()):
            for late in link.tick(self._count, made):
                self._sort(late, name, link)
            if not link.permanent and v.time_ns - link.heard_ns > _FORGET_NS:
                self.close_link(name)
        self._count += 1

    def _send_texts(self) -> None:
        """Tell every link what the flight logic has to say."""
        texts = self._vehicle.logic.texts
        for severity, text in texts:
            message = mavlink.MAVLink_statustext_message(severity, text[:_TEXT_SIZE].encode())
            for link in self._links.values():
                if link.streaming:
                    link.send(message)
        texts.clear()

    def _warn(self, topic: str, text: str) -> bool:
        """Say something about a trouble, not too often; return whether it was said."""
        now = self._vehicle.time_ns
        if now - self._told.get(topic, -_TEXT_PERIOD_NS) < _TEXT_PERIOD_NS:
            return False
        self._told[topic] = now
        self._vehicle.logic.texts.append((Severity.WARNING, text))
        return True

    # Messages -----------------------------------------------------------------------------------
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
        self._acknowledge(m, link, self._commands.handle(m.command, values, link))

    def _command_int(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        values = (m.param1, m.param2, m.param3, m.param4, float(m.x), float(m.y), m.z)
        self._acknowledge(m, link, self._commands.handle(m.command, values, link))

    def _acknowledge(self, m: Any, link: MavlinkLink, result: int) -> None:
        self._send_texts()  # why, before the bare result
        link.send(
            mavlink.MAVLink_command_ack_message(
                m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
            )
        )

    def _set_mode(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        self._commands.set_mode(m.base_mode, m.custom_mode)

    def _rc_override(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        fields = [getattr(m, f"chan{index}_raw") for index in range(1, 19)]
        self._vehicle.input.override(fields, 1e-9 * self._vehicle.time_ns)

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

    def _param_list(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.start_list()

    def _param_read(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.read_parameter(m.param_id, m.param_index)

    def _param_set(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        problem = link.set_parameter(m.param_id, m.param_value, m.param_type)
        if problem:
            self._warn("parameter", problem)

    def _mission_list(self, m: Any, name: Hashable, link: MavlinkLink) -> None:
        link.send(
            mavlink.MAVLink_mission_count_message(
                m.get_srcSystem(), m.get_srcComponent(), 0, m.mission_type
            )
        )


_TAKERS: dict[str, Callable[[MavlinkServer, Any, Hashable, MavlinkLink], None]] = {
    "SET_ATTITUDE_TARGET": MavlinkServer._setpoint,
    "SET_ACTUATOR_CONTROL_TARGET": MavlinkServer._setpoint,
    "COMMAND_LONG": MavlinkServer._command_long,
    "COMMAND_INT": MavlinkServer._command_int,
    "SET_MODE": MavlinkServer._set_mode,
    "RC_CHANNELS_OVERRIDE": MavlinkServer._rc_override,
    "TIMESYNC": MavlinkServer._timesync,
    "PING": MavlinkServer._ping,
    "PARAM_REQUEST_LIST": MavlinkServer._param_list,
    "PARAM_REQUEST_READ": MavlinkServer._param_read,
    "PARAM_SET": MavlinkServer._param_set,
    "MISSION_REQUEST_LIST": MavlinkServer._mission_list,
}
