"""The gait table and the clock of the legs."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_control.gait.table import COLUMN_UNITS, GAITS, GaitClock

DT = 0.002
LATE = 0.06
FL, FR, HL, HR = range(4)
NAMES = sorted(GAITS)


def walk(clock, duration, ground=lambda clock: ~clock.swinging, late=LATE, dt=DT):
    """Run a clock; the (time, leg) of its touchdowns and liftoffs, and (ticks, 4) of swinging."""
    touchdowns, liftoffs, swinging = [], [], []
    for tick in range(round(duration / dt)):
        clock.tick(np.ascontiguousarray(ground(clock)), True, late, dt)
        touchdowns += [(tick * dt, leg) for leg in range(4) if clock.touchdown[leg]]
        liftoffs += [(tick * dt, leg) for leg in range(4) if clock.liftoff[leg]]
        swinging.append(clock.swinging.copy())
    return touchdowns, liftoffs, np.array(swinging)


def on_time(clock):
    """Ground that is met when the clock expects it: at the end of the swing, to a tick."""
    return ~clock.swinging | (clock.swing_progress > 1.0 - DT / clock.swing_time)


# ------------------------------------------------------------------ the table


def test_the_gaits_of_the_thesis_are_there():
    assert set(GAITS) == {"crawl", "trot", "bound", "pronk", "climb"}
    assert all(name == gait.name for name, gait in GAITS.items())


@pytest.mark.parametrize("name", NAMES)
def test_rows_are_sane(name):
    gait = GAITS[name]
    assert set(COLUMN_UNITS) == set(gait._fields) - {"name", "touchdown_phase"}
    assert all(0.0 <= phase < 1.0 for phase in gait.touchdown_phase)
    assert 0.0 < gait.duty < 1.0
    assert gait.max_speed > 0.0
    # What the leg must reach: half a stance ahead at full speed, at the stance height, straight.
    reach = math.hypot(gait.stance_height, 0.5 * gait.max_speed * gait.period * gait.duty)
    assert reach < 0.64


def test_trot_moves_diagonal_pairs_half_a_period_apart():
    phase = GAITS["trot"].touchdown_phase
    assert phase[FL] == phase[HR] and phase[FR] == phase[HL]
    assert (phase[FL] - phase[FR]) % 1.0 == 0.5


def test_bound_moves_front_and_hind_pairs():
    phase = GAITS["bound"].touchdown_phase
    assert phase[FL] == phase[FR] and phase[HL] == phase[HR]
    assert (phase[FL] - phase[HL]) % 1.0 == 0.5


def test_pronk_moves_all_legs_at_once():
    assert len(set(GAITS["pronk"].touchdown_phase)) == 1


def test_crawl_always_stands_on_three_legs():
    gait = GAITS["crawl"]
    assert gait.static_margin > 0.0
    liftoff = [(phase + gait.duty) % 1.0 for phase in gait.touchdown_phase]
    for a in range(4):
        for b in range(4):
            if a != b:
                assert (liftoff[b] - liftoff[a]) % 1.0 >= 1.0 - gait.duty - 1e-12


# ------------------------------------------------------------------- the clock


@pytest.mark.parametrize("name", NAMES)
def test_each_leg_lifts_and_lands_once_a_period(name):
    gait = GAITS[name]
    clock = GaitClock(gait)
    walk(clock, gait.period, on_time)  # the first cycle begins on four feet
    periods = 5
    # Each swing may wait a tick for the ground, so that a cycle is longer by a few ticks.
    touchdowns, liftoffs, _ = walk(clock, (periods + 0.1) * gait.period, on_time)
    for events in (touchdowns, liftoffs):
        for leg in range(4):
            times = [time for time, who in events if who == leg]
            assert periods <= len(times) <= periods + 1
            assert np.diff(times) == pytest.approx(gait.period, abs=5 * DT)


@pytest.mark.parametrize("name", NAMES)
def test_legs_stand_for_their_duty(name):
    gait = GAITS[name]
    clock = GaitClock(gait)
    walk(clock, gait.period, on_time)
    _, _, swinging = walk(clock, 10 * gait.period, on_time)
    # Events fall on ticks: two of them a cycle, and a cycle at either end may be cut.
    tolerance = 3 * DT / gait.period + 0.02
    np.testing.assert_allclose(1.0 - swinging.mean(axis=0), gait.duty, atol=tolerance)


@pytest.mark.parametrize(
    ("name", "together"),
    [
        ("trot", [{FL, HR}, {FR, HL}]),
        ("bound", [{FL, FR}, {HL, HR}]),
        ("pronk", [{FL, FR, HL, HR}]),
        ("crawl", [{FL}, {FR}, {HL}, {HR}]),
    ],
)
def test_legs_swing_in_the_groups_of_the_gait(name, together):
    _, _, swinging = walk(GaitClock(GAITS[name]), 4 * GAITS[name].period, on_time)
    seen = {frozenset(np.flatnonzero(row)) for row in swinging} - {frozenset()}
    assert seen == {frozenset(group) for group in together}


def test_crawl_goes_around_hind_then_front_of_a_side():
    _, liftoffs, _ = walk(GaitClock(GAITS["crawl"]), 4.2 * GAITS["crawl"].period, on_time)
    order = [leg for _, leg in liftoffs]
    for leg, following in itertools.pairwise(order):
        assert following == {HL: FL, FL: HR, HR: FR, FR: HL}[leg]


@pytest.mark.parametrize("name", NAMES)
def test_a_gait_starts_with_all_feet_down_and_soon_lifts(name):
    clock = GaitClock(GAITS[name])
    assert not clock.swinging.any()
    leg, wait = clock.next_to_lift()
    _, liftoffs, _ = walk(clock, GAITS[name].period, on_time)
    time, first = liftoffs[0]
    assert GAITS[name].touchdown_phase[first] == GAITS[name].touchdown_phase[leg]
    assert time == pytest.approx(wait, abs=2 * DT)


def test_early_contact_ends_the_swing_in_its_second_half_only():
    trot = GAITS["trot"]
    clock = GaitClock(trot)
    always = np.ones(4, dtype=bool)
    progress = []
    for _ in range(round(0.5 * trot.period / DT)):
        progress.append(clock.swing_progress[FL] if clock.swinging[FL] else -1.0)
        clock.tick(always, True, LATE, DT)
    last = max(progress)
    assert last == pytest.approx(0.5, abs=DT / clock.swing_time + 1e-9)


def test_late_contact_makes_the_clock_wait_and_no_longer_than_the_limit():
    trot = GAITS["trot"]
    clock = GaitClock(trot)
    air = np.zeros(4, dtype=bool)
    waited, waits, lifted = 0, [], []
    for tick in range(round(3.0 / DT)):
        clock.tick(air, True, LATE, DT)
        waited += int(clock.swing_progress[FL] == 1.0)
        if clock.touchdown[FL]:
            waits.append(waited * DT)
            waited = 0
        if clock.liftoff[FL]:
            lifted.append(tick * DT)
    assert len(waits) > 4
    assert waits == pytest.approx(np.full(len(waits), LATE), abs=2 * DT)
    # While a leg is awaited time stands still for the gait: each diagonal is, once a period (but
    # in the first, that begins on four feet).
    assert np.diff(lifted)[1:] == pytest.approx(trot.period + 2 * LATE, abs=6 * DT)


def test_the_phase_stands_still_while_a_leg_is_late():
    clock = GaitClock(GAITS["trot"])
    air = np.zeros(4, dtype=bool)
    phases = []
    for _ in range(round(GAITS["trot"].period / DT)):
        clock.tick(air, True, 10.0, DT)
        phases.append(clock.phase)
    assert phases[-1] == phases[-10]
    assert clock.swing_progress[FL] == 1.0
    clock.tick(np.ones(4, dtype=bool), True, 10.0, DT)
    assert clock.touchdown[FL] and not clock.swinging[FL]
    clock.tick(np.ones(4, dtype=bool), True, 10.0, DT)
    assert clock.phase != phases[-1]


@pytest.mark.parametrize("name", NAMES)
def test_no_leg_lifts_when_it_may_not_and_swinging_legs_land(name):
    clock = GaitClock(GAITS[name])
    walk(clock, GAITS[name].period * 1.3, on_time)
    for _ in range(round(GAITS[name].period / DT)):
        clock.tick(on_time(clock), False, LATE, DT)
        assert not clock.liftoff.any()
    assert not clock.swinging.any()
    assert (clock.swing_progress == -1.0).all()


@settings(max_examples=60)
@given(
    st.sampled_from(NAMES),
    st.lists(
        st.tuples(
            st.lists(st.booleans(), min_size=4, max_size=4), st.booleans(), st.integers(1, 60)
        ),
        min_size=1,
        max_size=30,
    ),
)
def test_whatever_the_ground_does_events_alternate(name, stretches):
    """Liftoff only from stance, touchdown only from swing, swings no longer than they may be."""
    clock = GaitClock(GAITS[name])
    before = clock.swinging.copy()
    swing = np.zeros(4)
    for contact, lift, ticks in stretches:
        for _ in range(ticks):
            clock.tick(np.array(contact), lift, LATE, DT)
            assert not (clock.liftoff & before).any()
            assert not (clock.touchdown & ~before).any()
            assert ((before | clock.liftoff) & ~clock.touchdown == clock.swinging).all()
            assert 0.0 <= clock.phase < 1.0
            inside = (clock.swing_progress >= 0.0) & (clock.swing_progress <= 1.0)
            assert (inside == clock.swinging).all()
            swing = np.where(clock.swinging, swing + DT, 0.0)
            # A wait of another leg delays this one, too: at most one limit for each of the legs.
            assert (swing <= clock.swing_time + 4 * LATE + 8 * DT).all()
            before = clock.swinging.copy()


@pytest.mark.parametrize("name", NAMES)
def test_swing_windows_tell_when_the_swing_will_be(name):
    gait = GAITS[name]
    clock = GaitClock(gait)
    walk(clock, 0.02 * gait.period, on_time)  # off the events, where end and begin are the same
    for leg in range(4):
        begin, end = clock.swing_window(leg)
        assert 0.0 <= begin <= end <= gait.period
        assert end - begin <= clock.swing_time + 1e-12
        if begin > 0.0:
            assert end - begin == pytest.approx(clock.swing_time)
    begin, end = clock.swing_window(FL)
    touchdowns, liftoffs, _ = walk(clock, end + 0.1, on_time)
    # A tick of waiting at each touchdown of the others.
    if begin > 0.0:
        assert next(t for t, leg in liftoffs if leg == FL) == pytest.approx(begin, abs=8 * DT)
    assert next(t for t, leg in touchdowns if leg == FL) == pytest.approx(end, abs=8 * DT)
