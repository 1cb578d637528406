"""The whole way's course, steering and measures, against closed forms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_experiments.gap_course import GapCourse
from husky_experiments.metrics import cycle
from husky_experiments.metrics.morph import MorphTimes
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, Fans
from husky_experiments.session import Session, SessionError
from husky_experiments.steering import FLYING, go_to
from husky_sim.terrain import TerrainOptions

BETA = load_robot("beta")
ON_PERCH = BETA.sit_height + BETA.foot_radius
"""Height of the base over the ground while the perch lies on it [m]."""


def moving_base(time: np.ndarray, x: np.ndarray, z: np.ndarray) -> Base:
    position = np.column_stack((x, np.zeros(len(time)), z))
    upright = np.tile((0.0, 0.0, 0.0, 1.0), (len(time), 1))
    return Base(time, position, upright, np.gradient(position, time, axis=0), 0.0 * position)


def test_the_plant_builds_the_course_that_is_judged_by() -> None:
    course = GapCourse(approach=3.0, width=0.7, step=0.4, top=2.0)
    plant = course.plant()
    measures = {str(name).removeprefix("terrain_"): value for name, value in plant.items()}
    kind = measures.pop("terrain")
    built = TerrainOptions(kind=str(kind), **{name: float(v) for name, v in measures.items()})
    assert built.gap == course.surface
    places = np.array([[2.9, 0.1, 5.0], [3.3, 0.0, 0.0], [course.far_edge + 0.1, 0.0, 1.0]])
    assert course.height(places) == pytest.approx([0.0, -1.0, 0.4])


def test_energy_is_what_the_pack_gives() -> None:
    """15 V: 10 A in all, 8 A to the rotors, for 2 s."""
    time = np.linspace(0.0, 4.0, 401)
    empty = np.zeros((len(time), 4))
    ones = np.ones(len(time))
    fans = Fans(
        time, empty, empty, empty + 2.0, 15.0 * ones, 10.0 * ones, ones,
        np.zeros((len(time), 3)), np.zeros((len(time), 3)), np.zeros((len(time), 2), np.bool_),
    )  # fmt: skip
    recording = cast(Recording, SimpleNamespace(fans=fans))
    cost = cycle.energy_of(recording, BETA, cycle.Leg("flight", 1.0, 3.0))
    assert (cost.all, cost.rotors) == pytest.approx((300.0, 240.0))
    assert cost.electronics == pytest.approx(2.0 * BETA.battery.idle_power)
    assert cost.all == pytest.approx(cost.rotors + cost.electronics + cost.servos)
    nothing = cycle.energy_of(recording, BETA, cycle.Leg("trot_on", np.nan, np.nan))
    assert np.isnan([nothing.all, nothing.rotors, nothing.servos]).all()


def test_the_clearance_is_of_the_perch_over_the_edge_alone() -> None:
    time = np.linspace(0.0, 10.0, 1001)
    high = ON_PERCH + np.where(np.abs(time - 5.0) < 1.0, 0.9, 0.6)
    base = moving_base(time, time, high)
    assert cycle.clearance_at_edge(BETA, base, edge=5.0, top=0.5) == pytest.approx(0.4, abs=1e-3)
    assert cycle.clearance_at_edge(BETA, base, edge=8.0, top=0.5) == pytest.approx(0.1, abs=1e-3)
    assert np.isnan(cycle.clearance_at_edge(BETA, base, edge=20.0, top=0.5))


def test_who_lies_on_the_step_has_fallen_who_stands_there_has_not() -> None:
    course, time = GapCourse(), np.linspace(0.0, 2.0, 21)
    far = np.full(len(time), course.far_edge + 1.0)
    leg = cycle.Leg("trot_on", 0.0, 2.0)
    for height, falls in ((0.28, 0), (0.05, 1)):
        base = moving_base(time, far, np.full(len(time), course.step + height))
        recording = cast(Recording, SimpleNamespace(base=base))
        assert cycle.fallen(recording, course.height, (leg,), lowest=0.14) == falls


def test_legs_of_the_way_follow_each_other() -> None:
    """A leg that was not gone is not a number."""
    modes = [(0, "stand"), (1, "walk"), (5, "stand"), (6, "perch"), (30, "stand")]
    whole = [*modes, (31, "walk"), (36, "stand")]
    times = MorphTimes(6, 8, 8, 8.2, 9, 10, 11, 12, 25, 26, 30)
    for spans, last in ((whole, (31.0, 36.0)), (modes, (np.nan, np.nan))):
        time = np.array([start for start, _ in spans], float)
        words = np.array([mode for _, mode in spans], object)
        states = SimpleNamespace(time=time, mode=words)
        legs = cycle.legs_of(cast(Recording, SimpleNamespace(controller=states)), times)
        found = {leg.name: (leg.start, leg.end) for leg in legs}
        assert found["trot_out"] == (1.0, 5.0) and found["to_arms"] == (6, 10)
        assert found["flight"] == (12, 25) and found["to_legs"] == (26, 30)
        np.testing.assert_equal(found["trot_on"], last)


class Glider:
    """Goes as it is told, of whatever heading; the rest of a session is not asked."""

    def __init__(self, yaw: float) -> None:
        self.time, self.at = 0.0, np.zeros(2)
        self.yaw, self.wish = yaw, (0.0, 0.0, 0.0)

    @property
    def state(self) -> Any:
        turn = (0.0, 0.0, np.sin(self.yaw / 2), np.cos(self.yaw / 2))
        return SimpleNamespace(position=(*self.at, 1.0), orientation=turn)

    def set_velocity(self, ahead: float, left: float = 0.0, turn: float = 0.0) -> None:
        self.wish = ahead, left, turn

    def advance(self, duration: float) -> None:
        ahead, left, turn = self.wish
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        self.at += duration * np.array((c * ahead - s * left, s * ahead + c * left))
        self.yaw += duration * turn
        self.time += duration


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.3])
def test_it_comes_to_its_goal_and_turns_its_nose_ahead(yaw: float) -> None:
    glider = Glider(yaw)
    go_to(cast(Session, glider), (5.0, 0.2), FLYING, within=25.0)
    assert np.hypot(*(glider.at - (5.0, 0.2))) < FLYING.near
    assert abs(glider.yaw) < 0.02 and glider.wish == (0.0, 0.0, 0.0)


def test_a_goal_that_is_too_far_is_said_so() -> None:
    with pytest.raises(SessionError, match=r"not at its goal within 2 s: 3\.94 m"):
        go_to(cast(Session, Glider(0.0)), (5.0, 0.0), FLYING, within=2.0)
