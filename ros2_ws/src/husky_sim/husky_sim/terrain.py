"""Grounds that the robot can be put on: flat ground, slopes, obstacles, scenes to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from husky_description.plain_mujoco import mujoco
from husky_sim.gap import DEPTH, Gap
from husky_sim.lab_world import lab_world
from husky_sim.obstacle_site import fence
from husky_sim.obstacle_solids import ground_boxes, obstacle_boxes
from husky_sim.obstacle_world import DITCH_DEPTH, ObstacleWorld, Rectangle, Ridge
from husky_sim.ramp import Ramp, SurfacePoint
from husky_sim.random_world import random_world
from husky_sim.scene_grounds import (
    MIXED_ROUGHNESS,
    START,
    STEEPEST_BANK,
    WIDEST_LANE,
    SceneArea,
    SolidBox,
    check_facets,
    mixed_scene,
    rising_banks,
    rising_tiers,
    rough_facets,
    scattered_boxes,
)

FLOOR = "floor"
"""Name of the ground plane's geom; other terrain geoms are named floor_0, floor_1, ..."""

_THICKNESS = 0.15
"""Half of a ramp's [m]."""
_WIDTH = 6.0
"""Of a ramp [m]."""
_BEHIND, _YARD_WIDTH = 1.5, 4.0
"""Level ground behind the start of a ridge's yard, and its width [m]."""
_STEEPEST_RIDGE = np.radians(60.0)
"""Greatest inclination of a ridge [rad]."""


@dataclass(frozen=True)
class TerrainOptions:
    """What ground to build.

    Attributes:
        kind: one of `KINDS`.
        slope: inclination of the slope about the base's y axis, uphill along +x [rad]; those of
            a ramp, a ridge and of banks are not negative.
        height: greatest height of tiles and scenes, or height of one step, or of the step behind a
            gap [m].
        size: edge of a tile or a facet, or depth of one step, or width of a gap along +x [m].
        length: how far tiles, steps and scenes reach along +x, from 0.8 m before the robot's start
            [m]; of the straight slopes of a ramp or a ridge.
        approach: flat ground before a ramp, a ridge or a gap, or where the lane ends [m].
        blend: radius of the arcs at its foot and its crest [m].
        top: flat ground at its top, or behind a gap [m].
        lane: width of the flat ground along +x that rough ground, boxes, mixed scenes, banks and
            steps leave free, 0 for none [m].
    """

    kind: str = "flat"
    slope: float = 0.0
    height: float = 0.03
    size: float = 0.2
    length: float = 8.0
    approach: float = 1.5
    blend: float = 1.0
    top: float = 4.0
    lane: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError for what cannot be built: its name, value, what is allowed."""
        if self.kind not in KINDS:
            raise ValueError(f"terrain is {self.kind!r}, it must be one of {', '.join(KINDS)}")
        for name, lower, upper in (
            ("slope", -np.pi / 2, np.pi / 2),
            ("height", 0.0, 1.0),
            ("size", 0.02, 10.0),
            ("length", 0.1, 100.0),
            ("approach", 0.0, 100.0),
            ("blend", 0.0, 100.0),
            ("top", 0.0, 100.0),
            ("lane", 0.0, WIDEST_LANE),
        ):
            value = getattr(self, name)
            if not lower <= value <= upper:
                raise ValueError(
                    f"terrain {name} is {value}, it must be {lower:.3g} to {upper:.3g}"
                )
        if self.kind in ("ramp", "ridge"):
            self.ramp  # noqa: B018 - refuses what is no ramp
        if self.kind == "ridge" and not 0.0 < self.slope <= _STEEPEST_RIDGE:
            allowed = f"more than 0 and at most {np.degrees(_STEEPEST_RIDGE):.3g} deg"
            told = f"terrain slope is {np.degrees(self.slope):.3g} deg"
            raise ValueError(f"{told}, of a ridge it must be {allowed}")
        if self.kind in ("steps", "rough", "boxes", "mixed", "banks"):
            self.area  # noqa: B018 - refuses a lane without a scene ahead
        if self.kind == "rough":
            check_facets(self.height, self.size)
        if self.kind == "banks" and not 0.0 <= self.slope <= STEEPEST_BANK:
            allowed = f"0 to {np.degrees(STEEPEST_BANK):.3g} deg"
            raise ValueError(
                f"terrain slope is {np.degrees(self.slope):.3g} deg, of banks it must be {allowed}"
            )
        if self.kind == "mixed":
            check_facets(self.height, self.size, MIXED_ROUGHNESS)

    @property
    def ramp(self) -> Ramp:
        """The surface of a ramp of these measures; raises ValueError for a negative slope."""
        return Ramp(self.slope, self.approach, self.blend, self.length, self.top)

    @property
    def ridge(self) -> Ridge:
        """The ridge of these measures, its foot at `approach`."""
        flank = Ramp(self.slope, 0.0, self.blend, self.length, 0.0)
        length = 2.0 * flank.at(flank.slope_end + flank.arc).x + self.top
        return Ridge(Rectangle(self.approach + length / 2, 0.0, 0.0, length, _YARD_WIDTH), flank)

    @property
    def yard(self) -> Rectangle:
        """The ground around that ridge, with as much behind it as before it."""
        last = 2.0 * self.ridge.ground.x + _BEHIND
        return Rectangle((last - _BEHIND) / 2, 0.0, 0.0, last + _BEHIND, _YARD_WIDTH)

    @property
    def gap(self) -> Gap:
        """The surface of a gap of these measures."""
        return Gap(self.approach, self.size, self.height, self.top)

    @property
    def area(self) -> SceneArea:
        """The ground that a scene takes; raises ValueError for a lane without a scene ahead."""
        return SceneArea(self.lane, self.approach, self.length)

    def at(self, distance: float) -> SurfacePoint:
        """Return the point of the surface at a length along it from x = 0 [m].

        On tiles, steps and scenes it is the ground on which they stand.
        """
        if self.kind in ("ramp", "ridge"):
            return self.ramp.at(distance)
        if self.kind == "gap":
            return SurfacePoint(distance, self.gap.height(distance), 0.0)
        angle = self.slope if self.kind == "slope" else 0.0
        return SurfacePoint(distance * np.cos(angle), distance * np.sin(angle), angle)


def build(spec: mujoco.MjSpec, options: TerrainOptions, seed: int) -> None:
    """Add the ground to a scene.

    Args:
        spec: the scene; its world body gets the geoms, of the default class "terrain".
        options: which ground.
        seed: of everything about it that is random.
    """
    KINDS_TABLE[options.kind](spec, options, np.random.default_rng(seed))


def _plane(spec: mujoco.MjSpec, quat: list[float], height: float = 0.0) -> None:
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        pos=[0.0, 0.0, height],
        quat=quat,
        material="ground",
    )


def _flat(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    _plane(spec, [1.0, 0.0, 0.0, 0.0])


def _slope(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """A plane through the origin, uphill along +x."""
    _plane(spec, [np.cos(options.slope / 2), 0.0, -np.sin(options.slope / 2), 0.0])


def _ramp(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Flat ground, an arc, a slope, an arc, flat ground, 6 m wide; uphill along +x."""
    _flat(spec, options, rng)
    for index, (start, end) in enumerate(options.ramp.facets()):
        (x, z), (dx, dz) = start, np.subtract(end, start)
        length, angle = np.hypot(dx, dz), np.arctan2(dz, dx)
        # The box hangs under its upper face.
        middle = np.array((x + dx / 2, z + dz / 2)) - _THICKNESS * np.array(
            (-np.sin(angle), np.cos(angle))
        )
        spec.worldbody.add_geom(
            name=f"{FLOOR}_{index}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[middle[0], 0.0, middle[1]],
            size=[length / 2, _WIDTH / 2, _THICKNESS],
            quat=[np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0],
            material="tile",
        )


def _ridge(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """A solid hill across a yard 4 m wide: a slope up along +x, a level top, a slope down."""
    _flat(spec, options, rng)
    _add_boxes(spec, obstacle_boxes(fence(options.yard), [options.ridge]))


def _box(
    spec: mujoco.MjSpec,
    index: int,
    centre: tuple[float, float],
    size: tuple[float, float],
    top: float,
) -> None:
    """A box from 0.1 m under the ground up to `top`, all in metres."""
    half_height = (top + 0.1) / 2
    spec.worldbody.add_geom(
        name=f"{FLOOR}_{index}",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[*centre, top - half_height],
        size=[size[0] / 2, size[1] / 2, half_height],
        material="tile",
    )


def _tiles(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Tiles of random height on a plane, 2 m wide, with flat ground before and behind."""
    _flat(spec, options, rng)
    columns = int(2.0 / options.size)
    index = 0
    for row in range(int(options.length / options.size)):
        for column in range(columns):
            centre = (
                START + (row + 0.5) * options.size,
                (column + 0.5 - columns / 2) * options.size,
            )
            top = float(rng.uniform(0.0, options.height))
            if top > 1e-4:
                _box(spec, index, centre, (options.size, options.size), top)
                index += 1


def _steps(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Stairs up along +x, each step of the same height and depth, with a landing at the top.

    With a lane, at most five tiers that rise away from it, to both sides and ahead.
    """
    _flat(spec, options, rng)
    if options.lane:
        _add_boxes(spec, rising_tiers(options.area, options.height, options.size))
        return
    count = int(options.length / options.size)
    for step in range(count):
        start = START + step * options.size
        depth = options.size if step < count - 1 else 4.0
        _box(spec, step, (start + depth / 2, 0.0), (depth, 4.0), (step + 1) * options.height)


def _gap(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Ground on both sides of a pit, 4 m wide, the far side higher."""
    _plane(spec, [1.0, 0.0, 0.0, 0.0], -DEPTH)
    for index, (start, end, top) in enumerate(options.gap.blocks):
        half = (end - start) / 2, 2.0, (top + DEPTH) / 2
        spec.worldbody.add_geom(
            name=f"{FLOOR}_{index}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[start + half[0], 0.0, top - half[2]],
            size=list(half),
            material="tile",
        )


def _rough(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Tilted facets beside the lane and ahead."""
    _flat(spec, options, rng)
    _add_boxes(spec, rough_facets(options.area, options.height, options.size, rng))


def _boxes(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Boxes on flat ground beside the lane and ahead."""
    _flat(spec, options, rng)
    _add_boxes(spec, scattered_boxes(options.area, options.height, rng))


def _mixed(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Boxes and flights of steps on rough ground beside the lane and ahead."""
    _flat(spec, options, rng)
    _add_boxes(spec, mixed_scene(options.area, options.height, options.size, rng))


def _banks(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Planes that rise away from the lane, to both sides and ahead."""
    _flat(spec, options, rng)
    _add_boxes(spec, rising_banks(options.area, options.slope))


def _obstacles(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """A world of ridges, ditches, walls and crates in a fence; no measure of options changes it."""
    _add_world(spec, random_world(rng))


def _lab(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """A world of wide boxes in a fence; no measure of options changes it."""
    _add_world(spec, lab_world(rng))


def _add_world(spec: mujoco.MjSpec, world: ObstacleWorld) -> None:
    """Add the ground of a world, with its ditches, and all that stands on it."""
    _plane(spec, [1.0, 0.0, 0.0, 0.0], -DITCH_DEPTH)
    ground = ground_boxes(world)
    _add_boxes(spec, ground, material="ground")
    _add_boxes(spec, obstacle_boxes(world.boxes, world.ridges), first=len(ground))


def _add_boxes(
    spec: mujoco.MjSpec, boxes: list[SolidBox], first: int = 0, material: str = "tile"
) -> None:
    """Add boxes, numbered from `first` on."""
    for index, box in enumerate(boxes, first):
        spec.worldbody.add_geom(
            name=f"{FLOOR}_{index}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=box.centre,
            size=box.half_size,
            quat=box.quaternion,
            material=material,
        )


Builder = Callable[[mujoco.MjSpec, TerrainOptions, np.random.Generator], None]

KINDS_TABLE: dict[str, Builder] = {
    "flat": _flat,
    "slope": _slope,
    "ramp": _ramp,
    "ridge": _ridge,
    "tiles": _tiles,
    "steps": _steps,
    "gap": _gap,
    "rough": _rough,
    "boxes": _boxes,
    "mixed": _mixed,
    "banks": _banks,
    "obstacles": _obstacles,
    "lab": _lab,
}
"""Builder of each kind of ground: a new terrain is a function and a row here."""

KINDS = tuple(KINDS_TABLE)
