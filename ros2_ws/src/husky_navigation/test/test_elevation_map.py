"""The map over time: moving, things that come and go, drift, wrong poses, footholds."""

from dataclasses import replace

import numpy as np
import pytest
from map_trial import CAMERA, show
from simulated_walk import FEET_IN_BASE, STEADY, Motion, Pose, poses
from terrain_scenes import FLOOR, Box, Scene

from husky_navigation.depth_view import DepthView, PinholeCamera
from husky_navigation.elevation_map import ElevationMap
from husky_navigation.map_parameters import MapParameters

FLAT = Scene((FLOOR,))
BOX = Box((1.3, -0.2, -0.1), (1.6, 0.2, 0.3))
WITH_BOX = Scene((FLOOR, BOX))
STANDING = replace(Motion(), speed=0.0)
STILL = replace(STEADY, speed=0.0)


def stand(elevation_map, scene, images, random, motion=STANDING):
    reports = []
    for _ in range(images):
        time = max(0.0, elevation_map._time + 0.1)
        true, odometry = poses(scene, motion, time, random)
        reports.append(show(elevation_map, scene, true, odometry, time, random))
    return reports


def in_box(elevation_map):
    x, y = elevation_map.lattice.cell_centers()
    inside = np.ix_((x > 1.34) & (x < 1.56), (y > -0.16) & (y < 0.16))
    return elevation_map.elevation[inside]


def test_what_was_not_seen_is_nan():
    elevation_map = ElevationMap()
    assert np.isnan(elevation_map.elevation).all()
    stand(elevation_map, FLAT, 6, np.random.default_rng(1))
    x, _ = elevation_map.lattice.cell_centers()
    assert np.isnan(elevation_map.elevation[x < 0.4]).all()
    assert np.isnan(elevation_map.variance[x < 0.4]).all()
    assert np.isfinite(elevation_map.elevation).sum() > 2000
    elevation_map.clear()
    assert np.isnan(elevation_map.elevation).all()


def test_cells_keep_their_places_when_the_robot_moves():
    elevation_map = ElevationMap()
    stand(elevation_map, WITH_BOX, 6, np.random.default_rng(1))
    before, (x, y) = elevation_map.elevation, elevation_map.lattice.cell_centers()
    elevation_map.move_to(np.array([0.53, -0.31]))
    after, (moved_x, moved_y) = elevation_map.elevation, elevation_map.lattice.cell_centers()
    assert np.abs(np.array(elevation_map.lattice.center) - [0.53, -0.31]).max() <= 0.02 + 1e-9
    east, north = round((moved_x[0] - x[0]) / 0.04), round((moved_y[0] - y[0]) / 0.04)
    assert (east, north) == (13, -8)
    expected = np.full((200, 200), np.nan)
    expected[:-13, 8:] = before[13:, :-8]
    np.testing.assert_array_equal(after, expected)
    assert np.isfinite(expected).sum() > 2000


def test_a_box_that_goes_leaves_the_map_and_ground_stays():
    random, elevation_map = np.random.default_rng(2), ElevationMap()
    stand(elevation_map, WITH_BOX, 8, random)
    assert np.nanmean(in_box(elevation_map)) == pytest.approx(0.3, abs=0.02)
    seen = np.isfinite(elevation_map.elevation).sum()
    reports = stand(elevation_map, FLAT, 8, random)
    assert np.nanmax(np.abs(in_box(elevation_map))) < 0.05
    assert np.isfinite(elevation_map.elevation).sum() > seen
    # The ground that the box has hidden is ground now, and none other was taken away.
    assert sum(report.removed for report in reports) < 60


def test_a_box_that_comes_is_on_the_map_within_a_second():
    random, elevation_map = np.random.default_rng(2), ElevationMap()
    stand(elevation_map, FLAT, 8, random)
    stand(elevation_map, WITH_BOX, 10, random)
    assert np.mean(in_box(elevation_map) > 0.2) > 0.6


@pytest.mark.parametrize("behind_middle", [-0.01, 0.01])
def test_the_top_of_a_near_wall_is_as_high_as_its_face_is_seen(behind_middle):
    """The camera is 0.63 m up and looks down: it sees no top. The face is before the middle of its
    cells, or behind it, where `elevation` has the wall's foot.
    """
    face, random, elevation_map = 1.14 + behind_middle, np.random.default_rng(6), ElevationMap()
    wall = Scene((FLOOR, Box((face, -2.0, -0.1), (face + 0.2, 2.0, 2.5))))
    seen = []
    for rise in (0.0, 0.5, 1.0):
        for _ in range(6):
            time = max(0.0, elevation_map._time + 0.1)
            true, odometry = poses(wall, STANDING, time, random)
            up = np.array([0.0, 0.0, rise])
            true, odometry = (Pose(p.rotation, p.position + up) for p in (true, odometry))
            show(elevation_map, wall, true, odometry, time, random)
        (x, y), top = elevation_map.lattice.cell_centers(), elevation_map.top
        at_wall = np.ix_(np.abs(x - 1.14) < 0.01, np.abs(y) < 0.4)
        seen.append(np.nanmedian(top[at_wall]))
    assert seen == pytest.approx([0.6, 1.1, 1.6], abs=0.08)
    low = elevation_map.elevation[at_wall]
    assert (np.nanmedian(low) < 0.8) == (behind_middle > 0.0)


def test_the_top_of_a_wall_that_goes_leaves_the_map():
    random, elevation_map = np.random.default_rng(2), ElevationMap()
    wall = Scene((FLOOR, Box((1.53, -0.3, -0.1), (1.7, 0.3, 0.4))))
    stand(elevation_map, wall, 8, random)
    x, y = elevation_map.lattice.cell_centers()
    there = np.ix_((x > 1.4) & (x < 1.8), np.abs(y) < 0.2)
    assert np.nanmax(elevation_map.top[there]) > 0.3
    stand(elevation_map, FLAT, 12, random)
    assert np.nanmax(elevation_map.top[there]) < 0.1


def test_ground_out_of_sight_does_not_sink_while_the_robot_treads():
    """Seen with noise, bob and sway, for 2 s; the camera's errors average out to 1 mm."""
    random, elevation_map = np.random.default_rng(4), ElevationMap()
    motion = replace(Motion(), climb=0.0, stretch=0.0)
    for k in range(14):
        true, odometry = poses(FLAT, motion, 0.1 * k, random)
        show(elevation_map, FLAT, true, odometry, 0.1 * k, random)
    x, _ = elevation_map.lattice.cell_centers()
    hidden = x < true.position[0] + 0.4
    before = elevation_map.elevation[hidden]
    there = np.array([0.65, 0.0, 0.0])
    for k in range(14, 34):
        true, odometry = poses(FLAT, replace(motion, speed=0.0), 0.1 * k, random)
        true, odometry = (Pose(p.rotation, p.position + there) for p in (true, odometry))
        show(elevation_map, FLAT, true, odometry, 0.1 * k, random)
    change = elevation_map.elevation[hidden] - before
    assert np.isfinite(change).sum() > 200
    assert np.nanmax(np.abs(change)) < 2e-3


def test_cells_grow_old_until_they_are_measured_again():
    random, elevation_map = np.random.default_rng(3), ElevationMap()
    stand(elevation_map, FLAT, 6, random)
    known = np.isfinite(elevation_map.elevation)
    assert np.nanmedian(elevation_map.age) == 0.0
    assert np.isnan(elevation_map.age[~known]).all()
    nothing = np.zeros((120, 160), np.uint16)
    for time in (1.0, 1.5):
        elevation_map.integrate(DepthView(nothing, CAMERA, np.eye(3), np.zeros(3), time))
    assert np.nanmin(elevation_map.age) == pytest.approx(1.5 - 0.5)
    for x, age in (1.0, 1.0), (-0.5, 0.0):  # on ground that images have shown, and on other
        elevation_map.observe_foothold(np.array([x, 0.0, 0.0]))
        i, j = elevation_map.lattice.index_of(x, 0.0)
        assert elevation_map.age[i, j] == pytest.approx(age)
    stand(elevation_map, FLAT, 1, random)
    assert np.nanmedian(elevation_map.age) == 0.0


def test_a_wrong_pose_does_not_spoil_the_map():
    """Two images at a pitch wrong by 0.2 rad and a height wrong by 0.1 m, as at a stumble."""
    random, elevation_map = np.random.default_rng(5), ElevationMap()
    stand(elevation_map, FLAT, 8, random, STILL)
    seen = np.isfinite(elevation_map.elevation)
    c, s = np.cos(0.2), np.sin(0.2)
    wrong = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    for k in range(2):
        true, odometry = poses(FLAT, STILL, 0.0, random)
        odometry = Pose(odometry.rotation @ wrong, odometry.position + [0.0, 0.0, 0.1])
        report = show(elevation_map, FLAT, true, odometry, 0.9 + 0.1 * k, random)
        assert report.correction == 0.0
        assert not report.believed
        assert report.removed == 0
    still = elevation_map.elevation[seen]
    assert np.mean(np.isfinite(still)) > 0.98
    assert np.sqrt(np.nanmean(still**2)) < 0.02


def test_map_follows_when_odometry_jumps():
    """Its height jumps by 0.3 m and stays there: the map is right again within 1.5 s."""
    random, elevation_map = np.random.default_rng(6), ElevationMap()
    stand(elevation_map, FLAT, 8, random, STILL)
    for k in range(15):
        true, odometry = poses(FLAT, STILL, 0.0, random)
        odometry = Pose(odometry.rotation, odometry.position + [0.0, 0.0, 0.3])
        show(elevation_map, FLAT, true, odometry, 1.0 + 0.1 * k, random)
    x, y = elevation_map.lattice.cell_centers()
    ahead = elevation_map.elevation[np.ix_((x > 0.7) & (x < 2.0), np.abs(y) < 0.5)]
    assert np.mean(np.isfinite(ahead)) > 0.9
    assert np.sqrt(np.nanmean((ahead - 0.3) ** 2)) < 0.05


def test_footholds_fill_cells_and_lift_a_map_that_odometry_has_left():
    elevation_map = ElevationMap()
    cells = elevation_map._cells
    cells.height[:], cells.variance[:], cells.support[:] = 0.0, 1e-5, 20.0
    cells.height[:, 150:] = np.nan
    elevation_map.move_to(np.zeros(2))
    for k in range(1, 60):
        elevation_map.move_to(np.array([0.01 * k, 0.0]))
        assert elevation_map.observe_foothold(np.array([0.01 * k, 0.1, 0.01]))
    # Feet find the ground 1 cm higher: cells that no foot has touched follow.
    _, y = elevation_map.lattice.cell_centers()
    assert np.nanmedian(elevation_map.elevation[:, y < 0.0]) == pytest.approx(0.01, abs=0.006)
    assert not elevation_map.observe_foothold(np.array([9.0, 0.0, 0.0]))
    assert elevation_map.observe_foothold(np.array([0.5, 2.3, 0.07]))
    i, j = elevation_map.lattice.index_of(0.5, 2.3)
    assert elevation_map.elevation[i, j] == pytest.approx(0.07)
    assert elevation_map.variance[i, j] == pytest.approx(0.008**2)


def test_ground_under_a_standing_robot_is_a_plane_through_its_feet():
    elevation_map = ElevationMap()
    turn = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])
    feet = FEET_IN_BASE @ turn.T + [0.3, -0.2]
    feet = np.column_stack([feet, 0.1 + 0.2 * feet[:, 0] - 0.1 * feet[:, 1]])
    filled = elevation_map.seed_ground(feet, margin=0.1)
    area = (0.4 + 0.2) * (0.2 + 0.2)
    assert filled == pytest.approx(area / 0.04**2, rel=0.05)
    x, y = np.meshgrid(*elevation_map.lattice.cell_centers(), indexing="ij")
    known = np.isfinite(elevation_map.elevation)
    plane = 0.1 + 0.2 * x - 0.1 * y
    np.testing.assert_allclose(elevation_map.elevation[known], plane[known], atol=1e-9)
    assert elevation_map.seed_ground(feet, margin=0.1) == 0
    with pytest.raises(ValueError, match="in a line"):
        elevation_map.seed_ground(np.column_stack([np.arange(3.0), np.arange(3.0), np.zeros(3)]))
    with pytest.raises(ValueError, match="k >= 3"):
        elevation_map.seed_ground(feet[:2])


def test_bad_numbers_are_refused():
    elevation_map = ElevationMap(MapParameters(length=2.0))
    with pytest.raises(ValueError, match="position is nan"):
        elevation_map.move_to(np.array([np.nan, 0.0]))
    with pytest.raises(ValueError, match="position is"):
        elevation_map.observe_foothold(np.array([0.0, np.inf, 0.0]))
    with pytest.raises(ValueError, match=r"deviation is 0\.0"):
        elevation_map.observe_foothold(np.zeros(3), 0.0)
    view = DepthView(
        np.zeros((8, 8), dtype=np.uint16), PinholeCamera(8, 8, 4, 4), np.eye(3), np.zeros(3), 0.0
    )
    with pytest.raises(ValueError, match="capsules have shape"):
        elevation_map.integrate(view, np.zeros((2, 6)))
    assert elevation_map.integrate(view).cells == 0
