"""The flight controller's side of MAVLink 2: several links, of bytes and time alone.

A reply goes to the link that asked, streams go to every link that has spoken. What is addressed to
others is ignored; what claims to come from the flight controller itself is counted and ignored.

In lockstep a setpoint with stamp s acts in the first tick at or after s + 10 ms that is a multiple
of 10 ms, however early it came, and what changes the state (arming, modes, parameters) and stands
before it in the companion's stream acts with it. So a run does not depend on when bytes arrive.
A companion that has no setpoint for its time says so by SYSTEM_TIME.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.autopilot.mavlink_answers import MavlinkAnswers
from husky_pu.autopilot.mavlink_link import MavlinkLink, SignedAt
from husky_pu.autopilot.mavlink_peers import LinkTable, Trust
from husky_pu.autopilot.mavlink_setpoints import (
    SETPOINT_PERIOD_NS,
    HeldMessages,
    changes_state,
    is_setpoint,
    keeps_time,
    stamp_of,
)
from husky_pu.autopilot.state import Severity
from husky_pu.autopilot.telemetry import Message, Vehicle

_FUTURE_NS = 2 * SETPOINT_PERIOD_NS
"""A stamp further ahead than this is of a time before a reset [ns]."""
_COMPANION_NS = 100_000_000
"""So long after its last setpoint a link still counts as the companion's [ns]."""
_FORGET_NS = 10_000_000_000
"""Silence after which a link is dropped [ns]."""
_TEXT_PERIOD_NS = 1_000_000_000
"""Between two status texts about the same trouble [ns]."""
_TEXT_SIZE = 50


class MavlinkServer:
    """Speaks for a vehicle.

    Attributes:
        links: there are.
        stamp_ns: newest of the companion, of a setpoint good or bad [ns], -1 before the first.
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
        self._signed_at: SignedAt = {}
        self.links = LinkTable(self._make_link)
        self.impostors = self.foreign = 0
        self.restart(vehicle)

    def restart(self, vehicle: Vehicle) -> None:
        """The vehicle has started again; links stay, with their default streams."""
        self._vehicle = vehicle
        self._answers = MavlinkAnswers(vehicle, self._warn, self._send_texts, self._streaming)
        self.stamp_ns = -1
        self._companion: Hashable = None
        self._held = HeldMessages()
        self._told: dict[str, int] = {}
        self._refused_told = 0
        self._count = 0
        p = vehicle.parameters
        self._own = (int(p["MAV_SYS_ID"]), int(p["MAV_COMP_ID"]))
        for _, link in self.links:
            link.restart(vehicle)
        self.links.restart()

    # Links --------------------------------------------------------------------------------------
    def _make_link(self, number: int) -> MavlinkLink:
        return MavlinkLink(self._vehicle, number, self._key, self._unix_time, self._signed_at)

    def open_link(self, name: Hashable) -> None:
        """Stream to a link though nobody has spoken on it, for good."""
        link = self.links.get(name)
        if link is None:
            link = self.links.new()
            if not self.links.place(name, link, Trust.KEPT, self._vehicle.time_ns):
                return
        self.links.keep(name)
        link.streaming = link.permanent = True

    # Bytes in -----------------------------------------------------------------------------------
    def receive(self, data: bytes, name: Hashable) -> None:
        """Take any bytes from a link."""
        now = self._vehicle.time_ns
        link = self.links.get(name)
        if link is not None:
            messages = link.feed(data)
        else:
            link = self.links.new()
            messages = link.feed(data)
            good = any(self._is_from_other(message) for message in messages)
            trust = Trust.SPOKEN if good else Trust.SILENT
            if not self.links.place(name, link, trust, now, self._companion_link):
                return
        for message in messages:
            self._sort(message, name, link)

    @property
    def _companion_link(self) -> Hashable:
        """The link by which the setpoints come that are followed, None for none."""
        return self._vehicle.stream.link(1e-9 * self._vehicle.time_ns)

    def _is_from_other(self, message: Any) -> bool:
        return (message.get_srcSystem(), message.get_srcComponent()) != self._own

    def _sort(self, message: Any, name: Hashable, link: MavlinkLink) -> None:
        """Drop what is not for us; in lockstep hold what has its time."""
        if not self._is_from_other(message):
            self.impostors += 1
            self._warn("impostor", f"Another sender uses our id {self._own[0]}.{self._own[1]}")
            return
        link.streaming = True
        self.links.heard(name, self._vehicle.time_ns)
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system not in (0, self._own[0]) or component not in (0, self._own[1]):
            self.foreign += 1
            return
        waits = self._lockstep and name == self._companion and keeps_time(message)
        if waits or is_setpoint(message):
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
        self._answers.answer(message, name, link)

    @property
    def _companion_takes_part(self) -> bool:
        return self._lockstep and self._vehicle.time_ns - self.stamp_ns <= _COMPANION_NS

    def release(self, *, standstill: bool = False) -> None:
        """Let act what has been held and whose time has come.

        While time stands still commands act at once; setpoints wait for their time.
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
            link = self.links.get(name)
            if link is not None:
                self._answers.answer(message, name, link)

    # Bytes out ----------------------------------------------------------------------------------
    def send_due(self) -> None:
        """Send what is due after a tick of control."""
        v = self._vehicle
        v.damaged = self.links.damaged
        unsigned = self.links.refused
        if unsigned > self._refused_told and self._warn(
            "unsigned", f"{unsigned} frames refused: bad signature"
        ):
            self._refused_told = unsigned
        self._send_texts()
        made: dict[int, list[Message]] = {}
        for name, link in self.links:
            for late in link.send_due(self._count, made):
                self._sort(late, name, link)
            if not link.permanent and v.time_ns - link.heard_ns > _FORGET_NS:
                self.links.close(name)
        self._count += 1

    def _streaming(self) -> list[MavlinkLink]:
        return [link for _, link in self.links if link.streaming]

    def _send_texts(self) -> None:
        """Tell every link what the flight logic has to say."""
        texts = self._vehicle.logic.texts
        for severity, text in texts:
            message = mavlink.MAVLink_statustext_message(severity, text[:_TEXT_SIZE].encode())
            for link in self._streaming():
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
