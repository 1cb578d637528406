"""Setting drives up over the mailbox: who is there, parameters, AL states. May block.

A drive starts with what anybody has saved in it. Every object that the master relies on is read,
written when it differs, and read back; what was changed is kept for diagnostics.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from functools import partial

from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.axes import AxisSettings
from husky_drivers.ethercat.bus import (
    GOLD_TWITTER,
    NO_OBJECT,
    NO_SUBINDEX,
    AlState,
    Bus,
    SdoAbort,
)
from husky_drivers.ethercat.pdo import MAPPINGS, RX_ASSIGNMENT, TX_ASSIGNMENT, mapped
from husky_drivers.joint_master.setting_changes import SettingChange

_SPEED_MARGIN = 2.0
"""Ratio of a drive's own limit of speed to its joint's velocity limit."""
_UNLIMITED = 2**32 - 1


class DriveError(RuntimeError):
    """The segment or a drive could not be set up; says which and why."""


def gain_objects(
    settings: AxisSettings, kp: float, kd: float
) -> Iterator[tuple[od.ObjectEntry, float]]:
    """Objects that make the drive's cascade the law kp (p* - p) + kd (v* - v).

    The outer loop gives a speed, position_gain (p* - p) + v*; the inner one a current,
    velocity_gain times what the speed lacks, without an integral part. So the velocity gain is kd
    in amperes per count/s and the position gain kp / kd.

    Args:
        settings: scaling.
        kp: N m/rad, at least 0.
        kd: N m s/rad, above 0.

    Raises:
        ValueError: when a gain is not finite or out of its range.
    """
    if not (math.isfinite(kp) and kp >= 0.0):
        raise ValueError(f"kp is {kp!r} N m/rad, it must be finite and at least 0")
    if not (math.isfinite(kd) and kd > 0.0):
        raise ValueError(f"kd is {kd!r} N m s/rad, it must be finite and above 0")
    yield od.VELOCITY_GAIN, kd / (settings.torque_per_ampere * settings.counts_per_radian)
    yield od.POSITION_GAIN, kp / kd


def parameters(settings: AxisSettings, axis: int) -> Iterator[tuple[od.ObjectEntry, od.Number]]:
    """Objects that every drive has, and what they shall hold, in this order."""
    rated = round(settings.rated_current * 1e3)
    yield od.RATED_CURRENT, rated
    yield od.RATED_TORQUE, rated
    yield od.MAX_CURRENT, round(settings.peak_current / settings.current_per_permille)
    yield od.INTEGRAL_GAIN, 0.0
    yield from gain_objects(settings, settings.kp, settings.kd)
    yield od.INTERPOLATION_EXPONENT, -3
    yield od.INTERPOLATION_VALUE, round(settings.tick * 1e3)
    yield od.FOLLOWING_WINDOW, round(settings.following_window * settings.counts_per_radian)
    yield od.FOLLOWING_TIME, round(settings.following_time * 1e3)
    brake = settings.velocity_limit[axis] / settings.quick_stop_time * settings.counts_per_radian
    yield od.DECELERATION, round(brake)
    yield od.QUICK_STOP_DECELERATION, round(brake)
    yield od.QUICK_STOP_OPTION, 2  # brake on the quick-stop ramp, then switch on disabled
    yield od.SHUTDOWN_OPTION, 0  # torque off at once
    yield od.DISABLE_OPTION, 0
    yield od.HALT_OPTION, 2
    yield od.FAULT_OPTION, 2  # brake, then torque off; hardware faults never brake
    yield od.ABORT_CONNECTION_OPTION, 1  # no frames: fault


def guards(settings: AxisSettings, axis: int) -> Iterator[tuple[od.ObjectEntry, od.Number]]:
    """Objects that change what a command means, or how far it is followed, if anybody has set them.

    A drive without one of them is fine. The software limits lie beyond the commanded range by the
    following error that trips the drive: within them it is the drive's own guard.
    """
    counts = settings.counts_per_radian
    yield od.POLARITY, 0
    yield od.GEAR_MOTOR, 1
    yield od.GEAR_SHAFT, 1
    yield od.POSITION_OFFSET, 0
    yield od.VELOCITY_OFFSET, 0
    yield od.RANGE_LOWER, -(2**31)
    yield od.RANGE_UPPER, 2**31 - 1
    margin = settings.following_window
    yield od.LIMIT_LOWER, round((settings.position_lower[axis] - margin) * counts)
    yield od.LIMIT_UPPER, round((settings.position_upper[axis] + margin) * counts)
    yield od.MAX_MOTOR_SPEED, round(_SPEED_MARGIN * settings.velocity_limit[axis] * counts)
    yield od.MAX_ACCELERATION, _UNLIMITED  # the controller plans its own
    yield od.MAX_DECELERATION, _UNLIMITED


def commission(bus: Bus, settings: AxisSettings) -> list[SettingChange]:
    """Open the bus, check who is there and what it holds; drives end in SAFEOP.

    Returns:
        The changes.

    Raises:
        DriveError: a drive is missing, is another device, refuses a parameter or does not keep it.
    """
    bus.open()
    names = settings.joint_names
    if bus.slave_count != len(names):
        raise DriveError(f"{bus.slave_count} slaves on the bus, expected {len(names)}")
    changes: list[SettingChange] = []
    for axis, name in enumerate(names):
        identity = bus.identity(axis)
        if (identity.vendor, identity.product) != (GOLD_TWITTER.vendor, GOLD_TWITTER.product):
            raise DriveError(f"{name}: {identity} is not a Gold Twitter")
        changes += _set_up(bus, settings, axis)
    bus.bring_to(AlState.SAFEOP)
    check_al_states(bus, settings, AlState.SAFEOP)
    return changes


def _check_serial_number(bus: Bus, settings: AxisSettings, axis: int) -> None:
    """Raise DriveError when a drive is not the one that belongs to its joint."""
    if not settings.serial_numbers:
        return
    name, expected = settings.joint_names[axis], settings.serial_numbers[axis]
    try:
        found = _read(bus, axis, od.SERIAL_NUMBER)
    except SdoAbort as abort:
        raise DriveError(f"{name}: {abort}") from abort
    if found != expected:
        raise DriveError(f"{name}: the drive has serial number {found}, it must be {expected}")


def _set_up(bus: Bus, settings: AxisSettings, axis: int) -> list[SettingChange]:
    """Set what the joint's own drive holds, in PREOP; raises DriveError, which names the joint."""
    _check_serial_number(bus, settings, axis)
    changes: list[SettingChange] = []
    try:
        changes += _set_mappings(bus, axis)
        for entry, value in guards(settings, axis):
            changes += _set(bus, axis, entry, value, optional=True)
        for entry, value in parameters(settings, axis):
            changes += _set(bus, axis, entry, value)
    except (SdoAbort, DriveError) as error:
        raise DriveError(f"{settings.joint_names[axis]}: {error}") from error
    bus.set_watchdog(axis, settings.process_data_watchdog)
    return changes


def recover(bus: Bus, settings: AxisSettings) -> str:
    """Bring the drives that have left OP back to it, while frames go round for the others.

    A drive in SAFEOP still has its configuration; one below, or that has lost its station address
    as after a power cycle, is set up again. Drives have no torque by that: a fault of CiA 402
    stays, and they are not enabled. May block.

    Returns:
        Which drives do not come back and why; "" when all do.
    """
    failures: list[str] = []
    line_ends = False
    for axis, (name, al) in enumerate(zip(settings.joint_names, bus.al_states(), strict=True)):
        if al.status == AlState.OP or (al.status == 0 and line_ends):
            continue
        try:
            if al.status & 0x0F == AlState.SAFEOP:
                bus.request_state(AlState.SAFEOP, axis)  # acknowledges the error
            else:
                bus.take_back(axis, partial(_set_up, bus, settings, axis))
            bus.request_state(AlState.OP, axis)
        except (OSError, DriveError) as error:
            line_ends |= al.status == 0  # those behind do not answer either
            failures.append(str(error) if isinstance(error, DriveError) else f"{name}: {error}")
    return "; ".join(failures)


def _set_mappings(bus: Bus, axis: int) -> Iterator[SettingChange]:
    """Set what the mapping objects map, then which of them are used; in PREOP."""
    for index in MAPPINGS:
        wanted = mapped(index)
        slots = od.mapped_slots(index, 8)
        yield from _set_list(bus, axis, od.mapped_count(index), slots, wanted, optional=True)
    for count, assignment in ((od.RX_COUNT, RX_ASSIGNMENT), (od.TX_COUNT, TX_ASSIGNMENT)):
        yield from _set_list(bus, axis, count, od.mapping_slots(count), assignment)


def _set_list(
    bus: Bus,
    axis: int,
    count: od.ObjectEntry,
    slots: Sequence[od.ObjectEntry],
    wanted: Sequence[int],
    *,
    optional: bool = False,
) -> Iterator[SettingChange]:
    """Set a count and the entries behind it; writing begins and ends with the count."""
    held = _read(bus, axis, count, optional=optional)
    if held is None:
        return
    before = [_read(bus, axis, slot) or 0 for slot in slots[: int(held)]]
    if [_what_counts(int(value)) for value in before] == [_what_counts(each) for each in wanted]:
        return
    for entry, value in ((count, 0), *zip(slots, wanted, strict=False), (count, len(wanted))):
        bus.sdo_write(axis, entry.index, entry.subindex, entry.pack(value))
    texts = (" ".join(f"0x{int(value):X}" for value in values) for values in (before, wanted))
    yield SettingChange(axis, count.title, *texts)


def _what_counts(mapped_entry: int) -> int:
    """Of a mapped entry that fills, only the bits: drives write its index in several ways."""
    return mapped_entry if mapped_entry >> 16 else mapped_entry & 0xFFFF


def _read(
    bus: Bus, axis: int, entry: od.ObjectEntry, *, optional: bool = False
) -> od.Number | None:
    """Return what an object holds, None for an optional one that the drive does not have."""
    try:
        data = bus.sdo_read(axis, entry.index, entry.subindex)
    except SdoAbort as abort:
        if optional and abort.code in (NO_OBJECT, NO_SUBINDEX):
            return None
        raise
    try:
        return entry.unpack(data)
    except struct.error:
        raise DriveError(f"{entry.title} has {len(data)} bytes") from None


def _set(
    bus: Bus, axis: int, entry: od.ObjectEntry, value: od.Number, *, optional: bool = False
) -> Iterator[SettingChange]:
    """Set an object if it holds something else, and see that the drive keeps it."""
    before = _read(bus, axis, entry, optional=optional)
    wanted = entry.unpack(entry.pack(value))  # as the wire has it
    if before is None or before == wanted:
        return
    bus.sdo_write(axis, entry.index, entry.subindex, entry.pack(value))
    after = _read(bus, axis, entry)
    if after != wanted:
        raise DriveError(f"{entry.title} takes {wanted:g} and holds {after:g}")
    yield SettingChange(axis, entry.title, f"{before:.10g}", f"{wanted:.10g}")


def write_gains(bus: Bus, settings: AxisSettings, kp: float, kd: float) -> None:
    """Write the gains of all drives, also while they run [N m/rad, N m s/rad].

    Raises:
        ValueError: when a gain is out of its range; nothing is written.
        DriveError: when a drive refuses.
    """
    written = list(gain_objects(settings, kp, kd))
    for axis, name in enumerate(settings.joint_names):
        _write_all(bus, axis, name, iter(written))


def read_mode(bus: Bus, axis: int) -> int:
    """Mode of operation display of a drive, 0 when it does not say."""
    entry = od.MODE_DISPLAY
    try:
        return int(entry.unpack(bus.sdo_read(axis, entry.index, entry.subindex)))
    except SdoAbort:
        return 0


def check_al_states(bus: Bus, settings: AxisSettings, wanted: AlState) -> None:
    """Raise DriveError when a slave is not in a state."""
    for name, al in zip(settings.joint_names, bus.al_states(), strict=True):
        if al.status != wanted:
            raise DriveError(f"{name}: in {al.state} instead of {wanted.name} ({al.reason})")


def _write_all(
    bus: Bus, axis: int, name: str, written: Iterator[tuple[od.ObjectEntry, od.Number]]
) -> None:
    try:
        for entry, value in written:
            bus.sdo_write(axis, entry.index, entry.subindex, entry.pack(value))
    except SdoAbort as abort:
        raise DriveError(f"{name}: {abort}") from abort
