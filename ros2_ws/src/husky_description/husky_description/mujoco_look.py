"""What is seen of the robot in MuJoCo: geoms and skins without mass or contact.

The shapes of torso and hips are joined to one mesh per link and material, because every geom
costs time at each step. The links below are skins, which exist at rendering only: a skin's vertex
is a weighted sum of where its bones carry it. A link of the parallelogram that turns with one
serial link and moves with the other has weights +1 on the one, +1 and -1 on the other, whose
rotations cancel and leave a displacement, so that the sum is exact and not an interpolation.
"""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from husky_description import look
from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_description.shapes import Shape
from husky_description.triangles import Patch, join, triangulate

VISUAL_GROUP = 2


def add_materials(spec: mujoco.MjSpec) -> None:
    """Add the materials of the look."""
    for name, rgba in look.MATERIALS.items():
        glossy = name in ("carbon", "aluminium", "red", "gold")
        spec.add_material(
            name=name,
            rgba=rgba,
            specular=0.6 if glossy else 0.2,
            shininess=0.5 if glossy else 0.2,
            reflectance=0.0,
        )


def add_look(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, shapes: Iterable[Shape]) -> None:
    """Add shapes in the body's frame; bodies that look the same share the `name` of a mesh."""
    for material, patch in _by_material(shapes).items():
        mesh_name = f"{name}_{material}"
        if spec.mesh(mesh_name) is None:
            vertices, faces = patch
            spec.add_mesh(
                name=mesh_name,
                uservert=vertices.ravel(),
                userface=faces.ravel(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            )
        body.add_geom(
            spec.find_default("visual"),
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh_name,
            material=material,
        )


def add_parallelograms(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add thigh, calf, rod and ankle of all legs, one skin per material."""
    shapes = {
        "thigh": look.thigh_look(robot),
        "calf": look.calf_look(robot),
        "rod": look.rod_look(robot),
        "ankle": look.ankle_look(robot),
    }
    parts: dict[str, list[tuple[Patch, _Bones]]] = defaultdict(list)
    for leg in robot.legs:
        for frame in look.parallelogram(robot):
            bones = _bones(robot, leg, frame)
            for material, patch in _by_material(shapes[frame.name]).items():
                parts[material].append((patch, bones))
    for material, material_parts in parts.items():
        _add_skin(spec, f"legs_{material}", material, material_parts)


_Bones = list[tuple[str, Array, float]]
"""Body, origin of the part in the body's frame [m] (3,), weight."""


def _bones(robot: Robot, leg: str, frame: look.LegFrame) -> _Bones:
    """Bones that carry a frame of the parallelogram.

    A bone of weight w bound at b carries the point p to w (R (p - b) + o). The link that turns
    the frame is bound so that p has the right place on it; the pair on the other link adds
    R (displacement).
    """
    down = np.array([0.0, 0.0, -1.0])
    if frame.turns_with == "shin":
        turning, moving = f"{leg}_shin", f"{leg}_thigh"
        origin = down * frame.shin
        displacement = down * (frame.thigh - robot.thigh_length)
    else:
        turning, moving = f"{leg}_thigh", f"{leg}_shin"
        origin = down * frame.thigh
        displacement = down * frame.shin
    bones = [(turning, -origin, 1.0)]
    if np.any(displacement):
        bones += [(moving, np.zeros(3), 1.0), (moving, displacement, -1.0)]
    return bones


def _add_skin(
    spec: mujoco.MjSpec, name: str, material: str, parts: list[tuple[Patch, _Bones]]
) -> None:
    vertices, faces = join(patch for patch, _ in parts)
    bodies: list[str] = []
    bound: list[Array] = []
    indices: list[list[int]] = []
    weights: list[list[float]] = []
    first = 0
    for (patch_vertices, _), bones in parts:
        count = len(patch_vertices)
        for body, origin, weight in bones:
            bodies.append(body)
            bound.append(origin)
            indices.append(list(range(first, first + count)))
            weights.append([weight] * count)
        first += count
    spec.add_skin(
        name=name,
        material=material,
        group=VISUAL_GROUP,
        vert=vertices.ravel(),
        face=faces.ravel(),
        bodyname=bodies,
        bindpos=np.concatenate(bound),
        bindquat=np.tile([1.0, 0.0, 0.0, 0.0], len(bodies)),
        vertid=indices,
        vertweight=weights,
    )


def _by_material(shapes: Iterable[Shape]) -> dict[str, Patch]:
    groups: dict[str, list[Shape]] = defaultdict(list)
    for shape in shapes:
        groups[shape.material].append(shape)
    return {material: triangulate(group) for material, group in groups.items()}
