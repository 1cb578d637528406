"""A film shows the recorded motion, or says what is missing on this machine."""

from __future__ import annotations

import ctypes.util
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from husky_description.mujoco_model import build_spec
from husky_description.robot import JOINT_NAMES, load_robot
from husky_experiments.figures import offscreen, video
from husky_experiments.figures.stroboscope import Moment, stroboscope
from husky_experiments.recordings.recording import Recording
from husky_sim.gantry import GantryOptions
from husky_sim.world import World, WorldOptions


@pytest.fixture(scope="module")
def recording(walk_bag: Path) -> Recording:
    return Recording(walk_bag)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build_spec(load_robot()).compile()


@pytest.fixture
def can_draw(model: mujoco.MjModel) -> None:
    try:
        offscreen.Canvas(model, 32, 32).close()
    except offscreen.NoRenderingError as error:
        pytest.skip(str(error))


def test_motion_is_the_recorded_one(recording: Recording, model: mujoco.MjModel, walk: Any) -> None:
    """Also between samples: 100 Hz truth interpolated to 1e-5 of a 1 Hz, 2 deg roll."""
    times = np.array([0.5, 1.2345, 2.5017])
    positions = video.motion(recording, model, times)
    data = mujoco.MjData(model)
    for time, qpos in zip(times, positions, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        place, orientation, _ = walk.base(time)
        body = data.body("base")
        assert np.allclose(body.xpos, place, atol=1e-9)
        turned = Rotation.from_quat(np.roll(body.xquat, -1)) * Rotation.from_quat(orientation).inv()
        assert turned.magnitude() < 2e-5
        for index, name in enumerate(JOINT_NAMES):
            # linear over 2 ms: at most (2 pi)^2 0.2 rad/s^2 (1 ms)^2 / 2
            assert data.joint(name).qpos[0] == pytest.approx(
                walk.joint_position(time)[index], abs=4e-6
            )


def test_a_model_without_a_free_joint_is_refused(recording: Recording) -> None:
    fixed = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(ValueError, match="free joint"):
        video.motion(recording, fixed, np.array([0.0]))


@pytest.mark.usefixtures("can_draw")
def test_film(recording: Recording, model: mujoco.MjModel, tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    found = video.render(
        recording, model, path, size=(160, 120), fps=20.0, start=1.0, end=2.0, speed=0.5
    )
    assert found == path
    frames = imageio_ffmpeg.read_frames(str(path))
    about = next(frames)
    assert about["size"] == (160, 120)
    assert about["fps"] == 20.0
    assert about["codec"] == "h264"
    assert "yuv420p" in about["pix_fmt"]
    pictures = [np.frombuffer(frame, np.uint8) for frame in frames]
    assert len(pictures) == 40, "one second at half speed"
    assert pictures[0].std() > 5.0, "not one colour"
    assert np.mean(pictures[0] != pictures[-1]) > 0.02, "something moves"


@pytest.mark.usefixtures("can_draw")
def test_snapshots(recording: Recording, model: mujoco.MjModel, tmp_path: Path) -> None:
    path = tmp_path / "strip.png"
    assert video.snapshots(recording, model, path, [0.1, 1.5, 2.5], size=(120, 90)) == path
    with Image.open(path) as image:
        assert image.size == (360, 90)
    before = model.vis.quality.offsamples, model.vis.global_.offwidth
    video.snapshots(recording, model, path, [0.1], size=(64, 48))
    assert (model.vis.quality.offsamples, model.vis.global_.offwidth) == before


@pytest.mark.usefixtures("can_draw")
def test_all_moments_are_in_one_picture(
    recording: Recording, model: mujoco.MjModel, tmp_path: Path
) -> None:
    """The robot of each moment is at its own place, and its words are over it."""
    pictures = []
    moments = Moment(0.1, "here"), Moment(2.9, "there")
    for words in (False, True):
        chosen = [moment if words else Moment(moment.time) for moment in moments]
        path = stroboscope(recording, model, tmp_path / f"{words}.png", chosen, width=600)
        assert path is not None
        with Image.open(path) as image:
            pictures.append(np.asarray(image, int))
    robots, written = pictures
    seen = np.abs(robots - robots[0, 0]).max(axis=2) > 40
    half = seen.shape[1] // 2
    assert seen[:, :half].sum() > 200 and seen[:, half:].sum() > 200
    columns = np.flatnonzero((robots != written).any(axis=(0, 2)))
    assert columns.min() < half < columns.max()
    rows = np.flatnonzero((robots != written).any(axis=(1, 2)))
    assert rows.max() < np.flatnonzero(seen.any(axis=1)).mean()


def test_odd_sizes_are_refused(recording: Recording, model: mujoco.MjModel, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="even"):
        video.render(recording, model, tmp_path / "film.mp4", size=(161, 120))


@pytest.mark.parametrize("wanted", ["", "egl", "osmesa", "glfw"])
def test_without_a_library_the_package_is_named(
    monkeypatch: pytest.MonkeyPatch,
    recording: Recording,
    model: mujoco.MjModel,
    tmp_path: Path,
    wanted: str,
) -> None:
    monkeypatch.setenv("MUJOCO_GL", wanted)
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None)
    assert video.render(recording, model, tmp_path / "film.mp4") is None
    assert not (tmp_path / "film.mp4").exists()
    assert "libegl1" in video.unavailable_reason()
    assert "libosmesa6" in video.unavailable_reason()


def test_mujoco_gl_decides_where_it_can(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: f"lib{name}.so")
    for wanted, expected in (("osmesa", "osmesa"), ("egl", "egl"), ("glfw", "egl"), ("", "egl")):
        monkeypatch.setenv("MUJOCO_GL", wanted)
        assert offscreen.find_backend() == expected
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr(
        ctypes.util, "find_library", lambda name: "libOSMesa.so" if name == "OSMesa" else None
    )
    assert offscreen.find_backend() == "osmesa"
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: name if name == "EGL" else None)
    with pytest.raises(offscreen.NoRenderingError, match="libopengl0"):
        offscreen.find_backend()  # EGL alone does not draw
    monkeypatch.setenv("MUJOCO_GL", "Disable")
    with pytest.raises(offscreen.NoRenderingError, match="MUJOCO_GL is disable"):
        offscreen.find_backend()


def unit_world() -> World:
    options = WorldOptions(body="unit", keyframe="stand", gantry=GantryOptions())
    return World(load_robot(), options)


def test_a_saved_world_with_a_gantry_can_be_loaded(tmp_path: Path) -> None:
    world = unit_world()
    path = tmp_path / "scene.xml"
    path.write_text(world.scene_xml)
    loaded = video.load_scene(path)
    assert loaded.nq == world.model.nq
    assert [loaded.tendon(i).name for i in range(2)] == ["rope_left", "rope_right"]
    assert np.allclose(loaded.body("base").mass, world.model.body("base").mass)


def test_motion_of_the_unit_alone(unit_bag: Path, unit_flight: Any) -> None:
    times = np.array([0.5, 3.2, 5.0])
    positions = video.motion(Recording(unit_bag), unit_world().model, times)
    for time, qpos in zip(times, positions, strict=True):
        assert np.allclose(qpos[:3], unit_flight.position(time), atol=1e-9)
        turn = Rotation.from_quat(np.roll(qpos[3:7], -1))
        assert (turn * unit_flight.attitude(time).inv()).magnitude() < 1e-9


@pytest.mark.usefixtures("can_draw")
def test_taut_ropes_are_red(unit_bag: Path, tmp_path: Path) -> None:
    """At 4.2 s the left rope pulls, at 3 s none does."""
    recording, model = Recording(unit_bag), unit_world().model
    red = []
    for time in (3.0, 4.2):
        path = video.snapshots(recording, model, tmp_path / f"{time}.png", [time], smooth=False)
        assert path is not None
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB")).astype(int)
        red.append(int(np.sum((pixels[..., 0] > 90) & (pixels[..., 1:].max(axis=2) < 60))))
    assert red[1] > red[0] + 50
