"""Numbers that say which ground each of a robot's ways of moving can take."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from husky_description.parameters import number


@dataclass(frozen=True)
class WalkAbility:
    """A walk on nearly level ground.

    Attributes:
        speed: that is planned with, one of those measured [m/s].
        most_slope: rise over way [-]; the trot is one for level ground.
        most_roughness: deviation of the ground from a plane, rms [m].
        clearance: from steeper ground, of the base's centre [m].
    """

    speed: Annotated[float, number(0.05, 1.0)] = 0.4
    most_slope: Annotated[float, number(0.01, 0.5)] = 0.07
    most_roughness: Annotated[float, number(0.001, 0.1)] = 0.018
    clearance: Annotated[float, number(0.0, 1.0)] = 0.3


@dataclass(frozen=True)
class ClimbAbility:
    """A climb straight up a slope, and straight down.

    Attributes:
        speed: that is planned with, one of those measured [m/s].
        most_slope_deg: steepest ground [deg]; 45 deg are measured, 2 are for errors of the map.
        least_radius: of the ground where it bends [m]; less than of a slope that it can climb, for
            behind a crest unseen ground is taken for level.
        least_slope_deg: of the steepest part of a slope; gentler ground is no slope [deg].
        seen_first: of a slope, before it is begun; more is seen on the way [m].
        half_width: of the lane that has to be even [m].
        most_skew: angle between the lane and the fall line [rad].
    """

    speed: Annotated[float, number(0.05, 1.0)] = 0.25
    most_slope_deg: Annotated[float, number(5.0, 90.0)] = 47.0
    least_radius: Annotated[float, number(0.1, 10.0)] = 0.8
    least_slope_deg: Annotated[float, number(1.0, 45.0)] = 6.0
    seen_first: Annotated[float, number(0.1, 5.0)] = 1.2
    half_width: Annotated[float, number(0.1, 1.0)] = 0.3
    most_skew: Annotated[float, number(0.01, 0.5)] = 0.2

    @property
    def most_rise(self) -> float:
        """Rise over way of the steepest ground [-]."""
        return math.tan(math.radians(self.most_slope_deg))


@dataclass(frozen=True)
class Abilities:
    """One robot's ways of moving.

    Attributes:
        length, width: of the ground that the robot needs, feet and a margin [m].
        walk: on its legs alone.
        climb: None for a robot that does not.
    """

    length: Annotated[float, number(0.2, 2.0)] = 0.8
    width: Annotated[float, number(0.1, 2.0)] = 0.5
    walk: WalkAbility = WalkAbility()
    climb: ClimbAbility | None = ClimbAbility()

    @property
    def most_slope(self) -> float:
        """Rise over way of the steepest ground that the robot can take [-]."""
        return self.climb.most_rise if self.climb else self.walk.most_slope


ABILITIES = {"carbon": Abilities(), "beta": Abilities(climb=None)}
"""By the robot's name."""
