"""The camera's backend against a stand-in for `pyrealsense2`, and what is said without one."""

import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from husky_drivers import probes
from husky_drivers.camera_link import BackendError
from husky_drivers.d435.choice import make_backend
from husky_drivers.d435.frames import Intrinsics
from husky_drivers.d435.realsense import DepthStream, RealsenseBackend, load_librealsense

DEPTH = np.arange(48, dtype=np.uint16).reshape(6, 8)
READ, EXPOSED = "frame_timestamp", "sensor_timestamp"


class Frame:
    """A depth frame of librealsense, or a frame of another kind."""

    def __init__(self, number, depth=DEPTH, kind="depth", metadata=None):
        self.number, self.depth, self.kind = number, depth, kind
        self.metadata = metadata or {}

    def is_frameset(self):
        return False

    def is_depth_frame(self):
        return self.kind == "depth"

    def get_frame_number(self):
        return self.number

    def get_timestamp(self):
        return 100.0 * self.number

    def supports_frame_metadata(self, key):
        return key in self.metadata

    def get_frame_metadata(self, key):
        return self.metadata[key]

    def get_data(self):
        return self.depth

    def get_profile(self):
        return self

    def as_video_stream_profile(self):
        return self

    def get_intrinsics(self):
        height, width = self.depth.shape
        return SimpleNamespace(width=width, height=height, fx=5.0, fy=6.0, ppx=3.5, ppy=2.5)


class FrameSet:
    def __init__(self, depth):
        self.depth = depth

    def is_frameset(self):
        return True

    def as_frameset(self):
        return self

    def get_depth_frame(self):
        return self.depth


class Device:
    def __init__(self, name, number):
        self.get_info = {"name": name, "number": number, "firmware": "5.16"}.get

    def first_depth_sensor(self):
        return SimpleNamespace(get_depth_scale=lambda: 0.00025)


class Library:
    """As much of `pyrealsense2` as the backend uses."""

    __version__ = "2.56.5"
    camera_info = SimpleNamespace(name="name", serial_number="number", firmware_version="firmware")
    stream = SimpleNamespace(depth="depth")
    format = SimpleNamespace(z16="z16")
    frame_metadata_value = SimpleNamespace(frame_timestamp=READ, sensor_timestamp=EXPOSED)

    def __init__(self, devices=(("Intel RealSense D435", "1"),), error=None, at_start=None):
        self.devices, self.error, self.at_start = devices, error, at_start
        self.streams, self.enabled, self.callback = [], [], None

    def context(self):
        devices = [Device(*device) for device in self.devices]
        return SimpleNamespace(query_devices=lambda: devices)

    def config(self):
        return SimpleNamespace(
            enable_stream=lambda *wanted: self.streams.append(wanted),
            enable_device=self.enabled.append,
        )

    def pipeline(self, context):
        return SimpleNamespace(start=self._start, stop=self._stop)

    def decimation_filter(self, magnitude):
        step = int(magnitude)
        return SimpleNamespace(
            process=lambda frame: Frame(-1, frame.depth[::step, ::step], "decimated")
        )

    def _start(self, config, callback):
        if self.error:
            raise RuntimeError(self.error)
        self.callback = callback
        if self.at_start is not None:
            callback(self.at_start)

    def _stop(self):
        if self.callback is None:
            raise RuntimeError("stop() cannot be called before start()")
        self.callback = None


def opened(library, decimation=1, serial_number=""):
    stream = DepthStream.of_profile("424x240x6", decimation)
    backend = RealsenseBackend(library, stream, serial_number)
    backend.open()
    return backend


def test_the_profile_is_asked_for_and_frames_come_in_order():
    library = Library()
    backend = opened(library)
    assert library.streams == [("depth", 424, 240, "z16", 6)]
    assert library.enabled  # the one that was found, of several
    assert backend.poll(0.0) == ()
    library.callback(Frame(1))
    library.callback(FrameSet(Frame(2)))
    library.callback(Frame(3, kind="infrared"))
    library.callback(FrameSet(None))
    frames = backend.poll(0.0)
    assert [(frame.number, frame.time_ns) for frame in frames] == [
        (1, 100_000_000),
        (2, 200_000_000),
    ]
    for frame in frames:
        assert frame.intrinsics == Intrinsics(8, 6, 5.0, 6.0, 3.5, 2.5)
        assert frame.depth_unit == 0.00025
        assert np.array_equal(frame.depth, DEPTH) and not np.shares_memory(frame.depth, DEPTH)
        backend.taken(frame)
    assert backend.counters() == {"other_frames": 2}
    backend.close()
    assert library.callback is None
    backend.close()


def test_decimation_has_its_own_intrinsics_and_the_frames_own_number_and_time():
    library = Library()
    backend = opened(library, decimation=2)
    library.callback(Frame(4))
    (frame,) = backend.poll(0.0)
    assert (frame.number, frame.time_ms) == (4, 400.0)
    assert frame.intrinsics[:2] == (4, 3)
    assert np.array_equal(frame.depth, DEPTH[::2, ::2])


@pytest.mark.parametrize(
    ("metadata", "earlier"),
    [
        ({READ: 70_000, EXPOSED: 62_500}, 7.5),
        ({READ: 70_000}, 0.0),
        ({EXPOSED: 70_000}, 0.0),
        ({READ: 100, EXPOSED: 2**32 - 100}, 0.0),
        ({READ: 2**31, EXPOSED: 100}, 0.0),
    ],
)
def test_the_time_is_that_of_the_exposure_where_the_metadata_tell_it(metadata, earlier):
    library = Library()
    backend = opened(library)
    library.callback(Frame(10, metadata=metadata))
    assert backend.poll(0.0)[0].time_ms == pytest.approx(1000.0 - earlier)


def test_a_pulled_plug_is_survived_and_the_stream_starts_afresh():
    library = Library()
    backend = opened(library)
    library.callback(Frame(1))
    library.callback = None
    backend.close()  # librealsense complains: not ours to raise
    library.devices = ()
    with pytest.raises(OSError, match=r"no D435 on USB; librealsense 2\.56\.5 finds nothing"):
        backend.open()
    library.devices = Library().devices
    backend.open()
    assert backend.poll(0.0) == ()


@pytest.mark.parametrize(
    ("library", "number", "words"),
    [
        (Library(devices=()), "", "no D435 on USB; librealsense 2.56.5 finds nothing"),
        (Library(devices=(("Intel RealSense T265", "9"),)), "", "finds Intel RealSense T265 9"),
        (Library(), "42", "no D435 42 on USB; librealsense 2.56.5 finds Intel RealSense D435 1"),
        (
            Library(error="Couldn't resolve requests"),
            "",
            "librealsense: Couldn't resolve requests (depth stream 424x240x6)",
        ),
    ],
)
def test_a_camera_that_cannot_be_had_is_an_os_error(library, number, words):
    with pytest.raises(OSError, match=re.escape(words)):
        opened(library, serial_number=number)


def test_a_camera_can_be_chosen():
    library = Library(devices=(("Intel RealSense D435", "1"), ("Intel RealSense D435I", "2")))
    assert opened(library, serial_number="2").path == "USB 2"
    assert library.enabled == ["2"]


@pytest.mark.parametrize("profile", ["640x480", "640x480x", "0x480x15", "640X480X15", "a", ""])
def test_a_profile_that_is_none_is_refused(profile):
    words = f"profile is {profile!r}, it must be WIDTHxHEIGHTxFPS in pixels and Hz, 640x480x15 for"
    with pytest.raises(ValueError, match=re.escape(words)):
        DepthStream.of_profile(profile, 4)


def test_a_profile_is_read_as_it_is_written():
    assert DepthStream.of_profile("1280x720x30", 8) == DepthStream(1280, 720, 30, 8)
    assert DepthStream.of_profile(DepthStream().profile, 4) == DepthStream()


def test_no_library_is_named_with_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(BackendError, match=r"pyrealsense2 cannot be imported.*with pip"):
        load_librealsense()
    problem = probes.probe_d435("realsense", "", "", "640x480x15", 4).problem
    assert problem.startswith("pyrealsense2 cannot be imported")


@pytest.mark.parametrize("version", ["2.50.0", "2.56.5.9235", "3.0"])
def test_any_version_of_the_library_is_taken(monkeypatch, version):
    module = SimpleNamespace(__version__=version, pipeline=None, decimation_filter=Library)
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    assert make_backend("realsense", "", "7").path == "USB 7"


def test_there_is_no_other_backend():
    with pytest.raises(ValueError, match="must be one of sim, realsense"):
        make_backend("zed", "")


# The probe --------------------------------------------------------------------------------------
def probe(monkeypatch, library, profile="640x480x15"):
    monkeypatch.setitem(sys.modules, "pyrealsense2", library)
    return probes.probe_d435("realsense", "", "", profile, 2)


def test_the_probe_names_the_camera_and_what_it_sees(monkeypatch):
    depth = np.where(DEPTH % 4, 0, 900).astype(np.uint16)
    library = Library(at_start=Frame(1, depth))
    found, problem = probe(monkeypatch, library)
    assert found == (
        "D435, serial number 1, firmware 5.16 on USB, images of 4 x 3 come, "
        "50% of the pixels have depth",
    )
    assert not problem and library.callback is None


@pytest.mark.parametrize(
    ("library", "profile", "words"),
    [
        (Library(), "640x480x15", "USB: no image within 0 s"),
        (Library(devices=()), "640x480x15", "no D435 on USB"),
        (Library(error="busy"), "640x480x15", "librealsense: busy (depth stream 640x480x15)"),
        (Library(), "640x480", "profile is '640x480', it must be WIDTHxHEIGHTxFPS"),
    ],
)
def test_the_probe_says_why_there_is_no_image(monkeypatch, library, profile, words):
    monkeypatch.setattr(probes, "_FRAME_PATIENCE", 0.0)
    found, problem = probe(monkeypatch, library, profile)
    assert not found and words in problem
    assert library.callback is None
