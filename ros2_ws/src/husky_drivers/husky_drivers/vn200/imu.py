"""Samples of the VN-200: which are good, and how they look in ROS axes (REP-103)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from husky_description.rotation import Vector, rotate
from husky_description.sections import ImuSection
from husky_drivers.clock_restart import ClockRestart

Values = tuple[float, ...]
"""Payload of `IMU_LAYOUT`: time since start-up [ns, int], quaternion (x, y, z, w) FRD body to NED,
angular rate [rad/s] and specific force [m/s^2] in FRD body axes; 11 numbers."""

_MAX_ANGULAR_RATE = 200.0
"""Greatest sum of the rates' magnitudes that is believed [rad/s]: beyond the gyroscope's range."""
_MAX_SPECIFIC_FORCE = 2000.0
"""Greatest sum of the forces' magnitudes that is believed [m/s^2]: beyond the range likewise."""


@dataclass(frozen=True)
class ImuFigures:
    """Noise and ranges of a VN-200.

    Attributes:
        gyro_noise_density: white noise of the angular rate, one-sided [rad/s/sqrt(Hz)].
        accel_noise_density: white noise of the specific force, one-sided [m/s^2/sqrt(Hz)].
        gyro_bias: rms of the angular rate's bias on each axis [rad/s].
        accel_bias: rms of the specific force's bias on each axis [m/s^2].
        bias_correlation_time: time constant of both biases [s].
        gyro_range: greatest angular rate on each axis [rad/s].
        accel_range: greatest specific force on each axis [m/s^2].
        tilt_error: rms of the attitude's error about each horizontal axis [rad]. The maker's
            "dynamic accuracy" is 0.03 to 0.1 deg with GPS; the upper end is taken.
        heading_error: the same about the vertical [rad]; the maker's 0.2 to 0.3 deg likewise.
        attitude_correlation_time: time constant of the attitude's error [s]; assumed, about as
            long as such a filter trusts its gyroscope.
        rate: rate of the device's own loop, whose Nyquist frequency bounds the noise [Hz].
    """

    gyro_noise_density: float
    accel_noise_density: float
    gyro_bias: float
    accel_bias: float
    bias_correlation_time: float
    gyro_range: float
    accel_range: float
    tilt_error: float = math.radians(0.1)
    heading_error: float = math.radians(0.3)
    attitude_correlation_time: float = 10.0
    rate: float = 800.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            positive = name.endswith(("_time", "_range")) or name == "rate"
            if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
                least = "above 0" if positive else "0 or more"
                raise ValueError(f"{name} of the IMU is {value!r}, it must be {least}")

    @staticmethod
    def of(imu: ImuSection) -> ImuFigures:
        """Take the figures from the robot's description.

        A bias of rms b that is a first-order Gauss-Markov process with time constant T walks, over
        times short against T, with density b sqrt(2 / T): the description's walk gives T. Without a
        walk the bias is constant for all practical purposes. A device without noise and bias is
        taken to have no error of attitude, either.
        """
        walks = imu.accel_bias > 0.0 and imu.accel_bias_walk > 0.0
        time = 2.0 * (imu.accel_bias / imu.accel_bias_walk) ** 2 if walks else 1e6
        same = {f.name: getattr(imu, f.name) for f in fields(ImuFigures) if hasattr(imu, f.name)}
        errors = (imu.gyro_noise_density, imu.accel_noise_density, imu.gyro_bias, imu.accel_bias)
        if not any(errors):
            same |= {"tilt_error": 0.0, "heading_error": 0.0}
        return ImuFigures(bias_correlation_time=time, **same)

    @property
    def gyro_noise(self) -> float:
        """Standard deviation of one sample's angular rate without bias [rad/s]."""
        return self.gyro_noise_density * math.sqrt(0.5 * self.rate)

    @property
    def accel_noise(self) -> float:
        """Standard deviation of one sample's specific force without bias [m/s^2]."""
        return self.accel_noise_density * math.sqrt(0.5 * self.rate)

    @property
    def orientation_variance(self) -> Vector:
        """Variances about x, y, z of the world [rad^2]."""
        return self.tilt_error**2, self.tilt_error**2, self.heading_error**2

    @property
    def angular_velocity_variance(self) -> float:
        """Variance on each axis [rad^2/s^2]."""
        return self.gyro_noise**2 + self.gyro_bias**2

    @property
    def linear_acceleration_variance(self) -> float:
        """Variance on each axis [m^2/s^4]."""
        return self.accel_noise**2 + self.accel_bias**2


@dataclass
class SampleCounters:
    """What became of the packets since the driver started.

    Attributes:
        good: samples handed out.
        repeated: packets whose time did not move on, see `ClockRestart`; dropped.
        missed: packets missing between two samples, by their times.
        invalid: packets with a number out of range, or not a number; dropped.
        clock_restarts: times the device's clock went back: it has been started again.
    """

    good: int = 0
    repeated: int = 0
    missed: int = 0
    invalid: int = 0
    clock_restarts: int = 0


class SampleGate:
    """Lets new and sane samples through and counts the others."""

    def __init__(self, rate: float):
        """Start without a sample; packets come at a rate [Hz]."""
        self.counters = SampleCounters()
        self._period = 1e9 / rate
        self._last_time = -1
        self._restart = ClockRestart()

    def restart(self) -> None:
        """The line was interrupted: the next sample has no predecessor."""
        self._last_time = -1

    def accept(self, values: Values) -> bool:
        """Return whether a sample is new and sane."""
        time, x, y, z, w, p, q, r, a, b, c = values
        counters = self.counters
        if not (  # Written so that a NaN is refused.
            0.98 < x * x + y * y + z * z + w * w < 1.02
            and abs(p) + abs(q) + abs(r) < _MAX_ANGULAR_RATE
            and abs(a) + abs(b) + abs(c) < _MAX_SPECIFIC_FORCE
        ):
            counters.invalid += 1
            return False
        step = time - self._last_time
        if self._last_time >= 0:
            if step > 0:
                self._restart.moved_on()
                if step > 1.5 * self._period:
                    counters.missed += round(step / self._period) - 1
            elif self._restart.is_restart(time, self._last_time):
                counters.clock_restarts += 1
            else:
                counters.repeated += 1
                return False
        self._last_time = int(time)
        counters.good += 1
        return True


class GravityCheck:
    """Angle between gravity as the accelerometer feels it and as the reported attitude has it.

    A tare turns the attitude and leaves no trace in a register. But the specific force, turned into
    the world by the attitude, is gravity upside down in the mean over a time in which the body's
    speed changes little, walking and flying too: over 10 s, 1 m/s tilts it by 0.6 deg.
    """

    limit = math.radians(5.0)
    """Angle that no speed of the robot explains [rad]."""

    def __init__(self, time: float = 10.0, period: float = 0.02):
        """Start with nothing known.

        Args:
            time: time constant of the mean [s].
            period: least time between two samples that are taken: it costs a rotation each [s].
        """
        self._time, self._period = time, period
        self._begin()

    def _begin(self) -> None:
        self._last = -math.inf
        self._weight = 0.0
        self._sum: Vector = (0.0, 0.0, 0.0)

    def take(self, values: Values) -> None:
        """Take a sample; one before the last begins a new mean."""
        now = 1e-9 * values[0]
        step = now - self._last
        if 0.0 <= step < self._period:
            return
        if not 0.0 <= step < self._time:
            self._begin()
            step = self._period
        self._last = now
        share = -math.expm1(-step / self._time)
        _, x, y, z, w, _, _, _, a, b, c = values
        force = rotate((x, y, z, w), (a, b, c))
        north, east, down = (
            old + share * (new - old) for old, new in zip(self._sum, force, strict=True)
        )
        self._sum = (north, east, down)
        self._weight += share * (1.0 - self._weight)

    @property
    def angle(self) -> float:
        """Angle between the two directions [rad]; NaN before the mean is one of `1.6 time`."""
        north, east, down = self._sum
        if self._weight < 0.8:
            return math.nan
        return math.atan2(math.hypot(north, east), -down)

    @property
    def disagrees(self) -> bool:
        """True if the attitude has been turned, or has not found gravity."""
        return self.angle > self.limit
