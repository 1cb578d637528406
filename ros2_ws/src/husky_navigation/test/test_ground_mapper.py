"""Images and footholds go into the map with the pose of their own time."""

import numpy as np
import pytest

from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot
from husky_navigation.depth_view import PinholeCamera
from husky_navigation.ground_mapper import GroundMapper
from husky_navigation.pose_history import JointHistory, PoseHistory, rotation_matrix

ROBOT = load_robot()
JOINTS = np.array(ROBOT.stand_joint_position)
FEET = Kinematics(ROBOT).foot_positions(JOINTS)
HEIGHT = float(ROBOT.foot_radius - FEET[:, 2].mean())
"""Of the base over the ground on which it stands [m]."""
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
PINHOLE = PinholeCamera(84.3, 108.2, 79.5, 59.5)
MS = 1_000_000


def about_y(angle):
    return np.array([0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)])


def level_ground(position, pitch=0.0, height=0.0):
    """The depth image [mm] of level ground from a base, by where each ray meets the plane."""
    camera = ROBOT.d435
    down = float(camera.rpy[1]) + pitch
    v = np.tile(((np.arange(120) - 59.5) / 108.2)[:, None], (1, 160))
    falls = np.sin(down) + v * np.cos(down)  # of a ray of depth 1
    place = rotation_matrix(about_y(pitch)) @ np.array(camera.position)
    above = position[2] + place[2] - height
    depth = above / np.maximum(falls, 1e-6)
    return np.where((falls > 0.02) & (depth < 8.0), 1000.0 * depth, 0).astype(np.uint16)


def mapper(joints=JOINTS):
    return GroundMapper(ROBOT, lambda _: joints)


def stand(ground, start, end, position=(0.0, 0.0, HEIGHT), orientation=LEVEL, known=True):
    """Tell poses of a base at rest, 50 a second, from a time to another [ms]."""
    for time in range(start, end + 1, 20):
        ground.add_pose(time * MS, np.array(position), orientation, known=known)


def seen(ground):
    return int(np.isfinite(ground.map.elevation).sum())


def test_an_image_waits_for_its_pose():
    ground = mapper()
    stand(ground, 0, 100)
    image = level_ground((0.0, 0.0, HEIGHT))
    ground.add_image(110 * MS, image, PINHOLE)
    assert ground.counts["images"] == 0
    stand(ground, 120, 120)
    assert ground.counts["images"] == 1 and ground.image_time == 110 * MS
    ground.add_image(110 * MS, image, PINHOLE)
    assert ground.counts["images"] == 1 and ground.counts["repeated"] == 1


def test_the_pose_of_the_image_counts_not_the_newest():
    """The base pitches by 0.2 rad in 40 ms; the image is of the middle of that time."""
    ground = mapper()
    for image in range(6):
        start = 100 * image
        for time, pitch in ((0, -0.1), (40, 0.1), (60, 0.3)):
            place = np.array([0.0, 0.0, HEIGHT])
            ground.add_pose((start + time) * MS, place, about_y(pitch), known=True)
        ground.add_image((start + 20) * MS, level_ground((0.0, 0.0, HEIGHT)), PINHOLE)
    assert ground.counts["images"] == 6
    height = ground.map.elevation[np.isfinite(ground.map.elevation)]
    assert len(height) > 1000
    np.testing.assert_allclose(height, 0.0, atol=0.003)


def test_images_of_a_time_without_pose_are_dropped():
    ground = mapper()
    image = level_ground((0.0, 0.0, HEIGHT))
    stand(ground, 0, 100)
    stand(ground, 120, 200, known=False)  # it falls
    stand(ground, 220, 300)
    for time in (150, 210):
        ground.add_image(time * MS, image, PINHOLE)
    assert ground.counts["without_pose"] == 2 and ground.counts["images"] == 0
    ground.add_image(250 * MS, image, PINHOLE)
    assert ground.counts["images"] == 1


def test_images_do_not_pile_up_without_odometry():
    ground = mapper()
    for k in range(20):
        ground.add_image(k * 100 * MS, level_ground((0.0, 0.0, HEIGHT)), PINHOLE)
    stand(ground, 0, 2000)
    assert ground.counts["without_pose"] >= 15
    assert ground.counts["without_pose"] + ground.counts["images"] == 20


def test_an_image_of_before_the_world_started_again_is_dropped():
    ground = mapper()
    stand(ground, 4900, 5000)
    stand(ground, 0, 20)
    ground.add_image(5010 * MS, level_ground((0.0, 0.0, HEIGHT)), PINHOLE)
    assert ground.counts["without_pose"] == 1


def test_feet_that_stand_fill_the_ground_that_the_camera_never_sees():
    ground = mapper()
    stand(ground, 0, 100)
    for time in range(20, 101, 20):
        ground.add_contacts(time * MS, np.ones(4, dtype=bool))
    assert ground.counts["footholds"] == 4
    index = ground.map.lattice.index_of(0.0, 0.0)
    assert ground.map.elevation[index] == pytest.approx(0.0, abs=0.003)


def test_footholds_of_a_burst_of_contacts_are_kept():
    """A node that was not woken for 1 s takes all contacts, then all poses."""
    ground = mapper()
    stand(ground, 0, 0)
    for time in range(20, 1001, 20):
        ground.add_contacts(time * MS, np.ones(4, dtype=bool))
    stand(ground, 20, 1000)
    assert ground.counts["footholds"] == 4


def test_a_foot_that_has_just_touched_is_no_foothold():
    ground = mapper()
    stand(ground, 0, 200)
    swing = np.array([True, False, False, True])
    for time, standing in ((20, swing), (40, ~swing), (60, swing), (80, swing)):
        ground.add_contacts(time * MS, standing)
    assert ground.counts["footholds"] == 0
    ground.add_contacts(100 * MS, swing)
    assert ground.counts["footholds"] == 2


@pytest.mark.parametrize(
    ("time", "position"),
    [(0, (0.0, 0.0, HEIGHT)), (5020, (3.0, 0.0, HEIGHT))],
    ids=["reset", "jump"],
)
@pytest.mark.parametrize("falls", [False, True])
def test_odometry_that_starts_anew_starts_the_map_anew(time, position, falls):
    ground = mapper()
    stand(ground, 4900, 5000)
    for k in range(4):
        ground.add_image((4910 + k) * MS, level_ground((0.0, 0.0, HEIGHT)), PINHOLE)
    assert seen(ground) > 1000
    if falls:
        stand(ground, 5020, 5020, known=False)
        time += 20 if time else 0
    stand(ground, time, time, position)
    assert seen(ground) == 0 and ground.counts["restarts"] == 1
    stand(ground, time + 20, time + 20, position)
    ground.add_image((time + 10) * MS, level_ground(position), PINHOLE)
    assert ground.counts["images"] == 5


def test_images_without_joints_are_dropped():
    ground = mapper(joints=None)
    stand(ground, 0, 200)
    ground.add_image(50 * MS, level_ground((0.0, 0.0, HEIGHT)), PINHOLE)
    assert ground.counts["without_joints"] == 1 and seen(ground) == 0


def test_footholds_and_images_wait_for_joints_that_come_late():
    told = []
    ground = GroundMapper(ROBOT, lambda time: JOINTS if told and time <= told[-1] else None)
    for time in range(0, 201, 20):
        ground.add_pose(time * MS, np.array((0.0, 0.0, HEIGHT)), LEVEL, known=True)
        ground.add_contacts(time * MS, np.ones(4, dtype=bool))
        if time == 60:
            ground.add_image(50 * MS, level_ground((0.0, 0.0, HEIGHT)), PINHOLE)
            assert ground.counts["images"] == 0
        told.append(time * MS)
    assert ground.counts["images"] == 1 and ground.counts["footholds"] == 4


def test_half_an_image_leaves_the_other_half_of_the_map_as_it_was():
    ground = mapper()
    stand(ground, 0, 2000)
    image = level_ground((0.0, 0.0, HEIGHT))
    for time in range(100, 700, 100):
        ground.add_image(time * MS, image, PINHOLE)
    before, covered = seen(ground), image.copy()
    covered[:, :80] = 0
    for time in range(700, 2000, 50):
        ground.add_image(time * MS, covered, PINHOLE)
    assert seen(ground) >= 0.98 * before > 1000


def test_joints_between_two_are_interpolated_and_not_guessed():
    history = JointHistory()
    assert history.at(0) is None
    for time, angle in ((0, 0.0), (20, 0.1), (20, 9.0), (40, 0.3), (400, 0.5)):
        history.add(time * MS, np.full(12, angle))
    for time, angle in ((0, 0.0), (5, 0.025), (20, 0.1), (30, 0.2), (400, 0.5)):
        np.testing.assert_allclose(history.at(time * MS), np.full(12, angle))
    assert history.at(-1) is None and history.at(401 * MS) is None, "before and after"
    assert history.at(200 * MS) is None, "a gap"
    history.add(10 * MS, np.zeros(12))
    assert history.at(20 * MS) is None, "of a world that has started again"


def test_poses_between_two_are_interpolated():
    history = PoseHistory()
    history.add(0, np.array([0.0, 0.0, 0.5]), LEVEL)
    history.add(20 * MS, np.array([0.01, 0.0, 0.5]), -about_y(0.02))
    pose = history.at(5 * MS)
    np.testing.assert_allclose(pose.position, [0.0025, 0.0, 0.5])
    np.testing.assert_allclose(pose.rotation, rotation_matrix(about_y(0.005)), atol=1e-6)
    assert history.at(-1) is None and history.at(21 * MS) is None
    with pytest.raises(ValueError, match="not after"):
        history.add(20 * MS, np.zeros(3), LEVEL)
    history.add(900 * MS, np.zeros(3), LEVEL)
    assert history.at(500 * MS) is None, "too long a gap"
