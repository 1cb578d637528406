"""A RealSense T265Section to talk to: truth from the world in, pose frames as bytes out."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Any

from husky_description.rotation import (
    Quaternion,
    Vector,
    about_z,
    from_roll_pitch_yaw,
    multiply,
    rotate,
)
from husky_description.sections import T265Section
from husky_drivers.t265.frames import (
    Confidence,
    PoseFrame,
    rotation_from_ros,
    vector_from_ros,
)
from husky_drivers.t265.wire import BAUD, START, encode
from husky_sim.devices.t265.errors import Drift, normals

FAULTS = {
    "jump": (0.3, "once: the camera relocalises and the pose jumps by so many metres"),
    "freeze": (0.0, "no frames"),
    "lost": (0.05, "tracking fails; the pose goes on by a wrong acceleration of so much [m/s^2]"),
    "power_cycle": (0.0, "once: the camera starts again, at zero and with low confidence"),
}
"""Faults: default intensity, and what they do."""

_TRANSMIT_BUFFER = 4096
"""Bytes that may wait to be sent before output is lost."""
_NOISE_FACTOR = (4.0, 4.0, 2.0, 1.0)
"""By the tracker's confidence, of all noise; assumed."""
_BLUR_TIME_NS = 500_000_000
"""How long confidence stays low after a fast rotation [ns]; assumed."""
_DERIVATIVE_TIME = 0.02
"""Over which the camera is taken to differentiate its angular velocity [s]; assumed."""
_ZERO: Vector = (0.0, 0.0, 0.0)


class T265Device:
    """Stands for the camera, its tracking, and its wire (`husky_drivers.t265.wire`).

    Whoever owns the wire hands in the host's bytes with `feed` and carries `take_output` to the
    host. The world calls `sample` at each instant of the pose stream (200 Hz). The camera tracks
    from the first sample on, whenever the host starts to listen: what it says of the k-th sample
    depends on the seed, on the motion up to there and on k, not on the host.

    Attributes:
        streaming: whether the host has asked for frames.
    """

    def __init__(self, figures: T265Section, seed: int = 0):
        """Power the camera on; the seed is of noise, drift and the randomness of faults."""
        self.figures = figures
        self.streaming = False
        self._mount: Vector = tuple(figures.position.tolist())
        self._mount_rotation = from_roll_pitch_yaw(*figures.rpy.tolist())
        self._period = 1.0 / figures.rate
        self._fault = ""
        self._acceleration_error = _ZERO
        self._heard = b""
        self._output = bytearray()
        self.restart(seed)

    def restart(self, seed: int) -> None:
        """The world starts again at time 0; a host that listens does so still, a fault stays."""
        self._normals = normals(seed)
        self._random = random.Random(f"t265 faults {seed}")
        self._power_on()

    def _power_on(self) -> None:
        """Forget where the camera is: the next sample is the start."""
        self._drift = Drift(self.figures.drift, self.figures.drift_length, next(self._normals)[:3])
        self._number = 0
        self._started_ns = self._last_ns = -1
        self._blurred_until_ns = -1
        self._origin = self._true = self._taken_for = _ZERO
        self._start_heading: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self._velocity_error = _ZERO

    # The wire -----------------------------------------------------------------------------------
    @property
    def baud(self) -> int:
        """Rate of the bytes in both directions."""
        return BAUD

    def feed(self, data: bytes) -> None:
        """Take bytes from the host; any bytes."""
        heard = self._heard + data
        self.streaming = self.streaming or START in heard
        self._heard = heard[1 - len(START) :]

    def take_output(self) -> bytes:
        """Return the bytes to the host since the last call."""
        output = bytes(self._output)
        self._output.clear()
        return output

    # The world ----------------------------------------------------------------------------------
    def sample(self, *motion: Any) -> None:
        """Track, and send a frame; the arguments of `track`."""
        frame = self.track(*motion)
        if self.streaming and self._fault != "freeze" and len(self._output) < _TRANSMIT_BUFFER:
            self._output += encode(frame)

    def track(
        self,
        time_ns: int,
        position: Vector,
        orientation: Quaternion,
        velocity: Vector,
        angular_velocity: Vector,
    ) -> PoseFrame:
        """Return the frame of an instant.

        Args:
            time_ns: time of the world [ns].
            position: of base in world [m] (3,).
            orientation: base to world, (x, y, z, w).
            velocity: of the origin of base in world [m/s] (3,).
            angular_velocity: in base [rad/s] (3,).
        """
        # The truth of the camera in world, ROS axes.
        a, b, c = rotate(orientation, self._mount)
        x, y, z = position
        vx, vy, vz = velocity
        wx, wy, wz = rotate(orientation, angular_velocity)
        camera = (x + a, y + b, z + c)
        velocity = (vx + wy * c - wz * b, vy + wz * a - wx * c, vz + wx * b - wy * a)
        attitude = multiply(orientation, self._mount_rotation)
        if self._started_ns < 0:
            self._start(time_ns, camera, attitude)

        # The same seen from the start pose.
        back = self._start_heading
        ox, oy, oz = self._origin
        true = rotate(back, (camera[0] - ox, camera[1] - oy, camera[2] - oz))
        velocity = rotate(back, velocity)
        rate = rotate(back, (wx, wy, wz))
        attitude = multiply(back, attitude)
        if self._number == 0:
            self._last_velocity, self._last_rate = velocity, rate

        # What tracking makes of it.
        noise = next(self._normals)
        dt = 1e-9 * (time_ns - self._last_ns) if self._last_ns >= 0 else self._period
        velocity_taken_for = self._lose_the_way(true, velocity, dt, noise)
        turn = about_z(self._drift.heading)
        tracker, mapper = self._confidences(time_ns, rate)
        frame = self._frame(
            time_ns,
            velocity_taken_for,
            _difference(velocity, self._last_velocity, dt),
            multiply(turn, attitude),
            rotate(turn, rate),
            _difference(rate, self._last_rate, dt),
            tracker,
            mapper,
            noise,
        )
        self._true, self._last_velocity, self._last_rate = true, velocity, rate
        self._last_ns = time_ns
        self._number += 1
        return frame

    def _lose_the_way(
        self, true: Vector, velocity: Vector, dt: float, noise: Sequence[float]
    ) -> Vector:
        """Move on the place that the camera takes for its own; return the velocity it takes so.

        Args:
            true: place in its own world [m].
            velocity: in it [m/s].
            dt: since the last frame [s].
            noise: of this frame.
        """
        (x, y, z), (lx, ly, lz) = true, self._true
        step = (x - lx, y - ly, z - lz)
        drift = self._drift
        drift.advance(math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2), *noise[15:])
        ex, ey, ez = self._dead_reckon(dt)
        dx, dy, dz = drift.apply(step)
        x, y, z = self._taken_for
        self._taken_for = (x + dx + ex * dt, y + dy + ey * dt, z + dz + ez * dt)
        dx, dy, dz = drift.apply(velocity)
        return dx + ex, dy + ey, dz + ez

    def _start(self, time_ns: int, camera: Vector, attitude: Quaternion) -> None:
        """Put the camera's world where the camera is: levelled, heading along the view."""
        self._started_ns = time_ns
        self._origin = camera
        x, y, _ = rotate(attitude, (1.0, 0.0, 0.0))
        self._start_heading = about_z(-math.atan2(y, x))

    def _dead_reckon(self, dt: float) -> Vector:
        """Return the error of the velocity: it grows while tracking is lost [m/s]."""
        if self._fault != "lost":
            return self._velocity_error
        ex, ey, ez = self._velocity_error
        ax, ay, az = self._acceleration_error
        self._velocity_error = (ex + ax * dt, ey + ay * dt, ez + az * dt)
        return self._velocity_error

    def _confidences(self, time_ns: int, rate: Vector) -> tuple[int, int]:
        """Return tracker and mapper confidence."""
        x, y, z = rate
        if x * x + y * y + z * z > self.figures.fast_rotation**2:
            self._blurred_until_ns = time_ns + _BLUR_TIME_NS
        age = 1e-9 * (time_ns - self._started_ns)
        warm_up = self.figures.warm_up
        if self._fault == "lost":
            return Confidence.FAILED, Confidence.FAILED
        tracker = Confidence.HIGH
        if age < warm_up or time_ns < self._blurred_until_ns:
            tracker = Confidence.LOW
        elif age < 2.0 * warm_up:
            tracker = Confidence.MEDIUM
        # The map takes longer, and is not lost by a blurred image.
        mapper = min(Confidence.HIGH, int(age / (2.0 * warm_up))) if warm_up else Confidence.HIGH
        return tracker, mapper

    def _frame(
        self,
        time_ns: int,
        velocity: Vector,
        acceleration: Vector,
        attitude: Quaternion,
        rate: Vector,
        angular_acceleration: Vector,
        tracker: int,
        mapper: int,
        noise: Sequence[float],
    ) -> PoseFrame:
        """Return a frame in the T265's axes, with noise."""
        figures = self.figures
        factor = _NOISE_FACTOR[tracker]
        px, py, pz, hx, hy, hz, vx, vy, vz, wx, wy, wz, ax, ay, az = noise[:15]
        half = 0.5 * factor * figures.attitude_noise
        p, v = factor * figures.position_noise, factor * figures.velocity_noise
        w, a = factor * figures.angular_velocity_noise, factor * figures.acceleration_noise
        dw = w / _DERIVATIVE_TIME
        x, y, z, s = multiply((half * hx, half * hy, half * hz, 1.0), attitude)
        norm = 1.0 / math.sqrt(x * x + y * y + z * z + s * s)
        return PoseFrame(
            self._number,
            1e-6 * time_ns,
            vector_from_ros(_add(self._taken_for, p, px, py, pz)),
            vector_from_ros(_add(velocity, v, vx, vy, vz)),
            vector_from_ros(_add(acceleration, a, ax, ay, az)),
            rotation_from_ros((x * norm, y * norm, z * norm, s * norm)),
            vector_from_ros(_add(rate, w, wx, wy, wz)),
            vector_from_ros(_add(angular_acceleration, dw, wx, wy, wz)),
            tracker,
            mapper,
        )

    # Faults -------------------------------------------------------------------------------------
    def inject(self, fault: str, intensity: float | None = None) -> None:
        """Make the camera fail, until another fault or "" is injected.

        After a jump, or where it was lost, the pose stays as wrong as it is.

        Args:
            fault: one of `FAULTS`; "" clears.
            intensity: how strong, 0 to 100, see `FAULTS`; None for the default.

        Raises:
            ValueError: no such fault, or an intensity that is out of range.
        """
        if fault and fault not in FAULTS:
            raise ValueError(f"no fault {fault!r}; there are {', '.join(FAULTS)}")
        if intensity is not None and not 0.0 <= intensity <= 100.0:
            raise ValueError(f"intensity of {fault} is {intensity}, it must be within 0 and 100")
        strength = intensity if intensity is not None else FAULTS[fault][0] if fault else 0.0
        self._fault = fault if fault in ("freeze", "lost") else ""
        self._velocity_error = _ZERO
        direction = self._random.uniform(-math.pi, math.pi) if fault in ("jump", "lost") else 0.0
        offset = (strength * math.cos(direction), strength * math.sin(direction), 0.0)
        if fault == "jump":
            self._taken_for = _add(self._taken_for, 1.0, *offset)
        elif fault == "lost":
            self._acceleration_error = offset
        elif fault == "power_cycle":
            self._power_on()


def _add(vector: Vector, factor: float, x: float, y: float, z: float) -> Vector:
    a, b, c = vector
    return a + factor * x, b + factor * y, c + factor * z


def _difference(new: Vector, old: Vector, dt: float) -> Vector:
    x, y, z = new
    a, b, c = old
    rate = 1.0 / dt if dt > 0.0 else 0.0
    return (x - a) * rate, (y - b) * rate, (z - c) * rate
