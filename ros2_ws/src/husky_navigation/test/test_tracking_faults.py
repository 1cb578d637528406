"""The localizer with a T265 that jumps, relocalises, is lost, or comes back."""

import math
from dataclasses import replace

import numpy as np
import pytest
from localized_walk import (
    FROZEN,
    FUSED,
    LOST,
    PARAMETERS,
    QUIET,
    RELOCALISED,
    SETTLING,
    SHORT,
    Walk,
    beside_short,
    run,
    short,
)

from husky_navigation.map_frame import MapFrame


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


def silent_round(change):
    """Walk a round, 2.5 m of it by the legs alone, with another fault at the start again."""

    def both(frames, legs):
        frames.keep[frames.since(9.0, 11.5)] = False
        change(frames, legs)

    return run(replace(ROUND, distance=13.5), both)


def test_jump_after_a_silence_is_no_relocalisation():
    """Reject 0.3 m: over 2.5 m, legs of 1.5 % drift by 4 cm, and over 9.5 m a T265 by as much.

    The filter's random walks grow to 13 cm, of which 0.3 m are within three deviations.
    """
    trial = silent_round(jump(12.8, by=(-0.14, 0.27, 0.0)))
    assert trial.counts == {"frozen": 1, "jumps": 1, "absorbed": 1}
    assert trial.step(12.0, 13.5) < QUIET
    assert trial.distance[-1] < 0.06


def test_relocalisation_after_a_silence_corrects_the_base():
    """Correct a drift of the T265 of 0.14 m in 12 m: it has tracked on while it was silent."""
    trial = silent_round(drift(12.8))
    assert trial.counts == {"frozen": 1, "jumps": 1, "relocalised": 1}
    assert trial.distance[-1] < 0.04 < 0.09 < trial.distance[round(50 * 12.8)]


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
