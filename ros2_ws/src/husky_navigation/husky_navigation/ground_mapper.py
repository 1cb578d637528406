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
from husky_description.shapes import rotation_of
from husky_navigation.depth_view import DepthImage, DepthView, PinholeCamera
from husky_navigation.elevation_map import ElevationMap, ImageReport
from husky_navigation.map_parameters import MapParameters
from husky_navigation.pose_history import BasePose, PoseHistory
from husky_navigation.self_filter import LegCapsules

_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Optical axes (x right, y down, z ahead) to those of camera_link (x ahead, y left, z up)."""
_FIRM = 3
"""Contacts in a row, at 50 Hz, after which a foot stands: it has come to rest by then."""
_RESTART_NS = 1_000_000_000
"""A stamp so far back is that of a world that has started again, and an image so far ahead of the
poses is one of before that [ns]."""
_JUMP, _FASTEST = 0.5, 3.0
"""Distance between two poses beyond which odometry has started anew [m], and what a robot may add
to it in time [m/s]."""
_WAITING = 5
"""Images that wait for their pose and joints at most."""
_CONTACTS_WAITING = 100
"""Contacts that wait for theirs at most: 2 s, they are taken in bursts."""
_LATE_NS = 100_000_000
"""Joints that are later than a pose by this do not come any more [ns]."""

JointsAt = Callable[[int], Array | None]
"""Returns the joint positions (12,) [rad] at a time [ns], None where they are not known."""


class _Image(NamedTuple):
    time_ns: int
    depth: DepthImage
    camera: PinholeCamera


class _Contacts(NamedTuple):
    time_ns: int
    standing: NDArray[np.bool_]


class _Posture(NamedTuple):
    """Base and joints (12,) [rad] at one time; None where they are not known."""

    base: BasePose | None
    joints: Array | None


class GroundMapper:
    """Puts images and footholds into an elevation map, each with the pose of its own time.

    Attributes:
        map: of the ground, in odom.
        counts: `images` put into the map, `footholds` that were on it, `restarts`; images that were
            dropped: `repeated` (a stamp that was there before), `without_pose` (beyond the poses
            that are there, or the base was not known then), `without_joints`; and
            `lost_footholds`, which have no pose or joints.
        last: report of the newest image, None before it.
        image_time: stamp of the newest image in the map [ns], -1 before it.
        pose_time: stamp of the newest pose, whether or not the base was known [ns], -1 before it.
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
        self._camera_rotation = rotation_of(camera.rpy) @ _OPTICAL
        self._camera_position = np.array(camera.position)
        self._legs = LegCapsules(robot)
        self._kinematics = Kinematics(robot)
        self._foot_radius = robot.foot_radius
        self._joints_at = joints_at
        self._poses = PoseHistory()
        self.pose_time = -1
        self._position = np.zeros(3)
        self.clear()

    def clear(self) -> None:
        """Forget the map and what waits for its pose."""
        self.map.clear()
        self._images: deque[_Image] = deque()
        self._contacts: deque[_Contacts] = deque(maxlen=_CONTACTS_WAITING)
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
        if self.pose_time >= 0 and self._has_started_anew(time_ns, position):
            self._poses.clear()
            self.clear()
            self.counts["restarts"] += 1
        if known:
            self._poses.add(time_ns, position, orientation)
        elif time_ns > self._poses.newest:
            # Times before the next pose have a gap, and no pose.
            self._poses.clear()
        self.pose_time, self._position = time_ns, position
        self._advance()

    def _has_started_anew(self, time_ns: int, position: Array) -> bool:
        """Return whether a pose is of another odometry than the last, which may be unknown ones."""
        elapsed = 1e-9 * (time_ns - self.pose_time)
        walked = _JUMP + _FASTEST * max(0.0, elapsed)
        far = float(np.linalg.norm(position - self._position)) > walked
        return far or time_ns < self.pose_time - _RESTART_NS

    def add_contacts(self, time_ns: int, standing: NDArray[np.bool_]) -> None:
        """Take in which feet (4,) stand on the ground at a time [ns]; told 50 times a second."""
        self._contacts.append(_Contacts(time_ns, standing))
        self._advance()

    def add_image(self, time_ns: int, depth: DepthImage, camera: PinholeCamera) -> None:
        """Take in a depth image of a time [ns]; it waits until the pose of that time has come.

        Raises:
            ValueError: image or pinhole is malformed; says how (`DepthView`).
        """
        newest = self._images[-1].time_ns if self._images else self.image_time
        if time_ns <= newest and time_ns > newest - _RESTART_NS:
            self.counts["repeated"] += 1
            return
        if time_ns > self.pose_time + _RESTART_NS:
            self.counts["without_pose"] += 1
            return
        nowhere = np.eye(3), np.zeros(3)
        DepthView(depth, camera, *nowhere, time_ns * 1e-9)  # refuses malformed ones
        if len(self._images) == _WAITING:
            self._images.popleft()
            self.counts["without_pose"] += 1
        self._images.append(_Image(time_ns, depth, camera))
        self._advance()

    # What waits ---------------------------------------------------------------------------------
    def _advance(self) -> None:
        """Put into the map what has its pose."""
        while self._contacts and (posture := self._posture_at(self._contacts[0].time_ns)):
            self._add_footholds(self._contacts.popleft(), posture)
        while self._images and (posture := self._posture_at(self._images[0].time_ns)):
            self._integrate(self._images.popleft(), posture)

    def _posture_at(self, time_ns: int) -> _Posture | None:
        """Return pose and joints at a time [ns], None as long as they may still come."""
        if time_ns > self._poses.newest:
            return None
        joints = self._joints_at(time_ns)
        if joints is None and self._poses.newest <= time_ns + _LATE_NS:
            return None
        return _Posture(self._poses.at(time_ns), joints)

    def _integrate(self, image: _Image, posture: _Posture) -> None:
        """Put an image into the map."""
        base, joints = posture
        if base is None:
            self.counts["without_pose"] += 1
            return
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

    def _add_footholds(self, contacts: _Contacts, posture: _Posture) -> None:
        """Put the footholds of feet that have just come to rest into the map."""
        self._firm = np.where(contacts.standing, self._firm + 1, 0)
        fresh = np.flatnonzero(self._firm == _FIRM)
        seed = not self._seeded and bool((self._firm >= _FIRM).all())
        if not (seed or len(fresh)):
            return
        base, joints = posture
        if base is None or joints is None:
            self.counts["lost_footholds"] += len(fresh)
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
