"""The flight controller's parameters: PX4's names, types and meanings, and a few of our own (HKY_).

A default follows PX4 unless its description says otherwise.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum


class ParameterType(IntEnum):
    """Types on the wire (MAV_PARAM_TYPE)."""

    INT32 = 6
    REAL32 = 9


@dataclass(frozen=True)
class FlightParameter:
    """One row of the table.

    Attributes:
        name: at most 16 characters.
        default: an int for INT32, a float for REAL32.
        lower: least allowed value.
        upper: greatest allowed value.
        description: what it is, with its unit.
    """

    name: str
    default: int | float
    lower: float
    upper: float
    description: str

    @property
    def type(self) -> ParameterType:
        """Type on the wire."""
        return ParameterType.INT32 if isinstance(self.default, int) else ParameterType.REAL32


_ROWS: tuple[tuple[str, int | float, float, float, str], ...] = (
    ("MAV_SYS_ID", 1, 1, 250, "system id"),
    ("MAV_COMP_ID", 1, 1, 250, "component id"),
    ("MAV_TYPE", 2, 0, 40, "MAV_TYPE in the heartbeat, by the rotors: 2 quadrotor"),
    ("SYS_AUTOSTART", 4001, 0, 999999, "airframe: generic quadrotor"),
    ("ATT_W_ACC", 0.2, 0.0, 10.0, "weight of the accelerometer [1/s]"),
    ("ATT_W_MAG", 0.1, 0.0, 10.0, "weight of the magnetometer [1/s]"),
    ("ATT_W_GYRO_BIAS", 0.1, 0.0, 2.0, "weight of the gyro's bias [1/s]"),
    ("ATT_BIAS_MAX", 0.05, 0.0, 2.0, "limit of the gyro's bias [rad/s]"),
    ("ATT_MAG_DECL", 0.0, -180.0, 180.0, "magnetic declination, east positive [deg]"),
    ("MC_ROLL_P", 4.0, 0.0, 12.0, "roll rate per error [1/s]; PX4 6.5, fans lag"),
    ("MC_PITCH_P", 4.0, 0.0, 12.0, "pitch rate per error [1/s]; PX4 6.5, fans lag"),
    ("MC_YAW_P", 1.5, 0.0, 5.0, "yaw rate per error [1/s]; PX4 2.8, little authority"),
    ("MC_YAW_WEIGHT", 0.4, 0.0, 1.0, "weight of the heading beside the tilt"),
    ("MC_ROLLRATE_MAX", 220.0, 0.0, 1800.0, "limit of the roll rate [deg/s]"),
    ("MC_PITCHRATE_MAX", 220.0, 0.0, 1800.0, "limit of the pitch rate [deg/s]"),
    ("MC_YAWRATE_MAX", 60.0, 0.0, 1800.0, "limit of the yaw rate [deg/s]; PX4 200"),
    ("MC_ROLLRATE_P", 0.15, 0.0, 5.0, "moment share per rate [s/rad]; from the inertia"),
    ("MC_ROLLRATE_I", 0.2, 0.0, 10.0, "moment share per angle [1/rad]; from the inertia"),
    ("MC_ROLLRATE_D", 0.003, 0.0, 1.0, "per acceleration [s^2/rad]; from the inertia"),
    ("MC_PITCHRATE_P", 0.15, 0.0, 5.0, "moment share per rate [s/rad]; from the inertia"),
    ("MC_PITCHRATE_I", 0.2, 0.0, 10.0, "moment share per angle [1/rad]; from the inertia"),
    ("MC_PITCHRATE_D", 0.003, 0.0, 1.0, "per acceleration [s^2/rad]; from the inertia"),
    ("MC_YAWRATE_P", 0.2, 0.0, 5.0, "moment share per rate [s/rad]; from the inertia"),
    ("MC_YAWRATE_I", 0.1, 0.0, 10.0, "moment share per angle [1/rad]; from the inertia"),
    ("MC_YAWRATE_D", 0.0, 0.0, 1.0, "per acceleration [s^2/rad]"),
    ("MC_RR_INT_LIM", 0.3, 0.0, 1.0, "limit of roll's integral, share of the moment"),
    ("MC_PR_INT_LIM", 0.3, 0.0, 1.0, "limit of pitch's integral, share of the moment"),
    ("MC_YR_INT_LIM", 0.3, 0.0, 1.0, "limit of yaw's integral, share of the moment"),
    ("MC_AIRMODE", 0, 0, 1, "1: moments may raise the thrust; 0: they shrink instead"),
    ("IMU_DGYRO_CUTOFF", 30.0, 1.0, 200.0, "low-pass of the D term [Hz]"),
    ("MPC_MAN_TILT_MAX", 20.0, 1.0, 60.0, "full stick in STABILIZED [deg]; PX4 35"),
    ("MPC_MAN_Y_MAX", 60.0, 0.0, 400.0, "full yaw stick [deg/s]; PX4 150"),
    ("MPC_MANTHR_MIN", 0.0, 0.0, 1.0, "thrust at the lower end; PX4 0.08, which never rests"),
    ("MPC_THR_MAX", 1.0, 0.0, 1.0, "greatest thrust"),
    ("MPC_THR_HOVER", 0.5, 0.1, 0.8, "thrust that carries the weight, for a descent at a speed"),
    ("MPC_LAND_SPEED", 0.0, 0.0, 2.0, "of a descent in the air [m/s], 0 ramps down; PX4 0.7"),
    ("COM_RC_IN_MODE", 3, 0, 4, "0 RC, 1 MAVLink, 2 either with fallback, 3 first seen, 4 off"),
    ("COM_RC_LOSS_T", 0.5, 0.0, 35.0, "silence that means loss of RC [s]"),
    ("COM_RCL_EXCEPT", 0, 0, 7, "bit 2: loss of RC does not matter in OFFBOARD"),
    ("NAV_RCL_ACT", 3, 3, 6, "on loss of RC: 3 descend, 5 terminate, 6 disarm; PX4 2 return"),
    ("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "silence that means loss of the setpoints [s]"),
    ("COM_OBL_RC_ACT", 4, 4, 7, "then: 4 descend, 6 terminate, 7 disarm; PX4 0 position"),
    ("COM_LOW_BAT_ACT", 2, 0, 3, "0 warn, 2 and 3 descend when critical; PX4 0"),
    ("COM_DISARM_PRFLT", 0.0, 0.0, 60.0, "disarm when thrust stays 0 so long, 0 off [s]; PX4 10"),
    ("COM_ARM_WO_RC", 0, 0, 1, "1 arms STABILIZED without a stick input"),
    ("FD_FAIL_R", 0, 0, 180, "roll that terminates [deg], 0 off; PX4 60"),
    ("FD_FAIL_P", 0, 0, 180, "pitch that terminates [deg], 0 off; PX4 60"),
    ("FD_FAIL_R_TTRI", 0.3, 0.02, 5.0, "for so long [s]"),
    ("FD_ACT_EN", 1, 0, 1, "1: speed controllers that tell are watched for lost fans"),
    ("FD_ACT_MOT_THR", 0.1, 0.0, 1.0, "thrust share of a fan below which it is not; PX4 0.2"),
    ("FD_ACT_MOT_TOUT", 100, 10, 10000, "how long a fan must fail to be lost [ms]"),
    ("COM_ACT_FAIL_ACT", 0, 0, 2, "on a lost fan: 0 warn, 2 descend"),
    ("CA_FAILURE_MODE", 1, 0, 1, "1: the mixer does without a lost fan; PX4 0"),
    ("BAT1_N_CELLS", 6, 1, 16, "cells in series; PX4 0"),
    ("BAT1_V_EMPTY", 3.6, 2.0, 5.0, "voltage of an empty cell without load [V]"),
    ("BAT1_V_CHARGED", 4.05, 2.0, 5.0, "voltage of a full cell without load [V]"),
    ("BAT1_R_INTERNAL", 0.002, 0.0, 0.2, "resistance per cell, leads included [ohm]; PX4 0.005"),
    ("BAT1_CAPACITY", 5000.0, -1.0, 100000.0, "charge [mAh], below 0 unknown; PX4 -1"),
    ("BAT_LOW_THR", 0.15, 0.05, 0.5, "share left that is low"),
    ("BAT_CRIT_THR", 0.07, 0.03, 0.25, "share left that is critical"),
    ("BAT_EMERGEN_THR", 0.05, 0.0, 0.25, "share left that is an emergency"),
    ("RC_MAP_ROLL", 1, 0, 16, "channel, 0 none; PX4 0"),
    ("RC_MAP_PITCH", 2, 0, 16, "channel, 0 none; PX4 0"),
    ("RC_MAP_THROTTLE", 3, 0, 16, "channel, 0 none; PX4 0"),
    ("RC_MAP_YAW", 4, 0, 16, "channel, 0 none; PX4 0"),
    ("RC_MAP_OFFB_SW", 5, 0, 16, "switch STABILIZED / OFFBOARD, 0 none; PX4 0"),
    ("RC_MAP_ARM_SW", 6, 0, 16, "switch disarm / arm, 0 none; PX4 0"),
    ("RC_MAP_KILL_SW", 7, 0, 16, "switch that stops the fans at once, 0 none; PX4 0"),
    ("PWM_MAIN_DISARM", 1000, 800, 1050, "pulse while disarmed [us]"),
    ("HKY_ARM_GYR", 0.35, 0.01, 10.0, "rate of rotation that counts as still for arming [rad/s]"),
    ("HKY_ARM_TILT", 60.0, 1.0, 180.0, "greatest tilt for arming [deg]"),
    ("HKY_ARM_THR", 0.05, 0.0, 1.0, "greatest thrust asked for at arming"),
    ("HKY_THR_UP", 1.0, 0.01, 100.0, "fastest rise of the thrust [1/s]"),
    ("HKY_THR_DOWN", 4.0, 1.0, 100.0, "fastest fall of the thrust asked for [1/s]"),
    ("HKY_FS_RAMP", 0.7, 0.05, 0.8, "time in which a fail-safe takes full thrust to 0 [s]"),
    ("HKY_INT_THR", 0.05, 0.0, 1.0, "thrust below which integrals are reset and heading is free"),
    ("HKY_GYR_LOSS", 0.1, 0.004, 1.0, "silence of the sensors that means their loss [s]"),
)

TABLE = {row[0]: FlightParameter(*row) for row in _ROWS}
"""Every parameter by its name, in the order of its index on the wire."""


class ParameterError(ValueError):
    """A parameter that is unknown, of another type or out of range: MAV_PARAM_ERROR `number`."""

    number = 2


class UnknownParameterError(ParameterError):
    """There is no such parameter."""

    number = 1

    def __init__(self, name: str):
        """Name it."""
        super().__init__(f"{name}: no such parameter")


class FlightParameters:
    """Values of all parameters.

    Attributes:
        changes: counts changes, so that a reader knows when to read again.
        defaults: values before anybody has set one.
        kept: what was set by hand, to outlast the process.
        keepings: counts changes of `kept`.
        outlasting: somebody writes down what is kept.
        unfit: why values that were kept are not taken.
    """

    def __init__(
        self,
        airframe: Mapping[str, float] | None = None,
        kept: Mapping[str, float] | None = None,
        overrides: Mapping[str, float] | None = None,
    ):
        """Take the defaults.

        Args:
            airframe: defaults that differ from the table's.
            kept: what was set by hand in the life of a process before; it stands above defaults.
            overrides: what holds in the life of this process, until it is set by hand.

        Raises:
            ParameterError: see `set`; for what was kept see `unfit`.
        """
        self.changes = self.keepings = 0
        self.outlasting = False
        self._values: dict[str, int | float] = {}
        self.kept: dict[str, int | float] = {}
        self.unfit: list[str] = []
        for name, row in TABLE.items():
            self.set(name, row.default)
        for name, value in (airframe or {}).items():
            self.set(name, value)
        self.defaults = dict(self._values)
        for name, value in (kept or {}).items():
            try:
                self.set(name, value)
            except ParameterError as error:
                self.unfit.append(str(error))
            else:
                self.kept[name] = self._values[name]
        self._overrides = dict(overrides or {})
        for name, value in self._overrides.items():
            self.set(name, value)

    def __getitem__(self, name: str) -> int | float:
        return self._values[name]

    def set(self, name: str, value: float) -> None:
        """Change a value.

        Raises:
            ParameterError: unknown name, a number that is not finite or outside its range.
        """
        row = TABLE.get(name)
        if row is None:
            raise UnknownParameterError(name)
        if not math.isfinite(value) or not row.lower <= value <= row.upper:
            raise ParameterError(f"{name}: must be {row.lower:g} to {row.upper:g}")
        if row.type is ParameterType.INT32 and value != int(value):
            raise ParameterError(f"{name}: must be a whole number")
        self._values[name] = int(value) if row.type is ParameterType.INT32 else _single(value)
        self.changes += 1

    def keep(self, name: str, value: float) -> None:
        """Change a value by hand, as `set` does: it is to outlast the process."""
        self.set(name, value)
        self.kept[name] = self._values[name]
        self.keepings += 1

    def forget(self) -> None:
        """Go back to the defaults and overrides; nothing is kept."""
        for name, value in {**self.defaults, **self._overrides}.items():
            self.set(name, value)
        self.kept.clear()
        self.keepings += 1


def _single(value: float) -> float:
    """Return the nearest number of single precision: what the wire carries is what holds."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def to_wire(value: int | float) -> float:
    """Return the float field of PARAM_VALUE; an int's four bytes stand in it as they are (PX4)."""
    if isinstance(value, int):
        return float(struct.unpack("<f", struct.pack("<i", value))[0])
    return value


def from_wire(field: float, type_: int) -> int | float:
    """Return the value in PARAM_SET's float; raises ParameterError for a type PX4 does not use."""
    if type_ == ParameterType.INT32:
        return int(struct.unpack("<i", struct.pack("<f", field))[0])
    if type_ == ParameterType.REAL32:
        return field
    raise ParameterError(f"type {type_} is neither INT32 nor REAL32")


def read_overrides(text: str) -> dict[str, float]:
    """Return the values in "NAME=VALUE, NAME=VALUE"; raises ParameterError for something else."""
    values: dict[str, float] = {}
    for item in filter(None, map(str.strip, text.split(","))):
        name, _, number = item.partition("=")
        try:
            values[name.strip()] = float(number)
        except ValueError as error:
            raise ParameterError(f"{item!r} is not NAME=VALUE") from error
    return values
