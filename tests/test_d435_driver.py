"""The process `d435_driver` against the simulated device on a socket, with synthetic images."""

import math
import sys
from functools import cache

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from node_bench import DeviceThread, SensorBench, assert_refused, shared_bench
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from husky_description.robot import load_robot
from husky_drivers.nodes.d435_driver import D435Driver
from husky_drivers.probes import probe_d435
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.ports.socket_port import SocketPort
from husky_sim.devices.d435.device import D435Device

pytestmark = pytest.mark.graph

PERIOD_NS = 100_000_000
FIGURES = load_robot().d435
HEIGHT, WIDTH = FIGURES.height, FIGURES.width
MODULE = "husky_drivers.nodes.d435_driver"
OPTICAL = "camera_depth_optical_frame"


@cache
def scene():
    """A floor that is nearer at the bottom, with a square hole of no depth [mm]."""
    depth = np.linspace(3000, 500, HEIGHT)[:, None] + np.zeros(WIDTH)
    depth[20:40, 30:50] = 0
    return depth


def picture(number):
    """The scene in image `number` [mm], with noise of 3 mm."""
    depth = scene()
    noise = np.random.default_rng(number).integers(-3, 4, depth.shape)
    return np.where(depth > 0, depth + noise, 0).astype(np.uint16)


def number_of(message):
    number, rest = divmod(stamps.to_ns(message.header.stamp), PERIOD_NS)
    assert rest == 0
    return number


def depth_of(image):
    return np.frombuffer(image.data, "<u2").reshape(image.height, image.width)


class Bench(SensorBench):
    """A camera, faster than the real one by the wall clock, and its driver."""

    port_kind = SocketPort

    def __init__(self, domain, directory, **parameters):
        self.camera, self.next = D435Device(FIGURES, 5), 0
        super().__init__(domain, directory, MODULE, 0.02, self._tick, Image, graph.DEPTH_IMAGE)
        self.infos, self.clouds = [], []
        for kind, topic, keep in (
            (CameraInfo, graph.DEPTH_CAMERA_INFO, self.infos),
            (PointCloud2, graph.DEPTH_POINTS, self.clouds),
        ):
            self.node.create_subscription(kind, topic, keep.append, qos.STATUS)
        self.start(port=self.port.path, **{"diagnostic_updater.period": 0.1}, **parameters)

    def _tick(self, number):
        self.camera.send(number, number * PERIOD_NS, picture(number))
        self.port.service(self.camera)
        self.next = number + 1

    def inject(self, fault):
        """Return the number of the first image that the fault is in."""
        with self.held():
            self.camera.inject(fault)
            return self.next

    def wait_for_samples(self, count=5):
        """Wait for so many images that are exposed from now on, and keep only them."""
        with self.held():
            since = self.next
        fresh = lambda: [image for image in self.samples if number_of(image) >= since]  # noqa: E731
        self.wait(lambda: len(fresh()) >= count, f"{count} images")
        self.samples[:] = fresh()

    def taken(self):
        with self.held():
            return self.camera.taken

    def check_samples(self):
        """Each image that was published is the scene of its time."""
        assert self.samples
        for image in self.samples:
            assert np.array_equal(depth_of(image), picture(number_of(image)))


bench = shared_bench(Bench, **{"pointcloud.enable": True})


def test_images_and_their_pinhole_are_those_of_the_device(bench):
    bench.wait(lambda: len(bench.samples) >= 10 and len(bench.infos) >= 10, "images")
    bench.check_samples()
    numbers = list(map(number_of, bench.samples))
    assert sorted(set(numbers)) == numbers
    pinholes = set(map(number_of, bench.infos))
    assert {n for n in numbers if min(pinholes) <= n <= max(pinholes)} <= pinholes
    for image in bench.samples:
        assert (image.height, image.width, image.step) == (HEIGHT, WIDTH, 2 * WIDTH)
        assert (image.encoding, image.is_bigendian) == ("16UC1", 0)
        assert image.header.frame_id == OPTICAL
    across, down = FIGURES.field_of_view
    fx, fy = WIDTH / 2 / math.tan(across / 2), HEIGHT / 2 / math.tan(down / 2)
    cx, cy = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    for info in bench.infos:
        assert info.header.frame_id == OPTICAL
        assert (info.height, info.width) == (HEIGHT, WIDTH)
        assert (info.distortion_model, list(info.d)) == ("plumb_bob", [0.0] * 5)
        np.testing.assert_allclose(info.k, [fx, 0, cx, 0, fy, cy, 0, 0, 1], rtol=1e-6)
        np.testing.assert_allclose(info.p, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], rtol=1e-6)
        assert np.array_equal(np.reshape(info.r, (3, 3)), np.eye(3))
    values = bench.wait_for_good_report()
    assert (values["state"], values["backend"], values["invalid"]) == ("streaming", "sim", "0")
    assert float(values["valid"]) == pytest.approx(1.0 - 400 / (WIDTH * HEIGHT), abs=1e-3)


def test_points_lie_where_their_pixels_look(bench):
    bench.wait(lambda: len(bench.clouds) >= 2, "points")
    k = np.reshape(bench.infos[-1].k, (3, 3))
    for cloud in bench.clouds[:2]:
        assert [field.name for field in cloud.fields] == ["x", "y", "z"]
        assert (cloud.height, cloud.point_step, cloud.is_dense) == (1, 12, True)
        assert cloud.row_step == len(cloud.data) == 12 * cloud.width
        assert cloud.header.frame_id == OPTICAL
        points = np.frombuffer(cloud.data, "<f4").reshape(-1, 3)
        depth = picture(number_of(cloud))
        rows, columns = np.nonzero(depth)
        np.testing.assert_allclose(points[:, 2], 1e-3 * depth[rows, columns], rtol=1e-6)
        pixels = points @ k.T
        np.testing.assert_allclose(pixels[:, 0] / pixels[:, 2], columns, atol=1e-3)
        np.testing.assert_allclose(pixels[:, 1] / pixels[:, 2], rows, atol=1e-3)


def test_a_lost_device_and_a_frozen_one_are_reported_and_survived(bench):
    bench.check_the_plug()
    bench.inject("freeze")
    values = bench.wait_for_report(lambda s: s.message == "frozen", "a report of the freeze")
    assert int(values["times_frozen"]) >= 1 and int(values["reconnects"]) >= 1
    bench.inject("")
    bench.wait_for_good_report()
    bench.wait_for_samples()
    bench.check_samples()


def test_a_stuck_image_is_reported_and_not_published(bench):
    since = bench.inject("stuck")
    is_stuck = lambda s: (s.message, s.level) == ("stuck", DiagnosticStatus.ERROR)  # noqa: E731
    before = bench.wait_for_report(is_stuck, "a report of the stuck image")
    taken = bench.taken()
    after = bench.wait_for_report(is_stuck, "another one")
    bench.wait(lambda: bench.taken() > taken, "the device to hear that frames were dropped")
    assert int(after["stuck"]) > int(before["stuck"]) and after["good"] == before["good"]
    assert max(map(number_of, bench.samples)) < since
    bench.inject("")
    bench.wait_for_good_report()


def test_a_covered_lens_is_reported_and_its_images_are_published(bench):
    bench.inject("cover")
    values = bench.wait_for_report(
        lambda s: (s.message, s.level) == ("covered", DiagnosticStatus.WARN), "a report of that"
    )
    assert values["valid"] == "0.000"
    bench.wait_for_samples()
    assert not any(depth_of(image).any() for image in bench.samples)
    bench.inject("")
    bench.wait_for_good_report()


def test_damaged_frames_are_counted_and_the_others_come(bench):
    bench.inject("garbage")
    bench.wait_for_samples()
    bench.check_samples()
    bench.wait_for_report(
        lambda s: any(v.key == "crc_errors" and int(v.value) >= 3 for v in s.values),
        "a report of damaged frames",
    )
    bench.inject("")
    bench.wait_for_good_report()


def test_a_camera_that_starts_again_is_followed(bench):
    bench.inject("power_cycle")
    bench.wait_for_samples()
    bench.wait(lambda: 0 <= bench.taken() < number_of(bench.samples[-1]), "frames from 0 on")
    bench.wait_for_samples()
    bench.check_samples()
    values = bench.wait_for_good_report()
    assert values["repeated"] == values["invalid"] == "0"


def test_a_deactivated_driver_gives_the_port_back(bench):
    bench.check_deactivation()
    bench.end()


def test_the_probe_of_the_hardware_check_finds_the_device(tmp_path):
    camera = D435Device(FIGURES)
    with SocketPort(tmp_path / "d435") as port:

        def tick(number):
            camera.send(number, number * PERIOD_NS, picture(0))
            port.service(camera)

        thread = DeviceThread(0.01, tick)
        thread.start()
        try:
            found, problem = probe_d435("sim", str(port.path), "", "640x480x15", 4)
        finally:
            thread.end()
    assert not problem
    where, what = f"D435, the stand-in on {port.path}", f"images of {WIDTH} x {HEIGHT} come"
    assert found == (f"{where}, {what}, 98% of the pixels have depth",)
    assert "No such file" in probe_d435("sim", str(port.path), "", "640x480x15", 4).problem


def test_a_camera_that_cannot_be_used_here_is_no_crash(domain, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    rclpy.init(args=["--ros-args", "-p", "backend:=realsense"], domain_id=domain)
    try:
        node = D435Driver()
        assert node.trigger_configure() is TransitionCallbackReturn.FAILURE
        level, message, _ = node.report()
        node.destroy_node()
    finally:
        rclpy.shutdown()
    assert level == DiagnosticStatus.ERROR
    assert message.startswith("backend realsense: pyrealsense2 cannot be imported")


def test_a_bad_profile_ends_it_with_a_sentence():
    assert_refused(
        MODULE,
        "parameter profile is '640x480', it must be WIDTHxHEIGHTxFPS in pixels and Hz, "
        "640x480x15 for example",
        profile="640x480",
    )
