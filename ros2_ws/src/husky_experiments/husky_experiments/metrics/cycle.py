"""What a recording says of the whole way: its legs, how long each took and what energy it cost.

Energy is what the pack gives at its terminals, the integral of voltage times current. The rotors'
part is that of their speed controllers; servos and electronics have the rest. What a servo takes
is U i = (R i + k w) i by its motor's current, resistance and back-EMF, and nothing where that is
negative: none is fed back.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from scipy.integrate import trapezoid

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_experiments.metrics import measures
from husky_experiments.metrics.morph import GroundHeight, MorphTimes, mode_begins, perch_height
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, Fans

_AT_EDGE = 0.4
"""From the middle of the robot to the tips of its blades, and some air [m]."""


@dataclass(frozen=True)
class Leg:
    """One leg of the way."""

    name: str
    start: float  # s
    end: float  # s

    @property
    def duration(self) -> float:
        """How long it took [s]."""
        return self.end - self.start


def legs_of(recording: Recording, times: MorphTimes) -> list[Leg]:
    """Return the legs of a way on the ground, through the air, and on the ground again."""
    states = recording.controller
    walks = mode_begins(states, "walk")
    stands = [time for time in mode_begins(states, "stand") if time > walks[0]]
    after = [time for time in walks if time > times.stand]
    second = after[0] if after else float("nan")
    last = [time for time in stands if time > second]
    return [
        Leg("trot_out", walks[0], stands[0]),
        Leg("to_arms", times.crouch, times.armed),
        Leg("take_off", times.armed, times.lift_off),
        Leg("flight", times.lift_off, times.landed),
        Leg("switch_off", times.landed, times.back),
        Leg("to_legs", times.back, times.stand),
        Leg("trot_on", second, last[0] if last else float("nan")),
    ]


@dataclass(frozen=True)
class Energy:
    """What the pack gave on a leg of the way [J]."""

    all: float
    rotors: float
    electronics: float  # at their constant standby power
    servos: float


def power_of(fans: Fans) -> tuple[Array, Array]:
    """Return the power of the pack and that of the rotors' speed controllers [W] (n,) each."""
    volts = fans.battery_voltage
    return volts * fans.battery_current, volts * fans.current.sum(axis=1)


def energy_over(recording: Recording, start: float, end: float) -> float:
    """Return what the pack gave between two times [s] at its terminals [J]."""
    fans = recording.fans.between(start, end)
    return float(trapezoid(power_of(fans)[0], fans.time))


def energy_of(recording: Recording, robot: Robot, leg: Leg) -> Energy:
    """Return what a leg of the way cost; not a number where it was not gone."""
    if math.isnan(leg.duration):
        return Energy(math.nan, math.nan, math.nan, math.nan)
    fans = recording.fans.between(leg.start, leg.end)
    whole, rotors = (float(trapezoid(power, fans.time)) for power in power_of(fans))
    standby = robot.battery.idle_power * leg.duration
    return Energy(whole, rotors, standby, whole - rotors - standby)


def leg_metrics(recording: Recording, robot: Robot, leg: Leg) -> dict[str, float]:
    """Return time, way and energy of a leg by name; not a number where it was not gone."""
    base = recording.base.between(leg.start, leg.end)
    cost = energy_of(recording, robot, leg)
    return {
        f"{leg.name}_s": leg.duration,
        f"{leg.name}_m": measures.distance(base.position),
        **{f"{leg.name}_{part}_J": joules for part, joules in asdict(cost).items()},
    }


def clearance_at_edge(robot: Robot, base: Base, edge: float, top: float) -> float:
    """Return how high the perch passes over the edge of a step at least [m].

    Args:
        robot: its numbers.
        base: true motion.
        edge: where the step begins, x in world [m].
        top: height of the step in world [m].
    """
    near = np.abs(base.position[:, 0] - edge) < _AT_EDGE
    height = perch_height(robot, base)[near]
    return float(height.min()) - top if len(height) else float("nan")


def sink_speed(base: Base, landed: float) -> float:
    """Return how fast the robot sank in the tenth of a second before it landed [m/s]."""
    return float(-base.between(landed - 0.1, landed).velocity[:, 2].min())


def fallen(recording: Recording, ground: GroundHeight, legs: tuple[Leg, ...], lowest: float) -> int:
    """Return on how many legs of the way the robot, on its feet, has fallen.

    Args:
        recording: of the way.
        ground: its height.
        legs: that were walked.
        lowest: height of the base over the ground [m], see `measures.first_fall`.
    """
    count = 0
    for leg in legs:
        base = recording.base.between(leg.start, leg.end)
        height = base.position[:, 2] - ground(base.position)
        tilt, upright = measures.tilt(base.orientation), np.ones(len(base), np.bool_)
        count += measures.first_fall(base.time, height, tilt, upright, lowest) is not None
    return count


def height_error_of_estimate(recording: Recording, leg: Leg) -> float:
    """Return the greatest error of the estimated height of the base on a leg of the way [m]."""
    error = measures.estimate_error(recording.base, recording.estimate.between(leg.start, leg.end))
    return measures.peak(error.position[:, 2])
