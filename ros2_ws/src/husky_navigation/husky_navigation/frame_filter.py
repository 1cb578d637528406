"""Kalman filter of where the frames `odom` and `t265_odom` lie in `map`.

All three are level, so each lies in another by x, y, z and yaw. Legs and T265 are two dead
reckonings of one base: their drift grows with the distance, and neither sees the map. A pose of the
T265 tells the base's motion since the last one, but no place. The state therefore holds both: the
base in map, moved on by odometry, and the offset map to t265_odom, which walks as the T265 drifts.
Of a difference between the two, the base takes the share that the legs' drift has in the sum of
both, 88 % at the defaults, and the offset the rest. The covariance of the base grows all the while,
as it must without a landmark, but with the smaller of both drifts.

A T265 that is less sure of itself is noisier and drifts more: both deviations double with each step
of confidence below high, as those of the emulated camera do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_description.rotation import Quaternion, Vector, about_z
from husky_navigation.localizer_parameters import LocalizerParameters

HIGH_CONFIDENCE = 3
"""Greatest confidence of the T265."""
_BASE, _OFFSET = slice(0, 4), slice(4, 8)
"""Errors in a state, x, y, z [m] and yaw [rad] each: of the base by odometry, and by the T265."""
_STEP = 0.02
"""Motion from which on it counts as a step [m], [rad]: the noise of a standing robot is less."""
_UNIT = np.eye(8)
_DIFFERENCE = np.hstack([np.eye(4), -np.eye(4)])


class LevelTransform(NamedTuple):
    """Pose of a level frame in another: position x, y, z [m] and yaw [rad]."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0

    @classmethod
    def through(cls, point: Vector, image: Vector, yaw: float) -> LevelTransform:
        """Return the transform by a yaw [rad] that takes a point to its image [m]."""
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, z = point
        yaw = math.remainder(yaw, 2.0 * math.pi)
        return cls(image[0] - c * x + s * y, image[1] - s * x - c * y, image[2] - z, yaw)

    @property
    def rotation(self) -> Quaternion:
        """Child frame to parent, (x, y, z, w)."""
        return about_z(self.yaw)

    def apply(self, point: Vector) -> Vector:
        """Return where a point of the child frame [m] is in the parent."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        x, y, z = point
        return self.x + c * x - s * y, self.y + s * x + c * y, self.z + z


def heading_between(a: Quaternion, b: Quaternion) -> float:
    """Return the turn about z from frame A to B [rad], of a body's attitudes in A and in B.

    It is that of level frames at any tilt of the body; headings are undefined with the nose up.
    """
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    z = az * bw - aw * bz + ay * bx - ax * by
    return math.remainder(2.0 * math.atan2(z, aw * bw + ax * bx + ay * by + az * bz), 2.0 * math.pi)


class MatchedPose(NamedTuple):
    """Base at one time as odometry and as the T265 have it.

    Attributes:
        stamp: [ns].
        in_odom: position of the base in odom [m].
        in_tracking: the same in t265_odom [m].
        yaw: of t265_odom in odom [rad].
    """

    stamp: int
    in_odom: Vector
    in_tracking: Vector
    yaw: float


class TrackedPlace(NamedTuple):
    """Place that the T265 has seen, and how well the base was known there.

    Attributes:
        position: of the base in map [m].
        tracking: pose of t265_odom in map.
        variance: (4,) of the base, x, y, z [m^2], yaw [rad^2].
        walked: distance by odometry up to there [m].
        alone: part of it that the base has gone by the legs alone [m].
    """

    position: Vector
    tracking: LevelTransform
    variance: Array
    walked: float
    alone: float


class FrameFilter:
    """Extended Kalman filter over the errors of the base's pose in map, by odometry and by T265.

    Both errors are those at one point of the path, the base or a place shortly behind it. There the
    noise of each is diagonal, and an error of heading turns into one of position as the point moves
    on with the base.

    Attributes:
        odom: pose of odom in map.
        tracking: pose of t265_odom in map; only of meaning after `anchor`.
        walked: distance by odometry [m].
        alone: part of it by the legs alone, up to the last `anchor` [m].
    """

    def __init__(self, parameters: LocalizerParameters) -> None:
        """Start with all frames at the origin of map, and without error."""
        self.odom = self.tracking = LevelTransform()
        self.walked = self.alone = 0.0
        self._tracked = 0.0  # `walked` at the last pose of the T265 that was used.
        self._relocalised = 0.0, 0.0  # `walked` and `alone` at the last relocalisation.
        self._covariance = np.zeros((8, 8))
        self._at: Vector = (0.0, 0.0, 0.0)
        self._rest: tuple[Vector, Quaternion] | None = None
        p = parameters
        legs = 2.0 * p.leg_drift_length
        tracking = 2.0 * p.tracking_drift_length * p.tracking_drift**2
        self._leg_growth = np.array(
            [legs * p.leg_drift**2] * 2 + [legs * p.leg_height_drift**2, p.leg_heading_drift**2]
        )
        self._tracking_growth = np.array([tracking] * 3 + [p.tracking_heading_drift**2])
        self._leg_scale = np.array([p.leg_drift] * 2 + [p.leg_height_drift])
        self._tracking_scale = np.full(3, p.tracking_drift)
        self._turn_growth, self._rest_growth = p.leg_turn_drift**2, p.leg_rest_drift**2
        self._noise = np.array([p.tracking_position_noise**2] * 3 + [p.tracking_heading_noise**2])
        self._place_noise = np.array([p.place_deviation**2] * 3 + [p.place_heading_deviation**2])
        self._gate, self._place_gate = p.gate**2, p.relocalisation_gate**2

    def covariance_at(self, position: Vector) -> Array:
        """Return the covariance (4, 4) of the base's x, y, z [m] and yaw [rad] in map.

        Args:
            position: of the base in odom [m].
        """
        self._move_to(self.odom.apply(position))
        return self._covariance[_BASE, _BASE].copy()

    # Motion -------------------------------------------------------------------------------------
    def walk(self, position: Vector, rotation: Quaternion, dt: float, confidence: int) -> None:
        """Move the base on to where odometry has it.

        Args:
            position: of the base in odom [m].
            rotation: base to odom, (x, y, z, w).
            dt: time since the last call [s].
            confidence: of the T265 meanwhile.
        """
        covariance = self._covariance
        covariance[3, 3] += self._rest_growth * dt
        if self._rest is None:
            self._rest = position, rotation
        distance = math.dist(position, self._rest[0])
        turn = abs(heading_between(rotation, self._rest[1]))
        if distance < _STEP and turn < _STEP:
            return
        self._rest = position, rotation
        self.walked += distance
        self._move_to(self.odom.apply(position))
        growth = np.concatenate(
            [self._leg_growth, _variance_factor(confidence) * self._tracking_growth]
        )
        np.einsum("ii->i", covariance)[:] += distance * growth
        covariance[3, 3] += self._turn_growth * turn

    def _move_to(self, position: Vector) -> None:
        """Express the errors at another point, given in map [m]."""
        x, y, _ = self._at
        forward = _UNIT.copy()
        forward[0, 3] = forward[4, 7] = y - position[1]
        forward[1, 3] = forward[5, 7] = position[0] - x
        self._covariance[:] = forward @ self._covariance @ forward.T
        self._at = position

    def restart_odometry(
        self, before: tuple[Vector, Quaternion], after: tuple[Vector, Quaternion], deviation: Array
    ) -> None:
        """Let odometry start anew: the base stays in map where it was.

        Args:
            before: position [m] and attitude (x, y, z, w) of the base in the old odom.
            after: the same in the new odom.
            deviation: (4,) of the base's motion between the two, x, y, z [m] and yaw [rad].
        """
        base = self.odom.apply(before[0])
        yaw = self.odom.yaw + heading_between(before[1], after[1])
        self.odom = LevelTransform.through(after[0], base, yaw)
        self._rest = after
        self._move_to(base)
        np.einsum("ii->i", self._covariance)[_BASE] += deviation**2

    # The T265 -----------------------------------------------------------------------------------
    def anchor(self, match: MatchedPose, confidence: int) -> None:
        """Put t265_odom where the T265 has the base at the place that the filter knows."""
        self.alone += self.walked - self._tracked
        self._tracked = self.walked
        base = self.odom.apply(match.in_odom)
        self._move_to(base)
        yaw = self.odom.yaw + match.yaw
        self.tracking = LevelTransform.through(match.in_tracking, base, yaw)
        covariance = self._covariance
        covariance[_OFFSET, _OFFSET] = covariance[_BASE, _BASE]
        covariance[_OFFSET, _BASE] = covariance[_BASE, _OFFSET] = covariance[_BASE, _BASE]
        noise = _variance_factor(confidence) * self._noise
        np.einsum("ii->i", covariance)[_OFFSET] += noise

    def difference(self, match: MatchedPose, tracking: LevelTransform) -> Array:
        """Return by how much the base differs in map, (4,): x, y, z [m], yaw [rad].

        Args:
            match: of the base.
            tracking: pose of t265_odom in map: the base by the T265 less that by odometry.
        """
        x, y, z = self.odom.apply(match.in_odom)
        a, b, c = tracking.apply(match.in_tracking)
        yaw = math.remainder(tracking.yaw - self.odom.yaw - match.yaw, 2.0 * math.pi)
        return np.array([a - x, b - y, c - z, yaw])

    def doubt_legs(self, match: MatchedPose) -> None:
        """Widen the base's deviations by what the legs have done wrong if a pose is right."""
        self._move_to(self.odom.apply(match.in_odom))
        innovation = self.difference(match, self.tracking)
        np.einsum("ii->i", self._covariance)[_BASE] += innovation**2

    def update(self, match: MatchedPose, confidence: int) -> bool:
        """Fuse a pose of the T265; return False, and fuse nothing, if it is beyond the gate."""
        self._move_to(self.odom.apply(match.in_odom))
        innovation = self.difference(match, self.tracking)
        covariance, noise = self._covariance, np.diag(_variance_factor(confidence) * self._noise)
        cross = covariance[:, _BASE] - covariance[:, _OFFSET]
        inverse = np.linalg.inv(cross[_BASE] - cross[_OFFSET] + noise)
        if innovation @ inverse @ innovation > self._gate:
            return False
        gain = cross @ inverse
        left = _UNIT - gain @ _DIFFERENCE
        # Joseph's form stays positive definite, though the noise is small beside the drift.
        covariance[:] = left @ covariance @ left.T + gain @ noise @ gain.T
        error = (gain @ innovation).tolist()
        self.odom = _corrected(self.odom, match.in_odom, error[_BASE])
        self.tracking = _corrected(self.tracking, match.in_tracking, error[_OFFSET])
        self._at = self.odom.apply(match.in_odom)
        self._tracked = self.walked
        return True

    # Places -------------------------------------------------------------------------------------
    def place(self, match: MatchedPose) -> TrackedPlace:
        """Return the place where the base is, with the T265 in use."""
        variance = np.diag(self.covariance_at(match.in_odom))
        base = self.odom.apply(match.in_odom)
        return TrackedPlace(base, self.tracking, variance, self.walked, self.alone)

    def relocalise(self, match: MatchedPose, place: TrackedPlace) -> bool:
        """Correct the base by a place that the T265 has recognised; anchor t265_odom there.

        The uncertainty of the base when the place was seen first stays: only the drift since then
        is corrected, on each axis by itself. The gate is of the drift that is possible over the
        distance since then, which is less than the filter's on a short way.

        Args:
            match: of the base.
            place: as it was when it was seen first.

        Returns:
            False, and nothing is corrected, if the place is beyond the gate.
        """
        self._move_to(self.odom.apply(match.in_odom))
        innovation = self.difference(match, place.tracking)
        now = np.diag(self._covariance)[_BASE].copy()
        drift = np.maximum(now - place.variance, 0.0)
        possible = np.maximum(drift - self._excess_since(place), 0.0) + self._place_noise
        if float(np.sum(innovation**2 / possible)) > self._place_gate:
            return False
        gain = drift / (drift + self._place_noise)
        self.odom = _corrected(self.odom, match.in_odom, (gain * innovation).tolist())
        left = np.sqrt((now - gain * drift) / np.maximum(now, 1e-12))
        self._covariance[_BASE, _BASE] *= np.outer(left, left)
        self._at = self.odom.apply(match.in_odom)
        self.anchor(match, HIGH_CONFIDENCE)
        self._relocalised = self.walked, self.alone
        return True

    def _excess_since(self, place: TrackedPlace) -> Array:
        """Return by how much the filter overrates the drift since a place, (4,) [m^2], [rad^2].

        The filter adds 2 L sigma^2 for each metre. An error of scale or direction that lasts over
        L drifts by no more than sigma^2 d^2 in a distance d, which is less below 2 L.
        """
        walked, alone = self._relocalised
        alone_since = self.alone + self.walked - self._tracked - max(place.alone, alone)
        tracked_since = self.walked - max(place.walked, walked) - alone_since
        legs, tracking = self._leg_growth[:3], self._tracking_growth[:3]
        both = legs * tracking / (legs + tracking)
        by_legs = legs * alone_since - (self._leg_scale * alone_since) ** 2
        by_both = both * tracked_since - (self._tracking_scale * tracked_since) ** 2
        return np.append(np.maximum(by_legs, 0.0) + np.maximum(by_both, 0.0), 0.0)


def _corrected(frame: LevelTransform, point: Vector, error: list[float]) -> LevelTransform:
    """Return a frame after a correction x, y, z [m], yaw [rad] at one of its points [m]."""
    x, y, z = frame.apply(point)
    dx, dy, dz, turn = error
    return LevelTransform.through(point, (x + dx, y + dy, z + dz), frame.yaw + turn)


def _variance_factor(confidence: int) -> float:
    return 4.0 ** (HIGH_CONFIDENCE - confidence)
