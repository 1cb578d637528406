"""Which pose frames are good, and what they say of the tracking: repeats, gaps, jumps, losses."""

from __future__ import annotations

import math
from dataclasses import dataclass

from husky_description.rotation import Quaternion, Vector
from husky_drivers.camera_link import LATEST_TIME_MS
from husky_drivers.clock_restart import ClockRestart
from husky_drivers.t265.frames import Confidence, PoseFrame

_MAX_TRANSLATION = 1e5
_MAX_VELOCITY = 100.0
_MAX_ANGULAR_VELOCITY = 200.0
"""Greatest sums of magnitudes that are believed [m], [m/s], [rad/s]."""


@dataclass(frozen=True)
class JumpLimits:
    """How far a pose may be from where the frame before let it be expected.

    Attributes:
        distance: from the last position moved on by the mean velocity [m].
        angle: turned beyond the angular velocity times the time [rad].
        acceleration: what motion itself may add over a gap of t: acceleration t^2 / 2 [m/s^2] and
            the same number in [rad/s^2],
        speed: but no more than speed t [m/s], [rad/s].
    """

    distance: float = 0.05
    angle: float = 0.1
    acceleration: float = 30.0
    speed: float = 1.0


@dataclass
class PoseCounters:
    """What became of the frames since the driver started.

    Attributes:
        good: frames handed out.
        repeated: frames whose time did not move on, see `ClockRestart`; dropped.
        invalid: frames with a number out of range, or not a number; dropped.
        missed: frames missing between two, by their numbers.
        clock_restarts: times the camera's clock went back: it has been started again.
        jumps: frames that are further from the one before than motion explains.
        lost: times the tracking failed.
    """

    good: int = 0
    repeated: int = 0
    invalid: int = 0
    missed: int = 0
    clock_restarts: int = 0
    jumps: int = 0
    lost: int = 0


class PoseGate:
    """Lets new and sane frames through and counts the others.

    Attributes:
        counters: see `PoseCounters`.
        confidence: of the tracker in the last good frame; MEDIUM before the first.
        last_jump: size of the last jump: metres, or radians when it was the attitude that jumped.
    """

    def __init__(self, limits: JumpLimits | None = None):
        """Start without a frame; the limits say what counts as a jump."""
        self.counters = PoseCounters()
        self.confidence: int = Confidence.MEDIUM
        self.last_jump = 0.0
        self._limits = limits if limits is not None else JumpLimits()
        self._last: PoseFrame | None = None
        self._restart = ClockRestart()

    def accept(self, frame: PoseFrame) -> bool:
        """Return whether a frame is new and sane. A jump is counted, and let through."""
        counters = self.counters
        if not _sane(frame):
            counters.invalid += 1
            return False
        last = self._last
        if last is not None:
            step = 1e-3 * (frame.time_ms - last.time_ms)
            if step <= 0.0:
                if not self._restart.is_restart(1e6 * frame.time_ms, 1e6 * last.time_ms):
                    counters.repeated += 1
                    return False
                counters.clock_restarts += 1
            else:
                self._restart.moved_on()
                counters.missed += max(0, frame.number - last.number - 1)
                self._look_for_jump(last, frame, step)
        if frame.tracker_confidence == Confidence.FAILED != self.confidence:
            counters.lost += 1
        self.confidence = frame.tracker_confidence
        counters.good += 1
        self._last = frame
        return True

    def _look_for_jump(self, last: PoseFrame, frame: PoseFrame, step: float) -> None:
        limits = self._limits
        slack = min(0.5 * limits.acceleration * step, limits.speed) * step
        half = 0.5 * step
        x, y, z = frame.translation
        a, b, c = last.translation
        vx, vy, vz = frame.velocity
        ux, uy, uz = last.velocity
        x, y, z = x - a - half * (vx + ux), y - b - half * (vy + uy), z - c - half * (vz + uz)
        distance = math.sqrt(x * x + y * y + z * z)
        rate = max(_norm(last.angular_velocity), _norm(frame.angular_velocity))
        angle = _angle(last.rotation, frame.rotation) - rate * step
        if distance > limits.distance + slack:
            self.last_jump = distance
            self.counters.jumps += 1
        elif angle > limits.angle + slack:
            self.last_jump = angle
            self.counters.jumps += 1


def _sane(frame: PoseFrame) -> bool:
    x, y, z, w = frame.rotation
    return (  # Written so that a NaN is refused.
        0.98 < x * x + y * y + z * z + w * w < 1.02
        and _sum(frame.translation) < _MAX_TRANSLATION
        and _sum(frame.velocity) < _MAX_VELOCITY
        and _sum(frame.angular_velocity) < _MAX_ANGULAR_VELOCITY
        and 0.0 <= frame.time_ms < LATEST_TIME_MS
        and Confidence.FAILED <= frame.tracker_confidence <= Confidence.HIGH
    )


def _sum(vector: Vector) -> float:
    x, y, z = vector
    return abs(x) + abs(y) + abs(z)


def _norm(vector: Vector) -> float:
    x, y, z = vector
    return math.sqrt(x * x + y * y + z * z)


def _angle(a: Quaternion, b: Quaternion) -> float:
    """Return the angle between two attitudes [rad]."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return 2.0 * math.acos(min(1.0, abs(ax * bx + ay * by + az * bz + aw * bw)))
