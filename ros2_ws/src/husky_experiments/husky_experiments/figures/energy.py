"""Figure of the costs of moving: energy of a metre over speed, and over slope."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes

from husky_experiments.figures.style import FAN_COLOURS, label, make_figure, save
from husky_navigation.planning.travel_costs import METRE, ONCE, TravelCost


def draw_costs(costs: Sequence[TravelCost], directory: Path) -> Path:
    """Draw `energy.png`: metres over speed on the flat, metres over slope, and passages."""
    figure, axes = make_figure(1, 3, "Costs of moving", size=(13.0, 4.6))
    over_speed, over_slope, passages = axes[0]
    ways = [cost for cost in costs if cost.unit == METRE]
    flat = [cost for cost in ways if cost.slope_deg == 0.0]
    _lines(over_speed, flat, lambda cost: cost.speed)
    label(over_speed, "energy of a metre [J]", "speed [m/s]", "on the flat and in the air")
    sloping = [cost for cost in ways if cost.slope_deg != 0.0 or cost.mode == "climb"]
    _lines(over_slope, sloping, lambda cost: cost.slope_deg)
    label(over_slope, "energy of a metre [J]", "slope, uphill positive [deg]", "on slopes")
    for axis in (over_speed, over_slope):
        axis.set_yscale("log")
        if axis.has_data():
            axis.legend(fontsize=7, frameon=False)
    once = [cost for cost in costs if cost.unit == ONCE]
    names = [f"{cost.robot}: {cost.mode}, {cost.time:.1f} s" for cost in once]
    passages.barh(names, [cost.energy for cost in once], color=FAN_COLOURS[0])
    passages.invert_yaxis()
    label(passages, x="energy [J]", title="from one way of moving to another")
    return save(figure, directory, "energy")


def _lines(axis: Axes, costs: Sequence[TravelCost], across: Callable[[TravelCost], float]) -> None:
    """Draw one line for each robot, mode and share."""
    keys = dict.fromkeys((cost.robot, cost.mode, cost.thrust_share) for cost in costs)
    for key, colour in zip(keys, FAN_COLOURS, strict=False):
        chosen = [c for c in costs if (c.robot, c.mode, c.thrust_share) == key]
        chosen.sort(key=across)
        robot, mode, share = key
        name = f"{robot}: {mode}" + (f", {share:.0%} of the weight on the fans" if share else "")
        axis.plot(
            [across(c) for c in chosen],
            [c.energy for c in chosen],
            "o-",
            color=colour,
            ms=4,
            lw=1.2,
            label=name,
        )
