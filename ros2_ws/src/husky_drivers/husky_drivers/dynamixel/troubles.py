"""What is wrong with which servo, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from husky_drivers.dynamixel.control_table import describe_errors
from husky_drivers.dynamixel.readings import ServoReadings
from husky_drivers.dynamixel.settings import ServoSettings


class ServoTroubles:
    """Servos that cannot be used, and those that tell of an error.

    Attributes:
        unusable: why a servo cannot be used, by its place; the others can.
    """

    def __init__(self, settings: ServoSettings, readings: ServoReadings):
        """All can be used."""
        self._settings, self._readings = settings, readings
        self.unusable: dict[int, str] = {}

    def error_of(self, index: int) -> str:
        """Return what is wrong with a servo; "" when nothing is."""
        if index in self.unusable:
            return self.unusable[index]
        bits = int(self._readings.hardware_error[index])
        if bits:
            return describe_errors(bits)
        return "hardware error" if self._readings.alert[index] else ""

    def describe(self, places: Iterable[int], say: Callable[[int], str] | None = None) -> str:
        """Name some servos with what is wrong with each, or what `say` says of it."""
        names, ids = self._settings.joint_names, self._settings.ids
        return ", ".join(
            f"{names[i]} (servo {ids[i]}): {(say or self.error_of)(i)}" for i in places
        )

    def why_not_well(self, *, enabled: bool) -> str:
        """Name the servos that are not as they should be; "" when all are.

        Args:
            enabled: all must have torque.
        """
        readings = self._readings
        if self.unusable:
            return self.describe(sorted(self.unusable))
        faulty = np.flatnonzero(readings.alert | (readings.hardware_error != 0))
        if len(faulty):
            return self.describe(faulty)
        if enabled and not readings.torque_on.all():
            return self.describe(np.flatnonzero(~readings.torque_on), lambda i: "has no torque")
        return ""
