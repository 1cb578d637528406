"""The robot and what is drawn about it, in three dimensions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

import numpy as np
import trimesh
from grid_map_msgs.msg import GridMap
from tf2_msgs.msg import TFMessage
from viser import ViserServer
from visualization_msgs.msg import MarkerArray

from husky_bringup.console.drawings import Drawings
from husky_bringup.console.elevation import ElevationDrawing
from husky_bringup.console.frame_tree import IDENTITY, FrameTree, Pose
from husky_bringup.console.ground_pick import first_hit, moved_ray
from husky_bringup.console.server import move
from husky_description.arrays import Array
from husky_description.rotation import about_z
from husky_runtime import graph

_ORIGINS = (graph.FRAME_ODOM, graph.FRAME_WORLD, graph.FRAME_BASE)
"""Frames that stand still in the picture, the first that there is."""
_ROOT = "/scene"
_FOLLOWING = 0.1
"""Share of the way to the robot that the picture goes in each drawing."""
_JUMP = 1.0
"""A way that is longer is gone at once [m]."""
_AMBIENT = 0.4
"""Light from all sides, as a share of viser's own."""
_NEAR, _FAR = 0.05, 300.0
"""What is nearer or farther is not drawn [m]."""
_AXES = 0.1
"""Length of a frame's axes [m]."""
_FARTHEST = 1000.0
"""Greatest x and y of a goal in `map` [m]; the navigator takes none beyond."""


class Scene:
    """Draws frames, the robot's links in them, markers, ground and its map."""

    def __init__(self, server: ViserServer):
        """Draw nothing but a grid; the controls of the view are where the page is made just now."""
        self._server, self._tree = server, FrameTree()
        self._frames: dict[str, Any] = {}
        self._poses: dict[str, Pose] = {}
        self._meshes: Mapping[str, trimesh.Trimesh] = {}
        self._looks: dict[str, Any] = {}
        self._drawings = Drawings(server.scene, _path, "drawn")
        self._route = Drawings(server.scene, _path, "route")
        self._ground = Drawings(server.scene, _path, "ground")
        self._map = ElevationDrawing(server.scene, _path)
        self._layers: dict[str, Any] = {}
        self._centre = (0.0, 0.0, 0.0)
        self._root = server.scene.add_frame(_ROOT, show_axes=False)
        self._grid = server.scene.add_grid(
            f"{_ROOT}/grid", infinite_grid=True, cell_size=0.25, section_size=1.0, fade_distance=15
        )
        # These would take a browser without a graphics processor most of its time; it steers, too.
        server.scene.configure_environment_map(None)
        server.scene.configure_default_lights(cast_shadow=False)
        server.scene.add_light_hemisphere(f"{_ROOT}/sky", intensity=_AMBIENT)
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = (0.9, -1.1, 0.45), (0.0, 0.0, -0.1), 0.8
        camera.near, camera.far = _NEAR, _FAR
        gui = server.gui
        self._origin: Any = gui.add_dropdown(
            "fixed frame", _ORIGINS[:1], hint="stands still in the picture"
        )
        self._offered = self._fixed = _ORIGINS[0]
        self._follow = gui.add_checkbox("follow the robot", True)
        self._axes = gui.add_checkbox("axes of frames", False)
        self._layer_folder = gui.add_folder("drawings", visible=False)

    # What the robot tells ---------------------------------------------------------------------
    def take_looks(self, looks: Mapping[str, trimesh.Trimesh]) -> None:
        """Take the robot's links, by their frames."""
        self._meshes = looks
        for look in self._looks.values():
            look.remove()
        self._looks.clear()

    def take_transforms(self, message: TFMessage) -> None:
        """Take transforms of `/tf` or `/tf_static`."""
        for each in message.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            pose = (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)
            self._tree.tell(each.header.frame_id, each.child_frame_id, pose)

    def take_markers(self, message: MarkerArray) -> None:
        """Take markers."""
        self._drawings.take(message)

    def take_route(self, message: MarkerArray) -> None:
        """Take the navigator's route."""
        self._route.take(message)

    def take_ground(self, message: MarkerArray) -> None:
        """Take the ground, which is drawn in the place of the grid."""
        self._ground.clear()
        self._ground.take(message)
        self._grid.visible = not message.markers

    def take_map(self, message: GridMap) -> None:
        """Take the map that the robot has made; raises ValueError for a malformed one."""
        self._map.take(message)

    def restart(self) -> None:
        """The robot's time has started again: what was drawn is of another run."""
        self._drawings.clear()
        self._route.clear()
        self._map.clear()

    def forget(self) -> None:
        """Forget all but the robot's looks and the ground."""
        self._tree.clear()
        self.restart()

    @property
    def skipped(self) -> list[str]:
        """What is not drawn of the markers."""
        return sorted(set[str]().union(*(each.skipped for each in self._marked)))

    @property
    def _marked(self) -> tuple[Drawings, ...]:
        return self._ground, self._drawings, self._route

    # Goals --------------------------------------------------------------------------------------
    def pick(self, origin: Array, direction: Array) -> Pose:
        """Return the pose in `map` on the ground that a ray hits, facing away from the robot.

        The ground is what is drawn of it, simulated or mapped; elsewhere a level plane through the
        robot's feet.

        Args:
            origin: of the ray, as viser has it [m] (3,).
            direction: likewise, of any length (3,).

        Raises:
            ValueError: there is no ground, it is too far away, or it is not known where in `map`.
        """
        poses = self._tree.poses(graph.FRAME_MAP)
        for name in (self._fixed, graph.FRAME_BASE):
            if name not in poses:
                raise ValueError(f"there is no transform from {name} to {graph.FRAME_MAP}")
        in_fixed = np.array((origin + self._centre, direction / np.linalg.norm(direction)))
        ray = moved_ray(in_fixed, poses[self._fixed])
        surfaces = [*self._ground.solids(), *self._map.surfaces()]
        hits = [first_hit(ray, each, poses[name]) for name, each in surfaces if name in poses]
        way = min(hits, default=math.inf)
        if way == math.inf and ray[1, 2] != 0.0:
            way = (poses.get(graph.FRAME_FOOTPRINT, IDENTITY)[2] - ray[0, 2]) / ray[1, 2]
        if not 0.0 < way < math.inf:
            raise ValueError("there is no ground")
        x, y, z = (ray[0] + way * ray[1]).tolist()
        if max(abs(x), abs(y)) > _FARTHEST:
            raise ValueError(f"that is more than {_FARTHEST:.0f} m from the origin of map")
        base = poses[graph.FRAME_BASE]
        return (x, y, z, *about_z(math.atan2(y - base[1], x - base[0])))

    # Drawing ----------------------------------------------------------------------------------
    def draw(self, now: float) -> None:
        """Bring the picture up to a time of the robot [s]."""
        frames = self._tree.frames()
        known = [name for name in _ORIGINS if name in frames]
        options = tuple(known + [name for name in frames if name not in known]) or _ORIGINS[:1]
        if options != tuple(self._origin.options):
            was_chosen = self._origin.value != self._offered
            self._origin.options = options  # keeps its choice while that is one
            self._offered = options[0]
            if not was_chosen:
                self._origin.value = options[0]
        with self._server.atomic():
            chosen = self._origin.value  # whatever a client has sent
            self._fixed = chosen if chosen in options else options[0]
            poses = self._tree.poses(self._fixed)
            self._centre_on(poses.get(graph.FRAME_BASE, IDENTITY))
            # One that nothing hangs on costs as much as another, and is not seen.
            used = {*self._meshes, self._map.frame}.union(*(d.frames() for d in self._marked))
            placed = {n: p for n, p in poses.items() if n in used or self._axes.value}
            for name, pose in placed.items():
                self._place(name, pose)
            for name, handle in self._frames.items():
                if handle.visible != (name in placed):
                    handle.visible = not handle.visible
            for drawings in self._marked:
                drawings.draw(now)
            self._map.draw()
        self._offer_layers()

    def _centre_on(self, base: Pose) -> None:
        """Move everything so that the robot stays in the middle of the picture."""
        if self._follow.value:
            share = _FOLLOWING if math.dist(base[:3], self._centre) < _JUMP else 1.0
            x, y, z = (c + share * (b - c) for b, c in zip(base, self._centre, strict=False))
            self._centre = x, y, z
            move(self._root, (-x, -y, -z))

    def _place(self, name: str, pose: Pose) -> None:
        frame = self._frames.get(name)
        if frame is None:
            frame = self._frames[name] = self._server.scene.add_frame(
                _path(name), axes_length=_AXES, axes_radius=0.03 * _AXES
            )
        if pose != self._poses.get(name):
            self._poses[name] = pose
            x, y, z, qx, qy, qz, qw = pose
            move(frame, (x, y, z), (qw, qx, qy, qz))
        if frame.show_axes != bool(self._axes.value):
            frame.show_axes = not frame.show_axes
        if name in self._meshes and name not in self._looks:
            self._looks[name] = self._server.scene.add_mesh_trimesh(
                f"{_path(name)}/look", self._meshes[name]
            )

    def _offer_layers(self) -> None:
        """Have a switch for each namespace of markers and for the map, and do as it says."""
        for drawings in self._marked:
            for namespace in drawings.namespaces():
                drawings.show(namespace, self._is_on(namespace))
        if self._map.frame:
            self._map.show(self._is_on(graph.ELEVATION_MAP))

    def _is_on(self, layer: str) -> bool:
        """Return whether a layer is switched on; one that has no switch gets it."""
        if layer not in self._layers:
            self._layer_folder.visible = True
            with self._layer_folder:
                switch = self._server.gui.add_checkbox(layer.replace("_", " "), True)
            self._layers[layer] = switch
        return bool(self._layers[layer].value)


def _path(frame: str) -> str:
    """Return the name of a frame in the scene; a slash in it would be a step of a path."""
    return f"{_ROOT}/{quote(frame, safe='')}"
