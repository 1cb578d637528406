"""EtherCAT slave controller of one simulated drive (ETG.1000.4, .6): registers and process memory.

The registers are those that a master uses to find, configure and watch a drive; the rest of the
register space can be written without effect and reads 0. Behind the memory stand the drive (AL
states), its mailbox and its process data.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from husky_drivers.ethercat.bus import AL_ERROR, GOLD_TWITTER, AlState
from husky_sim.devices.drives.drive import INVALID_INPUTS, INVALID_OUTPUTS, SimulatedDrive
from husky_sim.devices.ethercat.clocks import Clocks
from husky_sim.devices.ethercat.mailbox import CoeServer
from husky_sim.devices.ethercat.sii import eeprom_image

REGISTERS, MEMORY = 0x1000, 0x3000
"""End of the registers and of the memory."""
STATION, ALIAS = 0x0010, 0x0012
USE_ALIAS = 0x0103
DL_STATUS = 0x0110
AL_CONTROL, AL_STATUS, AL_STATUS_CODE = 0x0120, 0x0130, 0x0134
WATCHDOG_DIVIDER, WATCHDOG_TIME, WATCHDOG_STATUS, WATCHDOG_COUNT = 0x0400, 0x0420, 0x0440, 0x0442
EEPROM, EEPROM_CONTROL, EEPROM_ADDRESS, EEPROM_DATA = 0x0500, 0x0502, 0x0504, 0x0508
FMMUS, SYNC_MANAGERS = 0x0600, 0x0800
OUTPUTS_CLOSED, INPUTS_CLOSED = SYNC_MANAGERS + 8 * 2 + 7, SYNC_MANAGERS + 8 * 3 + 7
RECEIVE_TIMES, RECEIVE_TIME_64, SYSTEM_TIME = 0x0900, 0x0918, 0x0910
TIME_OFFSET, TIME_DELAY, TIME_DIFFERENCE, SPEED_START = 0x0920, 0x0928, 0x092C, 0x0930
UNITS = 4
"""FMMUs, and sync managers."""

UNKNOWN_STATE, NO_BOOT, INVALID_MAILBOX, WATCHDOG_EXPIRED = 0x0012, 0x0013, 0x0016, 0x001B
_BOOT = 3
_INIT, _PREOP, _SAFEOP, _OP = (int(state) for state in AlState)
_SHORTEST_MAILBOX = 34
_FULL, _REPEAT = 0x08, 0x02
_OUTPUT_KIND, _INPUT_KIND, _REQUEST_KIND, _REPLY_KIND = 0x04, 0x00, 0x06, 0x02

_DESCRIPTION = struct.pack("<BBHBBBBH", 0x11, 0, 2, UNITS, UNITS, 8, 0x0F, 0x000D)
"""An ET1100 (assumed) with 8 KiB, two ports, byte-wise FMMUs, 64-bit distributed clock."""
_WRITABLE = (
    (STATION, 2),
    (0x0100, 4),
    (AL_CONTROL, 2),
    (0x0200, 2),
    (WATCHDOG_DIVIDER, 2),
    (0x0410, 2),
    (WATCHDOG_TIME, 2),
    (EEPROM, 1),
    (EEPROM_CONTROL, 14),
    (FMMUS, 16 * UNITS),
    *((SYNC_MANAGERS + 8 * unit, 5) for unit in range(UNITS)),
    *((SYNC_MANAGERS + 8 * unit + 6, 1) for unit in range(UNITS)),
    (TIME_OFFSET, 12),
    (SPEED_START, 2),
    (0x0934, 2),
    (0x0980, 2),
    (0x0990, 8),
    (0x09A0, 8),
)
"""Registers that a master can write: address and bytes."""
_WORD = struct.Struct("<H")


class SyncManager(NamedTuple):
    """A guarded area of the memory.

    Attributes:
        start, end: its addresses.
        control: its control register.
        active: whether it is switched on.
    """

    start: int
    end: int
    control: int
    active: bool

    @property
    def kind(self) -> int:
        """Direction and mode."""
        return self.control & 0x0F

    @property
    def watched(self) -> bool:
        """True if writing it feeds the process data watchdog."""
        return bool(self.control & 0x40)

    @property
    def written(self) -> bool:
        """True if the master writes it."""
        return bool(self.control & 0x04)

    @property
    def mailbox(self) -> bool:
        """True for a mailbox, False for a buffer."""
        return bool(self.control & 0x02)


class Fmmu(NamedTuple):
    """A stretch of logical addresses that stands for memory."""

    logical: int
    length: int
    physical: int
    reads: bool
    writes: bool


@dataclass(frozen=True)
class ProcessData:
    """Process data of one drive in the images of its segment.

    Attributes:
        outputs, inputs: their bytes.
        put_inputs: brings the inputs up to date.
        take_outputs: lets the drive take the outputs.
    """

    outputs: memoryview
    inputs: memoryview
    put_inputs: Callable[[], object]
    take_outputs: Callable[[], None]


class SlaveController:
    """Registers and memory of one drive on the wire.

    Attributes:
        position: place in the line from 0.
        memory: registers and process memory; registers that change by themselves are brought up to
            date when they are read.
        mailbox: server behind the mailboxes.
        fmmus: those that are active.
        managers: the sync managers.
        outputs_at, inputs_at: addresses of the process data while its sync managers fit it.
    """

    def __init__(
        self,
        place: tuple[int, int],
        drive: SimulatedDrive,
        process_data: ProcessData,
        clocks: Clocks,
        on_change: Callable[[], None],
    ):
        """Power on: registers as after a reset; the drive is as it is.

        Args:
            place: position in the line from 0, and number of slaves.
            drive: behind the controller.
            process_data: of the drive.
            clocks: of the whole line.
            on_change: called when addresses may reach something else.
        """
        self.position, self._count = place
        self._drive, self._process_data = drive, process_data
        self._clocks, self._on_change = clocks, on_change
        self._eeprom = eeprom_image(GOLD_TWITTER, self.position + 1)
        self._writable = bytearray(REGISTERS)
        for start, length in _WRITABLE:
            self._writable[start : start + length] = bytes((1,)) * length
        self.mailbox = CoeServer(drive)
        self.memory = bytearray(MEMORY)
        self._effects = (
            (STATION, 2, self._set_station),
            (0x0100, 4, self._set_station),
            (AL_CONTROL, 1, self._request_state),
            (WATCHDOG_DIVIDER, 2, self._set_watchdog),
            (WATCHDOG_TIME, 2, self._set_watchdog),
            (WATCHDOG_COUNT, 2, self._clear_expirations),
            (EEPROM_CONTROL + 1, 1, self._access_eeprom),
            (FMMUS, 16 * UNITS, self._set_fmmus),
            (SYNC_MANAGERS, 8 * UNITS, self._set_managers),
            (RECEIVE_TIMES, 4, self._latch_times),
            (TIME_OFFSET, 12, self._set_time),
            (SPEED_START, 2, self._restart_clock),
        )
        self._readings = (
            (AL_STATUS, 6, self._show_state),
            (WATCHDOG_STATUS, 3, self._show_watchdog),
            (SYNC_MANAGERS, 8 * UNITS, self.serve_mailbox),
            (OUTPUTS_CLOSED, 9, self._show_buffers),
            (SYSTEM_TIME, 8, self._show_time),
            (TIME_DIFFERENCE, 4, self._show_difference),
        )
        self._power_on()

    def notice_start(self) -> None:
        """Start as the drive has done, if it has: the clock from 0, too."""
        if self._starts != self._drive.starts:
            self._clocks.restart(self.position)
            self._power_on()

    def _power_on(self) -> None:
        """Have everything as after power on; what is in the EEPROM stays."""
        self._starts = self._drive.starts
        self.mailbox.reset()
        self.managers = [SyncManager(0, 0, 0, False)] * UNITS
        self.fmmus: list[Fmmu] = []
        self.outputs_at: tuple[int, int] | None = None
        self.inputs_at: tuple[int, int] | None = None
        self._filling = False
        self._last_reply = b""
        self._expired, self._expirations = False, 0
        self._station = 0
        memory = self.memory
        memory[:] = bytes(MEMORY)
        memory[: len(_DESCRIPTION)] = _DESCRIPTION
        memory[ALIAS : ALIAS + 2] = self._eeprom[8:10]
        last = self.position == self._count - 1
        # the drive runs; links and open ports: 0, and 1 unless last; 2 and 3 are closed
        links = 0x5211 | (0x0400 if last else 0x0820)
        _WORD.pack_into(memory, DL_STATUS, links)
        _WORD.pack_into(memory, 0x0140, _WORD.unpack_from(self._eeprom)[0])
        _WORD.pack_into(memory, WATCHDOG_DIVIDER, 2498)
        _WORD.pack_into(memory, WATCHDOG_TIME, 1000)
        memory[EEPROM_CONTROL] = 0x40  # reads 8 bytes at once

    # -- memory as datagrams see it

    def answers_to(self, station: int) -> bool:
        """Return whether a station address, or alias where it is in use, is this slave's."""
        if station == self._station:
            return True
        alias = self.memory[USE_ALIAS] & 1
        return bool(alias) and station == _WORD.unpack_from(self.memory, ALIAS)[0]

    def read(self, address: int, length: int) -> bytes | None:
        """Return bytes of the memory, 0 beyond its end; None when they cannot be read now."""
        end = address + length
        if address >= MEMORY or length == 0:
            return None
        if address < REGISTERS:
            for start, size, bring_up in self._readings:
                if address < start + size and end > start:
                    bring_up()
        else:
            for unit, manager in enumerate(self.managers):
                if manager.active and address < manager.end and end > manager.start:
                    return self._read_managed(unit, manager, address, end)
        return bytes(self.memory[address:end]).ljust(length, b"\0")

    def write(self, address: int, data: bytes) -> bool:
        """Write bytes into the memory; return whether they can be written now."""
        if address == SYSTEM_TIME and len(data) >= 4:
            i = self.position
            self._clocks.follow(i, i + 1, int.from_bytes(data[:4], "little"))
            return True
        end = address + len(data)
        if not data or end > MEMORY or address < REGISTERS < end:
            return False
        if address < REGISTERS:
            self._write_registers(address, data)
            return True
        for unit, manager in enumerate(self.managers):
            if manager.active and address < manager.end and end > manager.start:
                return self._write_managed(unit, manager, address, data)
        self.memory[address:end] = data
        return True

    def _write_registers(self, address: int, data: bytes) -> None:
        end = address + len(data)
        for at, value in enumerate(data, address):
            if self._writable[at]:
                self.memory[at] = value
        for start, size, take_effect in self._effects:
            if address < start + size and end > start:
                take_effect()

    def _set_station(self) -> None:
        self._station = _WORD.unpack_from(self.memory, STATION)[0]
        self._on_change()

    # -- sync managers, FMMUs

    def _set_managers(self) -> None:
        """Take over what has been written; one that is active keeps its address and control."""
        for unit, before in enumerate(self.managers):
            at = SYNC_MANAGERS + 8 * unit
            start, length, control, _, activate, _ = struct.unpack_from("<HHBBBB", self.memory, at)
            active = bool(activate & 0x01) and length > 0
            active = active and start >= REGISTERS and start + length <= MEMORY
            if before.active:
                active = bool(activate & 0x01)
                start, control, length = before.start, before.control, before.end - before.start
                struct.pack_into("<HHB", self.memory, at, start, length, control)
            manager = SyncManager(start, start + length, control, active)
            self.managers[unit] = manager
            if not active:
                self._set_full(unit, False)
        outputs, inputs = self._process_data.outputs, self._process_data.inputs
        self.outputs_at = self._buffer(2, _OUTPUT_KIND, len(outputs))
        self.inputs_at = self._buffer(3, _INPUT_KIND, len(inputs))
        self._repeat_reply()
        self._set_watchdog()
        self._on_change()

    def _buffer(self, unit: int, kind: int, length: int) -> tuple[int, int] | None:
        manager = self.managers[unit]
        stretch = (manager.start, manager.end)
        fits = manager.active and manager.kind == kind and manager.end - manager.start == length
        return stretch if fits else None

    def _set_fmmus(self) -> None:
        self.fmmus = []
        for unit in range(UNITS):
            logical, length, first, last, physical, bit, kind, active = struct.unpack_from(
                "<IHBBHBBB", self.memory, FMMUS + 16 * unit
            )
            if active & 1 and length and (first, last, bit) == (0, 7, 0):
                self.fmmus.append(Fmmu(logical, length, physical, bool(kind & 1), bool(kind & 2)))
        self._on_change()

    def _read_managed(
        self, unit: int, manager: SyncManager, address: int, end: int
    ) -> bytes | None:
        if manager.written:
            return None
        if manager.mailbox:
            self.serve_mailbox()
            if not self._is_full(unit):
                return None
        elif unit == 3 and self.inputs_at:
            if self.state < _SAFEOP:
                return None
            self._process_data.put_inputs()
            self.memory[manager.start : manager.end] = self._process_data.inputs
        data = bytes(self.memory[address:end]).ljust(end - address, b"\0")
        if manager.mailbox and end >= manager.end:
            self._set_full(unit, False)
            self.serve_mailbox()
        return data

    def _write_managed(self, unit: int, manager: SyncManager, address: int, data: bytes) -> bool:
        end = address + len(data)
        if not manager.written:
            return False
        if manager.mailbox:
            if self.state < _PREOP or self._is_full(unit):
                return False
            self._filling = self._filling or address <= manager.start
            if not self._filling:
                return False
            self.memory[address:end] = data
            if end >= manager.end:
                self._filling = False
                self._set_full(unit, True)
                self.serve_mailbox()
            return True
        if unit != 2 or not self.outputs_at:
            self.memory[address:end] = data
            return True
        if not self.operates:
            return False
        if address <= manager.start and end >= manager.end:
            offset = manager.start - address
            self._process_data.outputs[:] = data[offset : offset + manager.end - manager.start]
            self._process_data.take_outputs()
        return True

    # -- mailbox

    def _is_full(self, unit: int) -> bool:
        return bool(self.memory[SYNC_MANAGERS + 8 * unit + 5] & _FULL)

    def _set_full(self, unit: int, full: bool) -> None:
        self.memory[SYNC_MANAGERS + 8 * unit + 5] = _FULL if full else 0

    def serve_mailbox(self) -> None:
        """Process a request that has come; put the next reply out if there is room."""
        requests, replies = self.managers[:2]
        if self.state < _PREOP or not self._has_mailboxes():
            return
        server = self.mailbox
        if self._is_full(0) and not server.replies:
            request = bytes(self.memory[requests.start : requests.end])
            self._set_full(0, False)
            server.request(request, replies.end - replies.start)
        server.take_emergency()
        if server.replies and not self._is_full(1):
            self._put_reply(server.replies.popleft())

    def _put_reply(self, reply: bytes) -> None:
        replies = self.managers[1]
        self._last_reply = reply
        self.memory[replies.start : replies.end] = reply.ljust(replies.end - replies.start, b"\0")
        self._set_full(1, True)

    def _repeat_reply(self) -> None:
        """Put the last reply into the mailbox again when the master has toggled the request."""
        at = SYNC_MANAGERS + 8
        if (self.memory[at + 6] ^ self.memory[at + 7]) & _REPEAT == 0:
            return
        self.memory[at + 7] ^= _REPEAT
        if self._has_mailboxes() and self._last_reply and not self._is_full(1):
            self._put_reply(self._last_reply)

    # -- application layer

    @property
    def state(self) -> int:
        """AL state, without the error."""
        return int(self._drive.record["al_status"]) & 0x0F

    @property
    def operates(self) -> bool:
        """True if the drive is in OP and takes outputs."""
        return int(self._drive.record["al_status"]) == _OP

    def _show_state(self) -> None:
        record = self._drive.record
        _WORD.pack_into(self.memory, AL_STATUS, int(record["al_status"]))
        _WORD.pack_into(self.memory, AL_STATUS_CODE, int(record["al_status_code"]))

    def _request_state(self) -> None:
        """Obey the AL control register; an error stays until the master acknowledges it."""
        control = self.memory[AL_CONTROL]
        before, wanted = int(self._drive.record["al_status"]), control & 0x0F
        if before & AL_ERROR and not control & AL_ERROR:
            return
        self._show_watchdog()
        code = self._reason_against(self.state, wanted)
        if code:
            self._drive.refuse_state(code)
        else:
            self._drive.request_state(AlState(wanted))
        if self.state == _INIT or before & 0x0F == _INIT:
            self.mailbox.reset()
            self._last_reply, self._filling = b"", False
            self._set_full(0, False)
            self._set_full(1, False)
        self._on_change()

    def _reason_against(self, now: int, wanted: int) -> int:
        """Return the AL status code of a state that the configuration does not allow, else 0."""
        if wanted == _BOOT:
            return NO_BOOT
        if wanted not in (_INIT, _PREOP, _SAFEOP, _OP):
            return UNKNOWN_STATE
        if (now, wanted) == (_INIT, _PREOP):
            return 0 if self._has_mailboxes() else INVALID_MAILBOX
        if (now, wanted) == (_PREOP, _SAFEOP):
            if self.outputs_at is None:
                return INVALID_OUTPUTS
            if self.inputs_at is None:
                return INVALID_INPUTS
        return 0

    def _has_mailboxes(self) -> bool:
        requests, replies = self.managers[:2]
        apart = requests.end <= replies.start or replies.end <= requests.start
        return apart and all(
            manager.active
            and manager.kind == kind
            and manager.end - manager.start >= _SHORTEST_MAILBOX
            for manager, kind in ((requests, _REQUEST_KIND), (replies, _REPLY_KIND))
        )

    def _show_buffers(self) -> None:
        """Show that the outputs are open in OP alone, the inputs from SAFEOP on (assumed)."""
        self.memory[OUTPUTS_CLOSED] = int(not self.operates)
        self.memory[INPUTS_CLOSED] = int(self.state < _SAFEOP)

    # -- watchdog of the process data

    def _set_watchdog(self) -> None:
        divider, time = (
            _WORD.unpack_from(self.memory, at)[0] for at in (WATCHDOG_DIVIDER, WATCHDOG_TIME)
        )
        on = time > 0 and self.managers[2].watched
        self._drive.record["watchdog"] = time * ((divider + 2) * 40 / 1e9) if on else float("inf")

    def _show_watchdog(self) -> None:
        """Bring status and count up to date; also called before a state change hides it."""
        record = self._drive.record
        expired = int(record["al_status_code"]) == WATCHDOG_EXPIRED
        if expired and not self._expired:
            self._expirations = min(self._expirations + 1, 255)
        self._expired = expired
        self.memory[WATCHDOG_STATUS] = int(not expired)
        self.memory[WATCHDOG_COUNT] = self._expirations

    def _clear_expirations(self) -> None:
        self._expirations = 0

    # -- EEPROM

    def _access_eeprom(self) -> None:
        """Obey an EEPROM command: read (1), write a word (2), reload the alias (4)."""
        memory = self.memory
        command, write_enabled = memory[EEPROM_CONTROL + 1] & 0x07, memory[EEPROM_CONTROL] & 1
        at = 2 * int.from_bytes(memory[EEPROM_ADDRESS : EEPROM_ADDRESS + 4], "little")
        failed = command not in (0, 1, 2, 4)
        if command == 1:
            found = bytes(self._eeprom[at : at + 8]).ljust(8, b"\xff")
            memory[EEPROM_DATA : EEPROM_DATA + 8] = found
        elif command == 2:
            failed = not write_enabled or at + 2 > len(self._eeprom)
            if not failed:
                self._eeprom[at : at + 2] = memory[EEPROM_DATA : EEPROM_DATA + 2]
        elif command == 4:
            memory[ALIAS : ALIAS + 2] = self._eeprom[8:10]
            self._on_change()
        memory[EEPROM_CONTROL] = 0x40
        memory[EEPROM_CONTROL + 1] = 0x20 if failed else 0

    # -- distributed clock

    def _latch_times(self) -> None:
        """Note when this frame comes, and when it comes back from the slaves behind."""
        i, last = self.position, self._count - 1
        arrival = self._clocks.local(i)
        back = self._clocks.local(i, 2 * last - i) if i < last else 0
        times = (arrival & 0xFFFFFFFF, back & 0xFFFFFFFF, 0, 0)
        struct.pack_into("<IIII", self.memory, RECEIVE_TIMES, *times)
        struct.pack_into("<Q", self.memory, RECEIVE_TIME_64, arrival & (2**64 - 1))

    def _set_time(self) -> None:
        self._clocks.set(self.position, *struct.unpack_from("<qI", self.memory, TIME_OFFSET))

    def _show_time(self) -> None:
        time = self._clocks.system(self.position)
        struct.pack_into("<Q", self.memory, SYSTEM_TIME, time & (2**64 - 1))

    def _show_difference(self) -> None:
        difference = self._clocks.difference(self.position)
        shown = min(abs(difference), 2**31 - 1) | (1 << 31 if difference < 0 else 0)
        struct.pack_into("<I", self.memory, TIME_DIFFERENCE, shown)

    def _restart_clock(self) -> None:
        self._clocks.forget_correction(self.position)
