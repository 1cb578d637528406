"""The stance schedule from the gait table, against the gait's own clock."""

from __future__ import annotations

import numpy as np
import pytest

from husky_control.gait.table import GAITS, GaitClock
from husky_control.planning.collocation.schedule import make_schedule


@pytest.mark.parametrize("name", GAITS)
def test_legs_stand_when_the_gait_clock_says_so(name: str) -> None:
    gait = GAITS[name]
    schedule = make_schedule(gait, 24)
    clock = GaitClock(gait)
    ticks = 2000
    contact = np.ones(4, dtype=bool)
    for _ in range(2 * ticks):  # past the start, where all feet stand
        clock.tick(contact, True, 0.0, gait.period / ticks)
        interval = int(np.searchsorted(schedule.grid, clock.phase, side="right")) - 1
        near = np.abs(schedule.grid - clock.phase).min() < 3.0 / ticks
        if not near and not clock.swinging.any() and name != "pronk":
            continue  # a contact may end a swing early
        for leg in np.flatnonzero(clock.swinging):
            assert near or not schedule.stance[interval, leg]


@pytest.mark.parametrize("name", GAITS)
def test_shares_of_stance_are_the_duty(name: str) -> None:
    gait = GAITS[name]
    schedule = make_schedule(gait, 24)
    share = np.diff(schedule.grid) @ schedule.stance
    assert np.allclose(share, gait.duty)
    changes = np.flatnonzero((schedule.stance[1:] != schedule.stance[:-1]).any(axis=1)) + 1
    assert set(changes) <= set(schedule.switches)


def test_a_trot_has_two_slots_and_one_switch() -> None:
    schedule = make_schedule(GAITS["trot"], 20)
    assert schedule.slots == 2
    assert schedule.switches == (10,)
    assert schedule.slot_legs()[0].tolist() == [0, 3]
    assert schedule.slot_legs()[-1].tolist() == [1, 2]
    assert schedule.middle[0].tolist() == [0.25, 0.0, 0.0, 0.25]
    assert schedule.middle[-1].tolist() == [0.0, 0.75, 0.75, 0.0]


def test_with_a_slot_for_each_leg_nobody_moves() -> None:
    schedule = make_schedule(GAITS["crawl"], 24)
    table = schedule.slot_legs()
    assert schedule.slots == 4
    assert np.all((table == -1) | (table == np.arange(4)))
    assert np.all((table >= 0) == schedule.stance)


def test_what_cannot_be_scheduled_is_refused() -> None:
    with pytest.raises(ValueError, match="phases"):
        make_schedule(GAITS["crawl"], 4)
    with pytest.raises(ValueError, match="duty"):
        make_schedule(GAITS["trot"]._replace(duty=1.0), 8)
