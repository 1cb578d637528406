"""One picture of a whole way: the robot at several moments, seen from its right side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_experiments.figures import video
from husky_experiments.figures.offscreen import Canvas, NoRenderingError
from husky_experiments.recordings.recording import Recording

_FIELD = 14.0
"""Angle of view upward, narrow so that all robots are seen alike [deg]."""
_MARGIN = 0.75
"""Seen on either side of the first and of the last robot [m]."""
_OVER, _UNDER = 0.55, 0.75
"""Seen over the highest and under the lowest robot [m]."""
_AWAY = -50.0
"""Height of a robot that is not seen [m]."""
_DIFFERENT = 4
"""Least difference of a colour from that of the empty course that is the robot or its shadow."""


class Moment(NamedTuple):
    """When, and in words what is seen.

    Attributes:
        time: [s].
        words: written over the robot, "" for none.
    """

    time: float
    words: str = ""


def stroboscope(
    recording: Recording,
    model: mujoco.MjModel,
    path: Path,
    moments: Sequence[Moment],
    *,
    width: int = 1800,
    elevation: float = -6.0,
) -> Path | None:
    """Write a PNG of a robot that goes along x of world, at several moments in one picture.

    Args:
        recording: with ground truth and joint states.
        model: the world that was simulated.
        path: of the file.
        moments: the times, and what is written over each robot.
        width: of the picture [pixels]; the height follows from what is seen.
        elevation: of the camera's look, negative from above [deg].

    Returns:
        The path, or None where nothing can be drawn; then `video.unavailable_reason` says why.
    """
    times = np.array([moment.time for moment in moments])
    positions = video.motion(recording, model, times)
    places = positions[:, :3]
    low, high = places.min(axis=0) - (_MARGIN, 0, _UNDER), places.max(axis=0) + (_MARGIN, 0, _OVER)
    middle, size = (low + high) / 2.0, high - low
    height = 2 * round(width * size[2] / size[0] / 2)
    model = video.studio(model, smooth=True)
    model.vis.global_.fovy = _FIELD
    distance = float(size[2]) / 2.0 / math.tan(math.radians(_FIELD / 2.0))
    view = _View(middle, distance, elevation, width, height)
    try:
        with Canvas(model, width, height) as canvas:
            view.aim(canvas.camera)
            scene = canvas.scene
            scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            pixels = canvas.draw(_posed(model, _gone(positions[0]), middle))
            scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = True
            for position in positions:
                lit = position[:3]  # which marks the ground a little, so each has its own course
                empty = canvas.draw(_posed(model, _gone(position), lit)).astype(int)
                seen = canvas.draw(_posed(model, position, lit))
                robot = np.abs(seen - empty).max(axis=2) > _DIFFERENT
                pixels[robot] = seen[robot]
    except NoRenderingError as error:
        video.set_reason(error)
        return None
    picture = PilImage.fromarray(pixels)
    _write(picture, view, places, moments)
    picture.save(path)
    return path


def _posed(model: mujoco.MjModel, position: Array, lit: Array) -> mujoco.MjData:
    """Return a state of a model in positions (nq,), lit around a place (3,) [m]."""
    data = mujoco.MjData(model)
    data.qpos[:] = position
    video.pose(model, data, lit)
    return data


def _gone(position: Array) -> Array:
    """Return positions (nq,) with a robot that is not seen."""
    gone = position.copy()
    gone[2] = _AWAY
    return gone


class _View:
    """A camera that looks along y of world, and where it sees things."""

    def __init__(
        self, middle: Array, distance: float, elevation: float, width: int, height: int
    ) -> None:
        """Look at a place [m] (3,) from a distance [m], with an elevation [deg]."""
        self._middle, self._distance, self._elevation = middle, distance, elevation
        self._width, self._height = width, height

    def aim(self, camera: mujoco.MjvCamera) -> None:
        """Set up MuJoCo's camera."""
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = self._middle
        camera.distance, camera.azimuth, camera.elevation = self._distance, 90.0, self._elevation

    def pixel(self, place: Array) -> tuple[float, float]:
        """Return the pixel, right and down from the corner, at which a place (3,) [m] is seen."""
        look = math.radians(self._elevation)
        ahead = np.array((0.0, math.cos(look), math.sin(look)))
        up = np.array((0.0, -math.sin(look), math.cos(look)))
        away = place - self._middle
        scale = self._height / 2.0 / math.tan(math.radians(_FIELD / 2.0))
        scale /= self._distance + float(ahead @ away)
        return self._width / 2.0 + scale * away[0], self._height / 2.0 - scale * float(up @ away)


def _write(picture: PilImage.Image, view: _View, places: Array, moments: Sequence[Moment]) -> None:
    """Write over each robot what it does."""
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(max(11, picture.width // 90))
    for place, moment in zip(places, moments, strict=True):
        right, down = view.pixel(place + (0.0, 0.0, 0.6 * _OVER))
        pen.text((right, down), moment.words, (35, 35, 35), font, anchor="mm")
