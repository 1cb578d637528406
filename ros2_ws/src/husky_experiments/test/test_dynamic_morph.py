"""Measures of arms made while others stand, and of a leap: closed forms, and a made-up leap."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture
from husky_experiments.metrics.dynamic_morph import SPLAYED, Balancing
from husky_experiments.metrics.leap import ARMS, leap_of, propeller_tilts
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

BETA = load_robot("beta")
LEVEL_ARMS = np.array(flight_posture(BETA))
UNDERSIDE = float(BETA.perch.size[2] / 2.0 - BETA.perch.position[2])
ASKED, OFF, OPEN, LAND, TOUCH, END = 1.0, 3.0, 3.4, 5.0, 6.0, 7.0
"""Of the made-up leap: request, feet off, arms level, landing asked for, perch down, end [s]."""
SPEED, LEAN, HIP_SPEED = 0.5, 0.03, 4.0


def test_the_rate_is_that_of_the_first_way_to_an_arm() -> None:
    time = np.linspace(0.0, 10.0, 1001)
    hip = np.zeros((len(time), 4))
    hip[:, 2] = np.interp(time, (2.0, 4.0, 6.0, 10.0), (0.1, 1.7, 1.7, 0.1))  # back more slowly
    foot = np.zeros((len(time), 4))
    foot[:, 2] = np.interp(time, (1.0, 2.0), (0.0, 2.0 * SPLAYED))
    none = np.zeros(len(time))
    morph = Balancing(time, foot, none, none, none, np.zeros((len(time), 4)), hip)
    assert morph.rate(2) == pytest.approx(0.8, rel=0.02)
    assert morph.arms((2,)) == pytest.approx(8.5, abs=0.02)


@pytest.mark.parametrize("roll", [-0.2, 0.0, 0.3])
def test_propellers_tilt_with_the_body_and_with_the_hips(roll: float) -> None:
    turn = Rotation.from_euler("x", roll).as_quat()
    joints = LEVEL_ARMS.copy()
    joints[0] -= 0.1  # the front left one leans out, to the left
    tilts = propeller_tilts(BETA, turn[None], joints[None])
    assert tilts[0] == pytest.approx(max(abs(roll), abs(roll - 0.1)), abs=1e-6)


def leap_content(messages: Any) -> Iterable[tuple[str, bytes]]:
    """Yield a robot that leaps aside to the left, and lands there a little tilted."""
    stand = np.array(BETA.stand_joint_position)
    for tick in range(round(END / 0.01) + 1):
        time, time_ns = tick / 100.0, tick * 10_000_000
        low = float(np.interp(time, (OFF, OFF + 0.2, LAND, TOUCH), (0.2, 0.3, 0.3, 0.0)))
        aside = float(np.interp(time, (OFF, OFF + 1.0), (0.0, 0.1)))
        turn = Rotation.from_euler("y", LEAN if time > LAND else 0.05 * (time > OFF)).as_quat()
        place = (0.0, aside, UNDERSIDE + low + BETA.perch.size[0] / 2.0 * math.sin(LEAN))
        velocity = np.array((0.0, 0.0, SPEED * (OFF <= time <= OFF + 0.2)))
        yield (
            graph.GROUND_TRUTH,
            messages.odometry(time_ns, place, turn, velocity, np.zeros(3)),
        )
        touches = np.full(4, time < OFF - 1e-9)
        touches[1] |= abs(time - 2.0) > 1e-9 and time < OFF - 1e-9
        if abs(time - 2.0) < 1e-9:
            touches[:] = False  # for a moment, which does not count
        yield (
            graph.FOOT_CONTACTS,
            messages.foot_contacts(
                time_ns, touches, np.outer(touches, (0.0, 0.0, 15.0)), np.zeros((4, 3))
            ),
        )
        share = float(np.interp(time, (OFF, OPEN), (0.0, 1.0)))
        joints = stand + share * (LEVEL_ARMS - stand)
        torque = np.zeros(12)
        torque[4] = -8.0 * (abs(time - OFF) < 0.05)
        speed = np.zeros(12)
        speed[3] = -HIP_SPEED if OFF < time < OPEN else 9.0 * (time < OFF)
        yield graph.JOINT_STATES, messages.joint_states(time_ns, joints, speed, torque)


def test_a_leap_is_measured_as_it_was_made(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    write_bag(tmp_path / "bag", leap_content(messages))
    leap = leap_of(Recording(tmp_path / "bag"), BETA, ASKED, LAND)
    assert leap.off == pytest.approx(OFF - ASKED, abs=0.011)
    assert leap.speed == pytest.approx(SPEED)
    assert leap.leaning == pytest.approx(math.pi / 2, abs=0.15)  # outward from standing legs
    opening = (OPEN - OFF) * (1.0 - ARMS / (math.pi / 2.0))
    assert leap.opening == pytest.approx(opening, abs=0.05)
    assert leap.rate == pytest.approx((leap.leaning - ARMS) / leap.opening)
    assert leap.hip_speed == pytest.approx(HIP_SPEED)  # not what they do before
    assert leap.lowest == pytest.approx(0.2, abs=0.01)
    assert leap.tilt == pytest.approx(0.05, abs=1e-6)
    assert leap.astray == leap.landed == pytest.approx(0.1, abs=1e-3)
    assert leap.torque == pytest.approx(8.0)
    assert leap.landing_tilt == pytest.approx(LEAN, abs=1e-3)
    assert leap.landing_lean == pytest.approx(LEAN, abs=1e-3)  # level arms lean with the body
    assert leap.metrics["leap_landing_tilt_deg"] == pytest.approx(math.degrees(LEAN), abs=0.1)
