"""Live parameters that depend on each other: each pair once, with the reason of a refusal.

A rule cuts off corners alone: with the others at their defaults each end of a range is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

from husky_control.gait.table import GAITS, SWING_TIMES
from husky_description.gravity import GRAVITY

Values = Mapping[str, float]

FLIGHT_MISFIT = 0.025
"""Most by which the swing of a gait that hops may be off the time in the air [s]: with 0.034 s the
pronk fell or went backwards, with 0.023 s it walked."""

STEEPEST_LIFT = 6.0
"""Most swing height over swing time squared [m/s^2], 1/32 of a foot's greatest acceleration: with
7.4 m/s^2 a trot did not come to rest, with 9.2 it fell."""
SWAY_SUM = 0.13
"""Most static margin and lateral spread together [m]: with 0.14 m the crawl overloaded a knee, with
0.13 m it walked."""


class Rule(NamedTuple):
    """What some parameters must keep together, each good in its own range."""

    names: frozenset[str]  # of the parameters
    refusal: Callable[[Values], str]  # why values by name are refused, "" when they are good


def _in_order(less: str, more: str, unit: str, reason: str) -> Rule:
    def refusal(values: Values) -> str:
        a, b = values[less], values[more]
        if a <= b:
            return ""
        return f"{less} ({a:g}{unit}) must not be above {more} ({b:g}{unit}): {reason}"

    return Rule(frozenset((less, more)), refusal)


def _swing_time(gait: str, least: float, most: float) -> Rule:
    period, duty = f"gait.{gait}.period", f"gait.{gait}.duty"

    def refusal(values: Values) -> str:
        time = values[period] * (1.0 - values[duty])
        if least <= time <= most:
            return ""
        return (
            f"{period} ({values[period]:g} s) and {duty} ({values[duty]:g}) leave a leg "
            f"{time:.3g} s for its swing, which must take {least:g} to {most:g} s"
        )

    return Rule(frozenset((period, duty)), refusal)


def _lift(gait: str) -> Rule:
    names = [f"gait.{gait}.{name}" for name in ("swing_height", "period", "duty")]
    height, period, duty = names

    def refusal(values: Values) -> str:
        time = values[period] * (1.0 - values[duty])
        most = STEEPEST_LIFT * time**2
        if values[height] <= most:
            return ""
        return (
            f"{height} ({values[height]:g} m) is too high for a swing of {time:.3g} s, which "
            f"{period} ({values[period]:g} s) and {duty} ({values[duty]:g}) leave: it must be "
            f"at most {most:.3g} m"
        )

    return Rule(frozenset(names), refusal)


def _sway(gait: str, most: float) -> Rule:
    margin, spread = f"gait.{gait}.static_margin", f"gait.{gait}.lateral_spread"

    def refusal(values: Values) -> str:
        if values[margin] + values[spread] <= most + 1e-9:
            return ""
        return (
            f"{margin} ({values[margin]:g} m) and {spread} ({values[spread]:g} m) make the body "
            f"sway too far: their sum must be at most {most:g} m"
        )

    return Rule(frozenset((margin, spread)), refusal)


def _flight_time(gait: str, misfit: float) -> Rule:
    names = period, duty, hop = [f"gait.{gait}.{name}" for name in ("period", "duty", "hop_speed")]

    def refusal(values: Values) -> str:
        swing, flight = values[period] * (1.0 - values[duty]), 2.0 * values[hop] / GRAVITY
        if abs(swing - flight) <= misfit:
            return ""
        return (
            f"{hop} ({values[hop]:g} m/s) keeps the body in the air for {flight:.3g} s, but "
            f"{period} ({values[period]:g} s) and {duty} ({values[duty]:g}) leave the legs "
            f"{swing:.3g} s for their swing: they must be within {misfit:g} s of each other"
        )

    return Rule(frozenset(names), refusal)


_IN_ORDER: tuple[Rule, ...] = (
    _in_order(
        "contact.liftoff_force", "contact.touchdown_force", " N",
        "a foot that has just touched down would have lost its contact",
    ),
    _in_order(
        "contact.touchdown_force", "contact.early_force", " N",
        "early in the swing, where nothing is expected, more force is needed to believe a contact",
    ),
    _in_order(
        "wair.load_slope", "wair.most_load_slope", "",
        "the feet are asked for a load that nothing allows for",
    ),
)  # fmt: skip


def make_rules(length: float) -> tuple[Rule, ...]:
    """Return the rules of a robot whose legs are `length` times as long as Husky Carbon's."""
    time = math.sqrt(length)  # scales times among similar robots
    gaits = GAITS.values()
    return (
        *_IN_ORDER,
        *(_swing_time(name, time * a, time * b) for name, (a, b) in SWING_TIMES.items()),
        *(_lift(name) for name in GAITS),
        *(_sway(gait.name, length * SWAY_SUM) for gait in gaits if gait.static_margin > 0.0),
        *(_flight_time(gait.name, time * FLIGHT_MISFIT) for gait in gaits if gait.hop_speed > 0.0),
    )


RULES = make_rules(1.0)
"""Of Husky Carbon."""


def check_rules(values: Values, chosen: Collection[str], rules: Sequence[Rule] = RULES) -> None:
    """Check the rules that parameters have a part in.

    Args:
        values: of all parameters by name, in their units.
        chosen: names of those that change.
        rules: of the robot.

    Raises:
        ValueError: values do not fit each other; says which, and what is allowed.
    """
    for rule in rules:
        if not rule.names.isdisjoint(chosen):
            refusal = rule.refusal(values)
            if refusal:
                raise ValueError(refusal)
