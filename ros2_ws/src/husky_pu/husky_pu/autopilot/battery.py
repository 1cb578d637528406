"""How much the battery has left, from voltage under load and from the charge that was drawn."""

from __future__ import annotations

import math
from enum import IntEnum

from husky_pu.autopilot.flight_parameters import FlightParameters

_FILTER_TIME = 1.0
"""Time constant of the voltage without load [s]."""
_LEAST_VOLTAGE = 1.0
"""Below this the power module is not connected [V]."""


class BatteryLevel(IntEnum):
    """Warnings, in rising order; from one to the next there is no way back while armed."""

    NORMAL = 0
    LOW = 1
    CRITICAL = 2
    EMERGENCY = 3


class BatteryMonitor:
    """Estimates what is left.

    As in PX4: the voltage is put back to what it would be without load, low-passed and scaled
    between empty and charged; with a known capacity, charge is counted too. The lower one counts.

    Attributes:
        voltage: last measurement [V].
        current: last measurement [A].
        consumed: charge drawn since boot [A s].
        energy: the same [J].
        remaining: share left, 0 to 1; nan before the first good measurement.
    """

    def __init__(self, parameters: FlightParameters):
        """Start without a measurement."""
        self._parameters = parameters
        self.voltage = self.current = 0.0
        self.consumed = self.energy = 0.0
        self.remaining = math.nan
        self._rest_voltage = math.nan
        self._initial = math.nan

    @property
    def connected(self) -> bool:
        """Whether the power module says something that can be true."""
        return self.voltage > _LEAST_VOLTAGE

    def update(self, voltage: float, current: float, dt: float) -> None:
        """Take one measurement.

        Args:
            voltage: under load [V].
            current: drawn [A].
            dt: since the last one [s].
        """
        if not (math.isfinite(voltage) and math.isfinite(current)):
            return
        self.voltage, self.current = voltage, current
        self.consumed += max(0.0, current) * dt
        self.energy += max(0.0, current * voltage) * dt
        if not self.connected:
            return
        p = self._parameters
        cell = voltage / p["BAT1_N_CELLS"] + current * p["BAT1_R_INTERNAL"]
        if not math.isfinite(self._rest_voltage):
            self._rest_voltage = cell
        self._rest_voltage += dt / (dt + _FILTER_TIME) * (cell - self._rest_voltage)
        empty, full = p["BAT1_V_EMPTY"], p["BAT1_V_CHARGED"]
        left = (self._rest_voltage - empty) / max(full - empty, 1e-3)
        left = max(0.0, min(1.0, left))
        if p["BAT1_CAPACITY"] > 0.0:
            if not math.isfinite(self._initial):
                self._initial = left
            left = min(left, self._initial - self.consumed / (3.6 * p["BAT1_CAPACITY"]))
        self.remaining = max(0.0, left)

    @property
    def level(self) -> BatteryLevel:
        """The warning that stands."""
        p = self._parameters
        if not self.remaining < p["BAT_LOW_THR"]:
            return BatteryLevel.NORMAL
        if self.remaining < p["BAT_EMERGEN_THR"]:
            return BatteryLevel.EMERGENCY
        return BatteryLevel.CRITICAL if self.remaining < p["BAT_CRIT_THR"] else BatteryLevel.LOW
