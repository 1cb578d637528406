"""The depth camera's errors: their sizes are the figures', on planes and at edges."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import binary_opening

from husky_description.parameters import frozen
from husky_description.robot import load_robot
from husky_sim.devices.d435.errors import StereoErrors
from husky_sim.devices.d435.optics import intrinsics_of

FIGURES = load_robot().d435
PINHOLE = intrinsics_of(FIGURES)
HEIGHT, WIDTH = SHAPE = FIGURES.height, FIGURES.width
EXACT = {
    "noise_floor": 0.0,
    "noise_gain": 0.0,
    "lateral_noise": 0.0,
    "dropout": 0.0,
    "hole": 0.0,
    "flying_pixels": 0.0,
}
NEAR, FAR = 0.8, 2.0


def errors(seed=0, **figures):
    """With no other errors than these."""
    return StereoErrors(dataclasses.replace(FIGURES, **{**EXACT, **figures}), PINHOLE, seed)


def wall(depth):
    return np.full(SHAPE, float(depth))


def plane(down=0.0, across=0.0, middle=0.5004):
    """Depth of a plane: inverse depth in the middle [1/m], and its slopes [1/m per pixel]."""
    rows, columns = np.arange(HEIGHT)[:, None], np.arange(WIDTH)
    inverse = middle + down * (rows - HEIGHT / 2) + across * (columns - WIDTH / 2)
    return 1.0 / np.maximum(inverse, 1e-9)


def block(start, end):
    """A near wall in these columns before a far one."""
    depth = wall(FAR)
    depth[:, start:end] = NEAR
    return depth


def disparity(depth):
    return PINHOLE.fx * FIGURES.baseline / depth


def in_both(depth):
    """Pixels that lie in the right image, half a pixel beyond its first centre included."""
    return np.arange(WIDTH) - disparity(depth) >= -0.5


# Planes -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("depth", [0.3, 1.0, 7.3456])
def test_without_errors_a_wall_is_reported_in_millimetres(depth):
    """But for the strip on the left that the right imager does not see."""
    image = errors().apply(wall(depth), 0)
    seen = in_both(wall(depth))
    assert np.array_equal(image, np.where(seen, round(1e3 * depth), 0))
    assert np.sum(~seen[0]) == pytest.approx(disparity(depth), abs=0.5)


@pytest.mark.parametrize(("down", "across"), [(0.012, 0.0), (0.0, 0.004), (-0.01, -0.003)])
def test_lateral_noise_and_flying_pixels_leave_slopes_alone(down, across):
    """Up to the range before the horizon; within the rounding to millimetres.

    The first is the ground as a standing carbon sees it.
    """
    depth = plane(down, across)
    image = errors(lateral_noise=FIGURES.lateral_noise, flying_pixels=1.0).apply(depth, 0)
    near, far = FIGURES.range
    inside = (depth >= near) & (depth <= far) & in_both(depth)
    assert np.array_equal(image > 0, inside)
    assert np.abs(1e-3 * image - depth)[inside].max() < 0.0005 + 1e-9
    assert inside.mean() > 0.3


@pytest.mark.parametrize("depth", [0.25, 1.0, 4.0])
def test_noise_along_the_axis_has_its_sigma(depth):
    figures = {name: getattr(FIGURES, name) for name in ("noise_floor", "noise_gain")}
    image = np.stack([errors(1, **figures).apply(wall(depth), k) for k in range(2)])
    error = 1e-3 * image[:, in_both(wall(depth))] - depth
    sigma = FIGURES.noise_floor + FIGURES.noise_gain * (depth - FIGURES.noise_range) ** 2
    sigma = np.hypot(sigma, 0.001 / np.sqrt(12.0))  # and the rounding's
    count = error.size
    assert error.std() == pytest.approx(sigma, rel=5.0 / np.sqrt(2.0 * count))
    assert error.mean() == pytest.approx(0.0, abs=5.0 * sigma / np.sqrt(count))
    correlation = np.corrcoef(error[0][:-1], error[0][1:])[0, 1]
    assert abs(correlation) < 5.0 / np.sqrt(count / 2), "neighbours do not know of each other"


def test_all_errors_together_leave_a_slope_its_noise():
    depth = plane(0.01, 0.001)
    image = StereoErrors(FIGURES, PINHOLE).apply(depth, 0)
    sigma = FIGURES.noise_floor + FIGURES.noise_gain * (depth - FIGURES.noise_range) ** 2
    seen = (image > 0) & (depth < 8.0)  # where the range does not cut the noise
    error = (1e-3 * image - depth)[seen] / np.hypot(sigma, 0.001 / np.sqrt(12.0))[seen]
    assert error.std() == pytest.approx(1.0, rel=5.0 / np.sqrt(2.0 * error.size))


# Edges ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("row", [0, 60])
def test_the_right_imager_does_not_see_behind_a_block(row):
    image = errors().apply(block(80, 120), 0)[row]
    hidden = disparity(NEAR) - disparity(FAR)
    assert np.all(image[80:120] == 1e3 * NEAR)
    assert np.all(image[120:] == 1e3 * FAR), "nothing is hidden on the right of it"
    band = np.flatnonzero(image[10:] == 0) + 10
    assert np.array_equal(band, np.arange(80 - band.size, 80)), "it ends at the block"
    assert band.size == pytest.approx(hidden, abs=1.0) and hidden > 3.0


def test_lateral_noise_moves_edges_but_not_the_width_of_what_is_hidden():
    seen = errors(2, lateral_noise=FIGURES.lateral_noise)
    rows = np.concatenate([seen.apply(block(80, 120), k) for k in range(20)])
    hidden = np.sum(rows[:, 10:] == 0, axis=1)
    assert hidden.mean() == pytest.approx(disparity(NEAR) - disparity(FAR), abs=1.0)
    assert set(np.unique(rows)) == {0, 1000 * NEAR, 1000 * FAR}, "and invents no depths"


@pytest.mark.parametrize("border", [np.s_[:1], np.s_[-1:], np.s_[:, -1:]])
def test_an_edge_at_the_border_of_the_image_invents_no_depths(border):
    """The line of pixels at the border is another surface than the next one."""
    depth = wall(NEAR)
    depth[border] = FAR
    seen = errors(2, lateral_noise=FIGURES.lateral_noise)
    images = np.concatenate([seen.apply(depth, k) for k in range(10)])
    assert set(np.unique(images)) == {0, 1000 * NEAR, 1000 * FAR}


def test_an_edge_meanders_by_the_lateral_noise():
    """About its place, by lateral_noise d across the ray, alike over some neighbouring rows."""
    seen = errors(3, lateral_noise=FIGURES.lateral_noise)
    images = np.stack([seen.apply(block(0, 80), k) for k in range(40)])
    edge = np.sum(images[:, :, 20:] == 1000 * NEAR, axis=2) + 20.0
    sigma = np.hypot(PINHOLE.fx * FIGURES.lateral_noise, np.sqrt(1.0 / 12.0))  # and of the grid
    # Rows know of each other over a length of about 7: 5 sigma of 700 numbers.
    assert edge.std() == pytest.approx(sigma, rel=0.13)
    assert edge.mean() == pytest.approx(80.0, abs=5.0 * sigma / np.sqrt(700.0))
    near, apart = (np.mean((edge - 80)[:, lag:] * (edge - 80)[:, :-lag]) for lag in (1, 20))
    assert near > 0.6 * edge.var() and abs(apart) < 0.2 * edge.var()


def test_pixels_fly_between_both_sides_of_an_edge():
    share = 0.3
    images = np.stack([errors(4, flying_pixels=share).apply(block(0, 80), k) for k in range(8)])
    assert set(np.unique(images[:, :, 10:79])) == {1000 * NEAR}
    assert set(np.unique(images[:, :, 81:])) == {1000 * FAR}
    at_edge = images[:, :, 79:81] * 1e-3
    flying = at_edge[(at_edge > NEAR + 0.001) & (at_edge < FAR - 0.001)]
    count = at_edge.size
    assert flying.size == pytest.approx(share * count, abs=5 * np.sqrt(share * (1 - share) * count))
    # A uniform distribution: mean and deviation.
    spread = (FAR - NEAR) / np.sqrt(12.0)
    assert flying.mean() == pytest.approx((NEAR + FAR) / 2, abs=5 * spread / np.sqrt(flying.size))
    assert flying.std() == pytest.approx(spread, rel=0.1)


def test_a_block_before_the_sky_flies_up_to_the_range():
    depth = np.where(block(0, 80) == NEAR, NEAR, np.inf)
    images = np.stack([errors(5, flying_pixels=1.0).apply(depth, k) for k in range(4)])
    assert not images[:, :, 81:].any(), "the sky has no depth"
    flying = 1e-3 * images[:, :, 79:81]
    assert flying.min() >= NEAR and 0.9 * FIGURES.range[1] < flying.max() <= FIGURES.range[1]


# Missing pixels ---------------------------------------------------------------------------------
def test_single_pixels_drop_out():
    image = np.stack([errors(6, dropout=0.02).apply(wall(5.0), k) for k in range(4)])
    missing = image[:, :, 2:] == 0
    bound = 5.0 * np.sqrt(0.02 / missing.size)
    assert missing.mean() == pytest.approx(0.02, abs=bound)
    beside = (missing[:, :, 1:] & missing[:, :, :-1]).mean()
    assert beside == pytest.approx(0.02**2, abs=5.0 * 0.02 / np.sqrt(missing.size))


def test_holes_are_squares_of_eight_anywhere():
    images = np.stack([errors(7, hole=0.05).apply(wall(5.0), k) for k in range(8)])
    missing = images[:, :, 2:] == 0
    assert missing.mean() == pytest.approx(0.05, abs=5.0 * np.sqrt(0.05 / (missing.size / 64)))
    squares = np.ones((8, 8), bool)
    corners = set()
    for image in missing:
        beyond = np.pad(image, 8, mode="edge")  # squares go on behind the image's edge
        assert np.array_equal(binary_opening(beyond, squares)[8:-8, 8:-8], image)
        first = np.argwhere(image[1:, 1:] & ~image[:-1, 1:] & ~image[1:, :-1])
        corners |= {tuple(corner) for corner in (first % 8).tolist()}
    assert len(corners) >= 4, "the squares' grid lies elsewhere in each image"


@pytest.mark.parametrize(
    ("depth", "reported"),
    [(0.1999, 0), (0.2001, 200), (9.9996, 10000), (10.001, 0), (np.inf, 0), (1.23449, 1234)],
)
def test_depth_out_of_range_is_none(depth, reported):
    image = errors().apply(wall(depth), 0)
    assert set(np.unique(image[:, 25:])) == {reported}


def test_depth_that_does_not_fit_is_none():
    far = errors(range=frozen([0.2, 100.0]))
    assert far.apply(wall(65.5351), 0).max() == 0
    assert far.apply(wall(65.5349), 0).max() == 65535


# Seeds ------------------------------------------------------------------------------------------
def test_image_k_is_the_seeds():
    first, depth = StereoErrors(FIGURES, PINHOLE, 8), block(80, 120)
    images = [first.apply(depth, k) for k in range(3)]
    again = StereoErrors(FIGURES, PINHOLE, 8)
    for k in (2, 0, 1):
        assert np.array_equal(again.apply(depth, k), images[k])
    again.seed = 9
    for k in range(3):
        assert not np.array_equal(again.apply(depth, k), images[k])
        assert not np.array_equal(images[k], images[k - 1])
