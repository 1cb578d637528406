"""How still a body hovers, how it turns and what a gust does: closed forms, and a written bag."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture
from husky_experiments.figures.hovering import hold_figure, turn_figure
from husky_experiments.metrics.hovering import (
    HeadingStep,
    Stray,
    gust_summary,
    place_above,
    stray_from,
    sweep_summary,
    turn_of,
)
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

BETA = load_robot("beta")
STEP = math.radians(30.0)
TIME_CONSTANT = 0.5
BEGIN, END = 2.0, 6.0
HEIGHT, SWAY, LEAN = 0.5, 0.03, math.radians(1.0)


def first_order(rate: float = 1e3) -> HeadingStep:
    """Return a heading that goes to the step as 1 - exp(-t / T)."""
    time = np.arange(0.0, END - BEGIN, 1.0 / rate)
    return HeadingStep(
        time,
        STEP * (1.0 - np.exp(-time / TIME_CONSTANT)),
        np.tile((0.5, 0.6, 0.6, 0.5), (len(time), 1)),
        np.tile((-0.1, -0.1, 0.1, 0.1), (len(time), 1)),
        STEP,
    )


def content(messages: Any) -> Iterable[tuple[str, bytes]]:
    """Yield the messages of a robot that rises, sways, and turns from `BEGIN` on."""
    for tick in range(round(100 * END) + 1):
        time, time_ns, zeros = tick / 100.0, tick * 10_000_000, np.zeros(3)
        since = max(0.0, time - BEGIN)
        yaw = STEP * (1.0 - math.exp(-since / TIME_CONSTANT))
        up = 0.1 + HEIGHT * (time >= 1.0)
        place = (1.0 + SWAY * math.sin(20.0 * time) * (time >= 1.0), 2.0, up)
        turn = Rotation.from_euler("ZYX", (yaw, LEAN, 0.0)).as_quat()
        yield graph.GROUND_TRUTH, messages.odometry(time_ns, place, turn, zeros, zeros)
        joints = np.array(flight_posture(BETA))
        joints[0::3] += 0.1 * (time > BEGIN)
        yield graph.JOINT_STATES, messages.joint_states(time_ns, joints, zeros_12, zeros_12)
        pulses = np.array((1600, 1700, 1600, 1500) if time > BEGIN else (1600,) * 4, np.uint16)
        yield (
            graph.PROPULSION_STATE,
            messages.pack(
                "husky_msgs/msg/PropulsionState", stamp=messages.stamp(time_ns), pwm=pulses
            ),
        )


zeros_12 = np.zeros(12)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, write_bag: Any, messages: Any) -> Recording:
    path = tmp_path_factory.mktemp("hovering") / "bag"
    write_bag(path, content(messages))
    return Recording(path)


def test_a_turn_of_first_order() -> None:
    """Rise ln 9, settling within 5 % ln 20, of the time constant; no overshoot."""
    turn = first_order()
    assert turn.rise == pytest.approx(TIME_CONSTANT * math.log(9.0), abs=2e-3)
    assert turn.settling == pytest.approx(TIME_CONSTANT * math.log(20.0), abs=2e-3)
    assert turn.overshoot == 0.0
    told = turn.as_metrics("turn")
    assert told["turn_motor_command_max"] == 0.6
    assert told["turn_motor_spread_max"] == pytest.approx(0.1)
    assert told["turn_hip_tilt_max_deg"] == pytest.approx(math.degrees(0.1))


def test_a_turn_that_does_not_arrive_is_not_a_number() -> None:
    turn = first_order()
    short = HeadingStep(turn.time, 0.8 * turn.heading, turn.motors, turn.hips, STEP)
    assert math.isnan(short.rise) and math.isnan(short.settling)


def test_an_overshoot_is_a_share_of_the_step() -> None:
    turn = first_order()
    beyond = HeadingStep(turn.time, 1.2 * turn.heading, turn.motors, turn.hips, STEP)
    assert beyond.overshoot == pytest.approx(0.2, abs=1e-3)


def test_a_turn_of_a_recording(recording: Recording) -> None:
    turn = turn_of(recording, BETA, STEP, (BEGIN, END))
    assert turn.rise == pytest.approx(TIME_CONSTANT * math.log(9.0), abs=0.02)
    assert np.ptp(turn.motors[5:], axis=1) == pytest.approx(0.2)
    assert turn.hips[-1] == pytest.approx(0.1)


def test_a_place_counts_from_the_take_off(recording: Recording) -> None:
    base = recording.base
    place = place_above(base, 0.5, HEIGHT)
    assert place == pytest.approx((1.0, 2.0, 0.1 + HEIGHT))
    stray = stray_from(base, place, (1.0, END))
    assert stray.distance.max() == pytest.approx(SWAY, rel=0.01)
    assert stray.tilt == pytest.approx(LEAN, abs=1e-6)


def test_a_gust_carries_off_and_is_recovered_from() -> None:
    """A triangle of 0.3 m within 3 s each way: near again when 0.05 m are left."""
    time = np.linspace(0.0, 8.0, 8001)
    aside = np.interp(time, (0.0, 3.0, 6.0), (0.0, 0.3, 0.0))
    offset = np.column_stack((0.0 * time, aside, 0.1 * aside))
    told = gust_summary(Stray(time, offset, 0.2 * aside), (0.0, 3.0), 0.05)
    assert told["gust_displacement_max_m"] == pytest.approx(0.3)
    assert told["gust_height_change_max_m"] == pytest.approx(0.03)
    assert told["gust_tilt_max_deg"] == pytest.approx(math.degrees(0.06))
    assert told["gust_recovery_s"] == pytest.approx(2.5, abs=2e-3)


def test_the_figures_show_both_turns_and_both_places(
    recording: Recording, drawn: dict[str, Figure], tmp_path: Path
) -> None:
    turn_figure({"off": first_order(100.0), "on": first_order(50.0)}, tmp_path)
    drawn["yaw_step"].draw_without_rendering()
    heading, motors, hips = drawn["yaw_step"].axes
    assert len(motors.lines) == 8 and len(hips.lines) == 4
    assert np.asarray(heading.lines[0].get_ydata()).max() == pytest.approx(30.0, rel=0.01)
    stray = stray_from(recording.base, np.zeros(3), (1.0, END))
    hold_figure(stray, stray, tmp_path)
    drawn["hover"].draw_without_rendering()
    assert [len(axis.lines) for axis in drawn["hover"].axes] == [2, 2, 2, 2]


def test_a_sweep_of_the_arms_is_summed_up_by_its_worst_moment() -> None:
    places = np.array(((0.03, 0.0, 0.0), (0.0, 0.0, -0.04), (0.0, 0.0, 0.0)))
    tilts = np.array((0.0, 0.02, 0.01))
    summary = sweep_summary(Stray(np.arange(3.0), places, tilts))
    assert summary["sweep_position_error_max_m"] == pytest.approx(0.04)
    assert summary["sweep_position_error_rms_m"] == pytest.approx(0.05 / math.sqrt(3.0))
    assert summary["sweep_tilt_max_deg"] == pytest.approx(math.degrees(0.02))
