"""What a bridge tells of its joints' devices: status messages and diagnostics."""

from __future__ import annotations

from husky_drivers.joint_master.commanded_master import CommandedMaster
from husky_drivers.joint_master.phase import Phase
from husky_msgs.msg import DriveStatus, DriveStatusArray
from husky_runtime.lockstep import Peer, Presence
from husky_runtime.nodes import diagnostics, stamps


def joint_status(
    master: CommandedMaster, time_ns: int, *, active: bool, restarts: int
) -> DriveStatusArray:
    """Return the status of all devices.

    Args:
        master: of the devices.
        time_ns: stamp [ns].
        active: the node is.
        restarts: how often time has gone back.
    """
    status = DriveStatusArray(
        restarts=restarts,
        active=active,
        operational=master.phase is Phase.ENABLED,
        emergency_stop=master.emergency_stopped,
        working_counter=master.working_counter,
        expected_working_counter=master.expected_working_counter,
        short_cycles=master.short_cycles,
        refused_commands=master.refused_commands,
        reason=master.reason,
        drives=[
            DriveStatus(**{**vars(axis), "state": axis.state.title}) for axis in master.status()
        ],
    )
    stamps.fill(status.stamp, time_ns)
    return status


class JointReport:
    """Diagnostics of a bridge; a wire that stands still is told as such."""

    def __init__(self, master: CommandedMaster, controller: Peer):
        """Nothing has been reported."""
        self._master, self._controller = master, controller
        self._ticks = 0

    def make(self, ticks: int) -> diagnostics.Report:
        """Return level, message and values after so many ticks since the start."""
        master, controller = self._master, self._controller
        level, message = diagnostics.OK, master.phase.value
        if master.reason and master.phase is not Phase.ENABLED:
            message = f"{message}: {master.reason}"
        stands, self._ticks = ticks == self._ticks, ticks
        if stands:
            level, message = diagnostics.WARN, f"no cycle since the last report ({message})"
        faulty = {axis.joint: axis.error for axis in master.status() if axis.error}
        if controller.presence is Presence.LOST:
            level, message = diagnostics.ERROR, f"{controller.name} is lost"
        elif faulty or master.emergency_stopped or not master.is_connected:
            level = diagnostics.ERROR
            unsaid = [f"{joint}: {why}" for joint, why in faulty.items() if joint not in message]
            message = "; ".join([message, *unsaid])
        values = {
            "cycles": ticks,
            "working_counter": master.working_counter,
            "short_cycles": master.short_cycles,
            "refused_commands": master.refused_commands,
            "peer_losses": controller.losses,
            **master.counters(),
        }
        return level, message, values
