"""Figures of climbs: every slope, every cell of the map, and forces that Newton's law gives."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from PIL import Image

from husky_description.robot import load_robot
from husky_experiments.figures.incline import Climb, draw_all, friction_map, inertial_force
from husky_experiments.incline_course import Course
from husky_experiments.recordings.recording import Recording

ROBOT = load_robot()


@pytest.fixture(scope="module")
def climb(walk_bag, walk):
    return Climb(Course(0.0), Recording(walk_bag), walk.walking_from, walk.duration, {})


def test_every_figure_of_a_suite_becomes_a_file(climb, tmp_path):
    written = draw_all([climb, climb], ROBOT, tmp_path / "figures")
    assert {"joint_torques", "inertial_forces", "foot_placement", "joint_motion"} <= {
        path.stem for path in written
    }
    for path in written:
        with Image.open(path) as image:
            assert len(image.convert("L").getcolors()) > 20, f"{path} is nearly blank"


def test_torques_over_time_are_those_of_the_first_leg(climb, drawn, tmp_path, walk):
    draw_all([climb, climb], ROBOT, tmp_path)
    axes = np.reshape(drawn["joint_torques"].axes, (3, 2))
    for row, torque in zip(axes, walk.torque, strict=True):
        for axis in row:
            assert np.abs(axis.lines[0].get_ydata()) == pytest.approx(torque)


def test_inertial_force_is_what_ground_and_weight_do_not_balance(climb, walk):
    """Two feet press with 40 N and shear with 10 N each; the robot weighs some 75 N."""
    _, force = inertial_force(climb, ROBOT)
    assert np.allclose(force[:, 0], -2 * walk.tangential_force)
    assert np.allclose(force[:, 2], ROBOT.mass * 9.81 - 2 * walk.normal_force, atol=0.05)


def test_every_cell_of_the_map_is_drawn(tmp_path, monkeypatch):
    drawn, draw = {}, Axes.text

    def text(self, x, y, words, **options):
        drawn[x, y] = words
        return draw(self, x, y, words, **options)

    monkeypatch.setattr(Axes, "text", text)
    climbed = {(0.4, 30.0): 1, (0.4, 60.0): None, (0.7, 30.0): 3, (0.7, 60.0): 0}
    file = friction_map(climbed, 3, tmp_path / "figures")
    assert file.stat().st_size > 10_000
    cells = {(0, 0): "1 of 3", (1, 0): "3 of 3", (0, 1): "not tried", (1, 1): "0 of 3"}
    assert cells.items() <= drawn.items()
