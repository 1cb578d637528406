"""The errors of a stereo camera like the D435: from true depth to what it reports."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.sections import D435Section
from husky_drivers.d435.frames import DepthImage, Intrinsics

_WINDOW = 2.0
"""Standard deviation of the window in which a pixel is matched [pixels]; assumed."""
_EDGE = 0.5
"""Jump of the disparity that makes an edge [pixels]: half a pixel, because a surface reaches so far
beyond the centre of its last pixel."""
_HOLE = 8
"""Side of a hole [pixels]."""
_DEEPEST = 65.535
"""Greatest depth in 16 bits of millimetres [m]."""
_NOTHING = 1e-9
"""Inverse depth of where nothing is, so that its depth is a number [1/m]."""

Mask = NDArray[np.bool_]
Pixels = NDArray[np.intp]


class SmoothNoise:
    """Standard normal noise that is correlated over neighbouring pixels.

    White noise on a grid of a spacing of `scale`, seen through a Gaussian window.
    """

    def __init__(self, height: int, width: int, scale: float):
        """Prepare images; `scale` is the standard deviation of the window [pixels]."""
        self._rows = _window_weights(height, scale)
        self._columns = _window_weights(width, scale)

    def draw(self, generator: np.random.Generator) -> Array:
        """Return an image (height, width), each pixel of variance 1."""
        grid = generator.standard_normal((self._rows.shape[1], self._columns.shape[1]))
        image: Array = self._rows @ grid @ self._columns.T
        return image


def _window_weights(count: int, scale: float) -> Array:
    """Return the weight of each grid point at each pixel, (count, points), of unit rows."""
    points = np.arange(-3.0 * scale, count + 3.0 * scale, scale)
    weights = np.exp(-0.5 * ((np.arange(count)[:, None] - points) / scale) ** 2)
    unit: Array = weights / np.linalg.norm(weights, axis=1, keepdims=True)
    return unit


class StereoErrors:
    """Turns true depth into a D435's images.

    The camera looks for the surroundings of each pixel of its left image in the right image, where
    they are shifted to the left by the disparity fx b / d. From there the steps are:

    - a pixel at an edge may lie between both sides (flying pixels);
    - a pixel takes the surface of a pixel nearby for its own (lateral noise), so edges meander;
    - a pixel has no depth if a nearer surface covers it in the right image, if it is outside of
      that, or by chance;
    - the depth has noise along the optical axis, a range, and a unit of 1 mm.

    Inverse depth is an affine function of the pixel on a plane. Each step carries surfaces on from
    pixel to pixel by their slopes in inverse depth, so that edges alone show the lateral noise, and
    a plane of any slope shows only the noise along the axis. The figures were measured in this way:
    the one at edges, the other on turned planes (Nguyen, Izadi, Lovell: Modeling Kinect Sensor
    Noise for Improved 3D Reconstruction and Tracking, 2012; elevation_mapping has their model).

    Attributes:
        seed: of all images.
    """

    def __init__(self, figures: D435Section, intrinsics: Intrinsics, seed: int = 0):
        """Prepare images of these intrinsics."""
        self.seed = seed
        self._figures = figures
        height, width = intrinsics.height, intrinsics.width
        self._shape = height, width
        self._rows, self._columns = np.arange(height)[:, None], np.arange(width)
        self._wander = SmoothNoise(height, width, _WINDOW)
        lateral = figures.lateral_noise
        self._wander_size = lateral * intrinsics.fy, lateral * intrinsics.fx  # [pixels]
        self._disparity = intrinsics.fx * figures.baseline  # of inverse depth [pixels m]

    def apply(self, depth: Array, number: int) -> DepthImage:
        """Return image `number` [mm] of a true depth along the optical axis [m], inf for none.

        Equal seed, number and depth give an equal image.
        """
        generator = np.random.default_rng([self.seed, 435, number])
        inverse = 1.0 / depth
        uncovered = self._uncovered(inverse)
        down, across = _slope(inverse, 0), _slope(inverse, 1)
        inverse = self._fly(inverse, down, across, generator)
        rows, columns = self._matched(generator)
        there = rows * self._shape[1] + columns
        # The surface of the pixel that was taken for this one, carried on to this one.
        inverse = (
            inverse.take(there)
            + down.take(there) * (self._rows - rows)
            + across.take(there) * (self._columns - columns)
        )
        seen = uncovered.take(there) & self._not_dropped(generator)
        seen &= self._in_right_image(inverse) >= -_EDGE
        return self._measure(inverse, seen, generator)

    def _in_right_image(self, inverse: Array) -> Array:
        """Return the column of the right image in which each pixel's surface lies."""
        column: Array = self._columns - self._disparity * inverse
        return column

    def _uncovered(self, inverse: Array) -> Mask:
        """Return which pixels no other surface covers in the right image.

        A nearer surface further right has moved further to the left there, and covers what it has
        moved across.
        """
        column = self._in_right_image(inverse)
        leftmost = np.minimum.accumulate(column[:, :0:-1], axis=1)[:, ::-1]
        uncovered = np.ones(self._shape, bool)
        uncovered[:, :-1] = column[:, :-1] < leftmost - _EDGE
        return uncovered

    def _fly(
        self, inverse: Array, down: Array, across: Array, generator: np.random.Generator
    ) -> Array:
        """Return inverse depth in which a share of the pixels at edges lie between both sides."""
        # The difference to the surface at one of the four sides that differs most.
        beyond = np.zeros(self._shape)
        for here, there, surface in (
            (np.s_[:, :-1], np.s_[:, 1:], inverse - across),
            (np.s_[:, 1:], np.s_[:, :-1], inverse + across),
            (np.s_[:-1], np.s_[1:], inverse - down),
            (np.s_[1:], np.s_[:-1], inverse + down),
        ):
            side = surface[there] - inverse[here]
            np.copyto(beyond[here], side, where=np.abs(side) > np.abs(beyond[here]))
        chance, part = generator.random((2, *self._shape))
        flying = np.abs(beyond) > _EDGE / self._disparity
        flying &= chance < self._figures.flying_pixels
        furthest = 1.0 / self._figures.range[1]
        one = 1.0 / np.maximum(inverse[flying], furthest)
        other = 1.0 / np.maximum(inverse[flying] + beyond[flying], furthest)
        flown = inverse.copy()
        flown[flying] = 1.0 / (one + part[flying] * (other - one))
        return flown

    def _matched(self, generator: np.random.Generator) -> tuple[Pixels, Pixels]:
        """Return row and column of the pixel that each pixel is taken for: the lateral noise."""
        height, width = self._shape
        up_down, to_and_fro = (
            np.rint(size * self._wander.draw(generator)).astype(np.intp)
            for size in self._wander_size
        )
        rows = np.clip(self._rows + up_down, 0, height - 1)
        return rows, np.clip(self._columns + to_and_fro, 0, width - 1)

    def _not_dropped(self, generator: np.random.Generator) -> Mask:
        """Return which pixels are neither missing singly nor in a hole; holes lie anywhere."""
        kept: Mask = generator.random(self._shape) >= self._figures.dropout
        below, beside = generator.integers(_HOLE, size=2)
        height, width = self._shape
        blocks = generator.random((height // _HOLE + 2, width // _HOLE + 2)) >= self._figures.hole
        whole = blocks.repeat(_HOLE, axis=0).repeat(_HOLE, axis=1)
        kept &= whole[below : below + height, beside : beside + width]
        return kept

    def _measure(self, inverse: Array, seen: Mask, generator: np.random.Generator) -> DepthImage:
        """Return an image in millimetres, with noise along the optical axis."""
        figures = self._figures
        depth = 1.0 / np.maximum(inverse, _NOTHING)
        sigma = figures.noise_floor + figures.noise_gain * (depth - figures.noise_range) ** 2
        depth += sigma * generator.standard_normal(self._shape)
        near, far = figures.range.tolist()
        valid = seen & (depth >= near) & (depth <= min(far, _DEEPEST))
        return np.rint(1e3 * np.where(valid, depth, 0.0)).astype(np.uint16)


def _slope(inverse: Array, axis: int) -> Array:
    """Return the slope of a surface along an axis, [1/m] per pixel.

    Of the differences to both neighbours the smaller one, none where their signs differ: at the
    edge of a surface it is still the surface's. At the border of the image the next difference
    further in stands for the missing one.
    """
    step = np.diff(inverse, axis=axis)
    ahead = np.concatenate((step, step.take([-2], axis)), axis)
    behind = np.concatenate((step.take([1], axis), step), axis)
    rising, falling = np.minimum(ahead, behind), np.maximum(ahead, behind)
    slope: Array = np.maximum(rising, 0.0) + np.minimum(falling, 0.0)
    return slope
