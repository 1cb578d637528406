"""A D435 above a ground in closed form: depth images with the errors of the real camera."""

from dataclasses import dataclass

import numpy as np
from terrain_scenes import Scene, Values

from husky_description.arrays import Array

WIDTH, HEIGHT = 160, 120
FX, FY, CX, CY = 84.3, 108.2, 79.5, 59.5
REACH = 10.0
"""Of the camera [m]."""


@dataclass(frozen=True)
class Errors:
    """Errors of the camera; 0 for none.

    Attributes:
        noise: scale of axial and lateral noise.
        drop_out: share of pixels without depth.
        flying: share of the pixels at edges that see a mean of both sides.
        baseline: of the stereo pair [m], whose second eye is hidden behind edges.
    """

    noise: float = 1.0
    drop_out: float = 0.02
    flying: float = 0.5
    baseline: float = 0.05


NONE = Errors(0.0, 0.0, 0.0, 0.0)

U, V = np.meshgrid(
    np.float32((np.arange(WIDTH) - CX) / FX), np.float32((np.arange(HEIGHT) - CY) / FY)
)
"""Directions of the pixels, over the focal length."""


def true_depth(scene: Scene, rotation: Array, position: Array, u=U, v=V) -> Values:
    """Return depth [m] along the optical axis, in the shape of u, inf where nothing is met."""
    rays = np.float32(rotation) @ np.stack([u.ravel(), v.ravel(), np.ones(u.size, np.float32)])
    return scene.meet(position, rays).reshape(u.shape)


def take_image(
    scene: Scene, rotation: Array, position: Array, errors: Errors, random: np.random.Generator
) -> np.ndarray:
    """Return a depth image [mm] of a camera, optical axes to world, at a position in world."""
    shape = U.shape
    lateral = np.float32(0.01576 * errors.noise)
    u = U + lateral * random.standard_normal(shape, np.float32)
    v = V + lateral * random.standard_normal(shape, np.float32)
    depth = true_depth(scene, rotation, position, u, v)
    depth = np.where(depth < REACH, depth, np.inf)
    if errors.flying or errors.baseline:
        _disturb_edges(depth, errors, random)
    axial = errors.noise * (0.000611 + 0.003587 * (np.minimum(depth, REACH) - 0.3515) ** 2)
    depth = depth + axial * random.standard_normal(shape, np.float32)
    depth[random.random(shape, np.float32) < errors.drop_out] = 0.0
    return np.where(np.isfinite(depth), np.rint(1000.0 * depth), 0.0).astype(np.uint16)


def _disturb_edges(depth: Values, errors: Errors, random: np.random.Generator) -> None:
    finite = np.minimum(depth, REACH)
    # Stereo occlusion: the second eye, to the right, does not see what a nearer point hides.
    match = np.arange(WIDTH) - FX * errors.baseline / finite
    nearest = np.minimum.accumulate(match[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(depth.shape, dtype=bool)
    hidden[:, :-1] = nearest[:, 1:] < match[:, :-1] - 0.5
    # Flying pixels: between the depths on both sides of an edge.
    for axis in (0, 1):
        other = np.roll(finite, 1, axis=axis)
        # In inverse depth, in which planes are straight: noise and perspective are below 0.1.
        edge = np.abs(1.0 / finite - 1.0 / other) > 0.12
        edge &= random.random(depth.shape, np.float32) < errors.flying
        share = random.random(depth.shape, np.float32)
        mixed = share * finite + (1.0 - share) * other
        depth[edge] = mixed[edge]
    depth[hidden] = np.inf
