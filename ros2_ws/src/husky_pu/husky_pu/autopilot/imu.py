"""The flight controller's own sensors: what noise and biases make of true values, from a seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from husky_description.rotation import Vector

PerFan = tuple[float, ...]

_BLOCK = 500
"""Samples drawn at once: one second's worth."""


class SensorSample(NamedTuple):
    """One sample of every sensor, axes forward, right, down (FRD).

    Attributes:
        time_ns: the flight controller's clock, boot at 0 [ns].
        angular_velocity: [rad/s].
        specific_force: [m/s^2]; (0, 0, -9.81) at rest, level.
        magnetic_field: [gauss].
        pressure: of the air [Pa].
        battery_voltage: at the power module [V].
        battery_current: drawn from the battery [A].
        fan_speed: of each rotor, by its speed controller's telemetry [rad/s]; NaN without,
            or none.
        fan_current: that each speed controller takes [A]; as `fan_speed`.
    """

    time_ns: int
    angular_velocity: Vector
    specific_force: Vector
    magnetic_field: Vector
    pressure: float
    battery_voltage: float
    battery_current: float
    fan_speed: PerFan = ()
    fan_current: PerFan = ()


@dataclass(frozen=True)
class ImuErrors:
    """Standard deviations of the errors of a Pixhawk 2.4.8's sensors, each per axis.

    Attributes:
        gyro_density: white noise [rad/s/sqrt(Hz)]; MPU-6000 data sheet: 0.005 deg/s/sqrt(Hz).
        accel_density: white noise [m/s^2/sqrt(Hz)]; the same sheet: 400 ug/sqrt(Hz).
        mag_noise: white noise of a sample [gauss].
        gyro_bias: what a calibration leaves, constant from boot on [rad/s].
        accel_bias: the same [m/s^2].
        mag_bias: the same, hard iron [gauss].
        pressure_noise: white noise of a sample [Pa].
        voltage_noise: of the power module [V].
        current_noise: of the power module [A].
    """

    gyro_density: float = 8.7e-5
    accel_density: float = 3.9e-3
    mag_noise: float = 3e-3
    gyro_bias: float = 5e-3
    accel_bias: float = 0.05
    mag_bias: float = 5e-3
    pressure_noise: float = 3.0
    voltage_noise: float = 0.01
    current_noise: float = 0.2


NO_ERRORS = ImuErrors(*[0.0] * 9)
"""Perfect sensors."""


class AutopilotImu:
    """Adds errors to true samples. The errors of the k-th sample depend on the seed and k alone."""

    def __init__(self, errors: ImuErrors, seed: int, rate: float = 500.0):
        """Power the sensors on.

        Args:
            errors: how large they are.
            seed: of the noise and of the biases.
            rate: of the samples [Hz]; white noise has its density up to half of it.
        """
        self._generator = np.random.default_rng(seed)
        band = (0.5 * rate) ** 0.5
        self._bias = self._generator.standard_normal(9) * np.repeat(
            [errors.gyro_bias, errors.accel_bias, errors.mag_bias], 3
        )
        self._bias = np.append(self._bias, np.zeros(3))
        self._white = np.append(
            np.repeat(
                [errors.gyro_density * band, errors.accel_density * band, errors.mag_noise], 3
            ),
            [errors.pressure_noise, errors.voltage_noise, errors.current_noise],
        )
        self._rows = self._draw()

    def _draw(self) -> Iterator[list[float]]:
        """Yield the errors of one sample after the other."""
        while True:
            drawn = self._generator.standard_normal((_BLOCK, 12))
            yield from (drawn * self._white + self._bias).tolist()

    def measure(self, true: SensorSample) -> SensorSample:
        """Return what the sensors say of true values."""
        gx, gy, gz, ax, ay, az, mx, my, mz, pressure, voltage, current = next(self._rows)
        p, q, r = true.angular_velocity
        a, b, c = true.specific_force
        h, i, j = true.magnetic_field
        return SensorSample(
            true.time_ns,
            (p + gx, q + gy, r + gz),
            (a + ax, b + ay, c + az),
            (h + mx, i + my, j + mz),
            true.pressure + pressure,
            true.battery_voltage + voltage,
            true.battery_current + current,
            true.fan_speed,
            true.fan_current,
        )
