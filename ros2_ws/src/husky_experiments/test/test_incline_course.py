"""A climbing course: its geometry beside the ramp's, the settings of its nodes."""

import argparse

import numpy as np
import pytest

from husky_experiments.catalogue import wair
from husky_experiments.incline_course import Course, climbing_settings, course_for
from husky_sim.ramp import Ramp


@pytest.mark.parametrize("degrees", [10.0, 30.0, 45.0, 75.0])
def test_heights_are_over_the_ramp(degrees):
    course = Course(degrees)
    ramp = Ramp(np.radians(degrees), course.approach, course.blend, course.length)
    for place in (0.0, course.approach, ramp.slope_start, ramp.slope_start + 1.0):
        x, z, angle = ramp.at(place)
        over = np.array([x - 0.5 * np.sin(angle), 0.3, z + 0.5 * np.cos(angle)])
        assert course.height(over) == pytest.approx(0.5, abs=1e-9), place
    in_foot, on_crest = course.approach + 0.5 * ramp.arc, ramp.slope_end + 0.5 * ramp.arc
    for place in (in_foot, on_crest, ramp.slope_end + ramp.arc + 1.0):
        x, z, angle = ramp.at(place)
        over = np.array([x - 0.5 * np.sin(angle), 0.0, z + 0.5 * np.cos(angle)])
        assert course.height(over) == pytest.approx(0.5, abs=1e-9), place
    x, z, _ = ramp.at(ramp.slope_start + 2.0)
    assert course.along(np.array([x, 0.0, z])) == pytest.approx(2.0)
    assert course.along(np.zeros(3)) < 0.0


def test_level_ground_is_flat():
    course = course_for(0.0, 5.0, 0.5)
    assert course.plant() == {"terrain": "flat", "friction": 0.5}
    assert course.height(np.array([3.0, 0.0, 0.52])) == 0.52


def test_a_course_is_long_enough():
    assert course_for(30.0, 7.0, 0.7).length > 8.0
    assert course_for(30.0, 0.0, 0.7).plant()["terrain"] == "ramp"


def test_every_node_knows_how_the_fans_are_mounted():
    settings = climbing_settings(Course(45.0), 3, "vector", {"wair.load_slope": 0.3})
    assert {node["mounting"] for node in settings.values()} == {"vectoring"}
    assert settings["plant"]["seed"] == 3
    assert settings["low_level_controller"]["wair.load_slope"] == 0.3
    with pytest.raises(ValueError, match="must be vector or body_z"):
        climbing_settings(Course(45.0), 3, "sideways")


@pytest.mark.parametrize(
    ("arguments", "radius"),
    [
        ([], 1.5),
        (["--slope", "60"], 1.5),
        (["--slope", "75"], 3.0),
        (["--slope", "30", "--thrust-mode", "body_z"], 1.5),
        (["--slope", "45", "--thrust-mode", "body_z"], 3.0),
        (["--slope", "75", "--blend", "2"], 2.0),
    ],
)
def test_the_foot_of_the_slope_is_as_wide_as_the_robot_needs_it_or_as_asked_for(arguments, radius):
    parser = argparse.ArgumentParser()
    wair.add_options(parser)
    assert wair.blend(parser.parse_args(arguments)) == radius
