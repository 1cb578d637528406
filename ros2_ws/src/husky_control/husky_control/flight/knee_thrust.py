"""Statics of a robot that stands on some legs while propellers of others lift at their knees.

The edge is the line between the two standing feet beside a lifted leg. The body tips over it when
the centre of pressure reaches it: weight W with its centre m inside of the edge, and thrusts T_i
that tip the body inward by levers k_i and lift by their rise z_i, put that centre at

    mu = (W m + sum k_i T_i) / (W - sum z_i T_i)

inside of the edge. So one propeller holds a centre of mass that no foot could.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.rotor_geometry import flight_posture, rotor_geometry

if TYPE_CHECKING:
    from husky_description.robot import Robot

_UP = np.array((0.0, 0.0, 1.0))


class Edge(NamedTuple):
    """A line over which the body may tip, and what acts about it.

    Attributes:
        inward: level unit vector across it, away from the lifted leg, in world (3,).
        axis: about which the body turns as it tips inward (3,).
        inside: centre of mass inside of the edge [m].
        lever: by which each propeller's thrust tips inward (4,) [m].
        rise: upward share of each thrust (4,).
    """

    inward: Array
    axis: Array
    inside: float
    lever: Array
    rise: Array

    def pressure(self, weight: float, thrust: Array) -> float:
        """Return how far inside the centre of pressure lies [m], for thrusts (4,) [N]."""
        carried = weight - float(self.rise @ thrust)
        return (weight * self.inside + float(self.lever @ thrust)) / carried


def edge_of(foot: Array, leg: int, center: Array, rotor: Array, thrust_axis: Array) -> Edge:
    """Return the edge beside a leg.

    Args:
        foot: places of the feet (4, 3) [m], in level axes as all that follows.
        leg: that is lifted: front left, front right, hind left, hind right.
        center: of mass (3,) [m].
        rotor: places of the propellers (4, 3) [m].
        thrust_axis: direction of each thrust (4, 3).
    """
    begin, end = foot[leg ^ 1], foot[leg ^ 2]
    along = (end - begin)[:2] / np.hypot(*(end - begin)[:2])
    inward = np.array((-along[1], along[0], 0.0))
    middle = (begin + end) / 2.0
    if inward @ (foot[leg ^ 3] - middle) < 0.0:
        inward = -inward
    place = rotor - middle
    lever = (thrust_axis @ inward) * place[:, 2] - (place @ inward) * thrust_axis[:, 2]
    return Edge(
        inward, np.cross(_UP, inward), float(inward @ (center - middle)), lever, thrust_axis[:, 2]
    )


def thrust_for_margin(edge: Edge, leg: int, weight: float, margin: float) -> float:
    """Return the least thrust of one leg's propeller by which the centre of pressure is inside.

    Args:
        edge: beside the leg.
        leg: whose propeller pushes.
        weight: of the robot [N].
        margin: by so much inside of the edge [m].

    Returns:
        The thrust [N]; 0 where none is needed.
    """
    push = edge.lever[leg] + margin * edge.rise[leg]
    return max(0.0, weight * (margin - edge.inside) / float(push))


def pair_thrusts(edge: Edge, leg: int, moment: float, least: tuple[float, float]) -> Array:
    """Return the thrusts (4,) [N] of a leg and the one across that tip the body by a moment.

    Args:
        edge: between the two feet that stand.
        leg: one of the two in the air, beside which the edge was taken.
        moment: inward [N m].
        least: thrust of the leg's propeller and of the other one [N].
    """
    thrust, across = np.zeros(4), leg ^ 3
    thrust[leg], thrust[across] = least
    rest = moment - float(edge.lever @ thrust)
    more = leg if rest / edge.lever[leg] > 0.0 else across
    if least[1] > 0.0 or more == leg:
        thrust[more] += rest / edge.lever[more]
    else:  # the other one is off
        thrust[leg] = max(0.0, thrust[leg] + rest / edge.lever[leg])
    return thrust


class SingleRotors:
    """Thrust of each rotor alone, by way of a mixer that knows collective and moments.

    The flight controller divides a force and a moment among rotors as they stand in flight. The
    force and moment that wanted thrusts would give there come out of it as these thrusts, wherever
    the legs are: no message for single motors is needed.
    """

    def __init__(self, robot: Robot) -> None:
        """Take the rotors in the posture of flight."""
        geometry = rotor_geometry(robot, flight_posture(robot))
        self._effect = geometry.effectiveness(FanModel.of(robot).moment_per_thrust)[2:]

    def wrench(self, thrust: Array) -> tuple[float, Array]:
        """Return force along base z [N] and moment (3,) [N m] to ask for, by thrusts (4,) [N]."""
        force, *moment = self._effect @ thrust
        return float(force), np.array(moment)
