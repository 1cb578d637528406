"""Figures of the propulsion unit show the data, and where a rope was taut."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from PIL import Image

from husky_description.robot import load_robot
from husky_experiments.figures import figures
from husky_experiments.figures import propulsion as figure_propulsion
from husky_experiments.recordings.recording import Recording

ROBOT = load_robot()
UNIT = re.compile(r"\[(deg|m|m/s|N|V|A|us|rad/s|s)\]$")


@pytest.fixture(scope="module")
def recording(unit_bag: Path) -> Recording:
    return Recording(unit_bag)


def shaded(figure: Figure) -> list[list[tuple[float, float]]]:
    """Return for each axis where it is shaded for a taut rope."""
    colour = to_rgba(figure_propulsion.TAUT)
    return [
        [
            (patch.get_x(), patch.get_x() + patch.get_width())
            for patch in axis.patches
            if np.allclose(patch.get_facecolor(), colour)
        ]
        for axis in figure.axes
    ]


def test_the_unit_alone_has_no_legs_to_draw(recording: Recording, tmp_path: Path) -> None:
    written = figures.make_all(recording, ROBOT, tmp_path / "figures")
    assert [path.stem for path in written] == ["body", "battery", "unit_attitude", "fans", "t265"]
    for path in written:
        with Image.open(path) as image:
            assert len(image.convert("L").getcolors()) > 20, f"{path} is nearly blank"


def test_with_legs_both_are_drawn(
    tmp_path: Path,
    write_bag: Any,
    messages: Any,
    unit_flight: Any,
    walk: Any,
    drawn: dict[str, Figure],
) -> None:
    mount = (np.array(ROBOT.t265.position), ROBOT.t265.rpy.tolist())
    flown = [row for row in unit_flight.content(messages, mount) if "ground_truth" not in row[0]]
    write_bag(tmp_path / "bag", [*walk.content(messages), *flown])
    figures.make_all(Recording(tmp_path / "bag"), ROBOT, tmp_path / "figures")
    wanted = [*figures.DRAWINGS, *figures.UNIT_DRAWINGS]
    assert list(drawn) == [draw.__name__ for draw in wanted]


def test_axes_have_units(recording: Recording, drawn: dict[str, Figure], tmp_path: Path) -> None:
    figures.make_all(recording, ROBOT, tmp_path)
    for name, figure in drawn.items():
        labels = [text for a in figure.axes for text in (a.get_xlabel(), a.get_ylabel()) if text]
        assert len(labels) > len(figure.axes), name
        assert all(UNIT.search(text) for text in labels), (name, labels)


def test_attitude_has_desired_measured_and_true(
    recording: Recording, drawn: dict[str, Figure], tmp_path: Path, unit_flight: Any
) -> None:
    figure_propulsion.unit_attitude(recording, ROBOT, tmp_path)
    figure = drawn["unit_attitude"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "desired",
        "measured",
        "truth",
        "rope taut",
    ]
    true, measured, desired = figure.axes[2].lines
    time = true.get_xdata()
    assert np.allclose(true.get_ydata(), np.degrees(unit_flight.yaw * np.sin(time)))
    compass = np.degrees(unit_flight.compass)
    expected = np.degrees(unit_flight.yaw * np.sin(measured.get_xdata())) + compass
    assert np.allclose(measured.get_ydata(), expected)
    flown = desired.get_xdata() >= unit_flight.spin_up - 1e-9
    assert np.all(np.isnan(desired.get_ydata()[~flown]))
    assert np.allclose(desired.get_ydata()[flown], expected[flown])
    for spans in shaded(figure):
        assert np.allclose(spans, unit_flight.taut)


def test_battery_against_its_resistance(
    recording: Recording, drawn: dict[str, Figure], tmp_path: Path, unit_flight: Any
) -> None:
    figure_propulsion.battery(recording, ROBOT, tmp_path)
    voltage, current = drawn["battery"].axes
    true, measured, said = (line.get_ydata() for line in voltage.lines)
    assert np.allclose(said, true[::2], atol=1e-6)
    assert np.allclose(np.abs(measured - said), unit_flight.voltage_noise, atol=1e-6)
    assert set(current.lines[0].get_ydata()) == {2.0, 20.0}
    assert shaded(drawn["battery"]) == [[], []]


def test_fans(
    recording: Recording, drawn: dict[str, Figure], tmp_path: Path, unit_flight: Any
) -> None:
    figure_propulsion.fans(recording, ROBOT, tmp_path)
    total, each, speed, pulses = drawn["fans"].axes
    for line in total.lines:
        flown = line.get_xdata() >= unit_flight.spin_up - 1e-9
        assert np.allclose(line.get_ydata(), np.where(flown, 4 * unit_flight.thrust, 0.0))
    assert len(total.lines) == 2
    assert [len(axis.lines) for axis in (each, speed, pulses)] == [4, 4, 4]
    assert pulses.lines[2].get_ydata().max() == 1300
