"""The camera's backend against a stand-in for `pyrealsense2`, and what is said without one."""

import sys
from types import SimpleNamespace

import pytest

from husky_drivers.camera_link import BackendError
from husky_drivers.t265.choice import make_backend
from husky_drivers.t265.frames import odometry
from husky_drivers.t265.realsense import RealsenseBackend, load_librealsense


def xyz(*values):
    return SimpleNamespace(**dict(zip("xyzw", values, strict=False)))


class Frame:
    def __init__(self, number, is_pose=True):
        self.number, self.is_pose = number, is_pose

    def is_pose_frame(self):
        return self.is_pose

    def as_pose_frame(self):
        return self

    def get_frame_number(self):
        return self.number

    def get_timestamp(self):
        return 5.0 * self.number

    def get_pose_data(self):
        return SimpleNamespace(
            translation=xyz(1.0, 2.0, 3.0),
            velocity=xyz(4.0, 5.0, 6.0),
            acceleration=xyz(7.0, 8.0, 9.0),
            rotation=xyz(0.0, 0.0, 0.0, 1.0),
            angular_velocity=xyz(10.0, 11.0, 12.0),
            angular_acceleration=xyz(13.0, 14.0, 15.0),
            tracker_confidence=2,
            mapper_confidence=1,
        )


class Library:
    """As much of `pyrealsense2` 2.53.1 as the backend uses."""

    __version__ = "2.53.1"
    camera_info = SimpleNamespace(name="name", serial_number="number")
    stream = SimpleNamespace(pose="pose")

    def __init__(self, devices=(("Intel RealSense T265", "905312110001"),), error=None):
        self.devices, self.error = devices, error
        self.streams, self.enabled, self.callback = [], [], None

    def context(self):
        devices = [SimpleNamespace(get_info=dict(zip(("name", "number"), d, strict=True)).get)
                   for d in self.devices]  # fmt: skip
        return SimpleNamespace(query_devices=lambda: devices)

    def config(self):
        return SimpleNamespace(enable_stream=self.streams.append, enable_device=self.enabled.append)

    def pipeline(self, context):
        return SimpleNamespace(start=self._start, stop=self._stop)

    def _start(self, config, callback):
        if self.error:
            raise RuntimeError(self.error)
        self.callback = callback

    def _stop(self):
        if self.callback is None:
            raise RuntimeError("stop() cannot be called before start()")
        self.callback = None


def test_frames_come_through_in_order():
    library = Library()
    backend = RealsenseBackend(library)
    backend.open()
    assert library.streams == ["pose"]
    assert backend.poll(0.0) == ()
    for number in (1, 2, 3):
        library.callback(Frame(number))
    library.callback(Frame(4, is_pose=False))
    frames = backend.poll(0.0)
    assert [frame.number for frame in frames] == [1, 2, 3]
    assert [frame.time_ns for frame in frames] == [5_000_000, 10_000_000, 15_000_000]
    assert frames[0].acceleration == (7.0, 8.0, 9.0)
    assert frames[0].angular_acceleration == (13.0, 14.0, 15.0)
    assert (frames[0].tracker_confidence, frames[0].mapper_confidence) == (2, 1)
    pose, twist = odometry(frames[0])
    assert pose[:3] == (-3.0, -1.0, 2.0)
    assert twist == (-6.0, -4.0, 5.0, -12.0, -10.0, 11.0)
    assert backend.counters() == {"other_frames": 1}
    backend.close()
    assert library.callback is None
    backend.close()


def test_a_pulled_plug_is_survived_and_the_stream_starts_afresh():
    library = Library()
    backend = RealsenseBackend(library)
    backend.open()
    library.callback(Frame(1))
    library.callback = None
    backend.close()  # librealsense complains: not ours to raise
    library.devices = ()
    with pytest.raises(OSError, match=r"no T265 on USB; librealsense 2\.53\.1 finds nothing"):
        backend.open()
    library.devices = Library().devices
    backend.open()
    assert backend.poll(0.0) == ()


@pytest.mark.parametrize(
    ("library", "number", "words"),
    [
        (Library(devices=()), "", "no T265 on USB; librealsense 2.53.1 finds nothing"),
        (Library(devices=(("Intel RealSense D435", "1"),)), "", "finds Intel RealSense D435 1"),
        (Library(), "42", "no T265 42 on USB; librealsense 2.53.1 finds Intel RealSense T265 9053"),
        (Library(error="Device or resource busy"), "", "librealsense: Device or resource busy"),
    ],
)
def test_a_camera_that_cannot_be_had_is_an_os_error(library, number, words):
    with pytest.raises(OSError, match=words):
        RealsenseBackend(library, number).open()


def test_a_camera_can_be_chosen():
    library = Library()
    RealsenseBackend(library, "905312110001").open()
    assert library.enabled == ["905312110001"]


def module(version):
    return SimpleNamespace(__version__=version, pipeline=None)


@pytest.mark.parametrize("version", ["2.54.1", "2.56.4.9191", "3.0"])
def test_a_library_without_the_t265_is_named_with_what_would_have_it(monkeypatch, version):
    monkeypatch.setitem(sys.modules, "pyrealsense2", module(version))
    with pytest.raises(BackendError, match=f"version {version}, without the T265.*2.53.1"):
        make_backend("realsense", "")


def test_no_library_is_named_with_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(BackendError, match=r"pyrealsense2 cannot be imported.*2\.53\.1"):
        load_librealsense()


@pytest.mark.parametrize("version", ["2.53.1", "2.50.0.3812", "2.18.0"])
def test_a_library_with_the_t265_is_taken(monkeypatch, version):
    monkeypatch.setitem(sys.modules, "pyrealsense2", module(version))
    assert make_backend("realsense", "", "7").path == "USB 7"


def test_an_installation_from_source_hides_it_one_level_down(monkeypatch):
    inner = module("2.53.1")
    monkeypatch.setitem(sys.modules, "pyrealsense2", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "pyrealsense2.pyrealsense2", inner)
    assert load_librealsense() is inner


def test_there_is_no_other_backend():
    with pytest.raises(ValueError, match="must be one of sim, realsense"):
        make_backend("zed", "")
