"""A film of a recording: the robot as it truly moved, in the world that it moved in."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_description.robot import JOINT_NAMES
from husky_experiments.figures.offscreen import Canvas, Image, NoRenderingError, add_arrow
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

_CAMERA = {"distance": 1.75, "azimuth": 120.0, "elevation": -14.0}
"""From behind the right flank [m, deg, deg]."""
_GANTRY_CAMERA = {"azimuth": 150.0, "elevation": -5.0}
"""From behind the right flank, lower: what hangs as well as the beam are seen [deg, deg]."""
_BELOW_BASE = 0.55
"""What hangs below the base, and some air [m]."""
_TAUT_COLOUR = (0.85, 0.15, 0.10, 1.0)
"""Of a rope that pulls."""
_CAMERA_SMOOTHING = 1.0
"""The camera follows the mean position over this time [s]."""
_LIGHT_DISTANCE = 2.0
"""Of the lights from the robot [m]; they move along, so that its shadow stays sharp."""
_SHADOW_RADIUS = 4.0
"""Ground around the robot that the shadow map covers [m]."""
_SHADOW_SIZE = 2048
"""Pixels of the shadow map's edge."""
_FORCE_SCALE = 0.008
"""Length of a force arrow [m/N]."""
_FORCE_WIDTH = 0.008
_FORCE_COLOUR = (0.90, 0.33, 0.10, 0.9)
_THRUST_COLOUR = (0.15, 0.45, 0.85, 1.0)
_OVER_BASE = 0.35
"""Where the arrow of the thrust begins, over the base, so that the robot does not hide it [m]."""
_MINIMUM_FORCE = 2.0
"""Smaller forces get no arrow [N]."""

_reason = ""


def unavailable_reason() -> str:
    """Return why the last `render` or `snapshots` gave None, with the packages that would help."""
    return _reason


def render(
    recording: Recording,
    model: mujoco.MjModel,
    path: Path,
    *,
    size: tuple[int, int] = (640, 480),
    fps: float = 25.0,
    speed: float = 1.0,
    start: float | None = None,
    end: float | None = None,
    forces: bool = True,
    smooth: bool = False,
) -> Path | None:
    """Write an MP4 (H.264) of a recording.

    Args:
        recording: with ground truth, and joint states where there are legs.
        model: the world that was simulated: a free joint of the base, and the twelve joints if
            there are legs.
        path: of the file.
        size: width and height in pixels, even numbers.
        fps: frames per second of the film.
        speed: of playback; 0.25 is slow motion.
        start: simulated time of the first frame [s], None for the recording's first.
        end: simulated time of the last frame [s], None for the recording's last.
        forces: draw the forces of the ground on the feet.
        smooth: smooth edges, which takes twice the time.

    Returns:
        The path, or None where nothing can be drawn; then `unavailable_reason` says why.
    """
    import imageio_ffmpeg

    if size[0] % 2 or size[1] % 2:
        raise ValueError(f"size is {size}, H.264 needs even numbers")
    first, last = _limits(recording, start, end)
    times = np.arange(first, last, speed / fps)
    model = studio(model, smooth)
    try:
        with Canvas(model, *size) as canvas:
            writer = imageio_ffmpeg.write_frames(
                str(path),
                size,
                fps=fps,
                codec="libx264",
                pix_fmt_out="yuv420p",
                quality=7,
                macro_block_size=2,
                output_params=["-preset", "veryfast"],
            )
            writer.send(None)
            try:
                for frame in _frames(recording, model, canvas, times, forces):
                    writer.send(np.ascontiguousarray(frame))
            finally:
                writer.close()
    except NoRenderingError as error:
        set_reason(error)
        return None
    return path


def snapshots(
    recording: Recording,
    model: mujoco.MjModel,
    path: Path,
    times: Sequence[float],
    *,
    size: tuple[int, int] = (480, 360),
    forces: bool = True,
    smooth: bool = True,
) -> Path | None:
    """Write a PNG with pictures of a recording side by side.

    Args:
        recording: with ground truth, and joint states where there are legs.
        model: the world that was simulated.
        path: of the file.
        times: of the pictures [s].
        size: of each picture, width and height in pixels.
        forces: draw the forces of the ground on the feet.
        smooth: smooth edges, which takes twice the time.

    Returns:
        The path, or None where nothing can be drawn; then `unavailable_reason` says why.
    """
    model = studio(model, smooth)
    try:
        with Canvas(model, *size) as canvas:
            frames = list(_frames(recording, model, canvas, np.asarray(times, float), forces))
    except NoRenderingError as error:
        set_reason(error)
        return None
    PilImage.fromarray(np.concatenate(frames, axis=1)).save(path)
    return path


def set_reason(error: NoRenderingError) -> None:
    """Keep why nothing can be drawn."""
    global _reason
    _reason = f"no video: {error}"


def load_scene(path: Path) -> mujoco.MjModel:
    """Return the world that the plant has saved, to look at.

    What moves but has lost its mass on the way through XML gets one; a film needs none.

    Raises:
        ValueError: the file is no MuJoCo model.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    for body in spec.bodies[1:]:
        if body.joints and not body.explicitinertial:
            body.explicitinertial = True
            body.mass, body.ipos, body.inertia = 1.0, np.zeros(3), np.ones(3)
    return spec.compile()


def studio(model: mujoco.MjModel, smooth: bool) -> mujoco.MjModel:
    """Return a copy of a model that is lit for a film.

    Args:
        model: as it was simulated.
        smooth: smooth edges, which takes twice the time.
    """
    copied = copy.copy(model)
    copied.vis.quality.offsamples = 4 if smooth else 0
    wider = 2 if model.ntendon else 1  # what hangs is far from its shadow
    copied.vis.quality.shadowsize = _SHADOW_SIZE
    copied.vis.map.shadowclip = wider * _SHADOW_RADIUS / copied.stat.extent
    copied.vis.headlight.ambient[:] = 0.32
    copied.vis.headlight.diffuse[:] = 0.28
    copied.vis.headlight.specular[:] = 0.1
    copied.light_diffuse[:] = 0.5
    copied.light_specular[:] = 0.2
    return copied


def _limits(recording: Recording, start: float | None, end: float | None) -> tuple[float, float]:
    """Return the times between which there is ground truth, and joint states with legs [s]."""
    base = recording.base.time
    first, last = float(base[0]), float(base[-1])
    if recording.has(graph.JOINT_STATES):
        joints = recording.joints.time
        first, last = max(first, joints[0]), min(last, joints[-1])
    return max(first, start or first), last if end is None else min(last, end)


def motion(recording: Recording, model: mujoco.MjModel, times: Array) -> Array:
    """Return MuJoCo positions of a recording (n, model.nq), interpolated.

    Args:
        recording: with ground truth, and joint states where there are legs.
        model: with a free joint and the twelve joints if there are legs; what else moves in it
            stays where it is.
        times: [s] (n,).

    Raises:
        ValueError: the model has no free joint.
    """
    base = recording.base
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if not len(free):
        raise ValueError("the model has no free joint for the base")
    positions = np.tile(model.qpos0, (len(times), 1))
    at = int(model.jnt_qposadr[free[0]])
    for axis in range(3):
        positions[:, at + axis] = np.interp(times, base.time, base.position[:, axis])
    inside = np.clip(times, base.time[0], base.time[-1])
    turns = Slerp(base.time, Rotation.from_quat(base.orientation))(inside)
    positions[:, at + 3 : at + 7] = turns.as_quat(scalar_first=True)
    if not recording.has(graph.JOINT_STATES):
        return positions
    joints = recording.joints
    for index, name in enumerate(JOINT_NAMES):
        address = int(model.joint(name).qposadr[0])
        positions[:, address] = np.interp(times, joints.time, joints.position[:, index])
    return positions


def pose(model: mujoco.MjModel, data: mujoco.MjData, lit: Array) -> None:
    """Prepare a state to be drawn, by its positions, lit around a place (3,) [m]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    data.light_xpos[:] = lit - _LIGHT_DISTANCE * data.light_xdir


def _frames(
    recording: Recording, model: mujoco.MjModel, canvas: Canvas, times: Array, forces: bool
) -> Iterator[Image]:
    """Yield a picture for each time."""
    data = mujoco.MjData(model)
    base = recording.base
    period = float(np.median(np.diff(base.time)))
    window = max(1, round(_CAMERA_SMOOTHING / period))
    smooth = uniform_filter1d(base.position, window, axis=0, mode="nearest")
    contacts = recording.contacts if forces and recording.has(graph.FOOT_CONTACTS) else None
    fans = recording.fans if contacts is not None and recording.has(graph.FAN_STATE) else None
    captions = _Captions(recording)
    camera = canvas.camera
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    gantry = _Gantry(recording, model) if model.ntendon else None
    for name, value in (_CAMERA if gantry is None else _GANTRY_CAMERA).items():
        setattr(camera, name, value)
    for time, position in zip(times, motion(recording, model, times), strict=True):
        data.qpos[:] = position
        pose(model, data, position[:3])
        place = smooth[min(int(np.searchsorted(base.time, time)), len(smooth) - 1)]
        camera.lookat[:] = (place[0], place[1], place[2] - 0.12)
        if gantry is not None:
            gantry.dress(data, time)
            camera.lookat[:] = (place[0] / 2, place[1] / 2, gantry.middle)
            camera.distance = gantry.distance

        def add_forces(scene: mujoco.MjvScene, now: float = time) -> None:
            if contacts is None:
                return
            row = min(int(np.searchsorted(contacts.time, now)), len(contacts) - 1)
            for foot, force in zip(contacts.position[row], contacts.force[row], strict=True):
                if np.linalg.norm(force) > _MINIMUM_FORCE:
                    tip = foot + _FORCE_SCALE * force
                    add_arrow(scene, foot, tip, _FORCE_WIDTH, _FORCE_COLOUR)
            if fans is None:
                return
            row = min(int(np.searchsorted(fans.time, now)), len(fans) - 1)
            body = data.body("base")
            axes = body.xmat.reshape(3, 3)
            thrust, above = axes @ fans.force[row], body.xpos + _OVER_BASE * axes[:, 2]
            if np.linalg.norm(thrust) > _MINIMUM_FORCE:
                add_arrow(scene, above, above + _FORCE_SCALE * thrust, _FORCE_WIDTH, _THRUST_COLOUR)

        yield captions.write(canvas.draw(data, add_forces), time)


class _Gantry:
    """Ropes of a gantry, as they are seen.

    Attributes:
        middle: height half way between the beam and the least height of what hangs [m].
        distance: of a camera that sees all that is between [m].
    """

    def __init__(self, recording: Recording, model: mujoco.MjModel):
        """Find the ropes: two tendons, left and right."""
        self._model = model
        self._slack = model.tendon_rgba.copy()
        self._fans = recording.fans if recording.has(graph.FAN_STATE) else None
        beam = float(model.body("trolley").pos[2]) + 0.1
        low = max(0.0, float(recording.base.position[:, 2].min()) - _BELOW_BASE)
        self.middle = (low + beam) / 2.0
        half_view = np.radians(model.vis.global_.fovy) / 2.0
        self.distance = 0.55 * (beam - low) / float(np.tan(half_view))

    def dress(self, data: mujoco.MjData, time: float) -> None:
        """Lay the ropes from end to end, and redden those that pull."""
        mujoco.mj_tendon(self._model, data)
        if self._fans is None:
            return
        row = max(0, int(np.searchsorted(self._fans.time, time, "right")) - 1)
        pulls = self._fans.rope_taut[row, : self._model.ntendon, None]
        self._model.tendon_rgba[:] = np.where(pulls, _TAUT_COLOUR, self._slack)


class _Captions:
    """Writes time, mode and speed into pictures."""

    def __init__(self, recording: Recording):
        self._base = recording.base
        window = max(1, round(0.4 / float(np.median(np.diff(self._base.time)))))
        velocity = uniform_filter1d(self._base.velocity, window, axis=0, mode="nearest")
        self._speed = np.linalg.norm(velocity, axis=1)
        self._states: Any = None
        if recording.has(graph.CONTROLLER_STATE):
            self._states = recording.controller
        self._propulsion: Any = None
        if recording.has(graph.PROPULSION_STATE):
            self._propulsion = recording.propulsion
        self._font: Any = None

    def write(self, image: Image, time: float) -> Image:
        """Return the picture with its caption."""
        if self._font is None:
            self._font = ImageFont.load_default(max(11, image.shape[0] // 28))
        text = f"{time:6.2f} s"
        states = self._states
        if states is not None:
            row = max(0, int(np.searchsorted(states.time, time, "right")) - 1)
            mode = states.mode[row].replace("_", " ")
            text += f"   {mode}" + (f" ({states.gait[row]})" if mode == "walk" else "")
        if self._propulsion is not None:
            state = self._propulsion
            row = max(0, int(np.searchsorted(state.time, time, "right")) - 1)
            word = f"{100 * state.collective_desired[row]:.0f} % thrust"
            text += f"   {word if state.armed[row] else 'disarmed'}"
        row = min(int(np.searchsorted(self._base.time, time)), len(self._speed) - 1)
        text += f"   {self._speed[row]:.2f} m/s"
        picture = PilImage.fromarray(image)
        margin = image.shape[0] // 40
        ImageDraw.Draw(picture).text(
            (margin, margin),
            text,
            fill=(35, 35, 35),
            font=self._font,
            stroke_width=2,
            stroke_fill=(255, 255, 255),
        )
        return np.asarray(picture)
