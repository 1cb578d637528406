"""What each end of a wire has counted in a time, against what its ticks call for.

Two witnesses: the counters that nodes report on `/diagnostics`, and the stamps in the bag. A
message that a node says again, because it has waited for long, has the stamp of the first one and
counts once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from husky_description.actuation import BUS_SERVOS
from husky_description.robot import Robot
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

Reports = Mapping[str, Mapping[str, float]]
"""Numbers of `/diagnostics`, by node and key."""


@dataclass(frozen=True)
class Counter:
    """A number on `/diagnostics`."""

    node: str  # whose report it is in
    key: str  # in that report

    def between(self, before: Reports, after: Reports) -> int:
        """Return how far it has counted.

        Raises:
            LookupError: a report lacks it.
        """
        try:
            return round(after[self.node][self.key] - before[self.node][self.key])
        except KeyError:
            raise LookupError(f"{self.node} does not report {self.key}") from None


@dataclass(frozen=True)
class Wire:
    """A way of messages whose ends count them."""

    name: str  # of a topic, or of what goes over a line
    rate: float  # of the messages [Hz]; 0 for that of the sender
    sender: Counter | None  # counts what it sends; None where the ticks of the plant do
    receiver: Counter  # counts what it takes
    tolerance: int = 0  # messages that may be on their way at the begin or the end


@dataclass(frozen=True)
class GraphCounters:
    """Which numbers on `/diagnostics` tell of messages."""

    wires: tuple[Wire, ...]
    losses: tuple[Counter, ...]  # how often somebody was given up
    faults: tuple[Counter, ...]  # messages that were damaged, refused or dropped

    @property
    def nodes(self) -> frozenset[str]:
        """Nodes whose reports are needed."""
        ends = [end for wire in self.wires for end in (wire.sender, wire.receiver)]
        counters = (*self.losses, *self.faults, *ends)
        return frozenset(counter.node for counter in counters if counter is not None)


_TICKS = {graph.DRIVE_BRIDGE: graph.SERVO_STATE, graph.SERVO_BRIDGE: graph.CLOCK}
"""What the plant tells a bridge every tick."""
_CONTROLLER = Counter(graph.LOW_LEVEL_CONTROLLER, "ticks")
_COMPANION = Counter(graph.PIXHAWK_BRIDGE, "accepted_commands")
_FLIGHT_CONTROLLER = graph.FLIGHT_CONTROLLER
_WIRES = (
    Wire(graph.absolute(graph.FLIGHT_SENSORS), 500.0, None, Counter(_FLIGHT_CONTROLLER, "ticks")),
    # Devices and lines with clocks of their own: one message may be on its way.
    Wire("samples of the VN-200", 800.0, None, Counter(graph.VN200_DRIVER, "samples"), 1),
    Wire("frames of the T265", 200.0, None, Counter(graph.T265_DRIVER, "good"), 1),
    Wire(graph.absolute(graph.PROPULSION_COMMAND), 100.0, None, _COMPANION, 1),
    Wire("setpoints over MAVLink", 0.0, _COMPANION, Counter(_FLIGHT_CONTROLLER, "setpoints"), 1),
    Wire(
        "frames over SBUS",
        0.0,
        Counter(graph.RC_TRANSMITTER, "sent"),
        Counter(_FLIGHT_CONTROLLER, "sbus_frames"),
        1,
    ),
)
_LOSSES = (graph.PLANT, graph.LOW_LEVEL_CONTROLLER, graph.FLIGHT_CONTROLLER)
_FAULTS = {
    graph.LOW_LEVEL_CONTROLLER: "refused_commands",
    graph.VN200_DRIVER: "missed invalid crc_errors checksum_errors garbage_bytes",
    graph.T265_DRIVER: "missed invalid crc_errors garbage_bytes",
    graph.FLIGHT_CONTROLLER: "setpoints_refused setpoints_contested frames_damaged "
    "sbus_garbage_bytes serial_bytes_dropped",
    graph.PIXHAWK_BRIDGE: "refused_commands missing_messages damaged_frames dropped_bytes",
    graph.RC_TRANSMITTER: "dropped",
}
_BRIDGE_FAULTS = "short_cycles refused_commands"
MISSED_TICKS = Counter(graph.LOW_LEVEL_CONTROLLER, "missed_ticks")

_LOSSY = ("CONTROL", "CLOCK")
"""Qualities of service that are best effort: nobody waits for the recorder."""
LISTENER_LOSS = 1e-3
"""Share of such messages that the recorder may lose: its process has to stand still for a tenth of
a second before the queues of the middleware overflow, which a busy machine does at times."""


def counters_of(robot: Robot) -> GraphCounters:
    """Return what the graph of a robot with its propulsion counts."""
    bridge = graph.SERVO_BRIDGE if robot.actuation == BUS_SERVOS else graph.DRIVE_BRIDGE
    cycles = Counter(bridge, "cycles")
    return GraphCounters(
        wires=(
            Wire(graph.absolute(_TICKS[bridge]), 500.0, None, cycles),
            Wire(graph.absolute(graph.JOINT_STATES), 500.0, cycles, _CONTROLLER),
            *_WIRES,
        ),
        losses=tuple(Counter(node, "peer_losses") for node in (bridge, *_LOSSES)),
        faults=tuple(
            Counter(node, key)
            for node, keys in {bridge: _BRIDGE_FAULTS, **_FAULTS}.items()
            for key in keys.split()
        ),
    )


@dataclass(frozen=True)
class Count:
    """Messages of one way."""

    sent: int  # as counted by the sender, or as called for by its rate
    received: int  # as counted by the receiver
    tolerance: int  # by how many the two may differ

    @property
    def equal(self) -> bool:
        """Whether what was sent was received."""
        return abs(self.sent - self.received) <= self.tolerance


def count_on_wires(
    wires: Iterable[Wire], before: Reports, after: Reports, duration: float
) -> dict[str, Count]:
    """Compare the counters of both ends of wires, from report to report, some time later [s].

    Raises:
        LookupError: a report lacks a counter.
    """
    counts = {}
    for wire in wires:
        sent = round(wire.rate * duration)
        if wire.sender is not None:
            sent = wire.sender.between(before, after)
        counts[wire.name] = Count(sent, wire.receiver.between(before, after), wire.tolerance)
    return counts


def count_in_bag(recording: Recording, start: float, end: float) -> dict[str, Count]:
    """Compare the stamps in the bag with the rates of the topics, of those of 50 Hz and more.

    They are counted between two simulated times [s], the second one included.
    """
    counts = {}
    stamps = recording.stamps([topic.name for topic in graph.TOPICS if topic.rate >= 50.0])
    for name, times in stamps.items():
        # A thousandth of a tick: stamps are whole nanoseconds, times are not.
        inside = np.unique(times[(times > start + 2e-6) & (times <= end + 2e-6)])
        sent = round(graph.topic(name).rate * (end - start))
        tolerance = 1 + (round(LISTENER_LOSS * sent) if graph.topic(name).qos in _LOSSY else 0)
        counts[f"{name} in the bag"] = Count(sent, len(inside), tolerance)
    return counts
