"""The map of slopes over friction: its criterion tells ground that is not climbed."""

from argparse import Namespace

import pytest

from husky_experiments.catalogue import wair_map
from husky_experiments.catalogue.wair_map import climbed_to
from husky_experiments.run import Run


def test_climbed_to_ends_at_the_first_slope_that_a_seed_fails():
    climbed = {(0.7, 30.0): 3, (0.7, 45.0): 2, (0.7, 60.0): 3, (0.4, 30.0): 3, (0.4, 45.0): None}
    assert climbed_to(climbed, 0.7, 3) == 30.0
    assert climbed_to(climbed, 0.4, 3) == 30.0
    assert climbed_to({(0.7, 90.0): 0}, 0.7, 3) == 0.0


@pytest.mark.parametrize(
    ("slopes", "steepest", "ok"),
    [([30.0, 45.0, 90.0], 45.0, True), ([30.0, 45.0], 30.0, False), ([60.0], 0.0, False)],
)
def test_a_robot_that_does_not_climb_fails(monkeypatch, tmp_path, slopes, steepest, ok):
    """Whatever the grid is: here each seed climbs up to a slope."""
    monkeypatch.setattr(wair_map, "_climbs", lambda run, friction, slope, seed: slope <= steepest)
    grid = {"frictions": [0.4, 1.2], "slopes": slopes, "seeds": 2}
    run = Run("wair_map", Namespace(output=tmp_path / "out", no_figures=True, **grid))
    wair_map.run(run)
    assert len(run.criteria) == 2
    assert all(entry["ok"] is ok for entry in run.criteria.values())
