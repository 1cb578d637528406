"""Twelve simulated drives on an EtherCAT segment inside the process.

Implements `husky_drivers.ethercat.bus.Bus`, found as the bus "sim". On the wire's far side it takes
what the motors measured and says what the power stages do: `set_servo_state`, the master's
exchange, `servo_command`, once a tick in that order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.robot import Robot, load_robot
from husky_drivers.cia402 import COMMAND_OF_CONTROLWORD, NEXT_STATE, DriveState
from husky_drivers.ethercat import pdo
from husky_drivers.ethercat.bus import (
    GOLD_TWITTER,
    AlState,
    AlStatus,
    BusOptions,
    Emergency,
    Identity,
    SdoAbort,
)
from husky_sim.devices.drives import drive_cycle
from husky_sim.devices.drives.drive import SimulatedDrive
from husky_sim.devices.drives.drive_record import DRIVE

SERVO_COMMAND = np.dtype(
    [
        ("kind", "u1"),
        ("position", "f8"),
        ("velocity", "f8"),
        ("torque", "f8"),
        ("kp", "f8"),
        ("kd", "f8"),
        ("torque_limit", "f8"),
    ],
    align=True,
)
"""What one power stage does until the next tick; fields and units of husky_msgs/ServoCommand."""


class SimulatedSegment:
    """Twelve Gold Twitter drives, one per joint, in joint order along the wire.

    Attributes:
        drives: the slaves.
        command: records of `SERVO_COMMAND`, one per joint, as `servo_command` last left them.
    """

    def __init__(
        self,
        robot: Robot | None = None,
        options: BusOptions | None = None,
        *,
        tick: float = 0.002,
    ):
        """Power on.

        Args:
            robot: whose joints, motors and gears; Husky Carbon by default.
            options: none that count here.
            tick: time between two servo states and the drives' interpolation period [s].
        """
        robot = load_robot() if robot is None else robot
        if not tick > 0.0:
            raise ValueError(f"tick is {tick!r} s, it must be above 0")
        self._names = {name: i for i, name in enumerate(robot.joint_names)}
        count = len(self._names)
        self._tick = tick
        self._counts_per_radian = robot.encoder_counts_per_joint_turn / (2.0 * np.pi)
        self._torque_per_ampere = (
            robot.motor.torque_constant * robot.gear.ratio * robot.gear.efficiency
        )
        self._records = np.zeros(count, DRIVE)
        self.drives = tuple(
            SimulatedDrive(i, self._records[i : i + 1], robot.drive.peak_duration, tick)
            for i in range(count)
        )
        self._records["bus_voltage"] = robot.drive.bus_voltage
        self._records["watchdog"] = robot.drive.watchdog
        self._outputs = pdo.ProcessImage(pdo.RX, count)
        self._inputs = pdo.ProcessImage(pdo.TX, count)
        self._input_bytes = memoryview(self._inputs.data).toreadonly()
        self.command: NDArray[np.void] = np.zeros(count, SERVO_COMMAND)
        # compile the kernels, or load them, for the types of a tick, so that no tick waits
        still = np.zeros(count, np.int32)
        drive_cycle.advance(
            self._records, still, still, np.zeros(count), robot.drive.bus_voltage, 0.0
        )
        self.exchange(bytes(len(self._outputs.data)))
        self.servo_command()

    # -- far side: motors

    def set_servo_state(
        self, encoder_count: Any, velocity_count: Any, current: Any, bus_voltage: float
    ) -> None:
        """Let one tick pass and say what the motors did in it (husky_msgs/ServoState).

        Args:
            encoder_count: (12,) counts.
            velocity_count: (12,) counts/s.
            current: (12,) A.
            bus_voltage: V.
        """
        drive_cycle.advance(
            self._records, encoder_count, velocity_count, current, bus_voltage, self._tick
        )

    def servo_command(self) -> NDArray[np.void]:
        """What the power stages do until the next tick: `command`, brought up to date."""
        drive_cycle.power_stages(
            self._records, self._counts_per_radian, self._torque_per_ampere, self.command
        )
        return self.command

    # -- the process data of frames (`husky_sim.devices.ethercat`)

    @property
    def records(self) -> NDArray[np.void]:
        """Records of `drive_record.DRIVE`, which the drives and the kernels share."""
        return self._records

    @property
    def process_data(self) -> tuple[memoryview, memoryview]:
        """Outputs and inputs of all drives, drive after drive, writable."""
        return memoryview(self._outputs.data), memoryview(self._inputs.data)

    def put_inputs(self) -> int:
        """Bring the inputs up to date; return how many drives have an emergency message."""
        waiting: int = drive_cycle.put_inputs(self._records, self._inputs.fields)
        return waiting

    def take_outputs(self, reached: NDArray[np.uint8]) -> None:
        """Let drives in OP take the outputs that have reached them, 1 of (12,) each."""
        drive_cycle.take_outputs(
            self._records, self._outputs.fields, reached, NEXT_STATE, COMMAND_OF_CONTROLWORD
        )

    # -- faults

    def inject(self, joint: str, fault: str) -> None:
        """Make a drive fail (`drive.FAULTS`); raises ValueError for an unknown joint or fault."""
        self._drive(joint).inject(fault)
        self._find_away()

    def clear(self, joint: str | None = None) -> None:
        """End the injected faults of one drive or of all."""
        for drive in self.drives if joint is None else (self._drive(joint),):
            drive.clear()
        self._find_away()

    def _find_away(self) -> None:
        """Find the drives that frames do not reach: a line ends at a cut, and without power."""
        records = self._records
        ends = (records["unpowered"] != 0) | np.r_[False, records["cut"][:-1] != 0]
        records["away"] = (records["silent"] != 0) | np.logical_or.accumulate(ends)

    def _drive(self, joint: str) -> SimulatedDrive:
        if joint not in self._names:
            raise ValueError(f"no drive {joint!r}; there are {', '.join(self._names)}")
        return self.drives[self._names[joint]]

    # -- Bus

    @property
    def slave_count(self) -> int:
        """Number of drives."""
        return len(self.drives)

    @property
    def expected_working_counter(self) -> int:
        """Outputs count 2 and inputs 1 a drive."""
        return 3 * len(self.drives)

    def open(self) -> None:
        """Bring the drives to PREOP."""
        self.bring_to(AlState.INIT)
        self.bring_to(AlState.PREOP)

    def close(self, outputs: bytes | bytearray | memoryview = b"") -> None:
        """Pass last outputs on and bring the drives to INIT; torque goes."""
        self.exchange(outputs)
        self.bring_to(AlState.INIT)

    def identity(self, position: int) -> Identity:
        """All are Gold Twitters."""
        return GOLD_TWITTER

    def bring_to(self, state: AlState) -> None:
        """Ask all drives for an AL state, which they take at once or refuse."""
        for position in range(len(self.drives)):
            self.request_state(state, position)

    def request_state(self, state: AlState, position: int) -> None:
        """Ask a drive for an AL state; one that is off the bus does not hear it."""
        if not self._records[position]["away"]:
            self.drives[position].request_state(state)

    def take_back(self, position: int, set_up: Callable[[], object]) -> None:
        """Set a drive up from INIT to SAFEOP; raises OSError when it does not answer."""
        if self._records[position]["away"]:
            raise OSError(f"slave {position} does not answer at its place")
        for state in (AlState.INIT, AlState.PREOP):
            self.request_state(state, position)
        set_up()
        self.request_state(AlState.SAFEOP, position)

    def al_states(self) -> Sequence[AlStatus]:
        """AL status of every drive."""
        return [
            AlStatus(0, 0) if away else AlStatus(status, code)
            for away, status, code in zip(
                *(self._records[name].tolist() for name in ("away", "al_status", "al_status_code")),
                strict=True,
            )
        ]

    def set_watchdog(self, position: int, seconds: float) -> None:
        """Set a drive's process data watchdog, in steps of 100 us as the register has."""
        if not 1e-4 <= seconds <= 6.5535:
            raise ValueError(f"watchdog {seconds!r} s is outside [0.0001, 6.5535]")
        self._records[position]["watchdog"] = round(seconds * 1e4) * 1e-4

    def exchange(self, outputs: bytes | bytearray | memoryview) -> tuple[memoryview, int]:
        """Pass one frame through the drives; one of the wrong length reaches none of them."""
        if len(outputs) != len(self._outputs.data):
            return self._input_bytes, 0
        self._outputs.data[:] = outputs
        counter = drive_cycle.process_frame(
            self._records,
            self._outputs.fields,
            self._inputs.fields,
            NEXT_STATE,
            COMMAND_OF_CONTROLWORD,
        )
        return self._input_bytes, counter

    def sdo_read(self, position: int, index: int, subindex: int = 0) -> bytes:
        """Read an object of a drive; a drive off the bus times out."""
        self._check_answering(position, index, subindex)
        return self.drives[position].sdo_read(index, subindex)

    def sdo_write(self, position: int, index: int, subindex: int, data: bytes) -> None:
        """Write an object of a drive; a drive off the bus times out."""
        self._check_answering(position, index, subindex)
        self.drives[position].sdo_write(index, subindex, data)

    def emergencies(self) -> Sequence[Emergency]:
        """Emergency messages since the last call."""
        waiting = self._records["emergency"]
        if not waiting.any():
            return ()
        found = np.flatnonzero(waiting & (self._records["away"] == 0))
        waiting[found] = 0
        return [Emergency(int(i), int(self._records["error_code"][i])) for i in found]

    def _check_answering(self, position: int, index: int, subindex: int) -> None:
        if self._records["away"][position]:
            raise SdoAbort(0x05040000, position, index, subindex)

    def states(self) -> list[DriveState]:
        """CiA 402 states of the drives, for tests and displays on the far side."""
        return [DriveState(int(s)) for s in self._records["state"]]
