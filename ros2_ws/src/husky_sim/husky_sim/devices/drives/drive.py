"""A simulated Elmo Gold Twitter as an EtherCAT slave: identity, states, object dictionary, faults.

What happens at every tick and frame stands in `drive_cycle`; this is what is asked now and then:
the mailbox (objects with abort codes), the AL state machine, fault injection.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from husky_drivers.cia402 import DriveState, OperationMode
from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.bus import (
    AL_ERROR,
    GOLD_TWITTER,
    NO_OBJECT,
    NO_SUBINDEX,
    AlState,
    SdoAbort,
)
from husky_drivers.ethercat.pdo import MAPPINGS, RX_ASSIGNMENT, TX_ASSIGNMENT, mapped
from husky_sim.devices.drives import drive_cycle
from husky_sim.devices.drives.drive_record import DRIVE

READ_ONLY, TOO_LONG = 0x06010002, 0x06070012
CANNOT_MAP, WRONG_LENGTH, OUT_OF_RANGE, WRONG_STATE = 0x06040041, 0x06070010, 0x06090030, 0x08000022
GENERAL_ERROR = 0x08000000
INVALID_CHANGE, INVALID_OUTPUTS, INVALID_INPUTS = 0x0011, 0x001D, 0x001E

START_TIME = 0.02
"""Self-test after power on [s] (assumed)."""
WATCHDOG = 0.1
"""Process data watchdog after power on [s] (EtherCAT default: 1000 times 100 us)."""
SUPPLY_RANGE = (11.0, 98.0)
"""Bus voltage outside of which the drive trips [V] (assumed, for the 100 V type)."""
FAULTS = (
    "fault:<code>",
    "al_error:<code>",
    "mailbox:<n>",
    "sto",
    "silent",
    "cut",
    "unpowered",
    "disturbed_timing",
)
"""Faults that can be injected. A fault's code is that of object 0x603F in hexadecimal, e.g.
fault:8611, an AL error's that of register 0x0134; mailbox:3 refuses the third access to an object
from now on."""
_ONE_BY_ONE = ("sto", "silent", "cut", "unpowered", "disturbed")
"""Fields of the record that are 1 while such a fault lasts."""
_OUTLASTS = (
    *_ONE_BY_ONE,
    "injected_fault",
    "sto_state",
    "position",
    "velocity",
    "current",
    "bus_voltage",
    "peak_duration",
)
"""Fields of the record that a power cycle does not change."""


@dataclass(frozen=True)
class DriveParameter:
    """A writable object and the field of the drive that it sets.

    Attributes:
        field: name in `drive_record.DRIVE`.
        initial: value on the wire after power on (slave dump).
        scale: field per wire unit.
        lower, upper: allowed values on the wire.
        allowed: or the allowed values one by one.
    """

    field: str
    initial: float
    scale: float = 1.0
    lower: float = 0.0
    upper: float = 4294967295.0
    allowed: tuple[int, ...] | None = None

    def accepts(self, value: float) -> bool:
        """Whether the drive takes a value."""
        if self.allowed is not None:
            return value in self.allowed
        return math.isfinite(value) and self.lower <= value <= self.upper


_RAMPS = (0, 1, 2, 5, 6)
PARAMETERS: dict[od.ObjectEntry, DriveParameter] = {
    od.VELOCITY_GAIN: DriveParameter("velocity_gain", 0.0, upper=1e3),
    od.POSITION_GAIN: DriveParameter("position_gain", 0.0, upper=1e5),
    od.ABORT_CONNECTION_OPTION: DriveParameter("abort_option", 0, allowed=(0, 1, 2, 3)),
    od.QUICK_STOP_OPTION: DriveParameter("quick_stop_option", 2, allowed=_RAMPS),
    od.SHUTDOWN_OPTION: DriveParameter("shutdown_option", 0, allowed=(0, 1)),
    od.DISABLE_OPTION: DriveParameter("disable_option", 0, allowed=(0, 1)),
    od.HALT_OPTION: DriveParameter("halt_option", 2, allowed=(1, 2)),
    od.FAULT_OPTION: DriveParameter("fault_option", 0, allowed=(0, 1, 2)),
    od.FOLLOWING_WINDOW: DriveParameter("following_window", 1e9),
    od.FOLLOWING_TIME: DriveParameter("following_timeout", 20, scale=1e-3),
    od.MAX_CURRENT: DriveParameter("peak_ratio", 10000, scale=1e-3),
    od.RATED_CURRENT: DriveParameter("rated_current", 1000, scale=1e-3, lower=1.0),
    od.DECELERATION: DriveParameter("deceleration", 2147483647, lower=1.0),
    od.QUICK_STOP_DECELERATION: DriveParameter("quick_stop_deceleration", 2147483647, lower=1.0),
}

STORED: dict[od.ObjectEntry, od.Number] = {
    od.INTEGRAL_GAIN: 0.0,
    od.RATED_TORQUE: 1000,
    od.POLARITY: 0,
    od.GEAR_MOTOR: 1,
    od.GEAR_SHAFT: 1,
    od.POSITION_OFFSET: 0,
    od.VELOCITY_OFFSET: 0,
    od.RANGE_LOWER: -(2**31),
    od.RANGE_UPPER: 2**31 - 1,
    od.LIMIT_LOWER: -(2**31),
    od.LIMIT_UPPER: 2**31 - 1,
    od.MAX_MOTOR_SPEED: 2**32 - 1,
    od.MAX_ACCELERATION: 2**32 - 1,
    od.MAX_DECELERATION: 2**32 - 1,
}
"""Objects that are kept and have no effect here, and what they hold from the factory (assumed)."""

OS_COMMAND = od.ObjectEntry(0x1023, 1, "s", True, "command")
OS_REPLY = od.ObjectEntry(0x1023, 3, "s", False, "reply")
LONGEST_COMMAND = 512
"""Bytes of the longest OS command (assumed)."""
TEXTS: dict[od.ObjectEntry, bytes] = {
    od.ObjectEntry(0x1008, 0, "s", False, "device name"): b"Gold Twitter",
    od.ObjectEntry(0x100A, 0, "s", False, "software version"): b"Twitter 01.01.15.00",
    OS_COMMAND: b"",
    OS_REPLY: b"",
}
"""Objects that hold text. CiA 301's OS command stands for Elmo's interpreter, which is not
simulated: its reply repeats the command and ends it with a semicolon (assumed)."""

FACTORY_MAPPINGS: dict[int, tuple[int, ...]] = {
    0x1600: (0x607A0020, 0x60FE0120, 0x60400010),
    0x1A00: (0x60640020, 0x60FD0020, 0x60410010),
}
"""Mappings of the assignments after power on (slave dump); they are read and never used here."""

FIXED: dict[od.ObjectEntry, int] = (
    {
        od.ObjectEntry(0x1000, 0, "<I", False, "device type"): 0x00020192,
        od.ObjectEntry(0x1C10, 0, "<B", False, "mappings of sync manager 0"): 0,
        od.ObjectEntry(0x1C11, 0, "<B", False, "mappings of sync manager 1"): 0,
    }
    | {
        od.ObjectEntry(0x1C00, manager + 1, "<B", False, f"type of sync manager {manager}"): manager
        + 1
        for manager in range(4)
    }
    | {
        od.ObjectEntry(index, slot, "<I", False, f"object {slot} mapped by 0x{index:04X}"): mapping
        for index, mappings in FACTORY_MAPPINGS.items()
        for slot, mapping in enumerate(mappings, 1)
    }
)
"""Objects that never change."""

OBJECT_NAMES = {
    0x1018: "identity",
    0x1023: "OS command",
    0x1C00: "sync manager types",
    0x1C12: "output mappings",
    0x1C13: "input mappings",
    0x2110: "KI of the inner loop",
    0x2111: "KP of the inner loop",
    0x2112: "KP of the outer loop",
    0x607B: "position range limit",
    0x607D: "software position limit",
    0x6091: "gear ratio",
    0x60C2: "interpolation period",
}
"""Names of the objects that have several entries; mapping objects are named by their index."""

READINGS: dict[od.ObjectEntry, Callable[[Any], float]] = {
    od.VENDOR: lambda d: GOLD_TWITTER.vendor,
    od.PRODUCT: lambda d: GOLD_TWITTER.product,
    od.REVISION: lambda d: GOLD_TWITTER.revision,
    od.ObjectEntry(0x1001, 0, "<B", False, "error register"): lambda d: error_register(
        d["error_code"]
    ),
    od.STO_STATUS: lambda d: 1 if d["sto"] else 0,
    od.ERROR_CODE: lambda d: d["error_code"],
    od.CONTROLWORD: lambda d: d["controlword"],
    od.STATUSWORD: lambda d: drive_cycle.statusword(d),
    od.MODE_DISPLAY: lambda d: d["mode"],
    od.POSITION: lambda d: d["position"],
    od.VELOCITY: lambda d: d["velocity"],
    od.BUS_VOLTAGE: lambda d: max(round(d["bus_voltage"] * 1e3), 0),
    od.FOLLOWING_ERROR: lambda d: d["target_position"] - d["position"],
    od.SUPPORTED_MODES: lambda d: (
        OperationMode.CYCLIC_SYNCHRONOUS_POSITION.supported_bit
        | OperationMode.CYCLIC_SYNCHRONOUS_VELOCITY.supported_bit
        | OperationMode.CYCLIC_SYNCHRONOUS_TORQUE.supported_bit
    ),
}


def error_register(code: int) -> int:
    """Return object 0x1001 for an error code (CiA 301): the kind of error in one bit."""
    if code == 0:
        return 0
    kinds = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08}  # current, voltage, temperature
    kind = kinds.get(code >> 12, 0)
    if code >> 8 in (0x80, 0x81, 0x82):
        kind = 0x10  # communication
    elif code >> 12 == 0xF:
        kind = 0x80  # of the maker
    return 0x01 | kind


def _counts(entries: Iterable[od.ObjectEntry]) -> dict[od.ObjectEntry, int]:
    """Return the entries of subindex 0 that say how many others an object has."""
    last: dict[int, int] = {}
    for entry in entries:
        last[entry.index] = max(entry.subindex, last.get(entry.index, 0))
    return {
        od.ObjectEntry(index, 0, "<B", False, "number of entries"): count
        for index, count in last.items()
        if count
    }


class SimulatedDrive:
    """One drive, over its `record` of `drive_record.DRIVE`, which the kernels share."""

    def __init__(self, position: int, record: Any, peak_duration: float, interpolation: float):
        """Power on.

        Args:
            position: place on the wire, for messages.
            record: (1,) slice of the segment's records.
            peak_duration: how long the peak current may last from rest [s].
            interpolation: the only interpolation period the emulator follows [s].
        """
        self._position = position
        self._view = record
        self.record = record[0]
        self._interpolation = interpolation
        self._saved: dict[od.ObjectEntry, od.Number | tuple[int, ...]] = {}
        self._accesses_left = 0  # until one is refused, as injected; 0 for none
        self.record["sto_state"] = DriveState.SWITCH_ON_DISABLED
        self.record["peak_duration"] = peak_duration
        self.starts = 0
        self.power_on()
        self.record["al_status"] = AlState.PREOP

    def power_on(self) -> None:
        """Start, in INIT, with the objects that are saved; motor and injected faults stay."""
        self.starts += 1
        d = self.record
        kept = [d[name].item() for name in _OUTLASTS]
        self._view[0] = np.zeros((), DRIVE)
        for name, value in zip(_OUTLASTS, kept, strict=True):
            d[name] = value
        d["al_status"] = AlState.INIT
        d["watchdog"] = WATCHDOG
        d["state"] = DriveState.NOT_READY_TO_SWITCH_ON
        d["starting"] = START_TIME
        d["undervoltage"], d["overvoltage"] = SUPPLY_RANGE
        for parameter in PARAMETERS.values():
            d[parameter.field] = parameter.initial * parameter.scale
        self._load_objects()
        self.preset(self._saved)

    def _load_objects(self) -> None:
        """Have the objects that are no fields of the record as they come from the factory."""
        self._assigned: dict[int, tuple[int, ...]] = {
            od.RX_COUNT.index: (0x1600,),
            od.TX_COUNT.index: (0x1A00,),
        }
        self._assigned |= {index: mapped(index) for index in MAPPINGS}
        self._slots = {
            index: [*maps, *[0] * (8 - len(maps))] for index, maps in self._assigned.items()
        }
        self._plain: dict[od.ObjectEntry, od.Number] = {
            **STORED,
            od.INTERPOLATION_VALUE: round(self._interpolation * 1e3),
            od.INTERPOLATION_EXPONENT: -3,
        }
        self._texts = dict(TEXTS)
        self._fixed = {
            **FIXED,
            od.ObjectEntry(0x1018, 4, "<I", False, "serial number"): self._position + 1,  # assumed
            od.ObjectEntry(0x1023, 2, "<B", False, "status"): 1,  # done, there is a reply
        }
        values = (*PARAMETERS, *READINGS, *self._plain, *self._texts, *self._fixed)
        self._fixed |= _counts(values)
        self._entries = {(entry.index, entry.subindex): entry for entry in (*values, *self._fixed)}

    def preset(self, saved: dict[od.ObjectEntry, od.Number | tuple[int, ...]]) -> None:
        """Have somebody's values saved in the drive, whatever it would accept from the bus.

        Args:
            saved: values by object; lists by the count of an assignment or of a mapping object.
        """
        self._saved = {**self._saved, **saved}
        for entry, value in saved.items():
            if isinstance(value, tuple):
                self._assigned[entry.index] = value
                self._slots[entry.index] = [*value, *[0] * (8 - len(value))]
            elif entry in PARAMETERS:
                self.record[PARAMETERS[entry].field] = value * PARAMETERS[entry].scale
            else:
                self._plain[entry] = value

    # -- mailbox

    @cached_property
    def dictionary(self) -> dict[int, dict[int, od.ObjectEntry]]:
        """All entries by index and subindex, in order."""
        slots = [od.RX_COUNT, *od.mapping_slots(od.RX_COUNT)]
        slots += [od.TX_COUNT, *od.mapping_slots(od.TX_COUNT)]
        for index in MAPPINGS:
            slots += [od.mapped_count(index), *od.mapped_slots(index, 8)]
        found: dict[int, dict[int, od.ObjectEntry]] = {}
        for entry in sorted(
            (*self._entries.values(), *slots), key=lambda entry: (entry.index, entry.subindex)
        ):
            found.setdefault(entry.index, {})[entry.subindex] = entry
        return found

    def sdo_read(self, index: int, subindex: int) -> bytes:
        """Value of an object; raises SdoAbort."""
        self._count_access(index, subindex)
        if index in self._slots and subindex <= len(self._slots[index]):
            if subindex == 0:
                return struct.pack("<B", len(self._assigned[index]))
            return struct.pack(
                "<I" if index in MAPPINGS else "<H", self._slots[index][subindex - 1]
            )
        entry = self._entry(index, subindex)
        if entry in PARAMETERS:
            parameter = PARAMETERS[entry]
            value = float(self.record[parameter.field]) / parameter.scale
            return entry.pack(value if "f" in entry.format else round(value))
        if entry in READINGS:
            return entry.pack(READINGS[entry](self.record))
        if entry in self._texts:
            return self._texts[entry]
        if entry in self._fixed:
            return entry.pack(self._fixed[entry])
        return entry.pack(self._plain[entry])

    def sdo_write(self, index: int, subindex: int, data: bytes) -> None:
        """Set an object; raises SdoAbort."""
        self._count_access(index, subindex)
        if index in self._slots:
            self._assign(index, subindex, data)
            return
        entry = self._entry(index, subindex)
        if not entry.writable:
            raise self._abort(READ_ONLY, index, subindex)
        if entry in self._texts:
            if len(data) > LONGEST_COMMAND:
                raise self._abort(TOO_LONG, index, subindex)
            self._texts[entry], self._texts[OS_REPLY] = bytes(data), bytes(data) + b";"
            return
        try:
            value = entry.unpack(data)
        except struct.error:
            raise self._abort(WRONG_LENGTH, index, subindex) from None
        parameter = PARAMETERS.get(entry)
        if parameter is not None:
            if not parameter.accepts(value):
                raise self._abort(OUT_OF_RANGE, index, subindex)
            self.record[parameter.field] = value * parameter.scale
            return
        self._check_plain(entry, value)
        self._plain[entry] = value

    def _count_access(self, index: int, subindex: int) -> None:
        """Refuse an access when that was injected."""
        if self._accesses_left:
            self._accesses_left -= 1
            if not self._accesses_left:
                raise self._abort(GENERAL_ERROR, index, subindex)

    def _check_plain(self, entry: od.ObjectEntry, value: od.Number) -> None:
        """Refuse what this emulator cannot do: an integral gain, another interpolation period."""
        refused = entry is od.INTEGRAL_GAIN and value != 0.0
        if entry in (od.INTERPOLATION_VALUE, od.INTERPOLATION_EXPONENT):
            planned = {**self._plain, entry: value}
            period = planned[od.INTERPOLATION_VALUE] * 10.0 ** planned[od.INTERPOLATION_EXPONENT]
            refused = not math.isclose(period, self._interpolation, rel_tol=1e-9)
        if refused:
            raise self._abort(OUT_OF_RANGE, entry.index, entry.subindex)

    def _entry(self, index: int, subindex: int) -> od.ObjectEntry:
        entry = self._entries.get((index, subindex))
        if entry is None:
            known = any(key[0] == index for key in self._entries)
            raise self._abort(NO_SUBINDEX if known else NO_OBJECT, index, subindex)
        return entry

    def _assign(self, index: int, subindex: int, data: bytes) -> None:
        """Write a mapping object or an assignment: count 0, entries, count; in PREOP only."""
        slots = self._slots[index]
        if subindex > len(slots):
            raise self._abort(NO_SUBINDEX, index, subindex)
        size = 4 if index in MAPPINGS else 2
        if len(data) != (1 if subindex == 0 else size):
            raise self._abort(WRONG_LENGTH, index, subindex)
        if self.record["al_status"] & 0x0F != AlState.PREOP:
            raise self._abort(WRONG_STATE, index, subindex)
        value = int.from_bytes(data, "little")
        if subindex == 0:
            if value > len(slots):
                raise self._abort(OUT_OF_RANGE, index, subindex)
            self._assigned[index] = tuple(slots[:value])
        elif self._assigned[index]:
            raise self._abort(WRONG_STATE, index, subindex)
        elif index not in MAPPINGS and value not in MAPPINGS:
            raise self._abort(CANNOT_MAP, index, subindex)
        else:
            slots[subindex - 1] = value

    def _abort(self, code: int, index: int, subindex: int) -> SdoAbort:
        return SdoAbort(code, self._position, index, subindex)

    # -- application layer

    def request_state(self, wanted: AlState) -> None:
        """Go to an AL state one step up, or down; otherwise an error with its code is left."""
        d = self.record
        now = AlState(int(d["al_status"]) & 0x0F)
        d["al_status_code"] = 0
        if wanted > now and wanted is not AlState(now * 2 if now > 1 else 2):
            self.refuse_state(INVALID_CHANGE)
        elif wanted is AlState.SAFEOP and not self._maps(od.RX_COUNT, RX_ASSIGNMENT):
            self.refuse_state(INVALID_OUTPUTS)
        elif wanted is AlState.SAFEOP and not self._maps(od.TX_COUNT, TX_ASSIGNMENT):
            self.refuse_state(INVALID_INPUTS)
        else:
            d["al_status"] = wanted
            d["watchdog_left"] = d["watchdog"]
            d["controlword"] = 0
            if now is AlState.OP and wanted is not AlState.OP:
                drive_cycle.abort_connection(d)

    def _maps(self, count: od.ObjectEntry, assignment: tuple[int, ...]) -> bool:
        """Return whether an assignment is the one whose bytes the emulator knows."""
        return self._assigned[count.index] == assignment and all(
            self._assigned[index] == mapped(index) for index in assignment
        )

    def refuse_state(self, code: int) -> None:
        """Stay in the AL state and leave an error with its code."""
        self.record["al_status"] = int(self.record["al_status"]) & 0x0F | AL_ERROR
        self.record["al_status_code"] = code

    # -- faults

    def inject(self, fault: str) -> None:
        """Make something fail until `clear`.

        Args:
            fault: one of `FAULTS`. "disturbed_timing" happens once.

        Raises:
            ValueError: when there is no such fault; lists those there are.
        """
        kind, _, argument = fault.partition(":")
        if kind == "fault":
            self.record["injected_fault"] = _number(fault, argument, 16)
        elif kind == "al_error":
            self._fall(_number(fault, argument, 16))
        elif kind == "mailbox":
            self._accesses_left = _number(fault, argument, 10)
        elif fault == "disturbed_timing":
            self.record["disturbed"] = 1
        elif fault in _ONE_BY_ONE:
            self.record[fault] = 1
            if fault == "unpowered":
                self.power_on()  # as it will be when it has power again; without it nothing goes on
        else:
            raise ValueError(f"no fault {fault!r}; there are {', '.join(FAULTS)}")

    def _fall(self, code: int) -> None:
        """Leave OP by itself, with an error."""
        d = self.record
        if d["al_status"] == AlState.OP:
            d["al_status"] = AlState.SAFEOP
            drive_cycle.abort_connection(d)
        self.refuse_state(code)

    def clear(self) -> None:
        """End all injected faults; a drive in fault stays there until it is reset."""
        unpowered = self.record["unpowered"]
        self._accesses_left = 0
        for field in ("injected_fault", *_ONE_BY_ONE):
            self.record[field] = 0
        if unpowered:
            self.power_on()


def _number(fault: str, text: str, base: int) -> int:
    """Read the number of a fault, 1 to 0xFFFF; raises ValueError."""
    try:
        number = int(text, base)
    except ValueError:
        number = 0
    if not 0 < number <= 0xFFFF:
        kind = "hexadecimal, 1 to FFFF" if base == 16 else "1 to 65535"
        raise ValueError(f"{fault!r}: the number must be {kind}")
    return number
