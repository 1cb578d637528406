"""Measures of a morph, against closed forms and a made-up run whose times are known."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry
from husky_experiments.figures.perch import perch_figure
from husky_experiments.metrics import morph
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base
from husky_runtime import graph

BETA = load_robot("beta")
UNDERSIDE = float(BETA.perch.size[2] / 2.0 - BETA.perch.position[2])
"""From the base's origin down to the underside of the perch [m]."""
ARMS = np.array(flight_posture(BETA))


LEVEL = Rotation.identity()


def resting_base(turn: Rotation = LEVEL, height: float = UNDERSIDE) -> Base:
    zeros = np.zeros((1, 3))
    place = np.array([[0.3, -0.2, height]])
    return Base(np.zeros(1), place, turn.as_quat()[None], zeros, zeros)


def test_the_lowest_corner_is_that_of_the_side_it_leans_to() -> None:
    assert morph.perch_height(BETA, resting_base())[0] == pytest.approx(0.0, abs=1e-12)
    roll = 0.1
    leaning = resting_base(Rotation.from_euler("x", roll), 0.3)
    lowest = 0.3 - UNDERSIDE * np.cos(roll) - BETA.perch.size[1] / 2.0 * np.sin(roll)
    assert morph.perch_height(BETA, leaning)[0] == pytest.approx(lowest)


def test_the_centre_of_mass_is_where_the_rotors_geometry_says() -> None:
    """`rotor_geometry` adds up the masses by itself, and measures from their centre."""
    postures = ARMS + np.random.default_rng(3).uniform(-0.3, 0.3, (4, 12))
    found = morph.center_of_mass(BETA, postures)
    for center, posture in zip(found, postures, strict=True):
        hip = Rotation.from_euler("x", posture[0])
        thigh = hip * Rotation.from_euler("y", posture[1])
        plane = BETA.hip_position[0] + hip.apply((0.0, BETA.lateral_offset[0], 0.0))
        propeller = plane + thigh.apply(BETA.propeller_in_thigh[0].copy())
        wanted = propeller - rotor_geometry(BETA, posture).position[0]
        assert center == pytest.approx(wanted, abs=1e-6)


def test_the_margin_is_the_way_to_the_nearest_edge_and_sinks_with_a_tilt() -> None:
    joints = ARMS[None]
    x, y, z = morph.center_of_mass(BETA, joints)[0]
    ahead = abs(x - BETA.perch.position[0])
    across = BETA.perch.size[1] / 2.0 - abs(y)
    level = min(across, BETA.perch.size[0] / 2.0 - ahead)
    assert morph.perch_margins(BETA, resting_base(), joints)[0] == pytest.approx(level)
    roll = 0.1
    tilted = morph.perch_margins(BETA, resting_base(Rotation.from_euler("x", roll)), joints)[0]
    over_the_edge = across * np.cos(roll) - (z + UNDERSIDE) * np.sin(roll)
    assert tilted == pytest.approx(over_the_edge)
    over = morph.perch_margins(BETA, resting_base(Rotation.from_euler("x", 0.9)), joints)[0]
    assert over < 0.0


class MorphRun:
    """A made-up morph: times of the modes [s], and of what the body does."""

    modes = ((0.0, "stand"), (1.0, "perch"), (4.0, "splay"), (6.0, "quadrotor"))
    after = ((12.0, "splay"), (13.0, "perch"), (15.0, "stand_up"), (17.0, "stand"))
    end = 18.0
    touch, unloaded, arms, lift_off, landed = 3.0, 3.2, 5.0, 7.0, 11.0

    def mode(self, time: float) -> str:
        return [name for start, name in (*self.modes, *self.after) if time >= start - 1e-9][-1]

    def height(self, time: float) -> float:
        """Of the perch above the ground [m]."""
        corners = (1.0, self.touch, self.lift_off, 8.0, 10.0, self.landed, 15.0, 17.0)
        heights = (0.08, 0.0, 0.0, 0.3, 0.3, 0.0, 0.0, 0.08)
        return float(np.interp(time, corners, heights))

    def content(self, messages: Any) -> Any:
        for tick in range(round(self.end / 0.01) + 1):
            time, time_ns = tick / 100.0, tick * 10_000_000
            share = np.interp(time, (4.0, self.arms), (0.0, 1.0))
            joints = BETA.sit_joint_position + share * (ARMS - BETA.sit_joint_position)
            zeros = np.zeros(3)
            place = (0.0, 0.0, UNDERSIDE + self.height(time))
            upright = (0.0, 0.0, 0.0, 1.0)
            loaded = time < self.unloaded - 1e-9 or time > 15.0
            force = np.outer(np.full(4, loaded), (0.0, 0.0, 6.5))
            yield graph.GROUND_TRUTH, messages.odometry(time_ns, place, upright, zeros, zeros)
            yield (
                graph.FOOT_CONTACTS,
                messages.foot_contacts(time_ns, np.full(4, loaded), force, np.zeros((4, 3))),
            )
            joint_state = messages.joint_states(time_ns, joints, np.zeros(12), np.zeros(12))
            yield graph.JOINT_STATES, joint_state
            yield graph.JOINT_COMMAND, messages.joint_command(time_ns, 8, joints)
            felt = loaded and time != 2.0  # one doubtful report does not count
            state = {"contact": np.full(4, felt)}
            yield (
                graph.CONTROLLER_STATE,
                messages.controller_state(time_ns, self.mode(time), **state),
            )


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, write_bag: Any, messages: Any) -> Recording:
    path = tmp_path_factory.mktemp("morph") / "bag"
    write_bag(path, MorphRun().content(messages))
    return Recording(path)


def test_the_steps_are_found_when_they_were(recording: Recording) -> None:
    times, made = morph.morph_times(recording, BETA), MorphRun()
    assert times.crouch == pytest.approx(1.0)
    assert times.touch == pytest.approx(made.touch, abs=0.011)
    assert times.felt == times.perched == pytest.approx(made.unloaded)
    assert times.armed == pytest.approx(made.arms, abs=0.011)
    climb_speed = 0.3 / 1.0
    assert times.lift_off == pytest.approx(made.lift_off + morph.AIRBORNE / climb_speed, abs=0.011)
    assert times.landed == pytest.approx(made.landed - morph.RESTING / climb_speed, abs=0.011)
    assert (times.back, times.stand) == pytest.approx((13.0, 17.0))
    spans = morph.as_metrics(times)
    assert spans["perch_touched_s"] == pytest.approx(2.0, abs=0.011)
    assert spans["morph_to_legs_s"] == pytest.approx(4.0)


def test_only_what_rests_on_the_perch_is_judged(recording: Recording) -> None:
    times = morph.morph_times(recording, BETA)
    stability = morph.perch_stability(recording, BETA, times.crouch, times.stand)
    flight = (stability.time > times.lift_off) & (stability.time < times.landed)
    assert not stability.resting[flight].any()
    margin, tilt = stability.while_resting(times.crouch, times.stand)
    assert tilt == pytest.approx(0.0, abs=1e-7)
    assert margin == pytest.approx(stability.margin[stability.resting].min())
    assert np.isnan(stability.while_resting(8.5, 9.5)).all(), "in the air nothing can be said"


def test_what_did_not_happen_is_not_a_number(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    first = list(itertools.islice(MorphRun().content(messages), 5 * 50))  # half a second
    write_bag(tmp_path / "bag", first)
    spans = morph.as_metrics(morph.morph_times(Recording(tmp_path / "bag"), BETA))
    assert np.isnan(spans["perch_touched_s"]) and np.isnan(spans["legs_to_lift_off_s"])


def test_the_figure_marks_the_steps(
    recording: Recording, drawn: dict[str, Figure], tmp_path: Path
) -> None:
    times = morph.morph_times(recording, BETA)
    stability = morph.perch_stability(recording, BETA, times.crouch, times.stand)
    perch_figure(stability, times, recording, tmp_path)
    drawn["perch"].draw_without_rendering()
    margin, tilt = drawn["perch"].axes
    assert "lift-off" in [text.get_text() for text in tilt.texts]
    drawn_margin = np.asarray(margin.lines[0].get_ydata(), float)
    assert np.nanmin(drawn_margin) == pytest.approx(1e3 * stability.margin[stability.resting].min())
