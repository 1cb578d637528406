"""Grounds that the robot can be put on: flat, slope, ramp, tiles, steps, gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from husky_description.plain_mujoco import mujoco
from husky_sim.gap import DEPTH, Gap
from husky_sim.ramp import Ramp, SurfacePoint

FLOOR = "floor"
"""Name of the ground plane's geom; other terrain geoms are named floor_0, floor_1, ..."""

_THICKNESS = 0.15
"""Half of a ramp's [m]."""


@dataclass(frozen=True)
class TerrainOptions:
    """What ground to build.

    Attributes:
        kind: one of `KINDS`.
        slope: inclination of the slope about the base's y axis, uphill along +x [rad]; a ramp's
            is not negative.
        height: greatest tile height, or height of one step, or of the step behind a gap [m].
        size: edge of a tile, or depth of one step, or width of a gap along +x [m].
        length: how far tiles and steps reach along +x, from 0.8 m before the robot's start [m]; of
            the straight slope of a ramp.
        approach: flat ground before a ramp or a gap [m].
        blend: radius of the arcs at its foot and its crest [m].
        top: flat ground at its top, or behind a gap [m].
    """

    kind: str = "flat"
    slope: float = 0.0
    height: float = 0.03
    size: float = 0.2
    length: float = 8.0
    approach: float = 1.5
    blend: float = 1.0
    top: float = 4.0

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
        ):
            value = getattr(self, name)
            if not lower <= value <= upper:
                raise ValueError(
                    f"terrain {name} is {value}, it must be {lower:.3g} to {upper:.3g}"
                )
        if self.kind == "ramp":
            self.ramp  # noqa: B018 - refuses what is no ramp

    @property
    def ramp(self) -> Ramp:
        """The surface of a ramp of these measures; raises ValueError for a negative slope."""
        return Ramp(self.slope, self.approach, self.blend, self.length, self.top)

    @property
    def gap(self) -> Gap:
        """The surface of a gap of these measures."""
        return Gap(self.approach, self.size, self.height, self.top)

    def at(self, distance: float) -> SurfacePoint:
        """Return the point of the surface at a length along it from x = 0 [m].

        On tiles and steps it is the ground on which they stand.
        """
        if self.kind == "ramp":
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
        seed: of the tile heights.
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
            size=[length / 2, 3.0, _THICKNESS],
            quat=[np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0],
            material="tile",
        )


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
                0.8 + (row + 0.5) * options.size,
                (column + 0.5 - columns / 2) * options.size,
            )
            top = float(rng.uniform(0.0, options.height))
            if top > 1e-4:
                _box(spec, index, centre, (options.size, options.size), top)
                index += 1


def _steps(spec: mujoco.MjSpec, options: TerrainOptions, rng: np.random.Generator) -> None:
    """Stairs up along +x, each step of the same height and depth, with a landing at the top."""
    _flat(spec, options, rng)
    count = int(options.length / options.size)
    for step in range(count):
        start = 0.8 + step * options.size
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


Builder = Callable[[mujoco.MjSpec, TerrainOptions, np.random.Generator], None]

KINDS_TABLE: dict[str, Builder] = {
    "flat": _flat,
    "slope": _slope,
    "ramp": _ramp,
    "tiles": _tiles,
    "steps": _steps,
    "gap": _gap,
}
"""Builder of each kind of ground: a new terrain is a function and a row here."""

KINDS = tuple(KINDS_TABLE)
