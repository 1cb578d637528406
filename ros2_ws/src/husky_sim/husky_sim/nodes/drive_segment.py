"""Node `drive_segment`: the simulated drives at the end of an EtherCAT cable.

It answers the frames of a master on a network interface: of `drive_bridge` with the bus "soem", or
of any other. In lockstep the frame of tick k waits until the motors of tick k have been told, and
the plant waits until `drive_bridge` has told the joints that this frame has brought; a bridge that
falls silent is given up, and the drives' watchdogs act. In realtime a frame is answered when it
comes, and the plant with it.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from husky_description.actuation import DRIVES
from husky_msgs.msg import CycleEnd
from husky_runtime import graph
from husky_runtime.lockstep import Presence
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.presence import make_peer
from husky_runtime.nodes.run import run
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.cable import TARGET, Cable
from husky_sim.devices.ethercat.raw_port import RawPort
from husky_sim.devices.ethercat.tick_frames import TickFrames
from husky_sim.devices.ethercat.wired_segment import WiredSegment
from husky_sim.nodes.drive_pacer import PlantPacer


class DriveSegment(OneClock, Node):
    """Twelve drives behind a raw socket; implements `husky_drivers.nodes.pacer.BridgeCycle`.

    Frames come in a thread of their own, the motors by messages; a lock keeps them apart.
    """

    def __init__(self) -> None:
        """Declare parameters, power the drives on, open the port."""
        super().__init__(graph.DRIVE_SEGMENT)
        robot = declare_robot(self, DRIVES)
        paces = ("lockstep", "realtime")
        what = "lockstep: a frame waits for the motors of its tick; realtime: it does not"
        self.lockstep = declare(self, "time", "lockstep", what, allowed=paces) == "lockstep"
        what = "wall time a silent master is waited for [s]"
        grace = declare(self, "grace", 1.0, what, 0.2, 60.0)
        interface = declare(self, "interface", "ecat1", "network interface with the master's cable")
        what = "drift of each drive's clock, one after the other more by as much [ppm]"
        drift = declare(self, "clock_drift", 0.0, what, -100.0, 100.0)
        self.imu_stamp_ns = 0
        self._tick_ns = -1
        self._ticks = self._time = 0
        self._ended_ns = -1  # the last tick whose joints have been told
        self._master = make_peer(self, graph.DRIVE_BRIDGE, grace)
        self._lock = threading.RLock()  # of the drives
        self._drives = SimulatedSegment(robot)
        drifts = [drift * i for i in range(self._drives.slave_count)]
        wired = WiredSegment(self._drives, self._time_ns, drifts)
        self._cable = Cable(wired)
        self._frames = TickFrames(wired, self._cable, lockstep=self.lockstep)
        self._pacer = PlantPacer(self, self, self)
        ends = self.create_subscription(CycleEnd, graph.CYCLE_END, self._on_cycle_end, qos.CONTROL)
        self.hot = [*self._pacer.hot, ends]
        self._port = RawPort(interface, self._on_frame)
        self._diagnostics = diagnostics.Diagnostics(self, "EtherCAT drives", self._report)

    def _time_ns(self) -> int:
        """Return the time of the drives' clocks [ns]: each frame finds them later than the last.

        A reset of the world does not touch them.
        """
        self._time = max(self._time + 1, self._ticks * graph.TICK_PERIOD_NS)
        return self._time

    # Frames: in the port's thread -----------------------------------------------------------
    def _on_frame(self, frame: bytearray) -> Sequence[bytearray]:
        """Answer a frame now, or hold it until its tick begins; return the answers."""
        with self._lock:
            answers = self._frames.come(frame)
            if not self.lockstep and self._frames.open and not self._frames.awaited:
                self._tell_plant()
            return answers

    # Drives as the plant sees them: `husky_sim.nodes.drive_pacer.PlantSide` -----------------
    def set_servo_state(
        self, encoder_count: Any, velocity_count: Any, current: Any, bus_voltage: float
    ) -> None:
        """Let one tick pass and say what the motors did in it."""
        with self._lock:
            self._drives.set_servo_state(encoder_count, velocity_count, current, bus_voltage)

    def servo_command(self) -> NDArray[np.void]:
        """Return what the power stages do until the next tick."""
        with self._lock:
            return self._drives.servo_command()

    def inject(self, joint: str, fault: str) -> None:
        """Make a drive fail, or the cable that stands in a joint's place; raises ValueError."""
        with self._lock:
            if joint == TARGET:
                self._cable.inject(fault)
            else:
                self._drives.inject(joint, fault)

    def clear(self, joint: str | None = None) -> None:
        """End the injected faults of one drive, of the cable or of all; raises ValueError."""
        with self._lock:
            if joint in (TARGET, None):
                self._cable.clear()
            if joint != TARGET:
                self._drives.clear(joint)

    # The tick -------------------------------------------------------------------------------
    def begin(self, time_ns: int, renewed: bool = False) -> bool:
        """Begin a tick, whose motors have been told; return whether it has had its frame."""
        with self._lock:
            if self._frames.open:
                self._tell_plant()  # no frame came: the drives' watchdogs act
            self._tick_ns = time_ns
            self._ticks += 1
            self._send(self._frames.begin())
            if self.lockstep and self._master.ready(time_ns):
                self._tell_plant()
            return not self._frames.open

    def _send(self, answers: Sequence[bytearray]) -> None:
        for answer in answers:
            self._port.send(answer)

    def _on_cycle_end(self, end: CycleEnd) -> None:
        """The bridge has told the joints of a tick."""
        stamp = stamps.to_ns(end.stamp)
        with self._lock:
            if stamp > self._tick_ns:
                return  # of a time before a reset
            self.imu_stamp_ns = stamps.to_ns(end.imu_stamp)
            self._master.answer(stamp)
            told_again, self._ended_ns = stamp <= self._ended_ns, max(stamp, self._ended_ns)
            if not self.lockstep or told_again:
                return
            if stamp < self._tick_ns:
                self._send(self._frames.await_another())  # what has come was of that earlier tick
            elif self._frames.open:
                self._tell_plant()

    def _tell_plant(self) -> None:
        self._frames.end()
        self._pacer.cycle_ended(self._tick_ns)

    def tell_again(self) -> None:
        """The plant waits; the pacer tells it the last word again."""

    def restart(self, reason: str) -> None:
        """Time starts again: nobody has answered for it."""
        with self._lock:
            self._frames.end()
            self._ended_ns = -1
            self._master.restart()

    def quiet(self) -> None:
        """Go on without a silent master."""
        with self._lock:
            if not self._frames.open or not self.lockstep:
                return
            if self._master.expire(time.monotonic()):
                self.get_logger().warning(f"{self._master.name} is silent: going on without it")
            if self._master.ready(self._tick_ns):
                self._tell_plant()

    def _report(self) -> diagnostics.Report:
        with self._lock:
            states = [al.state for al in self._drives.al_states()]
        lost = self._master.presence is Presence.LOST
        level = diagnostics.ERROR if lost else diagnostics.OK
        message = f"{self._master.name} is lost" if lost else "answering"
        return (
            level,
            message,
            {
                "frames": self._frames.passed,
                "al_states": " ".join(states),
                "master_losses": self._master.losses,
            },
        )

    def close(self) -> None:
        """Power the drives off and close the port."""
        self._port.close()
        self._drives.close()
        self._tell_plant()


def main() -> int:
    """Run the node."""
    return run(DriveSegment)


if __name__ == "__main__":
    sys.exit(main())
