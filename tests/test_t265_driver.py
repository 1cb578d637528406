"""The process `t265_driver` against the simulated device on a pseudo-terminal."""

import importlib.util
import signal
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from nav_msgs.msg import Odometry
from node_bench import SensorBench, assert_refused, shared_bench
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_drivers.t265.frames import base_pose
from husky_runtime import graph
from husky_runtime.nodes import stamps
from husky_sim.devices.t265.device import T265Device

pytestmark = pytest.mark.graph

PERIOD_NS = 5_000_000
FIGURES = load_robot().t265
HEADING = Rotation.from_euler("z", 0.7)
SPEED = 0.5
VELOCITY = HEADING.apply([SPEED, 0.0, 0.0])
MODULE = "husky_drivers.nodes.t265_driver"


class Bench(SensorBench):
    """A camera that walks straight on at 0.5 m/s along a heading of 0.7 rad, and its driver."""

    def __init__(self, domain, directory, topic=graph.T265_ODOMETRY, **parameters):
        self.camera = T265Device(FIGURES, 5)
        super().__init__(domain, directory, MODULE, 0.005, self._tick, Odometry, topic)
        self.start(port=self.port.path, topic=topic, **parameters)

    def _tick(self, number):
        time_ns = number * PERIOD_NS
        position = 1e-9 * time_ns * VELOCITY
        self.camera.sample(time_ns, position, HEADING.as_quat(), VELOCITY, (0.0, 0.0, 0.0))
        self.port.service(self.camera)

    def inject(self, fault, intensity=None):
        with self.held():
            self.camera.inject(fault, intensity)


@pytest.fixture
def bench(domain, tmp_path, request):
    bench = Bench(domain, tmp_path, **getattr(request, "param", {}))
    yield bench
    bench.close()


def test_faults_of_line_and_device_are_reported_and_survived(bench):
    bench.check_the_plug()
    bench.inject("freeze")
    bench.wait_for_report(lambda s: s.message == "frozen", "a report of the frozen stream")
    bench.inject("lost")
    values = bench.wait_for_report(lambda s: s.message == "tracking lost", "a report of the loss")
    assert (values["tracker_confidence"], values["reconnects"]) == ("0", "1")
    assert int(values["times_frozen"]) >= 1
    bench.wait_for_samples(1)
    assert bench.samples[-1].pose.covariance[0] == pytest.approx(10.0)
    bench.inject("jump", 1.0)
    values = bench.wait_for_report(lambda s: "jump" in s.message, "a report of the jump")
    assert int(values["jumps"]) >= 1
    bench.wait_for_good_report()


@pytest.mark.parametrize(
    "bench",
    [{"clock": "host", "topic": "/camera/odom/sample", "odom_frame": "camera_odom_frame"}],
    indirect=True,
)
def test_as_intels_wrapper_with_the_hosts_clock(bench):
    bench.wait_for_samples(100)
    times = np.array([stamps.to_ns(sample.header.stamp) for sample in bench.samples])
    assert np.diff(times).min() > 0
    assert abs(times[-1] - time.time_ns()) < 30 * 10**9
    assert bench.samples[0].header.frame_id == "camera_odom_frame"
    bench.end()


@pytest.mark.parametrize("bench", [{"backend": "realsense", "serial_number": "'1'"}], indirect=True)
def test_a_camera_that_cannot_be_used_here_is_no_crash(bench):
    if importlib.util.find_spec("pyrealsense2") is not None:
        pytest.skip("there is a librealsense")
    bench.wait_for_report(
        lambda s: s.level == DiagnosticStatus.ERROR and "2.53.1" in s.message, "the reason"
    )
    assert bench.lifecycle_state() == State.PRIMARY_STATE_UNCONFIGURED
    assert not bench.change_state(Transition.TRANSITION_CONFIGURE)
    assert bench.lifecycle_state() == State.PRIMARY_STATE_UNCONFIGURED
    bench.end()


def test_bad_parameters_end_it_with_a_sentence(domain):
    for parameters, words in (
        ({"backend": "zed"}, "parameter backend is 'zed', it must be one of sim, realsense"),
        ({"clock": "sundial"}, "parameter clock is 'sundial', it must be one of device, host"),
        ({"jump_limit": 0.0}, "jump_limit"),
    ):
        assert_refused(MODULE, words, **parameters)


plain_bench = shared_bench(Bench)


def test_odometry_in_ros_axes_stamped_by_the_device(plain_bench):
    bench = plain_bench
    bench.wait(lambda: len(bench.samples) >= 400, "400 samples")
    times = np.array([stamps.to_ns(sample.header.stamp) for sample in bench.samples])
    assert not (times % PERIOD_NS).any()
    assert np.diff(times).min() > 0
    levels = set()
    for sample, time_ns in zip(bench.samples, times, strict=True):
        assert (sample.header.frame_id, sample.child_frame_id) == ("t265_odom", "t265_link")
        p, q = sample.pose.pose.position, sample.pose.pose.orientation
        v = sample.twist.twist.linear
        distance = SPEED * time_ns * 1e-9
        pose = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
        base = base_pose(pose, tuple(FIGURES.position), (0.0, 0.0, 0.0, 1.0))
        start = -FIGURES.position
        noise = 24 * (FIGURES.position_noise + 0.3 * FIGURES.attitude_noise)
        assert base[:3] == pytest.approx(
            (start[0] + distance, start[1], start[2]), abs=noise + 0.01 * distance
        )
        error = Rotation.from_quat(pose[3:]).magnitude()
        assert error < 24 * FIGURES.attitude_noise + FIGURES.drift
        assert (v.x, v.y, v.z) == pytest.approx((SPEED, 0, 0), abs=24 * FIGURES.velocity_noise)
        covariance = np.reshape(sample.pose.covariance, (6, 6))
        confidence = round(3 - np.log10(covariance[0, 0] / 0.01))
        expected = [0.01 * 10 ** (3 - confidence)] * 3 + [0.01 * 10 ** (1 - confidence)] * 3
        assert covariance == pytest.approx(np.diag(expected))
        assert list(sample.twist.covariance) == list(sample.pose.covariance)
        levels.add(confidence)
    assert 3 in levels and 0 not in levels

    values = bench.wait_for_good_report()
    assert (values["state"], values["backend"], values["tracker_confidence"]) == (
        "tracking",
        "sim",
        "3",
    )
    assert float(values["rate"]) > 0.0  # of the clock on the wall, which a busy machine stretches
    assert 1e9 * (len(times) - 1) / (times[-1] - times[0]) > 50.0
    assert (values["jumps"], values["invalid"], values["reconnects"]) == ("0", "0", "0")


def test_a_deactivated_driver_gives_the_port_back(plain_bench):
    plain_bench.check_deactivation()
    plain_bench.end(signal.SIGINT)
