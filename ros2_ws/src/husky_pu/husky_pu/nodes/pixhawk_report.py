"""What `pixhawk_bridge` says of itself on `/diagnostics`."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping

from husky_description.nodes import diagnostics
from husky_description.robot import LEGS
from husky_pu.companion_link import CompanionLink
from husky_pu.mavlink_client import MavlinkClient
from husky_pu.propulsion_bridge import Setpoints


class PixhawkReport:
    """Makes reports; rates and damage are since the report before.

    Attributes:
        connection: as the parameter says it.
    """

    def __init__(self, connection: str):
        """Begin to count."""
        self.connection = connection
        self._reported = (time.monotonic(), Counter[str](), 0, 0)
        self._projected = 0

    def make(
        self,
        link: CompanionLink,
        client: MavlinkClient,
        setpoints: Setpoints,
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
            "fans_lost": ", ".join(
                leg for leg, ok in zip(LEGS, telemetry.report.fan_ok, strict=True) if not ok
            ),
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
            "dropped_bytes": link.dropped,
            "problem": link.error,
        }
        for kind, count in sorted(received.items()):
            rate = (count - last_received[kind]) / max(now - last, 1e-3)
            values[f"rate {kind}"] = f"{rate:.1f}"
        conflict = client.conflict(now)
        if link.state != "connected":
            text = f"{link.state}: {link.error}" if link.error else link.state
            if not client.connected and counters.refused:
                text = f"{text}; {counters.refused} frames are not signed with our key"
            return diagnostics.ERROR, text, values
        if conflict:
            return diagnostics.ERROR, conflict, values
        if telemetry.report.failsafe:
            return diagnostics.ERROR, f"failsafe: {telemetry.report.failsafe}", values
        if client.signed and not client.config.signing_key:
            return diagnostics.WARN, "the autopilot signs and we have no key: it is deaf", values
        if setpoints.refused > last_refused:
            return diagnostics.WARN, f"thrust commands refused: {setpoints.refusal}", values
        if not all(telemetry.report.fan_ok):
            return diagnostics.ERROR, f"fan lost: {values['fans_lost']}", values
        if setpoints.projected > last_projected:
            return diagnostics.WARN, f"left out: {setpoints.projection}", values
        if damage > last_damage:
            return diagnostics.WARN, f"{damage - last_damage} messages damaged", values
        if battery.saturated:
            return diagnostics.WARN, "current of 327.67 A or more: its field is full", values
        return diagnostics.OK, link.state, values
