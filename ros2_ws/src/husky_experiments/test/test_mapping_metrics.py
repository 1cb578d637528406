"""How maps are judged: the true ground of a scene's file, edges of a gap, errors and coverage."""

import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_experiments.metrics import mapping
from husky_experiments.metrics.mapping import JudgedMap, RecordedMap, TrueGround
from husky_navigation.cells import Lattice
from husky_sim.gap import DEPTH
from husky_sim.scene import WorldOptions
from husky_sim.terrain import TerrainOptions
from husky_sim.world import World

LATTICE = Lattice(0.04, 200, -100, -100)


def judged(height, truth, in_view):
    x, y = np.meshgrid(*LATTICE.cell_centers(), indexing="ij")
    near = np.hypot(x, y) < mapping.RADIUS
    recorded = RecordedMap(0.0, LATTICE, height(x, y), np.ones(x.shape))
    beside = np.where(near, truth(x, y), np.nan)
    return JudgedMap(recorded, x, y, recorded.elevation, beside, near & in_view(x, y))


def test_the_ground_of_a_file_is_that_of_the_world_without_its_robot(tmp_path):
    gap = TerrainOptions(kind="gap", approach=2.0, size=0.8, height=0.5, top=3.0)
    world = World(load_robot(), WorldOptions(terrain=gap))
    (tmp_path / "scene.xml").write_text(world.scene_xml)
    ground = TrueGround(tmp_path / "scene.xml")
    x = np.array([0.0, 1.9, 2.1, 2.7, 2.9])
    np.testing.assert_allclose(ground.heights(x, np.zeros(5)), [0, 0, -DEPTH, -DEPTH, 0.5])
    level = ground.distances(np.array([[0.0, 0.0, 0.3]]), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(level, 2.8, err_msg="at the face of the step behind the gap")


def test_errors_and_coverage_are_those_of_the_cells_around_the_robot():
    ahead = judged(
        lambda x, y: np.where(x > 1.0, np.nan, 0.01),
        lambda x, y: np.zeros(x.shape),
        lambda x, y: x > 0.0,
    )
    found = mapping.summary([ahead, ahead])
    assert found["maps"] == 2
    assert found["rmse_m"] == pytest.approx(0.01) and found["bias_m"] == pytest.approx(0.01)
    # The cells of a disk of 2.5 m with x > 0; of those x < 1 is on the map.
    disk = 0.5 * np.pi * mapping.RADIUS**2
    known = mapping.RADIUS**2 * np.arcsin(1.0 / mapping.RADIUS) + np.sqrt(mapping.RADIUS**2 - 1.0)
    assert found["coverage"] == pytest.approx(known / disk, abs=0.01)


def test_edges_of_a_gap_are_found_to_a_cell():
    gap = judged(
        lambda x, y: np.where((x > 1.0) & (x < 1.6), np.where(x > 1.2, np.nan, -1.0), 0.004),
        lambda x, y: np.zeros(x.shape),
        lambda x, y: x > 0.0,
    )
    near, far = mapping.gap_edges(gap)
    assert near == pytest.approx(1.0, abs=0.021) and far == pytest.approx(1.6, abs=0.021)
    level = judged(lambda x, y: 0.0 * x, lambda x, y: 0.0 * x, lambda x, y: x > 0.0)
    assert np.isnan(mapping.gap_edges(level)).all()


def test_cells_at_the_edge_of_a_pit_are_not_compared():
    truth = np.zeros((20, 20))
    truth[10:] = -1.0
    truth[:2] = np.nan
    left_out = mapping._is_near_drop(truth, 2)
    assert left_out[8:12].all() and not left_out[:8].any() and not left_out[12:].any()
    step = np.where(truth < 0.0, 0.35, truth)
    assert not mapping._is_near_drop(step, 2).any(), "a box is compared"
