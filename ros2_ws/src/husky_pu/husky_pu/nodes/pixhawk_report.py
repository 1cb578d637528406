"""What `pixhawk_bridge` says of itself on `/diagnostics`."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from husky_pu.autopilot.fan_watch import name_lost
from husky_pu.companion.bridge import ThrustSetpoints
from husky_pu.companion.client import MavlinkClient
from husky_pu.companion.link import CompanionLink
from husky_runtime.nodes import diagnostics


class PixhawkReport:
    """Makes reports of a `connection` and `fans`; rates and damage are since the report before."""

    def __init__(self, connection: str, fans: Sequence[str]):
        """Begin to count; `fans` are their names."""
        self.connection = connection
        self.fans = fans
        self._reported = (time.monotonic(), Counter[str](), 0, 0)
        self._projected = 0

    def make(
        self,
        link: CompanionLink,
        client: MavlinkClient,
        setpoints: ThrustSetpoints,
        more: Mapping[str, object],
    ) -> diagnostics.Report:
        """Return level, message and values, `more` among them."""
        now = time.monotonic()
        last, last_received, last_refused, last_damage = self._reported
        counters, telemetry = client.reader.counters, client.telemetry
        received = client.received.copy()
        damage = counters.damaged + counters.refused + telemetry.invalid
        self._reported = (now, received, setpoints.refused, damage)
        last_projected, self._projected = self._projected, setpoints.projected
        battery = telemetry.report.battery
        values: dict[str, object] = {
            "state": link.state,
            "connection": self.connection,
            "target": "{}.{}".format(*client.target),
            "mode": telemetry.report.mode,
            "armed": telemetry.report.armed,
            "failsafe": telemetry.report.failsafe,
            "reason": telemetry.report.reason,
            **more,
            "accepted_commands": setpoints.accepted,
            "refused_commands": setpoints.refused,
            "refusal": setpoints.refusal,
            "projected_commands": setpoints.projected,
            "fans_lost": name_lost(self.fans, telemetry.report.fan_ok),
            "current": "327.67 A or more" if battery.saturated else f"{battery.current:.1f} A",
            "connections": client.connections,
            "losses": client.losses,
            "port_openings": link.connections,
            "missing_messages": client.missing,
            "foreign_messages": client.foreign,
            "unknown_messages": counters.unknown,
            "damaged_frames": counters.damaged,
            "refused_frames": counters.refused,
            "garbage_bytes": counters.garbage_bytes,
            "not_finite": telemetry.invalid,
            "autopilot_restarts": telemetry.boots,
            "rejected_intervals": client.rejected_intervals,
            "unsafe_parameters": "; ".join(client.settings.problems(unsafe=True)),
            "other_parameters": "; ".join(client.settings.problems(unsafe=False)),
            "unread_parameters": ", ".join(client.settings.unread),
            "dropped_bytes": link.dropped,
            "problem": link.error,
        }
        for kind, count in sorted(received.items()):
            rate = (count - last_received[kind]) / max(now - last, 1e-3)
            values[f"rate {kind}"] = f"{rate:.1f}"
        since = _Since(
            setpoints.refused - last_refused,
            setpoints.projected - last_projected,
            damage - last_damage,
        )
        lost = str(values["fans_lost"])
        return *_judge(link, client, setpoints, since, lost), values


class _Since(NamedTuple):
    """What has been counted since the report before."""

    refused: int
    projected: int
    damaged: int


def _judge(
    link: CompanionLink,
    client: MavlinkClient,
    setpoints: ThrustSetpoints,
    since: _Since,
    lost: str,
) -> tuple[bytes, str]:
    """Return level and message: the worst there is to say; `lost` are fans by name."""
    error, warn = diagnostics.ERROR, diagnostics.WARN
    report, refused = client.telemetry.report, client.reader.counters.refused
    if link.state != "connected":
        text = f"{link.state}: {link.error}" if link.error else link.state
        if not client.connected and refused:
            text = f"{text}; {refused} frames are not signed with our key"
        return error, text
    if conflict := client.conflict(time.monotonic()):
        return error, conflict
    if report.failsafe:
        return error, f"failsafe: {report.failsafe}"
    if unsafe := client.settings.problems(unsafe=True):
        return error, f"not to be armed: {'; '.join(unsafe)}"
    if client.signed and not client.config.signing_key:
        return warn, "the autopilot signs and we have no key: it is deaf"
    if since.refused > 0:
        return warn, f"thrust commands refused: {setpoints.refusal}"
    if lost:
        return error, f"fan lost: {lost}"
    if wrong := client.settings.problems(unsafe=False):
        return warn, f"parameters: {'; '.join(wrong)}"
    if since.projected > 0:
        return warn, f"left out: {setpoints.projection}"
    if since.damaged > 0:
        return warn, f"{since.damaged} messages damaged"
    if report.battery.saturated:
        return warn, "current of 327.67 A or more: its field is full"
    return diagnostics.OK, link.state
