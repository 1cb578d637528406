"""An EtherCAT segment on a network interface: SOEM as the master, through the package `pysoem`.

Registered as the bus "soem". Frames are sent and awaited without Python's global lock, so that
another thread may read and write objects at the same time (SOEM keeps frames apart by their index).
Slaves are configured by SOEM: station addresses, mailboxes, sync managers and FMMUs by what each
drive's objects 0x1C12 and 0x1C13 say, distributed clocks with SYNC0.
"""

from __future__ import annotations

import contextlib
import operator
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from husky_description.robot import Robot
from husky_drivers.ethercat import pdo
from husky_drivers.ethercat.bus import (
    AL_ERROR,
    TIMED_OUT,
    AlState,
    AlStatus,
    BusOptions,
    Emergency,
    Identity,
    SdoAbort,
)
from husky_drivers.ethercat.interface import (
    check_interface,
    claim_interface,
    flags_of,
    set_flags,
)
from husky_drivers.ethercat.patient_ear import PatientEar

_FRAME_TIMES = (0.002, 0.05)
"""Range of the time after which a frame of the set-up counts as lost [s]: SOEM's own, and what
simulated drives on a busy machine may take. A frame that is safe to repeat gets ten times that.
"""
_LONG_FRAME_TIME = 0.25
"""The same in lockstep [s]. SOEM has 16 indices of frames, so it takes an answer that comes 16
frames too late for that of another. That takes a stall of 4 s.
"""
_ATTEMPTS = 5
"""To access a register, or an object of a drive that answers."""
_CLOCK_LOOKS = 8
"""At two clocks, to find how far they are apart."""
_STATE_PATIENCE = 2.0
"""In which slaves reach a state that they are asked for [s] (SOEM's own: 2 s)."""
_STATE_POLL = 0.001
"""Between two looks at their states [s]."""
_AL_CONTROL, _AL_STATUS, _FMMUS, _SYNC_MANAGERS = 0x0120, 0x0130, 0x0600, 0x0800
_SYSTEM_TIME, _TIME_OFFSET, _TIME_DELAY = 0x0910, 0x0920, 0x0928
_MAILBOX_MANAGERS = 16
"""Bytes of the registers of sync managers 0 and 1; those of 2 and 3 follow."""
_GENERAL_ERROR = 0x08000000
_INPUT = operator.attrgetter("input")


class SoemBus:
    """Gold Twitter drives on a network interface; implements `husky_drivers.ethercat.bus.Bus`."""

    def __init__(self, robot: Robot, options: BusOptions):
        """Open nothing yet; the robot is the one whose joints the drives move."""
        self._options = options
        self._pysoem: Any = None
        self._master: Any = None
        self._slaves: Sequence[Any] = ()
        self._patience = round(options.patience * 1e6)  # [us]
        self._ear: PatientEar | None = None  # where drives answer when they can
        self._lock: socket.socket | None = None  # of the interface
        self._flags = 0  # of the interface, before SOEM has changed them
        self._registers: list[_Registers] = []  # of each slave as they were set up
        self._frame_time = 0  # after which a frame of the set-up counts as lost [us]
        self._has_clock = False
        self._clock = 0  # time that the last frame has brought from the first slave's clock [ns]
        self._inputs = bytes(pdo.TX.itemsize * len(robot.joint_names))
        self._emergencies: deque[Emergency] = deque()

    @property
    def slave_count(self) -> int:
        """Number of slaves that answered `open`."""
        return len(self._slaves)

    @property
    def expected_working_counter(self) -> int:
        """Outputs count 2 and inputs 1 a slave."""
        return 3 * len(self._slaves)

    def open(self) -> None:
        """Scan the segment and bring its slaves to PREOP; raises OSError when there is none."""
        self._let_go()
        interface = self._options.interface
        check_interface(interface, promiscuous=True)
        try:
            import pysoem
        except ImportError as error:
            raise OSError(
                f"bus soem needs the Python package pysoem, which cannot be imported ({error}): "
                "scripts/setup.sh installs it"
            ) from None
        self._pysoem = pysoem
        self._lock, self._flags = claim_interface(interface), flags_of(interface)
        least, most = _FRAME_TIMES
        frame_time = min(max(self._options.patience, least), most)
        if self._options.far_side is not None:
            self._ear = PatientEar(interface, self._options.far_side)
            frame_time = _LONG_FRAME_TIME
        self._frame_time = round(frame_time * 1e6)
        pysoem.settings.timeouts.ret = self._frame_time
        pysoem.settings.timeouts.safe = 10 * self._frame_time
        master = pysoem.Master()
        master.always_release_gil = True
        master.open(interface)
        if master.config_init() <= 0:
            master.close()
            self._let_go()
            raise OSError(
                f"no EtherCAT slave answers on {interface}: is it cabled, are the drives powered?"
            )
        self._master, self._slaves = master, master.slaves
        for slave in self._slaves:
            slave.add_emergency_callback(self._on_emergency)
        self._ask_all(AlState.PREOP)
        master.state_check(AlState.PREOP, round(_STATE_PATIENCE * 1e6))

    def close(self, outputs: bytes | bytearray | memoryview = b"") -> None:
        """Send last outputs, bring the slaves to INIT and close the interface."""
        if self._master is not None:
            if outputs:
                self._put_outputs(outputs)
                self._master.send_processdata()
            self._ask_all(AlState.INIT)
        self._let_go()

    def _let_go(self) -> None:
        if self._master is not None:
            self._master.close()
        if self._lock is not None:
            with contextlib.suppress(OSError):  # it may be gone
                set_flags(self._options.interface, self._flags)  # SOEM leaves it promiscuous
            self._lock.close()
        if self._ear is not None:
            self._ear.close()
        self._master, self._slaves, self._lock, self._ear = None, (), None, None
        self._clock = 0

    def identity(self, position: int) -> Identity:
        """Return the identity that stands in the slave's EEPROM."""
        slave = self._slaves[position]
        return Identity(slave.man, slave.id, slave.rev)

    # -- states

    def bring_to(self, state: AlState) -> None:
        """Bring all slaves to a state; raises OSError when their process data cannot be mapped."""
        if state is AlState.SAFEOP:
            self._map()
        elif state is AlState.OP:
            self.exchange(bytes(pdo.RX.itemsize * len(self._slaves)))  # outputs that are valid
        self._ask_all(state)
        end = time.monotonic() + _STATE_PATIENCE
        while self._master.read_state() != state and time.monotonic() < end:
            if state is AlState.OP:
                self.exchange(bytes(pdo.RX.itemsize * len(self._slaves)))
            time.sleep(_STATE_POLL)

    def _map(self) -> None:
        """Let SOEM set up sync managers, FMMUs and clocks; raises OSError."""
        try:
            self._master.config_map()
        except self._pysoem.ConfigMapError as error:
            told = ", ".join(_describe(each) for each in error.error_list)
            raise OSError(f"process data cannot be mapped: {told}") from None
        for i, slave in enumerate(self._slaves):
            sizes = (len(slave.output), len(slave.input))
            if sizes != (pdo.RX.itemsize, pdo.TX.itemsize):
                raise OSError(
                    f"slave {i} maps {sizes[0]} bytes of outputs and {sizes[1]} of inputs, "
                    f"expected are {pdo.RX.itemsize} and {pdo.TX.itemsize}"
                )
        self._check_image()
        self._has_clock = bool(self._master.config_dc())
        self._registers = [self._read_registers(i) for i in range(len(self._slaves))]
        for slave in self._slaves:
            self._start_sync(slave)

    def _check_image(self) -> None:
        """Check that what is written at the first slave's outputs is the outputs of all.

        SOEM has them one after the other in its process image ("sequential order"), and pysoem
        copies as many bytes as it gets. One copy takes a fifth of the time of twelve.
        """
        size = pdo.RX.itemsize
        expected = [bytes((i,)) * size for i in range(len(self._slaves))]
        self._put_outputs(b"".join(expected))
        found = [slave.output for slave in self._slaves]
        self._put_outputs(bytes(size * len(self._slaves)))
        if found != expected:
            raise OSError("this version of pysoem does not write the outputs of all slaves at once")

    def _start_sync(self, slave: Any) -> None:
        cycle = round(self._options.cycle * 1e9)
        slave.dc_sync(True, cycle, cycle // 2)

    def _ask_all(self, state: AlState) -> None:
        self._master.state = int(state)
        self._master.write_state()

    def request_state(self, state: AlState, position: int) -> None:
        """Ask a slave for a state, and acknowledge an error that stands."""
        slave = self._slaves[position]
        slave.state = state | AL_ERROR
        slave.write_state()

    def take_back(self, position: int, set_up: Callable[[], object]) -> None:
        """Bring a slave that has lost its configuration to SAFEOP, while frames go round.

        Its registers get what they had when it was set up. Another slave in its place is not taken:
        SOEM compares the identity in the EEPROM.
        """
        registers = self._registers[position]
        if self._slaves[position].recover(self._frame_time) <= 0:
            raise OSError(f"slave {position} does not answer at its place")
        managers = registers.sync_managers
        self._go(position, AlState.INIT)
        self._write(position, _SYNC_MANAGERS, managers[:_MAILBOX_MANAGERS])
        self._go(position, AlState.PREOP)
        set_up()
        self._write(position, _SYNC_MANAGERS + _MAILBOX_MANAGERS, managers[_MAILBOX_MANAGERS:])
        self._write(position, _FMMUS, registers.fmmus)
        self._set_clock(position, registers.delay)
        self._go(position, AlState.SAFEOP)

    def _go(self, position: int, state: AlState) -> None:
        """Bring a slave to a state; raises OSError, which says where it is instead."""
        self._write(position, _AL_CONTROL, struct.pack("<H", state | AL_ERROR))
        end = time.monotonic() + _STATE_PATIENCE
        while True:
            status, code = struct.unpack("<HxxH", self._read(position, _AL_STATUS, 6))
            if status == state:
                return
            if status & AL_ERROR or time.monotonic() > end:
                al = AlStatus(status, code)
                raise OSError(f"slave {position}: in {al.state}, not {state.name} ({al.reason})")
            time.sleep(_STATE_POLL)

    def _read_registers(self, position: int) -> _Registers:
        return _Registers(
            self._read(position, _SYNC_MANAGERS, 2 * _MAILBOX_MANAGERS),
            self._read(position, _FMMUS, 64),
            self._read(position, _TIME_DELAY, 4),
        )

    def _set_clock(self, position: int, delay: bytes) -> None:
        """Let a slave's clock show the time of the others, and start its SYNC0."""
        self._write(position, _TIME_OFFSET, bytes(8))
        try:
            offset = self._time_behind(position, 0 if position else 1)
        except (IndexError, OSError):  # no other has kept its time
            offset = self._clock - self._read_time(position)
        self._write(position, _TIME_OFFSET, struct.pack("<q", offset))
        self._write(position, _TIME_DELAY, delay)
        self._start_sync(self._slaves[position])

    def _time_behind(self, position: int, reference: int) -> int:
        """Return by how much a slave's time is behind that of another [ns].

        Each is read in a frame of its own, so the best of some looks counts: the one in which the
        reference has moved on least.
        """
        looks = []
        for _ in range(_CLOCK_LOOKS):
            before, time = self._read_time(reference), self._read_time(position)
            after = self._read_time(reference)
            looks.append((after - before, (before + after) // 2 - time))
        return min(looks)[1]

    def _read_time(self, position: int) -> int:
        return int.from_bytes(self._read(position, _SYSTEM_TIME, 8), "little")

    def _read(self, position: int, address: int, size: int) -> bytes:
        """Read registers of a slave; raises OSError."""
        slave = self._slaves[position]
        data: bytes = self._attempt(position, lambda: slave._fprd(address, size, self._frame_time))
        return data

    def _write(self, position: int, address: int, data: bytes) -> None:
        """Write registers of a slave; raises OSError."""
        slave = self._slaves[position]
        self._attempt(position, lambda: slave._fpwr(address, data, self._frame_time))

    def _attempt(self, position: int, access: Callable[[], Any]) -> Any:
        """Return what an access to registers returns, asked again when an answer is lost."""
        for _ in range(_ATTEMPTS):
            try:
                return access()
            except self._pysoem.WkcError:
                continue
        raise OSError(f"slave {position} does not answer")

    def al_states(self) -> Sequence[AlStatus]:
        """Read the AL status of every slave: one datagram when all are alike."""
        self._master.read_state()
        return [
            AlStatus(slave.state, slave.al_status if slave.state & AL_ERROR else 0)
            for slave in self._slaves
        ]

    def set_watchdog(self, position: int, seconds: float) -> None:
        """Set a slave's process data watchdog, in steps of 100 us; raises OSError."""
        slave = self._slaves[position]  # of which pysoem waits for 4 ms, whatever its time-outs are
        self._attempt(position, lambda: slave.set_watchdog("processdata", round(seconds * 1e3, 1)))

    # -- process data

    def exchange(self, outputs: bytes | bytearray | memoryview) -> tuple[memoryview, int]:
        """Send one frame with the outputs of all slaves and await it for the frame time-out.

        Simulated drives in lockstep may take longer. A complete answer whose clock has not moved on
        since the one before counts as lost: SOEM does not look how long a frame is, and has the
        bytes of the last one behind a short one.
        """
        self._put_outputs(outputs)
        master = self._master
        if self._ear is not None:
            self._ear.forget()
        master.send_processdata()
        awaited = self._ear is None or self._ear.wait()
        counter: int = master.receive_processdata(self._patience if awaited else 0)
        if counter <= 0:
            return memoryview(self._inputs), 0
        if counter == self.expected_working_counter and self._has_clock:
            clock = master.dc_time
            if clock <= self._clock:
                return memoryview(self._inputs), 0
            self._clock = clock
        self._inputs = b"".join(map(_INPUT, self._slaves))
        return memoryview(self._inputs), counter

    def _put_outputs(self, outputs: bytes | bytearray | memoryview) -> None:
        mapped = pdo.RX.itemsize * len(self._slaves)
        if len(outputs) != mapped:
            raise ValueError(f"{len(outputs)} bytes of outputs for slaves that take {mapped}")
        self._slaves[0].output = bytes(outputs)  # of all: see `_check_image`

    # -- mailbox

    def sdo_read(self, position: int, index: int, subindex: int = 0) -> bytes:
        """Read an object; blocks for some frames."""
        slave = self._slaves[position]
        data: bytes = self._access(
            lambda: slave.sdo_read(index, subindex), position, index, subindex
        )
        return data

    def sdo_write(self, position: int, index: int, subindex: int, data: bytes) -> None:
        """Write an object; blocks for some frames."""
        slave = self._slaves[position]
        self._access(lambda: slave.sdo_write(index, subindex, data), position, index, subindex)

    def _access(self, access: Callable[[], Any], position: int, index: int, subindex: int) -> Any:
        """Return what an access to an object returns, tried again when its frames are lost.

        A drive that refuses, or does not answer for its registers either, is not asked again.
        """
        soem = self._pysoem
        code = TIMED_OUT
        for _ in range(_ATTEMPTS):
            try:
                return access()
            except soem.SdoError as error:
                code = error.abort_code
                break
            except soem.WkcError:
                code = TIMED_OUT
            except (soem.MailboxError, soem.PacketError, AssertionError):
                code = _GENERAL_ERROR  # the late answer to another access, of any slave
            try:
                self._read(position, _AL_STATUS, 2)
            except OSError:
                break
        raise SdoAbort(code & 0xFFFFFFFF, position, index, subindex)

    def _on_emergency(self, emergency: Any) -> None:
        self._emergencies.append(Emergency(emergency.slave_pos - 1, emergency.error_code))

    def emergencies(self) -> Sequence[Emergency]:
        """Emergency messages that came with what was read of mailboxes since the last call."""
        found = []
        while self._emergencies:
            found.append(self._emergencies.popleft())
        return found


def _describe(error: Any) -> str:
    """Return what an error of pysoem says, with the slave by its place from 0."""
    what = getattr(error, "desc", "") or getattr(error, "error_code", "")
    return f"slave {error.slave_pos - 1}: {type(error).__name__} {what}"


class _Registers(NamedTuple):
    """Registers of a slave that are set up, and lost when its power is."""

    sync_managers: bytes
    fmmus: bytes
    delay: bytes
