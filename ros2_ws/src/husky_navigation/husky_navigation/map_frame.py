"""Localizer: the frame `odom` in `map` (REP-105), from odometry of the legs and poses of the T265.

`map` coincides with odom at the start. Odometry is continuous and drifts; `frame_filter` corrects
it by the T265. Frames of the T265 come late: each is compared with odometry at its own stamp,
interpolated and never extrapolated; one that is ahead of odometry waits. The correction is of
`odom` in map, which changes slowly, so an old frame corrects the newest pose as well.

Every frame is compared with the one before: a step that the legs do not explain is a jump. A T265
that has started, has jumped or was gone is watched until it is steady, then t265_odom is anchored
anew where the base is, so that nothing in map moves. There is one exception: the camera returns to
a place that it knows and corrects its own drift. It then has the base where map has it by what the
T265 said when it saw that place first. If that is within the drift that is possible over the
distance since then, the jump is a relocalisation, and corrects the base in map. Any other jump
within that drift looks the same.

Where the two part without a jump, the robot slips, falls or is carried, and the T265 is believed.
That holds as well for a T265 that stands still while the legs walk, as long as its poses have
noise: poses that are equal come from a camera that is frozen.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_description.rotation import Quaternion, Vector, multiply
from husky_navigation.frame_filter import (
    HIGH_CONFIDENCE,
    FrameFilter,
    LevelTransform,
    MatchedPose,
    TrackedPlace,
    heading_between,
)
from husky_navigation.localizer_parameters import LocalizerParameters

_KEPT = 100
"""Poses of odometry: 2 s at 50 Hz."""
_WAITING = 400
"""Frames of the T265 that wait for odometry at most: 2 s at 200 Hz."""
_AHEAD_NS = 1_000_000_000
"""A frame so far ahead of odometry has a wrong stamp [ns]."""
_SAME = 1e-4
"""Poses of the T265 that differ by less are equal [m], [rad]: its noise is ten times as much."""
_HALF_FRAME_NS = 2_500_000
"""Half the time between frames of the T265 [ns]: an update is due at the nearest of them."""
_PLACES = 2000
"""Places that are remembered: 2 km."""
_FARTHEST = 1e6
"""Greatest coordinate that is believed [m]."""
_REPORTED_NS = 2_000_000_000
"""A relocalisation is reported as a state for so long, and a slip once [ns]."""
_FAILED, _LOW, _MEDIUM = 0, 1, 2


class LocalizerState(Enum):
    """Measurements that `map` to `odom` rests on."""

    LEGS_ONLY = "legs only"
    SETTLING = "tracking settles"
    FUSED = "fused"
    RELOCALISED = "relocalised"
    FROZEN = "tracking frozen"
    LOST = "tracking lost"


@dataclass
class LocalizerCounters:
    """Counters of frames of the T265 and of poses of odometry by their fate, since the start.

    Attributes:
        odometry: poses taken.
        odometry_refused: whose stamp stood still or went back.
        odometry_restarts: steps beyond what the robot can do; the base stays in map where it was.
        tracking: frames compared with odometry.
        fused: of these, those that the filter has used.
        refused: frames whose stamp stood still or went back.
        ahead: frames more than 1 s ahead of odometry.
        late: frames older than all poses of odometry that are kept.
        unmatched: frames in a gap of odometry, or too many that waited for it.
        repeated: frames with the pose of the one before.
        jumps: steps between two frames that the legs do not explain, rejected.
        slips: poses beyond the filter's gate without a jump: the robot slips, falls or is carried,
            and its legs are not believed.
        returned: jumps that went back before the T265 was steady; nothing has changed.
        absorbed: jumps that have become part of the offset map to t265_odom.
        relocalised: jumps that have corrected the base in map.
        frozen: times the T265 stood still or was silent.
        lost: times its tracking failed.
    """

    odometry: int = 0
    odometry_refused: int = 0
    odometry_restarts: int = 0
    tracking: int = 0
    fused: int = 0
    refused: int = 0
    ahead: int = 0
    late: int = 0
    unmatched: int = 0
    repeated: int = 0
    jumps: int = 0
    slips: int = 0
    returned: int = 0
    absorbed: int = 0
    relocalised: int = 0
    frozen: int = 0
    lost: int = 0


class _TimedPose(NamedTuple):
    """Pose of the base at a stamp [ns], in odom or in t265_odom."""

    stamp: int
    position: Vector
    rotation: Quaternion
    confidence: int = HIGH_CONFIDENCE


class MapFrame:
    """Localizer of the base in `map`.

    Call `clear` when the clock has gone back: until then, stamps that go back are refused.

    Attributes:
        parameters: of the localizer.
        counters: see `LocalizerCounters`.
    """

    def __init__(
        self,
        parameters: LocalizerParameters | None = None,
        report: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Start with map and odom as one.

        Args:
            parameters: of the localizer.
            report: called with a sentence when odometry starts anew, and when the T265 jumps, is
                used again, or no longer.
        """
        self.parameters = parameters or LocalizerParameters()
        self.counters = LocalizerCounters()
        self._report = report
        self.clear()

    def clear(self) -> None:
        """Start anew, as with a new world; the counters go on."""
        self._filter = FrameFilter(self.parameters)
        self._odometry: deque[_TimedPose] = deque(maxlen=_KEPT)
        self._waiting: deque[_TimedPose] = deque()
        self._places: deque[TrackedPlace] = deque(maxlen=_PLACES)
        self._phase = LocalizerState.LEGS_ONLY
        self._stamp = -1  # Of the newest frame.
        self._heard = 0  # Stamp of the newest odometry when the newest frame came.
        self._frame: _TimedPose | None = None  # The newest whose pose was another.
        self._last: MatchedPose | None = None  # The same beside odometry.
        self._taken = -1  # Stamp of the newest that was compared.
        self._confidence = HIGH_CONFIDENCE
        self._since = 0  # When the T265 began to settle.
        self._jumped = False  # It settles after a jump.
        self._weakest = HIGH_CONFIDENCE  # Least confidence meanwhile.
        self._fused = -1  # Stamp of the last pose that was fused.
        self._slipped = -_REPORTED_NS  # Stamp of the last slip.
        self._relocalised = -_REPORTED_NS  # Stamp of odometry then.

    # Results ------------------------------------------------------------------------------------
    @property
    def map_to_odom(self) -> LevelTransform:
        """Pose of odom in map: what is published as the transform map to odom."""
        return self._filter.odom

    @property
    def base_in_map(self) -> tuple[Vector, Quaternion] | None:
        """Newest position [m] and attitude (x, y, z, w) of the base in map; None without any."""
        if not self._odometry:
            return None
        _, position, rotation, _ = self._odometry[-1]
        odom = self._filter.odom
        return odom.apply(position), multiply(odom.rotation, rotation)

    @property
    def covariance(self) -> Array:
        """Covariance (4, 4) of the base's x, y, z [m] and yaw [rad] in map."""
        position = self._odometry[-1].position if self._odometry else (0.0, 0.0, 0.0)
        return self._filter.covariance_at(position)

    @property
    def deviation(self) -> Array:
        """Standard deviations (4,) of the base's x, y, z [m] and yaw [rad] in map."""
        deviation: Array = np.sqrt(np.diag(self.covariance))
        return deviation

    @property
    def state(self) -> LocalizerState:
        """Measurements that the pose rests on; `RELOCALISED` for 2 s after that happened."""
        if (
            self._phase is LocalizerState.FUSED
            and self._odometry[-1].stamp - self._relocalised < _REPORTED_NS
        ):
            return LocalizerState.RELOCALISED
        return self._phase

    @property
    def _is_watched(self) -> bool:
        """Return whether frames of the T265 are used, or will be."""
        return self._phase in (LocalizerState.FUSED, LocalizerState.SETTLING)

    # Odometry -----------------------------------------------------------------------------------
    def add_odometry(
        self, stamp: int, position: Sequence[float], rotation: Sequence[float]
    ) -> bool:
        """Take a pose of the base in odom; return False if its stamp stands still or goes back.

        Args:
            stamp: [ns].
            position: [m] (3,).
            rotation: base to odom, unit quaternion (x, y, z, w).

        Raises:
            ValueError: a number is not finite or out of range; nothing has changed.
        """
        pose = _checked("odometry", stamp, position, rotation)
        if not self._odometry:
            self._filter.walk(pose.position, pose.rotation, 0.0, self._confidence)
        elif stamp <= self._odometry[-1].stamp:
            self.counters.odometry_refused += 1
            return False
        else:
            self._move(self._odometry[-1], pose)
        self._odometry.append(pose)
        self.counters.odometry += 1
        while self._waiting and self._waiting[0].stamp <= stamp:
            self._take(self._waiting.popleft())
        if self._is_watched and stamp - self._heard > 1e9 * self.parameters.silence:
            self._give_up(LocalizerState.FROZEN, "the T265 is silent")
            self._last = None
        return True

    def _move(self, last: _TimedPose, pose: _TimedPose) -> None:
        """Move the base on, or anchor odometry that has started anew."""
        p = self.parameters
        dt = 1e-9 * (pose.stamp - last.stamp)
        known = min(dt, p.odometry_gap)
        step = math.dist(last.position, pose.position)
        turn = _angle(last.rotation, pose.rotation)
        if (
            step <= p.most_speed * known + p.odometry_jump
            and turn <= p.most_turn_rate * known + p.odometry_turn_jump
        ):
            self._filter.walk(pose.position, pose.rotation, dt, self._confidence)
            return
        self.counters.odometry_restarts += 1
        self._report(
            f"odometry starts anew: it stepped by {step:.2f} m and {turn:.2f} rad in {dt:.2f} s"
        )
        # The greatest motion that was possible is taken for three deviations.
        deviation = known / 3.0 * np.array([p.most_speed] * 3 + [p.most_turn_rate])
        before, after = (last.position, last.rotation), (pose.position, pose.rotation)
        self._filter.restart_odometry(before, after, deviation)
        # What is kept of the old odom is expressed in the new one.
        yaw = heading_between(pose.rotation, last.rotation)
        shift = LevelTransform.through(last.position, pose.position, yaw)
        self._odometry = deque(
            (
                old._replace(
                    position=shift.apply(old.position),
                    rotation=multiply(shift.rotation, old.rotation),
                )
                for old in self._odometry
            ),
            maxlen=_KEPT,
        )
        if self._last is not None:
            self._last = self._last._replace(
                in_odom=shift.apply(self._last.in_odom), yaw=self._last.yaw + yaw
            )

    # The T265 -----------------------------------------------------------------------------------
    def add_tracking(
        self, stamp: int, position: Sequence[float], rotation: Sequence[float], confidence: int
    ) -> bool:
        """Take a pose of the base by the T265; return False if it is refused.

        It is if its stamp stands still, goes back or is far ahead, and before the first odometry.

        Args:
            stamp: of the pose, not of its arrival [ns].
            position: of the base in t265_odom [m] (3,).
            rotation: base to t265_odom, unit quaternion (x, y, z, w).
            confidence: of the tracker: 0 failed, 1 low, 2 medium, 3 high.

        Raises:
            ValueError: a number is not finite or out of range; nothing has changed.
        """
        pose = _checked("tracking", stamp, position, rotation, confidence)
        if not self._odometry:
            self.counters.unmatched += 1
            return False
        if stamp <= self._stamp:
            self.counters.refused += 1
            return False
        newest = self._odometry[-1].stamp
        if stamp > newest + _AHEAD_NS:
            self.counters.ahead += 1
            return False
        self._stamp = stamp
        if self._waiting or stamp > newest:
            if len(self._waiting) == _WAITING:
                self._waiting.popleft()
                self.counters.unmatched += 1
            self._waiting.append(pose)
        else:
            self._take(pose)
        return True

    def _take(self, frame: _TimedPose) -> None:
        """Compare a frame with odometry, and use it if it is good."""
        match = self._match(frame)
        if match is None:
            return
        counters, last, elapsed = self.counters, self._last, match.stamp - self._taken
        counters.tracking += 1
        self._heard, self._taken = self._odometry[-1].stamp, match.stamp
        self._confidence = frame.confidence
        if frame.confidence == _FAILED:
            self._last = None
            if self._phase is not LocalizerState.LOST:
                self._give_up(LocalizerState.LOST, "the T265 has lost its way")
            return
        if last is not None and _is_same(self._frame, frame):
            counters.repeated += 1
            self._look_for_frozen(last, match)
            return
        self._frame, self._last = frame, match
        if self._is_watched and elapsed > 1e9 * self.parameters.silence:
            self._give_up(LocalizerState.FROZEN, "the T265 was silent")
        if not self._is_watched:
            self._settle(match, jumped=False)
        elif last is not None and self._has_jumped(last, match):
            counters.jumps += 1
            self._jump(match)
        self._weakest = min(self._weakest, frame.confidence)
        if self._phase is LocalizerState.SETTLING:
            if match.stamp - self._since >= 1e9 * self.parameters.settle_time:
                self._use_again(match)
        elif match.stamp - self._fused >= 1e9 * self.parameters.update_period - _HALF_FRAME_NS:
            self._fuse(match)

    def _match(self, frame: _TimedPose) -> MatchedPose | None:
        """Return a frame beside odometry at its stamp, None if that is not known."""
        stamp, odometry = frame.stamp, self._odometry
        if stamp < odometry[0].stamp:
            self.counters.late += 1
            return None
        pairs = pairwise(reversed(odometry))  # The newest come first: few frames are old.
        first = odometry[0], odometry[0]
        after, before = next((pair for pair in pairs if pair[1].stamp < stamp), first)
        gap = after.stamp - before.stamp
        if stamp != after.stamp and gap > 1e9 * self.parameters.odometry_gap:
            self.counters.unmatched += 1
            return None
        share = (stamp - before.stamp) / gap if gap else 0.0
        x, y, z = before.position
        a, b, c = after.position
        position = (x + share * (a - x), y + share * (b - y), z + share * (c - z))
        rotation = _between(before.rotation, after.rotation, share)
        yaw = heading_between(rotation, frame.rotation)
        return MatchedPose(stamp, position, frame.position, yaw)

    def _has_jumped(self, last: MatchedPose, match: MatchedPose) -> bool:
        """Return whether the T265 has made a step that the legs do not explain."""
        x, y, z = match.in_tracking
        a, b, c = last.in_tracking
        c_yaw, s_yaw = math.cos(last.yaw), math.sin(last.yaw)
        u, v, w = last.in_odom
        o, p, q = match.in_odom
        dx, dy = x - a, y - b
        difference = (
            u + c_yaw * dx - s_yaw * dy - o,
            v + s_yaw * dx + c_yaw * dy - p,
            w + z - c - q,
        )
        return self._is_beyond(
            math.hypot(*difference), match.yaw - last.yaw, match.stamp - last.stamp
        )

    def _is_beyond(self, distance: float, yaw: float, elapsed: int) -> bool:
        """Return whether a difference [m], [rad] over a time [ns] is that of a jump."""
        p = self.parameters
        dt = min(1e-9 * elapsed, p.silence)
        turn = abs(math.remainder(yaw, 2.0 * math.pi))
        return distance > p.jump_distance + p.slip_speed * dt or turn > (
            p.jump_angle + p.slip_turn * dt
        )

    def _jump(self, match: MatchedPose) -> None:
        """Watch a T265 that has jumped, or use it as before if it has jumped back."""
        difference = self._filter.difference(match, self._filter.tracking).tolist()
        distance, yaw = math.hypot(*difference[:3]), difference[3]
        if self._phase is LocalizerState.SETTLING:
            if self._jumped and not self._is_beyond(distance, yaw, match.stamp - self._since):
                self.counters.returned += 1
                self._phase = LocalizerState.FUSED
                self._report("the T265 has jumped back")
            else:
                self._settle(match, jumped=self._jumped)
            return
        self._report(f"the T265 has jumped by {distance:.2f} m and {abs(yaw):.2f} rad")
        self._settle(match, jumped=True)

    def _look_for_frozen(self, last: MatchedPose, match: MatchedPose) -> None:
        """Give up a T265 that repeats its pose while the legs walk."""
        motion = math.dist(last.in_odom, match.in_odom)
        turn = abs(math.remainder(match.yaw - last.yaw, 2.0 * math.pi))
        if self._phase is not LocalizerState.FROZEN and (
            max(motion, turn) > self.parameters.frozen_motion
        ):
            self._give_up(LocalizerState.FROZEN, "the T265 repeats its pose while the legs walk")

    def _give_up(self, phase: LocalizerState, reason: str) -> None:
        """Go on by the legs alone."""
        if phase is LocalizerState.LOST:
            self.counters.lost += 1
        else:
            self.counters.frozen += 1
        self._phase = phase
        self._report(f"{reason}; legs only")

    def _settle(self, match: MatchedPose, *, jumped: bool) -> None:
        """Watch the T265 before it is used."""
        self._phase = LocalizerState.SETTLING
        self._since, self._jumped = match.stamp, jumped
        self._weakest = HIGH_CONFIDENCE

    def _use_again(self, match: MatchedPose) -> None:
        """Anchor the T265 that is steady, or correct the base if it has relocalised."""
        if self._weakest == _LOW:
            # It may have started anew, and knows none of them then.
            self._places.clear()
        self._phase, self._fused = LocalizerState.FUSED, match.stamp
        place = self._known_place(match) if self._jumped else None
        if place is not None and self._filter.relocalise(match, place):
            self.counters.relocalised += 1
            self._relocalised = self._odometry[-1].stamp
            self._report("the T265 has recognised a place; the base in map is corrected")
            return
        self._filter.anchor(match, self._confidence)
        self.counters.absorbed += self._jumped
        self._report("the T265 is used, from where the base is in map")

    def _fuse(self, match: MatchedPose) -> None:
        """Correct the base by a frame, beyond the gate by all that the legs do not explain."""
        if not self._filter.update(match, self._confidence):
            self.counters.slips += 1
            if match.stamp - self._slipped > _REPORTED_NS:
                self._report("the T265 moves as the legs do not explain; it is believed")
            self._slipped = match.stamp
            self._filter.doubt_legs(match)
            self._filter.update(match, self._confidence)
        self.counters.fused += 1
        self._fused = match.stamp
        walked = self._filter.walked
        if not self._places or walked - self._places[-1].walked > self.parameters.place_spacing:
            self._places.append(self._filter.place(match))

    def _known_place(self, match: MatchedPose) -> TrackedPlace | None:
        """Return the nearest place at which the base was long ago, None if there is none near."""
        base = self._filter.odom.apply(match.in_odom)
        latest = self._filter.walked - self.parameters.loop_distance
        near = [place for place in self._places if place.walked <= latest]
        nearest = min(near, key=lambda place: math.dist(place.position, base), default=None)
        if nearest is None or math.dist(nearest.position, base) > self.parameters.place_radius:
            return None
        return nearest


def _is_same(last: _TimedPose | None, frame: _TimedPose) -> bool:
    """Return whether two frames of the T265 have one pose."""
    return (
        last is not None
        and math.dist(last.position, frame.position) < _SAME
        and 2.0 * math.dist(last.rotation, frame.rotation) < _SAME
    )


def _angle(a: Quaternion, b: Quaternion) -> float:
    """Return the angle between two attitudes [rad]."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return 2.0 * math.acos(min(1.0, abs(ax * bx + ay * by + az * bz + aw * bw)))


def _between(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """Return the attitude at a share of the way from one to another.

    It lies on the chord of the quaternions: over 20 ms at 5 rad/s that is the arc within 0.01 mrad.
    """
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    if ax * bx + ay * by + az * bz + aw * bw < 0.0:
        bx, by, bz, bw = -bx, -by, -bz, -bw
    x, y, z, w = (
        ax + share * (bx - ax),
        ay + share * (by - ay),
        az + share * (bz - az),
        aw + share * (bw - aw),
    )
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return x / norm, y / norm, z / norm, w / norm


def _checked(
    name: str,
    stamp: int,
    position: Sequence[float],
    rotation: Sequence[float],
    confidence: int = HIGH_CONFIDENCE,
) -> _TimedPose:
    """Return a pose as plain numbers.

    Raises:
        ValueError: what is wrong with it, and what is allowed.
    """
    if not isinstance(stamp, int) or stamp < 0:
        raise ValueError(f"{name}: stamp is {stamp!r}, it must be whole nanoseconds, 0 or more")
    if len(position) != 3 or len(rotation) != 4:
        raise ValueError(
            f"{name}: position and rotation have {len(position)} and {len(rotation)} numbers, "
            "they must have 3 and 4"
        )
    x, y, z = map(float, position)
    if not (abs(x) <= _FARTHEST and abs(y) <= _FARTHEST and abs(z) <= _FARTHEST):
        raise ValueError(
            f"{name}: position is {x}, {y}, {z}, it must be finite, within {_FARTHEST:.0e} m"
        )
    a, b, c, d = map(float, rotation)
    square = a * a + b * b + c * c + d * d
    if not 0.98 < square < 1.02:
        raise ValueError(f"{name}: rotation is {a}, {b}, {c}, {d}, it must be a unit quaternion")
    if confidence not in (_FAILED, _LOW, _MEDIUM, HIGH_CONFIDENCE):
        raise ValueError(f"{name}: confidence is {confidence!r}, it must be 0, 1, 2 or 3")
    norm = math.sqrt(square)
    return _TimedPose(stamp, (x, y, z), (a / norm, b / norm, c / norm, d / norm), int(confidence))
