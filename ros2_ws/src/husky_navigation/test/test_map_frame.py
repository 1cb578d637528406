"""The localizer on walks in closed form, with the errors of legs and T265.

Legs have a wrong scale and a heading that drifts with the distance, both constant: the worst case
for a filter that takes them for random. The T265 has the errors of `husky_sim.devices.t265`.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_description.rotation import about_z, from_roll_pitch_yaw, multiply
from husky_navigation.frame_filter import LevelTransform, heading_between
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
KNOWN = {}


def short():
    """Return the short walk without faults."""
    if not KNOWN:
        KNOWN["short"] = run(SHORT)
    return KNOWN["short"]


def beside_short(trial):
    """Return how far a short walk with a fault is from one without, at most [m]."""
    return float(np.linalg.norm(trial.error - short().error, axis=1).max())


QUIET = 5e-3
"""Step of the base in map beyond its motion that is none [m].

Odometry has noise of 0.5 mm on each axis, which makes steps of up to 3 mm, and a correction takes
0.9 of what legs of 1.5 % have done wrong in 5 cm, 0.7 mm.
"""


# Accuracy ---------------------------------------------------------------------------------------
def test_without_a_t265_map_is_odom_and_its_deviation_grows():
    walk = Walk()
    trial = run(walk, tracking=False)
    assert set(trial.states) == {LEGS_ONLY}
    assert not trial.odom.any()
    # Steps on a circle of the wrong radius do not close: the chord that is left, in closed form.
    turn = 2.0 * math.pi / LOOP + walk.heading
    own = (1.0 + walk.scale) * 2.0 * math.sin(0.5 * walk.heading * LOOP) / turn
    assert trial.distance[-1] == pytest.approx(own, abs=0.01)  # the noise of odometry
    assert trial.yaw_error[-1] == pytest.approx(walk.heading * LOOP)
    deviation = np.hypot(*trial.deviation[:2])
    assert 0.3 * own < deviation < 3.0 * own


def test_loop_of_50_m_ends_within_half_a_percent():
    """Legs alone end 0.79 m off. The T265 alone would end up to 0.4 m off, 0.1 m in the mean."""
    trial = run(Walk())
    assert trial.distance.max() <= 0.005 * LOOP
    assert abs(trial.yaw_error).max() < 0.02  # legs alone 0.1
    assert trial.distance[-1] < 3.0 * np.hypot(*trial.deviation[:2])
    assert 0.05 < np.hypot(*trial.deviation[:2]) < 0.01 * LOOP
    assert trial.counts == {}
    assert trial.map_frame.counters.fused == pytest.approx(20 * LOOP, rel=0.02)


def test_base_takes_the_share_of_the_less_drift():
    """A T265 without error; of what legs do wrong the filter leaves the share of its drift."""
    walk = Walk(distance=10.0, turn_rate=0.0, heading=0.0, tracking=0.0)
    trial = run(walk)
    p = PARAMETERS
    legs = p.leg_drift_length * p.leg_drift**2
    share = legs / (legs + p.tracking_drift_length * p.tracking_drift**2)
    start, end = trial.error[[125, -1], 0]  # from when the T265 is sure of itself, at 2 s
    own = walk.scale * (walk.distance - 2.5)
    assert end - start == pytest.approx((1.0 - share) * own, abs=3e-3)  # the noise


def test_covariance_on_a_line_is_that_of_two_random_walks():
    map_frame = MapFrame()
    for k in range(1001):
        map_frame.add_odometry(20_000_000 * k, (0.02 * k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    p, s = PARAMETERS, 20.0
    growth = 2.0 * p.leg_drift_length * p.leg_drift**2
    turn = p.leg_heading_drift**2 + p.leg_rest_drift**2  # at 1 m/s
    covariance = map_frame.covariance
    assert covariance[0, 0] == pytest.approx(growth * s, rel=1e-3)
    assert covariance[1, 1] == pytest.approx(growth * s + turn * s**3 / 3.0, rel=5e-3)
    assert covariance[1, 3] == pytest.approx(turn * s**2 / 2.0, rel=5e-3)
    assert covariance[3, 3] == pytest.approx(turn * s, rel=1e-3)


# Delay ------------------------------------------------------------------------------------------
TURNING = Walk(1.2, 0.3, 0.0, 1.0, rest=2.0, latency=0.0, jitter=0.03, scale=0.0, heading=0.0)


def test_delay_adds_no_error_at_turns_of_1_rad_per_s():
    prompt, late = run(TURNING), run(replace(TURNING, latency=0.1))
    assert late.counts == prompt.counts == {}
    assert late.map_frame.counters.tracking > 0.98 * 200 * 6  # the last 0.1 s have not come
    # 1.2 m by legs without error: noise, and the drift of the T265, 0.3 % of it.
    assert abs(late.yaw_error).max() < abs(prompt.yaw_error).max() + 1e-3 < 6e-3
    assert late.distance.max() < prompt.distance.max() + 1e-3 < 0.012


def test_delay_that_is_not_compensated_turns_the_base():
    """The same with the stamp of arrival, and a filter that believes the T265 of all turns.

    At 1 rad/s 0.1 s are 0.1 rad.
    """
    late = replace(TURNING, latency=0.1, jitter=0.0)
    open_gates = replace(
        PARAMETERS, jump_distance=1.0, jump_angle=1.0, gate=20.0, leg_turn_drift=0.1
    )
    compensated = run(late, parameters=open_gates)
    trial = run(late, stamped_late=0.1, parameters=open_gates)
    assert abs(compensated.yaw_error).max() < 6e-3
    assert abs(trial.yaw_error).max() == pytest.approx(0.1, abs=0.02)


# Jumps ------------------------------------------------------------------------------------------
def jump(start, end=math.inf, by=(0.2, -0.2, 0.1)):
    def change(frames, legs):
        frames.position[frames.since(start, end)] += by

    return change


def test_jump_of_the_t265_moves_nothing_in_map():
    trial = run(SHORT, jump(5.0))
    assert trial.counts == {"jumps": 1, "absorbed": 1}
    assert trial.changes()[2:] == [(5.04, SETTLING), (5.54, FUSED)]  # with 30 to 40 ms of latency
    assert trial.step(4.9, 6.0) < QUIET
    # For 0.5 s, which are 0.5 m, legs of 1.5 % have gone on alone.
    assert beside_short(trial) < 0.015
    assert "jumped by 0.30 m and 0.00 rad" in trial.said[1]


def test_turn_of_the_t265_is_a_jump():
    def change(frames, legs):
        frames.turn(5.0, 0.15)

    trial = run(SHORT, change)
    assert trial.counts == {"jumps": 1, "absorbed": 1}
    assert trial.step(4.9, 6.0) < QUIET
    assert beside_short(trial) < 0.015


def test_jump_that_goes_back_changes_nothing():
    trial = run(SHORT, jump(5.0, 5.2))
    assert trial.counts == {"jumps": 2, "returned": 1}
    # The filter has seen no frame for 0.2 s: legs of 1.5 % at 1 m/s.
    assert beside_short(trial) < 5e-3


def test_small_jumps_in_a_row_are_seen_on_all_frames():
    """Twenty frames at 10 cm more each, between which no frame is fused."""

    def change(frames, legs):
        for k in range(20):
            frames.position[frames.since(5.0 + 0.005 * k)] += (0.1, 0.0, 0.0)

    trial = run(SHORT, change)
    assert trial.counts == {"jumps": 20, "absorbed": 1}
    assert trial.step(4.9, 6.0) < QUIET


# Motion without the legs ------------------------------------------------------------------------
def test_t265_is_believed_of_a_robot_that_is_carried():
    """Legs do not notice 0.5 m, in 0.5 s: 5 mm in a frame, which is no jump."""

    def change(frames, legs):
        position, _ = legs
        missed = position[275, :2] - position[250, :2]
        position[250:275, :2] = position[250, :2]
        position[275:, :2] -= missed

    trial = run(SHORT, change)
    # Most of ten updates: a first one may be within the gate.
    assert trial.counts.keys() == {"slips"}
    assert 8 <= trial.counts["slips"] <= 11
    assert trial.said[1:] == ["the T265 moves as the legs do not explain; it is believed"]
    # Until the next frame is fused, that is for 0.05 s and the latency, the base stays behind.
    assert beside_short(trial) < 0.1
    assert np.linalg.norm(trial.error[-1] - short().error[-1]) < 0.03


# Relocalisation ---------------------------------------------------------------------------------
ROUND = Walk(distance=15.0, turn_rate=2.0 * math.pi / 12.0)
"""Passes its start after 12 m."""


def drift(until, by=(0.1, -0.1, 0.02), then=(0.0, 0.0, 0.0)):
    """Let the T265 drift by so much [m] in 12 m, until it takes itself to be elsewhere."""

    def change(frames, legs):
        gone = np.outer(np.minimum(frames.time / 12.0, 1.0), by)
        gone[frames.since(until)] = then
        frames.position += gone

    return change


def test_relocalisation_corrects_the_base():
    walk, when = ROUND, 12.8
    trial = run(walk, drift(when))
    before, after = (trial.distance[round(50 * time)] for time in (when, when + 1.0))
    assert trial.counts == {"jumps": 1, "relocalised": 1}
    assert trial.changes()[2:] == [(12.84, SETTLING), (13.34, RELOCALISED)]
    assert before > 0.09
    # A place is known within 3 cm; the share of the drift that is left is less.
    assert after < 0.03
    assert trial.step(when + 0.4, when + 0.6) == pytest.approx(before - after, abs=0.02)
    assert trial.step(when - 0.5, when + 0.4) < QUIET
    # That of the place, 7 cm, which the legs had reached before the T265 was used.
    assert trial.deviation[0] < 0.09  # 0.12 without


def test_jump_to_where_the_base_cannot_be_is_no_relocalisation():
    """At the start again, by 0.6 m: six deviations of the drift since then."""
    trial = run(ROUND, drift(12.8, then=(0.5, 0.5, 0.0)))
    assert trial.counts == {"jumps": 1, "absorbed": 1}
    assert trial.step(12.0, 14.0) < QUIET


def test_jump_where_the_t265_has_not_been_is_no_relocalisation():
    """The same drift is taken back half-way round."""
    trial = run(replace(ROUND, distance=8.0), drift(6.8))
    assert trial.counts == {"jumps": 1, "absorbed": 1}
    assert trial.step(6.0, 8.0) < QUIET


# A T265 that is gone ----------------------------------------------------------------------------
def freeze(frames, legs):
    gone = frames.since(4.0, 6.0)
    for values in (frames.position, frames.yaw, frames.sway):
        values[gone] = values[np.argmax(gone)]


def silence(frames, legs):
    frames.keep[frames.since(4.0, 6.0)] = False


def lose(frames, legs):
    """As the emulated fault `lost`, with 0.5 m/s^2; the pose stays as wrong as it is."""
    frames.confidence[frames.since(4.0, 6.0)] = 0
    frames.position[:, 0] += 0.25 * np.clip(frames.time - 4.0, 0.0, 2.0) ** 2


@pytest.mark.parametrize(
    ("change", "state", "noticed", "counts"),
    [
        (freeze, FROZEN, 4.08, {"repeated": 399, "frozen": 1}),  # 2 cm, and a latency of 40 ms
        (silence, FROZEN, 4.54, {"frozen": 1}),
        (lose, LOST, 4.04, {"lost": 1}),
    ],
)
def test_legs_go_on_without_the_t265(change, state, noticed, counts):
    trial = run(SHORT, change)
    assert trial.counts == counts
    (start, there), *back = trial.changes()[2:]
    assert there is state
    assert start == pytest.approx(noticed, abs=0.03)
    assert back == [(6.04, SETTLING), (6.54, FUSED)]
    # Nothing jumps, though the T265 is wrong by up to 2 m.
    assert trial.step(3.9, 7.5) < QUIET
    # Legs of 1.5 % have gone alone for 2.5 m.
    assert 0.02 < beside_short(trial) < 0.06
    # Their deviation, by the filter's formula, takes the place of the T265's.
    more = np.diff([short().deviation[0] ** 2, trial.deviation[0] ** 2])[0]
    p = PARAMETERS
    legs = 2.0 * p.leg_drift_length * p.leg_drift**2
    tracking = 2.0 * p.tracking_drift_length * p.tracking_drift**2
    assert more > 2.4 * (legs - legs * tracking / (legs + tracking))


def test_t265_that_stands_with_the_robot_is_not_frozen():
    """Not even without noise: all frames have one pose then."""
    map_frame, level = MapFrame(), (0.0, 0.0, 0.0, 1.0)
    for k in range(200):
        map_frame.add_odometry(20_000_000 * k, (0.0, 0.0, 0.0), level)
        for i in range(4):
            map_frame.add_tracking(20_000_000 * k + 5_000_000 * i, (1.0, 0.0, 0.0), level, 3)
    assert map_frame.counters.frozen == 0
    assert map_frame.counters.repeated > 700


def test_t265_that_starts_again_is_anchored_anew():
    """At zero and with low confidence, as after the fault `power_cycle`."""

    def change(frames, legs):
        later = frames.since(5.0)
        frames.turn(5.0, -frames.yaw[np.argmax(later)])
        frames.position[later] -= frames.position[np.argmax(later)].copy()
        frames.confidence[frames.since(5.0, 6.0)] = 1

    trial = run(SHORT, change)
    assert trial.counts == {"jumps": 1, "absorbed": 1}
    assert trial.step(4.9, 7.5) < QUIET
    assert beside_short(trial) < 0.03


def test_less_confidence_counts_less():
    """Deviations of the T265 are eight times as great at low confidence, and so its share less."""

    def change(frames, legs):
        frames.confidence[:] = 1

    trial = run(SHORT, change)
    assert trial.distance[-1] > 2.0 * short().distance[-1]
    assert trial.deviation[0] > 1.3 * short().deviation[0]


# Odometry that starts anew ----------------------------------------------------------------------
def restart(frames, legs):
    """Let odom lie elsewhere from 5 s on."""
    position, rotation = legs
    odom = LevelTransform(1.0, -2.0, 0.3, 0.9)
    for k in range(250, len(position)):
        position[k] = odom.apply(position[k].tolist())
        rotation[k] = multiply(odom.rotation, rotation[k].tolist())


@pytest.mark.parametrize("tracking", [True, False])
def test_base_stays_in_map_where_odometry_starts_anew(tracking):
    trial = run(SHORT, restart, tracking=tracking)
    assert trial.counts == {"odometry_restarts": 1}
    assert "odometry starts anew: it stepped by" in trial.said[-1]
    # The way of one step, 2 cm, is not known; the T265 gives it back.
    assert trial.step(4.9, 6.0) < 0.02 + QUIET
    if tracking:
        assert np.linalg.norm(trial.error[-1] - short().error[-1]) < 3e-3
    else:
        other = run(SHORT, tracking=False)
        assert np.linalg.norm(trial.error[-1] - other.error[-1]) < 0.03


def test_t265_that_comes_late_is_compared_with_the_odometry_before_its_restart():
    trial = run(replace(SHORT, latency=0.3, jitter=0.0), restart)
    assert trial.counts == {"odometry_restarts": 1}
    assert np.linalg.norm(trial.error[-1] - short().error[-1]) < 0.01


def test_cleared_localizer_begins_anew():
    map_frame = run(replace(SHORT, distance=2.0)).map_frame
    assert any(map_frame.map_to_odom)
    map_frame.clear()
    assert map_frame.map_to_odom == LevelTransform()
    assert map_frame.state is LEGS_ONLY
    assert map_frame.base_in_map is None
    assert not map_frame.covariance.any()
    assert map_frame.counters.fused > 0
    assert map_frame.add_odometry(0, (3.0, 1.0, 0.5), (0.0, 0.0, 0.0, 1.0))
    assert map_frame.base_in_map == ((3.0, 1.0, 0.5), (0.0, 0.0, 0.0, 1.0))


# Bad input --------------------------------------------------------------------------------------
GOOD = (10**9, (0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("index", "value", "message"),
    [
        (0, 1.5, "stamp is 1.5, it must be whole nanoseconds"),
        (0, -1, "stamp is -1"),
        (1, (0.0, math.nan, 0.0), "position is 0.0, nan, 0.0, it must be finite"),
        (1, (0.0, 0.0, 1e7), "position is 0.0, 0.0, 10000000.0"),
        (1, (0.0, 0.0), "they must have 3 and 4"),
        (2, (0.0, 0.0, 0.0, 0.9), "rotation is 0.0, 0.0, 0.0, 0.9, it must be a unit quaternion"),
        (2, (0.0, 0.0, math.inf, 1.0), "rotation is 0.0, 0.0, inf"),
        (3, 4, "confidence is 4, it must be 0, 1, 2 or 3"),
    ],
)
def test_bad_numbers_are_named(index, value, message):
    map_frame = MapFrame()
    map_frame.add_odometry(*GOOD)
    pose = [*GOOD, 3]
    pose[index] = value
    with pytest.raises(ValueError, match=f"tracking: .*{message}"):
        map_frame.add_tracking(*pose)
    if index < 3:
        with pytest.raises(ValueError, match=f"odometry: .*{message}"):
            map_frame.add_odometry(*pose[:3])
    assert map_frame.add_tracking(*GOOD, 3)


def test_bad_stamps_are_refused_and_counted():
    map_frame, (stamp, *pose) = MapFrame(), GOOD
    period, counters = 20_000_000, map_frame.counters
    assert not map_frame.add_tracking(stamp, *pose, 3)  # before odometry
    for k in range(150):
        assert map_frame.add_odometry(stamp + k * period, *pose)
    newest = stamp + 149 * period
    assert not map_frame.add_odometry(newest, *pose)
    assert not map_frame.add_odometry(newest - 1, *pose)
    assert map_frame.add_tracking(newest - 2_100_000_000, *pose, 3)  # 100 poses are kept: 2 s
    assert not map_frame.add_tracking(newest - 2_100_000_000, *pose, 3)
    assert not map_frame.add_tracking(newest - 2_200_000_000, *pose, 3)
    assert not map_frame.add_tracking(newest + 1_000_000_001, *pose, 3)
    assert map_frame.add_tracking(newest + period, *pose, 3)  # waits
    assert counters.tracking == 0
    assert map_frame.add_odometry(newest + 15 * period, *pose)  # a gap of 0.3 s
    assert counters.tracking == 0
    assert vars(counters) == vars(type(counters)()) | {
        "odometry": 151,
        "odometry_refused": 2,
        "late": 1,
        "refused": 2,
        "ahead": 1,
        "unmatched": 2,
    }


def test_bad_parameter_is_named():
    with pytest.raises(ValueError, match="gate: nan"):
        LocalizerParameters(gate=math.nan)
    with pytest.raises(ValueError, match=r"loop_distance: 2\.0 is not above twice place_radius"):
        LocalizerParameters(loop_distance=2.0)


@given(st.integers(0, 2**32))
@settings(max_examples=6, deadline=None)
def test_whatever_comes_the_base_does_not_jump(seed):
    """Faults of all kinds at random while odometry is good: the base stays near it.

    The T265 may correct what legs can have done wrong, a relocalisation apart: it needs a place of
    5 m ago, and the robot walks 3 m.
    """
    random, map_frame = np.random.default_rng(seed), MapFrame()
    offset, before, stuck = np.zeros(3), np.zeros(3), None
    for k in range(150):
        place = np.array([0.02 * k, 0.0, 0.5])
        map_frame.add_odometry(20_000_000 * k, place, about_z(0.0))
        for i in range(4):
            fault = random.integers(60)
            if fault == 0:
                offset = random.normal(0.0, 1.0, 3)
            elif fault == 1:
                stuck = place + offset if stuck is None else None
            seen = place + offset if stuck is None else stuck
            stamp = 20_000_000 * k + 5_000_000 * i - int(random.integers(200_000_000))
            confidence = int(random.choice([0, 1, 3, 3, 3, 3]))
            map_frame.add_tracking(max(0, stamp), seen, about_z(0.1), confidence)
        base = np.array(map_frame.base_in_map[0]) - place
        assert np.linalg.norm(base - before) < 0.05
        before = base
        if k % 10 == 0:
            assert np.linalg.eigvalsh(map_frame.covariance).min() > -1e-12
    assert np.linalg.norm(before) < 0.3


# Geometry ---------------------------------------------------------------------------------------
def test_level_transform_is_a_turn_about_z_and_a_shift():
    frame = LevelTransform(1.0, 2.0, 3.0, 0.4)
    expected = Rotation.from_euler("z", 0.4).apply([0.5, -0.3, 0.2]) + [1.0, 2.0, 3.0]
    assert frame.apply((0.5, -0.3, 0.2)) == pytest.approx(expected)
    same = LevelTransform.through((0.5, -0.3, 0.2), tuple(expected), 0.4 + 4.0 * math.pi)
    assert same == pytest.approx(frame)


@given(st.tuples(*[st.floats(-3.1, 3.1)] * 4))
@settings(max_examples=30)
def test_heading_between_frames_does_not_depend_on_the_tilt(angles):
    """Of a body that lies at any roll and pitch in a frame that is turned by the fourth angle."""
    body = from_roll_pitch_yaw(*angles[:3])
    turned = multiply(about_z(angles[3]), body)
    assert heading_between(turned, body) == pytest.approx(angles[3], abs=1e-9)
