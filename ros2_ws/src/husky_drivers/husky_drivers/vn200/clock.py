"""Stamps from the device's clock: taken as they are, or mapped to the host's clock."""

from __future__ import annotations

from collections import deque

_BLOCK_NS = 1_000_000_000
"""Time over which one minimum is taken [ns]."""
_BLOCKS = 30
"""Minima that the drift is estimated from."""
_MAX_DRIFT = 200e-6
"""Greatest drift between two crystals that is believed."""
_JUMP_NS = 50_000_000
"""An offset this far from the prediction is a clock that was set, not a delay [ns]."""
_PATIENCE_NS = 500_000_000
"""A late offset counts as a set clock only when none has been near for so long [ns]."""


class DeviceClock:
    """The device's time is ROS time: the simulation's emulator counts simulated time.

    Attributes:
        simulated: the device is emulated, and pauses with the world.
    """

    simulated = True

    def stamp(self, device_ns: int, host_ns: int) -> int:
        """Return the device's time [ns]."""
        return device_ns


class HostClock:
    """Maps the device's time to the host's by the smallest delay seen, following the drift.

    A packet is never early, often punctual, sometimes late: host minus device time is offset plus
    delay with a sharp lower edge. The edge is a straight line in device time; its slope (the drift)
    is the line through the minima of one-second blocks of the last half minute, its height the
    lowest that touches a minimum. So jitter of scheduling and of the USB adapter does not reach the
    stamps; the smallest delay itself (transmission, 0.6 ms for 54 bytes at 921600 baud) stays in
    them unless `latency` takes it out. Stamps never go back, but when a clock was set.

    Attributes:
        simulated: the device is emulated.
        drift: between the two clocks [-].
        resets: how often one of them was set.
    """

    simulated = False

    def __init__(self, latency: float = 0.0):
        """Start without an offset; `latency` is the smallest delay, taken off each stamp [s]."""
        self._latency = round(latency * 1e9)
        self._minima: deque[tuple[int, int]] = deque(maxlen=_BLOCKS)
        self._last_stamp = -(1 << 62)
        self._last_device = -1
        self.drift = 0.0
        self.resets = 0
        self._restart(0, 0)

    def _restart(self, device_ns: int, offset: int) -> None:
        self._minima.clear()
        self.drift = 0.0
        self._origin = device_ns
        self._offset = float(offset)
        self._block_start = device_ns
        self._block_minimum = (device_ns, offset)
        self._near_at = device_ns

    def stamp(self, device_ns: int, host_ns: int) -> int:
        """Return the host's time [ns] of a sample of `device_ns` that was read at `host_ns`."""
        offset = host_ns - device_ns
        residual = offset - self._predict(device_ns)
        if device_ns < self._last_device or self._last_device < 0 or residual < -_JUMP_NS:
            self._reset(device_ns, offset)
        elif residual < 0.0:
            self._offset += residual
            self._near_at = device_ns
        elif residual < _JUMP_NS:
            self._near_at = device_ns
        elif device_ns - self._near_at > _PATIENCE_NS:
            self._reset(device_ns, offset)
        self._last_device = device_ns
        if offset - self.drift * (device_ns - self._block_minimum[0]) < self._block_minimum[1]:
            self._block_minimum = (device_ns, offset)
        if device_ns - self._block_start >= _BLOCK_NS:
            self._end_block(device_ns, offset)
        stamp = device_ns + round(self._predict(device_ns)) - self._latency
        self._last_stamp = max(stamp, self._last_stamp + 1)
        return self._last_stamp

    def _reset(self, device_ns: int, offset: int) -> None:
        """One of the clocks was set: what was learnt no longer holds."""
        if self._last_device >= 0:
            self.resets += 1
            self._last_stamp = -(1 << 62)
        self._restart(device_ns, offset)

    def _predict(self, device_ns: int) -> float:
        return self._offset + self.drift * (device_ns - self._origin)

    def _end_block(self, device_ns: int, offset: int) -> None:
        """Fit the edge anew to the minima."""
        self._minima.append(self._block_minimum)
        self._block_start = device_ns
        self._block_minimum = (device_ns, offset)
        origin, base = self._minima[-1]
        times = [float(time - origin) for time, _ in self._minima]
        offsets = [float(value - base) for _, value in self._minima]
        mean_time = sum(times) / len(times)
        mean_offset = sum(offsets) / len(offsets)
        spread = sum((time - mean_time) ** 2 for time in times)
        if len(times) >= 3:
            slope = sum(
                (time - mean_time) * (value - mean_offset)
                for time, value in zip(times, offsets, strict=True)
            )
            self.drift = min(_MAX_DRIFT, max(-_MAX_DRIFT, slope / spread))
        self._origin = origin
        self._offset = base + min(
            value - self.drift * time for time, value in zip(times, offsets, strict=True)
        )
