"""Figures show the data, with units, for whole and for partial recordings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from husky_description.robot import load_robot
from husky_experiments.figures import figures
from husky_experiments.figures.style import Band, bands, close_look, modes_of, thin
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

ROBOT = load_robot()
UNIT = re.compile(r"\[(deg|N m|m|m/s|N|s|-)\]$")


@pytest.fixture(scope="module")
def recording(walk_bag: Path) -> Recording:
    return Recording(walk_bag)


def test_every_figure_becomes_a_file(recording: Recording, tmp_path: Path) -> None:
    written = figures.make_all(recording, ROBOT, tmp_path / "new" / "figures")
    assert [path.stem for path in written] == [draw.__name__ for draw in figures.DRAWINGS]
    for path in written:
        with Image.open(path) as image:
            assert image.width >= 1200
            assert len(image.convert("L").getcolors()) > 20, f"{path} is nearly blank"


def test_axes_have_units(recording: Recording, drawn: dict[str, Figure], tmp_path: Path) -> None:
    figures.make_all(recording, ROBOT, tmp_path)
    assert len(drawn) == len(figures.DRAWINGS)
    for name, figure in drawn.items():
        labels = [text for a in figure.axes for text in (a.get_xlabel(), a.get_ylabel()) if text]
        assert len(labels) >= 2, name
        assert all(UNIT.search(text) for text in labels), (name, labels)
        assert any(UNIT.search(axis.get_xlabel()) for axis in figure.axes), name


def test_joint_angles_of_all_twelve_joints(
    recording: Recording, drawn: dict[str, Figure], tmp_path: Path, walk: Any
) -> None:
    figures.joint_angles(recording, ROBOT, tmp_path)
    axes = drawn["joint_angles"].axes
    assert len(axes) == 12
    for place, axis in enumerate(axes):
        group, leg = divmod(place, 4)
        measured, desired = axis.lines
        time, angle = measured.get_data()
        index = 3 * leg + group
        expected = [np.degrees(walk.joint_position(t)[index]) for t in time]
        assert np.allclose(angle, expected)
        ahead = [np.degrees(walk.joint_position(t)[index]) for t in desired.get_xdata()]
        assert np.allclose(desired.get_ydata() - ahead, np.degrees(walk.tracking_error))


def test_torques_stand_beside_the_ratings(
    recording: Recording, drawn: dict[str, Figure], tmp_path: Path, walk: Any
) -> None:
    figures.torques(recording, ROBOT, tmp_path)
    for axis in drawn["torques"].axes:
        levels = {round(line.get_ydata()[0], 3) for line in axis.lines[4:]}
        ratings = (
            ROBOT.gear_rated_torque,
            ROBOT.gear_repeated_peak_torque,
            ROBOT.gear_momentary_peak_torque,
        )
        assert levels == {round(sign * r, 3) for r in ratings for sign in (-1, 1)}
    knees = drawn["torques"].axes[4]
    assert np.abs(knees.lines[0].get_ydata()).max() == pytest.approx(walk.torque[2])


def test_what_is_missing_is_left_out(
    tmp_path: Path, write_bag: Any, messages: Any, drawn: dict[str, Figure]
) -> None:
    zeros = np.zeros(12)
    write_bag(
        tmp_path / "bag",
        [
            (graph.JOINT_STATES, messages.joint_states(i * 2_000_000, zeros, zeros, zeros))
            for i in range(50)
        ],
    )
    figures.make_all(Recording(tmp_path / "bag"), ROBOT, tmp_path / "figures")
    assert set(drawn) == {"torques"}


def test_bands_follow_mode_and_gait(recording: Recording, walk: Any) -> None:
    stand, walking = modes_of(recording)
    assert (stand.mode, stand.label) == ("stand", "stand")
    assert (walking.mode, walking.label) == ("walk", "trot")
    assert stand.end == walking.start == pytest.approx(walk.walking_from)
    assert close_look(recording) == (walking.start, walking.end)
    assert bands(recording.controller.between(90.0, 99.0)) == []
    assert Band(0.0, 1.0, "stand_up", "trot").label == "stand up"


@pytest.mark.parametrize("mode", ["wair", "tread"])
def test_the_closer_look_is_at_steps(
    tmp_path: Path, messages: Any, write_bag: Any, mode: str
) -> None:
    modes = ["hang"] * 600 + [mode] * 300 + ["hang"] * 100
    write_bag(
        tmp_path / "bag",
        [
            (graph.CONTROLLER_STATE, messages.controller_state(i * 10_000_000, now))
            for i, now in enumerate(modes)
        ],
    )
    start, end = close_look(Recording(tmp_path / "bag"))
    assert 6.0 < start < end < 9.0


def test_thinning_keeps_the_extremes() -> None:
    time = np.arange(100_000) / 500.0
    values = np.sin(time)
    values[54_321] = 40.0
    values[12_345] = -40.0
    thin_time, thin_values = thin(time, values, bins=500)
    assert len(thin_time) <= 1200
    assert (thin_values.max(), thin_values.min()) == (40.0, -40.0)
    assert np.all(np.diff(thin_time) >= 0.0)
    assert len(thin(time[:100], values[:100], bins=500)[0]) == 100
