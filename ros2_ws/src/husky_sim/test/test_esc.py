"""Speed controller: arming, loss of pulses, dead band, lag, soft cut-off."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_description.robot import load_robot
from husky_sim.propulsion.esc import ESC, OPEN, esc_constants, step_esc

ROBOT = load_robot()
SHARED = esc_constants(ROBOT)
DT = 0.01
ARMING, TIMEOUT = 100, 10  # steps
FULL = 25.2


def make():
    escs = np.zeros(1, ESC)
    escs["limit"] = 1.0
    return escs


def run(escs, pulse, steps, voltage=FULL, shared=SHARED, dt=DT):
    out = OPEN
    for _ in range(steps):
        out = step_esc(escs[0], float(pulse), voltage, dt, shared[0])
    return out


def armed():
    escs = make()
    assert run(escs, 1000, ARMING) == 0.0
    return escs


def test_arms_after_a_second_of_low_pulses():
    escs = make()
    assert run(escs, 1000, ARMING - 1) == OPEN
    assert run(escs, 1000, 1) == 0.0
    assert run(escs, 1500, 1) > 0.0


@pytest.mark.parametrize("pulse", [0, 1050, 1500, 2000, 799, 2201])
def test_never_arms_without_low_pulses(pulse):
    assert run(make(), pulse, 5 * ARMING) == OPEN


RUNS = st.lists(
    st.tuples(st.sampled_from(["low", "high", "none"]), st.integers(1, 130)), min_size=1, max_size=8
)
WIDTH = {"low": 1000.0, "high": 1600.0, "none": 0.0}


@settings(max_examples=60)
@given(RUNS)
def test_bridge_closes_and_opens_as_the_history_of_pulses_says(runs):
    kinds = [kind for kind, length in runs for _ in range(length)]
    ends = range(ARMING - 1, len(kinds))
    seconds_of_low = [m for m in ends if set(kinds[m - ARMING + 1 : m + 1]) == {"low"}]
    escs = make()
    for n in range(len(kinds)):
        out = run(escs, WIDTH[kinds[n]], 1)
        # Declared over the whole history: some second of low pulses, and since then no gap.
        armed_at = max((m for m in seconds_of_low if m <= n), default=None)
        drives = False
        if armed_at is not None:
            since = "".join(kind[0] for kind in kinds[armed_at : n + 1])
            drives = "n" * (TIMEOUT + 1) not in since
        assert (out != OPEN) == drives


def test_last_pulse_holds_through_a_short_gap_and_no_longer():
    escs = armed()
    before = run(escs, 1600, 200)
    assert run(escs, 0, TIMEOUT) == pytest.approx(before)
    assert run(escs, 0, 1) == OPEN
    assert run(escs, 1600, 300) == OPEN  # not by itself
    assert run(escs, 1000, ARMING) == 0.0
    assert run(escs, 1600, 200) == pytest.approx(before)


@given(st.floats(1050.0, 2200.0))
def test_throttle_is_linear_in_the_pulse(pulse):
    escs = armed()
    assert run(escs, pulse, 300) == pytest.approx(min((pulse - 1000.0) / 1000.0, 1.0))


def test_dead_band_stands_still():
    assert run(armed(), 1049.9, 300) == 0.0


@pytest.mark.parametrize("dt", [0.0005, 0.002, 0.01])
def test_lag_is_first_order_whatever_the_step(dt):
    escs = armed()
    steps = round(0.05 / dt)
    assert run(escs, 2000, steps, dt=dt) == pytest.approx(
        1.0 - math.exp(-0.05 / ROBOT.esc.throttle_lag)
    )


def test_cut_off_integrates_the_missing_voltage_and_gives_it_back():
    escs = armed()
    run(escs, 2000, 300)
    cutoff = 6 * ROBOT.esc.cutoff_cell_voltage
    assert run(escs, 2000, 50, voltage=cutoff - 1.0) == pytest.approx(
        1.0 - 0.5 * ROBOT.esc.cutoff_gain
    )
    assert run(escs, 2000, 50, voltage=cutoff) == pytest.approx(1.0 - 0.5 * ROBOT.esc.cutoff_gain)
    assert run(escs, 2000, 1000, voltage=cutoff - 1.0) == 0.0
    assert run(escs, 2000, 1000, voltage=cutoff + 1.0) == pytest.approx(1.0)


def test_a_failed_bridge_stays_open():
    escs = armed()
    run(escs, 1600, 200)
    escs["failed"] = 1
    assert run(escs, 1600, 200) == OPEN
    escs["failed"] = 0
    first = run(escs, 1600, 1)
    assert 0.0 < first < 0.1  # comes back through the lag
