"""Noise of the emulated VN-200: white noise, slow biases and a slow attitude error, from a seed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from husky_drivers.vn200.imu import ImuFigures

_BLOCK = 800
"""Samples drawn at once: one second's worth."""


class ImuNoise:
    """An endless sequence of errors, one per sample of the device.

    Biases and attitude error are first-order Gauss-Markov processes that start in their stationary
    distribution; the white noise has the density of the figures up to the Nyquist frequency.
    """

    def __init__(self, figures: ImuFigures, seed: int):
        """Start a sequence of errors of these sizes; equal seeds give equal sequences."""
        self._generator = np.random.default_rng(seed)
        self._white = np.repeat([figures.gyro_noise, figures.accel_noise], 3)
        self._slow_rms = np.array(
            [figures.gyro_bias] * 3
            + [figures.accel_bias] * 3
            + [0.5 * figures.tilt_error] * 2  # Halved: the quaternion takes half the angle.
            + [0.5 * figures.heading_error]
        )
        times = [figures.bias_correlation_time] * 6 + [figures.attitude_correlation_time] * 3
        self._decay = np.exp(-1.0 / (figures.rate * np.array(times)))
        self._slow = self._slow_rms * self._generator.standard_normal(9)
        self._powers = self._decay ** np.arange(1, _BLOCK + 1)[:, None]
        if self._powers.min() < 1e-200:
            raise ValueError(f"a correlation time of the IMU is {min(times)} s, which is too short")
        self._rows = self._endless_rows()

    def next(self) -> list[float]:
        """Return the next sample's errors, 9 numbers.

        Angular rate [rad/s] (3) and specific force [m/s^2] (3) in FLU body axes, half of the
        attitude's error as a rotation vector in ENU world axes [rad] (3).
        """
        return next(self._rows)

    def _endless_rows(self) -> Iterator[list[float]]:
        while True:
            yield from self._block().tolist()

    def _block(self) -> NDArray[np.float64]:
        """Return a block of rows; shape (_BLOCK, 9)."""
        drawn = self._generator.standard_normal((_BLOCK, 15))
        # x[k] = decay x[k-1] + drive[k], summed up in closed form.
        drive = drawn[:, 6:] * (self._slow_rms * np.sqrt(1.0 - self._decay**2))
        slow: NDArray[np.float64] = self._powers * (
            self._slow + np.cumsum(drive / self._powers, axis=0)
        )
        self._slow = slow[-1].copy()
        slow[:, :6] += drawn[:, :6] * self._white
        return slow
