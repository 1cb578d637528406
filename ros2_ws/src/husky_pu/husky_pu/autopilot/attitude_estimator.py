"""Attitude from gyro, accelerometer and magnetometer: a complementary filter.

The law and its default weights are those of PX4's `attitude_estimator_q` (after Mahony, Hamel and
Pflimlin, "Nonlinear complementary filters on the special orthogonal group", IEEE TAC 2008). The
heading follows the magnetometer alone and roll and pitch the accelerometer alone.

Two things are those of PX4's EKF2. A unit at rest takes the accelerometer's word for what is level
within half a second and reads off the gyro's bias, as zero-velocity updates do. Whether the
accelerometer counts is judged behind a low-pass: judged sample by sample it would count in some
phases of a stride and not in others, and their mean is not level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from husky_description.gravity import GRAVITY
from husky_description.rotation import Quaternion, Vector, from_roll_pitch_yaw

_ALIGNMENT = 50
"""Samples averaged for the first attitude: 0.1 s."""
_SLOW_SPIN = 0.175
"""Rate below which the bias is learnt [rad/s], as in PX4."""
_BIAS_TIME = 0.5
"""Time constant of the bias that is read off a unit at rest [s]."""
_REST_WEIGHT = 2.0
"""Of the accelerometer on a unit at rest, where it feels nothing but gravity [1/s]."""
_SHAKE_TIME = 0.1
"""Time constant of the specific force by which the accelerometer is judged [s]."""


@dataclass(frozen=True)
class EstimatorWeights:
    """Weights of the corrections.

    Attributes:
        accel: of the accelerometer's [1/s], PX4's ATT_W_ACC.
        mag: of the magnetometer's [1/s], ATT_W_MAG.
        gyro_bias: of the bias [1/s], ATT_W_GYRO_BIAS.
        bias_limit: of the bias [rad/s], ATT_BIAS_MAX.
        declination: of the magnetic field, east positive [rad], ATT_MAG_DECL.
    """

    accel: float = 0.2
    mag: float = 0.1
    gyro_bias: float = 0.1
    bias_limit: float = 0.05
    declination: float = 0.0


class AttitudeEstimator:
    """Turns samples into an attitude.

    Attributes:
        attitude: quaternion (x, y, z, w), body FRD to NED.
        rates: angular velocity in the body without the estimated bias [rad/s].
        gyro_bias: estimate [rad/s].
        aligned: whether `attitude` is valid.
    """

    def __init__(self, weights: EstimatorWeights | None = None):
        """Start without an attitude; the first 0.1 s of samples give it."""
        self.weights = weights if weights is not None else EstimatorWeights()
        self.attitude: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self.rates: Vector = (0.0, 0.0, 0.0)
        self.gyro_bias: Vector = (0.0, 0.0, 0.0)
        self.aligned = False
        self._count = 0
        self._sums = [0.0] * 9
        self._felt: Vector = (0.0, 0.0, 0.0)  # specific force behind the low-pass [m/s^2]

    def update(
        self, gyro: Vector, accel: Vector, mag: Vector, dt: float, *, at_rest: bool = False
    ) -> None:
        """Take one sample.

        Args:
            gyro: [rad/s] FRD.
            accel: specific force [m/s^2] FRD.
            mag: field [gauss] FRD; zero when there is no magnetometer: the heading is free then.
            dt: since the last sample [s].
            at_rest: the unit is known to be still: the gyro shows its bias, the accelerometer
                what is level.
        """
        if not self.aligned:
            self._align(gyro, accel, mag)
            return
        w = self.weights
        x, y, z, s = self.attitude
        bx, by, bz = self.gyro_bias
        gx, gy, gz = gyro
        ax, ay, az = accel
        # The direction down in the body: third row of the rotation matrix.
        dx, dy, dz = 2 * (x * z - s * y), 2 * (y * z + s * x), 1 - 2 * (x * x + y * y)
        cx = cy = cz = 0.0
        mx, my, mz = mag
        if mx or my or mz:
            north = (1 - 2 * (y * y + z * z)) * mx + 2 * (x * y - s * z) * my
            north += 2 * (x * z + s * y) * mz
            east = 2 * (x * y + s * z) * mx + (1 - 2 * (x * x + z * z)) * my
            east += 2 * (y * z - s * x) * mz
            error = -w.mag * _wrap(math.atan2(east, north) - w.declination)
            cx, cy, cz = dx * error, dy * error, dz * error
        if 0.9 * GRAVITY < self._smooth(accel, dt) < 1.1 * GRAVITY:
            weight = max(w.accel, _REST_WEIGHT) if at_rest and w.accel > 0.0 else w.accel
            k = -weight / GRAVITY  # at rest the specific force points up
            cx += k * (ay * dz - az * dy)
            cy += k * (az * dx - ax * dz)
            cz += k * (ax * dy - ay * dx)
        if at_rest:
            k = dt / _BIAS_TIME
            bias = (bx + k * (gx - bx), by + k * (gy - by), bz + k * (gz - bz))
            bx, by, bz = (max(-w.bias_limit, min(w.bias_limit, b)) for b in bias)
        elif abs(gx - bx) + abs(gy - by) + abs(gz - bz) < _SLOW_SPIN:
            k, limit = w.gyro_bias * dt, w.bias_limit
            bx = max(-limit, min(limit, bx - k * cx))
            by = max(-limit, min(limit, by - k * cy))
            bz = max(-limit, min(limit, bz - k * cz))
        self.gyro_bias = (bx, by, bz)
        p, q, r = gx - bx, gy - by, gz - bz
        self.rates = (p, q, r)
        h = 0.5 * dt
        p, q, r = h * (p + cx), h * (q + cy), h * (r + cz)
        x, y, z, s = (
            x + s * p + y * r - z * q,
            y + s * q + z * p - x * r,
            z + s * r + x * q - y * p,
            s - x * p - y * q - z * r,
        )
        k = 1.0 / math.sqrt(x * x + y * y + z * z + s * s)
        self.attitude = (x * k, y * k, z * k, s * k)

    def _smooth(self, accel: Vector, dt: float) -> float:
        """Pass a specific force through the low-pass; return the length of what comes out."""
        k = dt / (_SHAKE_TIME + dt)
        x, y, z = (f + k * (a - f) for f, a in zip(self._felt, accel, strict=True))
        self._felt = (x, y, z)
        return math.sqrt(x * x + y * y + z * z)

    def _align(self, gyro: Vector, accel: Vector, mag: Vector) -> None:
        """Average, then take down from the accelerometer and north from the magnetometer."""
        self._sums = [a + b for a, b in zip(self._sums, (*gyro, *accel, *mag), strict=True)]
        self._count += 1
        self.rates = gyro
        if self._count < _ALIGNMENT:
            return
        mean = [total / self._count for total in self._sums]
        ax, ay, az = self._felt = (mean[3], mean[4], mean[5])
        roll = math.atan2(-ay, -az)
        pitch = math.atan2(ax, math.hypot(ay, az))
        mx, my, mz = mean[6:]
        # The field turned level by roll and pitch.
        across = my * math.cos(roll) - mz * math.sin(roll)
        down = my * math.sin(roll) + mz * math.cos(roll)
        along = mx * math.cos(pitch) + down * math.sin(pitch)
        level = math.atan2(-across, along) if any(mag) else 0.0
        self.attitude = from_roll_pitch_yaw(roll, pitch, level + self.weights.declination)
        self.aligned = True


def _wrap(angle: float) -> float:
    """Return an angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))
