"""Costs of moving: amounts of way, turn and time, and energy for one unit of each."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from husky_experiments.catalogue import energy
from husky_experiments.figures import energy as figures
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, Fans
from husky_navigation.planning.travel_costs import METRE, ONCE, RADIAN, SECOND, TravelCosts

SPEED, RATE, VOLTS, AMPERES = 0.3, 0.5, 44.0, 2.0


@pytest.fixture
def recording() -> Recording:
    """Return a recording of 10 s: it walks up a slope of 3 to 4 and turns all the while."""
    time = np.linspace(0.0, 10.0, 101)
    along = SPEED * time
    base = Base(
        time=time,
        position=np.column_stack((0.8 * along, np.zeros(101), 0.6 * along)),
        orientation=Rotation.from_euler("z", RATE * time[:, None]).as_quat(),
        velocity=np.zeros((101, 3)),
        angular_velocity=np.zeros((101, 3)),
    )
    fans = Fans(
        time=time,
        speed=np.zeros((101, 4)),
        thrust=np.zeros((101, 4)),
        current=np.zeros((101, 4)),
        battery_voltage=np.full(101, VOLTS),
        battery_current=np.full(101, AMPERES),
        battery_charge=np.ones(101),
        force=np.zeros((101, 3)),
        moment=np.zeros((101, 3)),
        rope_taut=np.zeros((101, 2), dtype=np.bool_),
    )
    return cast(Recording, SimpleNamespace(base=base, fans=fans))


@pytest.mark.parametrize(
    ("unit", "amount"), [(METRE, 4.0 * SPEED), (RADIAN, 4.0 * RATE), (SECOND, 4.0), (ONCE, 1.0)]
)
def test_a_cost_is_for_one_unit(recording: Recording, unit: str, amount: float) -> None:
    cost = energy.cost_of("carbon", energy.Passage("walk", unit, (3.0, 7.0), SPEED), recording)
    assert cost.time == pytest.approx(4.0 / amount)
    assert cost.energy == pytest.approx(4.0 * VOLTS * AMPERES / amount)
    assert (cost.robot, cost.mode, cost.unit, cost.speed) == ("carbon", "walk", unit, SPEED)


def test_the_figure_shows_the_measured_costs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(figures, "save", lambda figure, *_: drawn.append(figure))
    costs = [*TravelCosts.load("carbon").rows, *TravelCosts.load("beta").rows]
    figures.draw_costs(costs, tmp_path)
    over_speed, over_slope, passages = drawn[0].axes
    for axis, kept in (
        (over_speed, [c for c in costs if c.unit == METRE and c.slope_deg == 0.0]),
        (over_slope, [c for c in costs if c.unit == METRE and c.mode == "climb"]),
    ):
        shown = np.concatenate([line.get_ydata() for line in axis.lines])
        assert sorted(shown) == sorted(cost.energy for cost in kept)
    names = [label.get_text() for label in passages.get_yticklabels()]
    assert len(names) == sum(cost.unit == ONCE for cost in costs)
    assert any(name.startswith("beta: take_off") for name in names)
