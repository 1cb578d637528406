"""Setting drives up over the mailbox: who is there, parameters, AL states. May block."""

from __future__ import annotations

import math
from collections.abc import Iterator

from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.axes import AxisSettings
from husky_drivers.ethercat.bus import (
    AL_ERROR,
    AL_STATUS_CODES,
    GOLD_TWITTER,
    AlState,
    Bus,
    SdoAbort,
)
from husky_drivers.ethercat.pdo import RX_ASSIGNMENT, TX_ASSIGNMENT


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
    """Objects to write to a drive in PREOP, in this order."""
    for count, assignment in ((od.RX_COUNT, RX_ASSIGNMENT), (od.TX_COUNT, TX_ASSIGNMENT)):
        yield count, 0
        yield from zip(od.mapping_slots(count), assignment, strict=False)
        yield count, len(assignment)
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


def commission(bus: Bus, settings: AxisSettings) -> None:
    """Open the bus, check who is there and write all parameters; drives end in SAFEOP.

    Raises:
        DriveError: a drive is missing, is another device, or refuses a parameter.
    """
    bus.open()
    names = settings.joint_names
    if bus.slave_count != len(names):
        raise DriveError(f"{bus.slave_count} slaves on the bus, expected {len(names)}")
    for axis, name in enumerate(names):
        identity = bus.identity(axis)
        if (identity.vendor, identity.product) != (GOLD_TWITTER.vendor, GOLD_TWITTER.product):
            raise DriveError(f"{name}: {identity} is not a Gold Twitter")
        _write_all(bus, axis, name, parameters(settings, axis))
        bus.set_watchdog(axis, settings.process_data_watchdog)
    bus.request_state(AlState.SAFEOP)
    check_al_states(bus, settings, AlState.SAFEOP)


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
    for axis, name in enumerate(settings.joint_names):
        status = bus.al_status(axis)
        if status != wanted:
            now = AlState(status & ~AL_ERROR).name if status else "no state"
            why = describe_code(bus.al_status_code(axis))
            raise DriveError(f"{name}: in {now} instead of {wanted.name} ({why})")


def describe_code(code: int) -> str:
    """What an AL status code means."""
    return AL_STATUS_CODES.get(code, f"AL status code 0x{code:04X}")


def _write_all(
    bus: Bus, axis: int, name: str, written: Iterator[tuple[od.ObjectEntry, od.Number]]
) -> None:
    try:
        for entry, value in written:
            bus.sdo_write(axis, entry.index, entry.subindex, entry.pack(value))
    except SdoAbort as abort:
        raise DriveError(f"{name}: {abort}") from abort
