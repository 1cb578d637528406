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
        most_bank: rise across the lane that gentler slopes may have too [-]: a walk takes it.
    """

    speed: Annotated[float, number(0.05, 1.0)] = 0.25
    most_slope_deg: Annotated[float, number(5.0, 90.0)] = 47.0
    least_radius: Annotated[float, number(0.1, 10.0)] = 0.8
    least_slope_deg: Annotated[float, number(1.0, 45.0)] = 6.0
    seen_first: Annotated[float, number(0.1, 5.0)] = 1.2
    half_width: Annotated[float, number(0.1, 1.0)] = 0.3
    most_skew: Annotated[float, number(0.01, 0.5)] = 0.2
    most_bank: Annotated[float, number(0.0, 0.5)] = WalkAbility.most_slope

    @property
    def most_rise(self) -> float:
        """Rise over way of the steepest ground [-]."""
        return math.tan(math.radians(self.most_slope_deg))


@dataclass(frozen=True)
class FlyAbility:
    """A flight from level ground, at one height, to level ground.

    Splayed, the propellers reach 0.43 m from the base's middle (beta.yaml: the knees are 0.198 m
    ahead and to the side, the discs' radius is 0.152 m), and nothing is lower than the perch.

    Attributes:
        speed: that is planned with, one of those measured [m/s].
        spacing: of the heights at which it flies, multiples of it in `map` [m].
        most_altitude: of the base over the ground where it takes off, and where it lands [m].
        clearance: of the base over all ground below; of it 0.29 m are the perch's [m].
        radius: around the base, in which no ground is higher than that; where it takes off, in
            which the ground is level. 0.3 m of it are for errors of flight and map [m].
        edge: distance of a landing place from obstacles, edges and unseen ground [m].
        perched: height of the base over the ground on which its perch lies [m].
        risen: way up that the measured take-off has, and down the measured landing: the default of
            `quadrotor.height` [m].
        rise_speed: `HoverGains.climb_speed` [m/s].
        sink_speed: in a landing, measured (docs/beta.md, "The whole way") [m/s].
    """

    speed: Annotated[float, number(0.05, 1.5)] = 0.48
    spacing: Annotated[float, number(0.05, 1.0)] = 0.25
    most_altitude: Annotated[float, number(0.5, 5.0)] = 2.2
    clearance: Annotated[float, number(0.3, 2.0)] = 0.45
    radius: Annotated[float, number(0.45, 2.0)] = 0.75
    edge: Annotated[float, number(0.45, 3.0)] = 1.0
    perched: Annotated[float, number(0.1, 1.0)] = 0.29
    risen: Annotated[float, number(0.2, 5.0)] = 0.5
    rise_speed: Annotated[float, number(0.05, 1.0)] = 0.25
    sink_speed: Annotated[float, number(0.05, 1.0)] = 0.17


@dataclass(frozen=True)
class Abilities:
    """One robot's ways of moving.

    Attributes:
        length, width: of the ground that the robot needs, feet and a margin [m].
        walk: on its legs alone.
        climb: None for a robot that does not.
        fly: None for a robot that does not.
    """

    length: Annotated[float, number(0.2, 2.0)] = 0.8
    width: Annotated[float, number(0.1, 2.0)] = 0.5
    walk: WalkAbility = WalkAbility()
    climb: ClimbAbility | None = ClimbAbility()
    fly: FlyAbility | None = None

    @property
    def most_slope(self) -> float:
        """Rise over way of the steepest ground that the robot can take [-]."""
        return self.climb.most_rise if self.climb else self.walk.most_slope


ABILITIES = {"carbon": Abilities(), "beta": Abilities(climb=None, fly=FlyAbility())}
"""By the robot's name. Carbon hovers for seconds (docs/flight.md): it does not fly anywhere."""
