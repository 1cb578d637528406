"""The map of the ground from the robot's own measurements: poses, joints, contacts, images."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.kinematics import Kinematics
from husky_description.robot import Robot
from husky_description.rotation import from_roll_pitch_yaw
from husky_navigation.depth_view import DepthImage, DepthView, PinholeCamera
from husky_navigation.elevation_map import ElevationMap, ImageReport
from husky_navigation.map_parameters import MapParameters
from husky_navigation.pose_history import BasePose, PoseHistory, rotation_matrix
from husky_navigation.self_filter import LegCapsules

_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Optical axes (x right, y down, z ahead) to those of camera_link (x ahead, y left, z up)."""
_FIRM = 3
"""Contacts in a row, at 50 Hz, after which a foot stands: it has come to rest by then."""
_RESTART_NS = 1_000_000_000
"""A stamp so far back is that of a world that has started again, and an image so far ahead of the
poses is one of before that [ns]."""
_JUMP = 0.5
"""Distance between two poses, 20 ms apart, that no robot walks: odometry has started anew [m]."""
_WAITING = 5
"""Images that wait for their pose at most."""

JointsAt = Callable[[int], Array | None]
"""Returns the joint positions (12,) [rad] at a time [ns], None where they are not known."""


class _Image(NamedTuple):
    time_ns: int
    depth: DepthImage
    camera: PinholeCamera


class _Contacts(NamedTuple):
    time_ns: int
    standing: NDArray[np.bool_]


class GroundMapper:
    """Puts images and footholds into an elevation map, each with the pose of its own time.

    Attributes:
        map: of the ground, in odom.
        counts: `images` put into the map, `footholds` that were on it, `restarts`; images that were
            dropped: `repeated` (a stamp that was there before), `without_pose` (beyond the poses
            that are there, or the base was not known then), `without_joints`.
        last: report of the newest image, None before it.
        image_time: stamp of the newest image in the map [ns], -1 before it.
    """

    def __init__(self, robot: Robot, joints_at: JointsAt, parameters: MapParameters | None = None):
        """Start with nothing seen.

        Args:
            robot: its legs, and where its camera is.
            joints_at: looks joints up.
            parameters: of the map.
        """
        self.map = ElevationMap(parameters)
        self.counts: Counter[str] = Counter()
        camera = robot.d435
        turn = np.array(from_roll_pitch_yaw(*camera.rpy.tolist()))
        self._camera_rotation = rotation_matrix(turn) @ _OPTICAL
        self._camera_position = np.array(camera.position)
        self._legs = LegCapsules(robot)
        self._kinematics = Kinematics(robot)
        self._foot_radius = robot.foot_radius
        self._joints_at = joints_at
        self._poses = PoseHistory()
        self.clear()

    @property
    def pose_time(self) -> int:
        """Stamp of the newest pose [ns], -1 without one."""
        return self._poses.newest

    def clear(self) -> None:
        """Forget the map and what waits for its pose."""
        self.map.clear()
        self._images: deque[_Image] = deque()
        self._contacts: deque[_Contacts] = deque(maxlen=_WAITING)
        self._firm = np.zeros(4, dtype=np.int64)
        self._seeded = False
        self.last: ImageReport | None = None
        self.image_time = -1

    # Measurements -------------------------------------------------------------------------------
    def add_pose(self, time_ns: int, position: Array, orientation: Array, *, known: bool) -> None:
        """Take in a pose of the base in odom; images that waited for it go into the map.

        Args:
            time_ns: its stamp [ns]. One far before the last, or a position far from the last,
                starts the map anew.
            position: of the base [m] (3,).
            orientation: unit quaternion (x, y, z, w), base to odom.
            known: False while the robot falls or hangs: nothing of that time is put into the map.

        Raises:
            ValueError: the stamp is that of the last pose, or a little before it.
        """
        before = self._poses.position
        far = before is not None and float(np.abs(position - before).max()) > _JUMP
        if far or time_ns < self._poses.newest - _RESTART_NS:
            self._poses.clear()
            self.clear()
            self.counts["restarts"] += 1
        if known:
            self._poses.add(time_ns, position, orientation)
        elif time_ns > self._poses.newest:
            # Times before the next pose have a gap, and no pose.
            self._poses.clear()
        self._advance()

    def add_contacts(self, time_ns: int, standing: NDArray[np.bool_]) -> None:
        """Take in which feet (4,) stand on the ground at a time [ns]; told 50 times a second."""
        self._contacts.append(_Contacts(time_ns, standing))
        self._advance()

    def add_image(self, time_ns: int, depth: DepthImage, camera: PinholeCamera) -> None:
        """Take in a depth image of a time [ns]; it waits until the pose of that time has come.

        Raises:
            ValueError: the image is none, or its pinhole is none.
        """
        newest = self._images[-1].time_ns if self._images else self.image_time
        if time_ns <= newest and time_ns > newest - _RESTART_NS:
            self.counts["repeated"] += 1
            return
        if time_ns > self._poses.newest + _RESTART_NS:
            self.counts["without_pose"] += 1
            return
        nowhere = np.eye(3), np.zeros(3)
        DepthView(depth, camera, *nowhere, time_ns * 1e-9)  # refuses what is none
        if len(self._images) == _WAITING:
            self._images.popleft()
            self.counts["without_pose"] += 1
        self._images.append(_Image(time_ns, depth, camera))
        self._advance()

    # What waits ---------------------------------------------------------------------------------
    def _advance(self) -> None:
        """Put into the map what has its pose."""
        newest = self._poses.newest
        while self._contacts and self._contacts[0].time_ns <= newest:
            self._stand(self._contacts.popleft())
        while self._images and self._images[0].time_ns <= newest:
            self._see(self._images.popleft())

    def _see(self, image: _Image) -> None:
        """Put an image into the map."""
        base = self._poses.at(image.time_ns)
        if base is None:
            self.counts["without_pose"] += 1
            return
        joints = self._joints_at(image.time_ns)
        if joints is None:
            self.counts["without_joints"] += 1
            return
        self.map.move_to(base.position)
        view = DepthView(
            image.depth,
            image.camera,
            base.rotation @ self._camera_rotation,
            base.position + base.rotation @ self._camera_position,
            image.time_ns * 1e-9,
        )
        self.last = self.map.integrate(view, self._legs.in_odom(joints, *base))
        self.image_time = image.time_ns
        self.counts["images"] += 1

    def _stand(self, contacts: _Contacts) -> None:
        """Put the footholds of feet that have just come to rest into the map."""
        self._firm = np.where(contacts.standing, self._firm + 1, 0)
        fresh = np.flatnonzero(self._firm == _FIRM)
        seed = not self._seeded and bool((self._firm >= _FIRM).all())
        if not (seed or len(fresh)):
            return
        base, joints = self._poses.at(contacts.time_ns), self._joints_at(contacts.time_ns)
        if base is None or joints is None:
            return
        feet = self._footholds(base, joints)
        if seed:
            self.map.move_to(base.position)
            self.map.seed_ground(feet)
            self._seeded = True
        for leg in fresh:
            self.counts["footholds"] += self.map.observe_foothold(feet[leg])

    def _footholds(self, base: BasePose, joints: Array) -> Array:
        """Return where the soles are, in odom [m] (4, 3)."""
        feet = self._kinematics.foot_positions(joints) @ base.rotation.T + base.position
        feet[:, 2] -= self._foot_radius
        return feet
