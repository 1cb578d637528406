"""Costs of ways of moving: their file, and what is read from it."""

from __future__ import annotations

import io
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from husky_navigation.planning.travel_costs import (
    METRE,
    ONCE,
    TABLE,
    TravelCost,
    TravelCosts,
    read_costs,
    write_costs,
)

ROWS = [
    TravelCost("carbon", "climb", -30.0, 0.0, 0.25, METRE, 4.0, 1000.0),
    TravelCost("carbon", "climb", 0.0, 0.0, 0.25, METRE, 4.0, 200.0),
    TravelCost("carbon", "climb", 30.0, 0.0, 0.25, METRE, 5.0, 2600.0),
    TravelCost("carbon", "to_climb", 0.0, 0.0, 0.0, ONCE, 6.5, 300.0),
    TravelCost("beta", "walk", 0.0, 0.0, 0.3, METRE, 3.3, 100.0),
]


def written(rows: list[TravelCost] = ROWS) -> str:
    file = io.StringIO()
    write_costs(file, rows, "made by a test")
    return file.getvalue()


def test_costs_that_are_written_are_read_again() -> None:
    assert read_costs(io.StringIO(written())) == ROWS


def test_between_two_slopes_costs_are_linear_and_far_beyond_them_unknown() -> None:
    slopes = np.array([-15.0, 15.0, 32.0, 34.0])
    time, energy = TravelCosts(ROWS[:4]).per_metre("climb", 0.25, slopes)
    np.testing.assert_allclose(time, [4.0, 4.5, 5.0, np.nan])
    np.testing.assert_allclose(energy, [600.0, 1400.0, 2600.0, np.nan])


def test_a_cost_that_was_not_measured_is_named() -> None:
    costs = TravelCosts(ROWS[:4])
    with pytest.raises(LookupError, match=r"'climb' at 0\.5 m/s"):
        costs.per_metre("climb", 0.5, np.zeros(1))
    with pytest.raises(LookupError, match="0 costs of mode 'fly' for the unit 'once'"):
        costs.of("fly", ONCE)
    assert costs.of("to_climb", ONCE).energy == 300.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "columns are"),
        (written().replace("slope_deg", "slope"), "columns are"),
        (written().replace(",once,", ",month,"), "row 4: unit is 'month'"),
        (written().replace(",6.5,300", ",6.5"), "row 4: it must have 8 columns"),
        (written().replace("6.5", "soon"), "row 4: could not convert"),
        (written().replace("6.5", "nan"), "row 4: time is nan"),
        (written().replace("2600", "-1"), "row 3: energy is -1"),
    ],
)
def test_a_damaged_table_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "costs.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        TravelCosts.load("carbon", path)


def test_a_robot_without_costs_is_named(tmp_path: Path) -> None:
    path = tmp_path / "costs.csv"
    path.write_text(written())
    with pytest.raises(ValueError, match="no costs of 'delta', there are those of carbon, beta"):
        TravelCosts.load("delta", path)


@pytest.mark.parametrize("robot", ["carbon", "beta"])
def test_the_measured_costs(robot: str) -> None:
    """A faster trot costs less for a metre: standing costs too."""
    costs = TravelCosts.load(robot, TABLE)
    trots = [c for c in costs.rows if (c.mode, c.unit, c.thrust_share) == ("walk", METRE, 0.0)]
    trots = sorted((c for c in trots if c.slope_deg == 0.0), key=lambda cost: cost.speed)
    assert all(a.energy > b.energy and a.time > b.time for a, b in pairwise(trots))
