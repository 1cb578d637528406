"""A walk over a ground with a map, and how good the map is at its end."""

from dataclasses import dataclass

import numpy as np
from simulated_camera import CX, CY, FX, FY, Errors, U, V, take_image, true_depth
from simulated_walk import Motion, Pose, footholds, poses
from terrain_scenes import Scene

from husky_description.arrays import Array
from husky_navigation.depth_view import DepthView, PinholeCamera
from husky_navigation.elevation_map import ElevationMap, ImageReport
from husky_navigation.map_parameters import MapParameters

CAMERA = PinholeCamera(FX, FY, CX, CY)
RADIUS = 2.5
"""Around the robot, within which a map is judged [m]."""


def show(
    elevation_map: ElevationMap,
    scene: Scene,
    true: Pose,
    odometry: Pose,
    time: float,
    random: np.random.Generator,
    errors: Errors | None = None,
) -> ImageReport:
    """Take an image where the robot is, and hand it to the map with the pose of odometry."""
    camera, believed = true.camera(), odometry.camera()
    image = take_image(scene, camera.rotation, camera.position, errors or Errors(), random)
    elevation_map.move_to(odometry.position)
    view = DepthView(image, CAMERA, believed.rotation, believed.position, time)
    return elevation_map.integrate(view)


@dataclass(frozen=True)
class Walk:
    """The end of a walk.

    Attributes:
        map: as it is then.
        scene: the ground.
        true, odometry: the base's pose, and what odometry takes it to be.
        ground_seen: places on the ground that were in view (n, 2), in world [m].
    """

    map: ElevationMap
    scene: Scene
    true: Pose
    odometry: Pose
    ground_seen: Array

    def places(self) -> tuple[Array, Array]:
        """Return where the cells' centres are in odom [m], (n, n) each."""
        return np.meshgrid(*self.map.lattice.cell_centers(), indexing="ij")

    def truth(self) -> Array:
        """Return the ground's height in odom as it is now, drift included [m] (n, n)."""
        drift = self.odometry.position - self.true.position
        x, y = self.places()
        return self.scene.height(x - drift[0], y - drift[1]) + drift[2]

    def near(self) -> Array:
        """Return which cells are near enough to be judged (n, n)."""
        x, y = self.places()
        robot = self.odometry.position
        return np.hypot(x - robot[0], y - robot[1]) < RADIUS

    def coverage(self) -> float:
        """Return the share of the cells in view until now that are on the map."""
        drift = self.odometry.position - self.true.position
        lattice = self.map.lattice
        where = np.floor((self.ground_seen + drift[:2]) / lattice.resolution).astype(int)
        where -= [lattice.x, lattice.y]
        where = where[((where >= 0) & (where < lattice.cells)).all(axis=1)]
        seen = np.zeros((lattice.cells, lattice.cells), dtype=bool)
        seen[where[:, 0], where[:, 1]] = True
        seen &= self.near()
        return float(np.isfinite(self.map.elevation[seen]).mean())


def walk(
    scene: Scene,
    motion: Motion | None = None,
    errors: Errors | None = None,
    images: int = 22,
    period: float = 0.15,
    seed: int = 0,
    parameters: MapParameters | None = None,
) -> Walk:
    """Walk over a ground and map it, with feet that touch it now and then.

    Fewer images than the camera's 10 a second are harder for the map.
    """
    random, motion = np.random.default_rng(seed), motion or Motion()
    elevation_map = ElevationMap(parameters)
    in_view = []
    for k in range(images):
        true, odometry = poses(scene, motion, k * period, random)
        elevation_map.move_to(odometry.position)
        for place in footholds(scene, true, odometry)[[(0, 3), (1, 2)][k % 2], :]:
            elevation_map.observe_foothold(place + [0.0, 0.0, 0.003 * random.standard_normal()])
        show(elevation_map, scene, true, odometry, k * period, random, errors)
        if k % 3 == 0:
            in_view.append(_ground_in_view(scene, true.camera()))
    return Walk(elevation_map, scene, true, odometry, np.concatenate(in_view))


def _ground_in_view(scene: Scene, camera: Pose) -> Array:
    """Return places of the ground's upper side that the camera sees in its range (n, 2)."""
    depth = true_depth(scene, camera.rotation, camera.position)
    which = (depth > 0.2) & (depth < 3.25)
    d = depth[which]
    points = np.stack([U[which] * d, V[which] * d, d], axis=1) @ camera.rotation.T
    points += camera.position
    above = np.abs(scene.height(points[:, 0], points[:, 1]) - points[:, 2]) < 0.01
    return points[above, :2]
