"""A VN-200 to talk to: bytes in, bytes out, samples from the world; no port and no clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from husky_description.rotation import (
    Quaternion,
    conjugate,
    from_rows,
    multiply,
    rotate,
    swap_world_and_body,
)
from husky_drivers.vn200.binary import IMU_LAYOUT, BinaryOutput
from husky_drivers.vn200.commissioning import IDENTITY
from husky_drivers.vn200.imu import ImuFigures
from husky_drivers.vn200.protocol import MAX_LINE, ErrorCode, ProtocolError, decode_ascii
from husky_sim.devices.vn200.faults import LineFaults
from husky_sim.devices.vn200.noise import ImuNoise
from husky_sim.devices.vn200.registers import (
    FACTORY,
    Measurement,
    Registers,
    Vn200Settings,
    ascii_output,
    binary_values,
)

_TRANSMIT_BUFFER = 2048
"""Bytes that may wait to be sent before output is lost."""


@dataclass(frozen=True)
class Vn200Options:
    """How the emulated device behaves where manuals are silent or contradict themselves.

    Attributes:
        replies_at_new_baud: the reply to a change of baud rate goes out at the new rate.
        reset_time: silence after a reset, in the time of the samples [s].
        reset_restarts_clock: a reset sets the device's clock to zero. Off by default: in the
            simulation the device's clock is the robot's clock.
        model: content of register 1.
        saved: what somebody has left in its flash memory.
    """

    replies_at_new_baud: bool = False
    reset_time: float = 0.05
    reset_restarts_clock: bool = False
    model: str = "VN-200T-CR"
    saved: Vn200Settings = FACTORY


class Vn200Device:
    """Emulates a VN-200 on its serial port 1.

    Whoever owns the wire hands in the host's bytes with `feed` and carries `take_output` to the
    host, both at `baud`. The world calls `sample` at each instant of the device's own loop (800
    Hz); output is complete when `sample` returns. The errors of the k-th sample depend on the seed
    and on k alone, whatever is said on the line.
    """

    def __init__(self, figures: ImuFigures, seed: int = 0, options: Vn200Options | None = None):
        """Power the device on.

        Args:
            figures: noise and ranges.
            seed: of the noise, and of the randomness of faults.
            options: see `Vn200Options`.
        """
        self.options = options if options is not None else Vn200Options()
        self.figures = figures
        self._noise = ImuNoise(figures, seed)
        self._faults = LineFaults(seed)
        self._line = bytearray()
        self._output = bytearray()
        self._overflowed = False
        self._clock_start = 0
        self._now = 0
        self._silent_until = -1
        self._count = 0
        self._tare: Quaternion | None = None
        self._measurement: Measurement = (0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._registers = Registers(self.options.model, self.options.saved)
        self._power_on()

    def _power_on(self) -> None:
        """Start with what the flash memory holds."""
        self._registers.load()
        self._baud = self._registers.settings.baud
        self._baud_to_be: int | None = None
        frame = self._registers.settings.frame
        self._frame = None if frame == IDENTITY else from_rows(frame)
        self._paused = False
        self._line.clear()
        self._plan_output()

    # The wire -----------------------------------------------------------------------------------
    @property
    def baud(self) -> int:
        """Rate of the bytes that `feed` takes and of those that `take_output` has returned."""
        return self._baud

    def feed(self, data: bytes) -> None:
        """Take bytes from the host; any bytes."""
        self._change_baud()
        if self._now < self._silent_until or self._faults.kind == "stop":
            return
        self._line += data
        *lines, rest = bytes(self._line).split(b"\n")
        for line in lines:
            start = line.rfind(b"$")
            if start >= 0 and self._now >= self._silent_until:
                self._take_line(line[start:])
        self._line = bytearray(rest[max(0, rest.rfind(b"$")) :])
        if len(self._line) > MAX_LINE:
            self._line.clear()
            if rest.startswith(b"$"):
                self._complain(ErrorCode.SERIAL_BUFFER_OVERFLOW)

    def take_output(self) -> bytes:
        """Return the bytes to the host since the last call; they go at `baud`."""
        self._change_baud()
        output = bytes(self._output)
        self._output.clear()
        if self._overflowed:
            self._overflowed = False
            self._complain(ErrorCode.OUTPUT_BUFFER_OVERFLOW)
        return output

    @property
    def streaming(self) -> bool:
        """Whether samples go out as binary packets."""
        return bool(self._binary) and not self._paused and self._now >= self._silent_until

    def _change_baud(self) -> None:
        """Change the rate as soon as nothing is left to go out at the old one."""
        if self._baud_to_be is not None and not self._output:
            self._baud = self._baud_to_be
            self._baud_to_be = None

    # The world ----------------------------------------------------------------------------------
    def sample(
        self,
        time_ns: int,
        orientation: Sequence[float],
        angular_velocity: Sequence[float],
        specific_force: Sequence[float],
    ) -> None:
        """Measure, and send what is due.

        Args:
            time_ns: time of the world [ns].
            orientation: quaternion (x, y, z, w), FLU body to ENU world.
            angular_velocity: of the body in FLU body axes [rad/s] (3,).
            specific_force: at the sensor in FLU body axes [m/s^2] (3,): (0, 0, g) at rest, level.
        """
        self._now = time_ns
        gx, gy, gz, ax, ay, az, hx, hy, hz = self._noise.next()
        self._count += 1
        if self._faults.kind != "repeat":
            x, y, z, w = orientation
            p, q, r = angular_velocity
            a, b, c = specific_force
            gyro, accel = self.figures.gyro_range, self.figures.accel_range
            self._measurement = (
                time_ns - self._clock_start,
                *self._attitude(
                    x + hx * w + hy * z - hz * y,
                    y + hy * w + hz * x - hx * z,
                    z + hz * w + hx * y - hy * x,
                    w - hx * x - hy * y - hz * z,
                ),
                max(-gyro, min(gyro, p + gx)),
                max(-gyro, min(gyro, -q - gy)),
                max(-gyro, min(gyro, -r - gz)),
                max(-accel, min(accel, a + ax)),
                max(-accel, min(accel, -b - ay)),
                max(-accel, min(accel, -c - az)),
            )
            if self._frame is not None:
                self._measurement = _turned(self._measurement, self._frame)
        if self._paused or time_ns < self._silent_until:
            return
        if len(self._output) > _TRANSMIT_BUFFER:
            self._overflowed = True
            return
        for divisor, encode in self._plan:
            if not self._count % divisor:
                packet = encode(self._measurement)
                self._output += packet if not self._faults.kind else self._faults.apply(packet)

    def restart(self, seed: int) -> None:
        """The world starts again at time 0, with a seed; the host's settings stay, a fault too."""
        self._noise = ImuNoise(self.figures, seed)
        self._faults.reseed(seed)
        self._count = 0
        self._now = self._clock_start = 0
        self._silent_until = -1

    def _attitude(self, x: float, y: float, z: float, w: float) -> Quaternion:
        """Return the attitude that is reported, FRD body to NED, for one in ROS axes."""
        scale = 1.0 / (math.sqrt(x * x + y * y + z * z + w * w) or 1.0)
        attitude = swap_world_and_body((x * scale, y * scale, z * scale, w * scale))
        return attitude if self._tare is None else multiply(self._tare, attitude)

    def _plan_output(self) -> None:
        """Make the list of what is sent every so many samples."""
        settings = self._registers.settings
        self._binary: list[tuple[int, Callable[[Measurement], bytes]]] = [
            (output.rate_divisor, _encoder(output))
            for output in settings.outputs
            if output.layout is not None and output.async_mode & 1
        ]
        ascii_encoder = ascii_output(settings)
        rate = round(self.figures.rate)
        ascii_plan = [] if ascii_encoder is None else [(rate // settings.async_rate, ascii_encoder)]
        self._plan = ascii_plan + self._binary

    # Commands -----------------------------------------------------------------------------------
    def _take_line(self, line: bytes) -> None:
        """Carry out one line of the host and reply."""
        try:
            message = decode_ascii(line)
            reply = self._execute(message.command, message.fields)
        except ProtocolError as error:
            self._complain(error.code)
            return
        self._send(self._registers.reply(message, reply))
        if message.command == "RST":
            self._restart()
        elif message.command == "RFS":
            self._registers.factory_reset()
            self._restart()
        elif self._registers.settings.baud != self._baud:
            self._baud_to_be = self._registers.settings.baud
            if self.options.replies_at_new_baud:
                self._baud = self._baud_to_be

    def _execute(self, command: str, fields: tuple[str, ...]) -> tuple[str, ...]:
        """Return the fields of the reply; raises ProtocolError for a command that is refused."""
        if command == "RRG":
            return self._registers.read(fields, self._measurement)
        if command == "WRG":
            reply = self._registers.write(fields)
            self._plan_output()
            return reply
        if command == "ASY":
            if fields not in (("0",), ("1",)):
                raise ProtocolError(ErrorCode.INVALID_PARAMETER, f"ASY {','.join(fields)}")
            self._paused = fields == ("0",)
            return fields
        if command not in ("WNV", "RFS", "RST", "TAR"):
            raise ProtocolError(ErrorCode.INVALID_COMMAND, f"command {command}")
        if fields:
            raise ProtocolError(ErrorCode.TOO_MANY_PARAMETERS, f"command {command}")
        if command == "WNV":
            self._registers.save()
        elif command == "TAR":
            _, x, y, z, w, *_ = self._measurement
            self._tare = multiply((-x, -y, -z, w), self._tare or (0.0, 0.0, 0.0, 1.0))
        return ()

    def _restart(self) -> None:
        """Fall silent and come back with the settings of the flash memory."""
        self._silent_until = self._now + round(self.options.reset_time * 1e9)
        self._tare = None
        if self.options.reset_restarts_clock:
            self._clock_start = self._now
        baud = self._baud
        self._power_on()
        if self._output and self._baud != baud:
            self._baud, self._baud_to_be = baud, self._baud

    def _complain(self, code: ErrorCode) -> None:
        """Send an error, as register 30 wants it."""
        if self._registers.error_mode:
            self._send(self._registers.error(code))
        if self._registers.error_mode == 2:
            self._registers.stop_ascii_output()
            self._plan_output()

    def _send(self, data: bytes) -> None:
        if self._faults.kind != "stop":
            self._output += data

    # Faults -------------------------------------------------------------------------------------
    def inject(self, fault: str, intensity: float | None = None) -> None:
        """Make the device or its line fail, until another fault or "" is injected.

        Args:
            fault: one of `faults.FAULTS`; "" clears.
            intensity: how strong or how often, see there; None for the default.

        Raises:
            ValueError: no such fault, or an intensity that is out of range.
        """
        if fault == "power_cycle":
            self._faults.set("")
            self._output.clear()
            self._restart()
        else:
            self._faults.set(fault, intensity)


def _turned(measurement: Measurement, frame: Quaternion) -> Measurement:
    """Return what a device measures whose reference frame rotation is not the identity."""
    time_ns, x, y, z, w, p, q, r, a, b, c = measurement
    return (
        time_ns,
        *multiply((x, y, z, w), conjugate(frame)),
        *rotate(frame, (p, q, r)),
        *rotate(frame, (a, b, c)),
    )


def _encoder(output: BinaryOutput) -> Callable[[Measurement], bytes]:
    """Return what makes a packet of a measurement."""
    layout = output.layout
    assert layout is not None
    if layout == IMU_LAYOUT:
        return lambda measurement: layout.encode(*measurement)
    return lambda measurement: layout.encode(*binary_values(layout.fields, measurement))
