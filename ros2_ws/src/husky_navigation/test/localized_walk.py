"""Walks in closed form with a localizer, and the errors of legs and T265.

Legs have a wrong scale and a heading that drifts with the distance, both constant: the worst case
for a filter that takes them for random. The T265 has the errors of `husky_sim.devices.t265`.
"""

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_description.rotation import about_z
from husky_navigation.frame_filter import heading_between
from husky_navigation.localizer_parameters import LocalizerParameters
from husky_navigation.map_frame import LocalizerState, MapFrame

LOOP = 50.0
"""Circumference of the loop [m]."""
PARAMETERS = LocalizerParameters()
LEGS_ONLY, SETTLING, FUSED, RELOCALISED, FROZEN, LOST = LocalizerState


def attitudes(roll, pitch, yaw):
    """Return quaternions (n, 4) of fixed-axis roll, pitch and yaw (n,) [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (np.cos(0.5 * angle), np.sin(0.5 * angle)) for angle in (roll, pitch, yaw)
    )
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def walked_wrongly(position, scale, heading, slope):
    """Return positions (n, 3) by steps that are too long, turned, and rise too much."""
    step = np.diff(position, axis=0)
    scale, heading, slope = (np.broadcast_to(e, len(position))[1:] for e in (scale, heading, slope))
    c, s = (1.0 + scale) * np.cos(heading), (1.0 + scale) * np.sin(heading)
    x, y, z = step.T
    taken = np.column_stack([c * x - s * y, s * x + c * y, z + slope * np.hypot(x, y)])
    return np.vstack([position[:1], position[0] + np.cumsum(taken, axis=0)])


def gauss_markov(distance, bound, random, length=20.0):
    """Return an error along a path (n,), of an rms of half its bound, as the emulated T265's."""
    some = distance[::20]
    values, value = [], 0.5 * bound * random.standard_normal()
    keep = np.exp(-np.diff(some, prepend=some[0]) / length)
    drive = 0.5 * bound * np.sqrt(1.0 - keep**2) * random.standard_normal(len(some))
    for share, driven in zip(keep.tolist(), drive.tolist(), strict=True):
        value = max(-bound, min(bound, share * value + driven))
        values.append(value)
    return np.interp(np.arange(len(distance)), np.arange(0, len(distance), 20), values)


@dataclass
class Frames:
    """Frames of the T265, 200 a second: of the base in t265_odom."""

    time: Array
    position: Array
    yaw: Array
    sway: Array
    confidence: Array
    keep: Array = field(init=False)  # which of them come

    def __post_init__(self):
        self.keep = np.ones(len(self.time), dtype=bool)

    def since(self, start, end=math.inf):
        """Return which are of a time between two [s]."""
        return (self.time >= start - 1e-9) & (self.time < end - 1e-9)

    def turn(self, start, angle):
        """Let t265_odom be turned about the camera from a time [s] on, by an angle [rad]."""
        later = self.since(start)
        pivot = self.position[np.argmax(later)].copy()
        turned = Rotation.from_euler("z", angle).apply(self.position[later] - pivot)
        self.position[later] = pivot + turned
        self.yaw[later] += angle


@dataclass(frozen=True)
class Walk:
    """A walk on a circle, or a line, and what is measured of it.

    Attributes:
        distance: [m].
        speed: [m/s].
        turn_rate: [rad/s].
        swing: rate [rad/s] at which the heading swings as well, 1 s to each side.
        rest: time before it [s].
        scale, heading: error of the legs' steps [-], and of their heading [rad/m].
        tracking: greatest drift of the T265 [-].
        latency, jitter: of the T265's frames [s].
        seed: of all noise.
    """

    distance: float = LOOP
    speed: float = 1.0
    turn_rate: float = 2.0 * math.pi / LOOP
    swing: float = 0.0
    rest: float = 0.0
    scale: float = 0.015
    heading: float = 0.002
    tracking: float = 0.008
    latency: float = 0.03
    jitter: float = 0.01
    seed: int = 1

    def truth(self):
        """Return times [s], positions, yaws, and roll and pitch in one, 200 a second."""
        time = np.arange(round(200 * (self.rest + self.distance / self.speed)) + 1) / 200.0
        moved = np.maximum(0.0, time - self.rest)
        angle = self.turn_rate * moved
        radius = self.speed / self.turn_rate if self.turn_rate else 0.0
        x = radius * np.sin(angle) if self.turn_rate else self.speed * moved
        y = radius * (1.0 - np.cos(angle))
        z = 0.55 + 0.02 * np.sin(2.0 * math.pi * 2.5 * moved)
        sway = 0.02 * np.sin(2.0 * math.pi * 1.25 * moved)
        yaw = angle + self.swing * (np.abs((moved - 1.0) % 4.0 - 2.0) - 1.0)
        return time, np.column_stack([x, y, z]), yaw, sway

    def measure(self):
        """Return the frames of the T265, and odometry: positions (m, 3) and attitudes (m, 4)."""
        random = np.random.default_rng(self.seed)
        time, position, yaw, sway = self.truth()
        distance = self.speed * np.maximum(0.0, time - self.rest)
        turned = self.heading * distance
        legs = walked_wrongly(position, self.scale, turned, 0.003)[::4]
        legs += 5e-4 * random.standard_normal(legs.shape)
        attitude = attitudes(0.5 * sway, sway, yaw + turned)[::4]
        bounds = [share * self.tracking for share in (0.4, 0.4, 0.2)]
        errors = [gauss_markov(distance, bound, random) for bound in bounds]
        seen = walked_wrongly(position, *errors)
        # t265_odom lies where the camera was, and does not look along odom's x.
        c, s = math.cos(0.7), math.sin(0.7)
        seen = (seen - [0.245, 0.1, 0.6]) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        age = np.minimum(time, 2.0)
        confidence = np.where(age < 1.0, 1, np.where(age < 2.0, 2, 3))
        noise = 2.0 ** (3 - confidence)
        seen += 5e-4 * noise[:, None] * random.standard_normal(seen.shape)
        seen_yaw = yaw + errors[1] - 0.7 + 1e-3 * noise * random.standard_normal(len(yaw))
        return Frames(time, seen, seen_yaw, sway, confidence), (legs, attitude)


@dataclass
class Trial:
    """A walk with a localizer: errors at each pose of odometry, 50 a second."""

    map_frame: MapFrame
    time: Array
    error: Array  # (n, 3) [m], of the base in map
    yaw_error: Array  # (n,) [rad]
    odom: Array  # (n, 4) map to odom
    states: list
    said: list
    deviation: Array  # (4,) at the end

    @property
    def counts(self):
        """Return the counters that are not 0, without those of good frames."""
        counted = vars(self.map_frame.counters).items()
        good = ("odometry", "tracking", "fused")
        return {name: count for name, count in counted if count and name not in good}

    @property
    def distance(self):
        """Horizontal error (n,) [m]."""
        return np.hypot(self.error[:, 0], self.error[:, 1])

    def step(self, start, end):
        """Return the greatest step of the base in map beyond its motion, between two times [m]."""
        steps = np.diff(self.error[round(50 * start) : round(50 * end)], axis=0)
        return float(np.linalg.norm(steps, axis=1).max())

    def changes(self):
        """Return times [s] at which the state has changed, and what it was then."""
        pairs = zip(self.time[1:].tolist(), self.states, self.states[1:], strict=False)
        return [(round(time, 2), after) for time, before, after in pairs if before is not after]


def run(
    walk,
    change=lambda frames, legs: None,
    *,
    tracking=True,
    stamped_late=0.0,
    parameters=PARAMETERS,
):
    """Feed a walk to a localizer, in the order of arrival, and compare it with the truth.

    Args:
        walk: to be walked.
        change: changes the frames and odometry in place.
        tracking: whether there is a T265.
        stamped_late: added to the T265's stamps [s].
        parameters: of the localizer.
    """
    _, position, yaw, _ = walk.truth()
    frames, (legs, attitude) = walk.measure()
    change(frames, (legs, attitude))
    said = []
    map_frame = MapFrame(parameters, said.append)
    random = np.random.default_rng(walk.seed + 1)
    arrival = frames.time + walk.latency + walk.jitter * random.random(len(frames.time))
    arrival = np.maximum.accumulate(arrival)
    rotation = attitudes(0.5 * frames.sway, frames.sway, frames.yaw).tolist()
    stamp = np.round(1e9 * (frames.time + stamped_late)).astype(int).tolist()
    seen, confidence = frames.position.tolist(), frames.confidence.tolist()
    due = np.searchsorted(arrival, 0.002 + np.arange(len(legs)) / 50.0, side="right").tolist()
    keep, next_frame = (frames.keep & tracking).tolist(), 0
    rows, states = [], []
    for k, (place, turn) in enumerate(zip(legs.tolist(), attitude.tolist(), strict=True)):
        while next_frame < due[k]:
            if keep[next_frame]:
                i = next_frame
                map_frame.add_tracking(stamp[i], seen[i], rotation[i], confidence[i])
            next_frame += 1
        assert map_frame.add_odometry(k * 20_000_000, place, turn)
        base, base_rotation = map_frame.base_in_map
        heading = heading_between(base_rotation, about_z(yaw[4 * k]))
        rows.append([*base, heading, *map_frame.map_to_odom])
        states.append(map_frame.state)
    table = np.array(rows)
    return Trial(
        map_frame,
        np.arange(len(legs)) / 50.0,
        table[:, :3] - position[::4],
        table[:, 3],
        table[:, 4:],
        states,
        said,
        map_frame.deviation,
    )


SHORT = Walk(distance=7.5)


@cache
def short():
    """Return the short walk without faults."""
    return run(SHORT)


def beside_short(trial):
    """Return how far a short walk with a fault is from one without, at most [m]."""
    return float(np.linalg.norm(trial.error - short().error, axis=1).max())


QUIET = 5e-3
"""Step of the base in map beyond its motion that is none [m].

Odometry has noise of 0.5 mm on each axis, which makes steps of up to 3 mm, and a correction takes
0.9 of what legs of 1.5 % have done wrong in 5 cm, 0.7 mm.
"""
