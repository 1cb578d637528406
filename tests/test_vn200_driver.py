"""The process `vn200_driver` against the emulated device on a pseudo-terminal."""

import os
import signal
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from node_bench import SensorBench, assert_refused, shared_bench
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu

from husky_description.robot import load_robot
from husky_drivers.vn200.binary import BinaryOutput, OutputLayout
from husky_drivers.vn200.imu import ImuFigures
from husky_drivers.vn200.protocol import encode_ascii
from husky_runtime import graph
from husky_runtime.nodes import stamps
from husky_sim.devices.vn200.device import Vn200Device, Vn200Options
from husky_sim.devices.vn200.registers import Vn200Settings

pytestmark = pytest.mark.graph

PERIOD_NS = 1_250_000
MODULE = "husky_drivers.nodes.vn200_driver"
FIGURES = ImuFigures.of(load_robot().imu)
TILT = Rotation.from_euler("xyz", [0.2, -0.1, 2.5])
POSE = (tuple(TILT.as_quat()), (0.5, -0.25, 1.0), (1.0, 2.0, 9.0))

OFF = BinaryOutput(0, 1, None)
OTHERS = BinaryOutput(1, 80, OutputLayout([0x0009]))
"""Binary output 2 that somebody has saved: 26 bytes, 10 times a second."""


class Bench(SensorBench):
    """An IMU that turns on the spot, at about its own pace, and its driver."""

    def __init__(self, domain, directory, **parameters):
        saved = Vn200Settings(outputs=(OFF, OTHERS, OFF))
        self.imu = Vn200Device(FIGURES, 5, Vn200Options(reset_time=0.0, saved=saved))
        super().__init__(domain, directory, MODULE, 0.00125, self._tick, Imu, graph.IMU)
        self.start(port=self.port.path, **parameters)

    def _tick(self, number):
        self.imu.sample((number + 1) * PERIOD_NS, *POSE)
        self.port.service(self.imu)


@pytest.fixture
def bench(domain, tmp_path, request):
    bench = Bench(domain, tmp_path, **getattr(request, "param", {}))
    yield bench
    bench.close()


def test_faults_of_line_and_device_are_reported_and_survived(bench):
    check_a_stop(bench)
    bench.check_the_plug()
    with bench.held():
        bench.imu.inject("truncate")
    values = bench.wait_for_report(lambda s: "damaged" in s.message, "a report of damage")
    assert int(values["truncated"]) > 0
    assert int(values["reconnects"]) == 1
    with bench.held():
        bench.imu.inject("")
        bench.imu.feed(encode_ascii("VNWRG,76,1,8,01,0009"))
    values = bench.wait_for_report(lambda s: "no packet of ours" in s.message, "strange output")
    assert float(values["garbage_rate"]) > 100.0
    with bench.held():
        bench.imu.inject("power_cycle")
    bench.wait_for_samples()
    bench.wait_for_good_report()
    with bench.held():
        bench.imu.inject("power_cycle")
        for request in ("VNWRG,26,0,1,0,-1,0,0,0,0,1", "VNWNV", "VNRST"):
            bench.imu.feed(encode_ascii(request))
    bench.wait_for_report(
        lambda s: s.level == DiagnosticStatus.ERROR and "$VNWRG,26,1,0,0,0,1" in s.message,
        "the turned frame",
    )


def check_a_stop(bench):
    """Stopped while the world stands, it says its last sample again: DDS may have dropped it."""
    bench.wait_for_samples()
    with bench.held():
        os.kill(bench.process.pid, signal.SIGSTOP)
        time.sleep(1.0)  # longer than a busy machine keeps a process waiting
        os.kill(bench.process.pid, signal.SIGCONT)
        bench.wait(lambda: len(set(map(stamp_of, bench.samples[-3:]))) == 1, "the last sample")
    bench.wait_for_samples()


def stamp_of(sample):
    return stamps.to_ns(sample.header.stamp)


@pytest.mark.parametrize("bench", [{"autostart": "false"}], indirect=True)
def test_without_autostart_it_waits_to_be_told(bench):
    assert bench.lifecycle_state() == State.PRIMARY_STATE_UNCONFIGURED
    assert not bench.port.connected
    assert bench.change_state(Transition.TRANSITION_CONFIGURE)
    assert bench.change_state(Transition.TRANSITION_ACTIVATE)
    bench.wait_for_samples()
    assert bench.change_state(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    bench.wait(lambda: not bench.port.connected, "the port to be closed")
    bench.end()


@pytest.mark.parametrize("bench", [{"clock": "host"}], indirect=True)
def test_stamps_of_the_hosts_clock(bench):
    bench.wait_for_samples(200)
    times = np.array([stamp_of(sample) for sample in bench.samples])
    assert np.diff(times).min() > 0
    assert abs(times[-1] - time.time_ns()) < 30 * 10**9
    bench.end()


def test_bad_parameters_end_it_with_a_sentence(domain):
    for parameters, words in (
        ({"rate": 300}, "rate is 300 Hz, it must be a divisor of 800"),
        ({"clock": "sundial"}, "parameter clock is 'sundial', it must be one of device, host"),
        ({"baud": 115200}, "fit into 115200 baud up to 213 Hz"),
    ):
        assert_refused(MODULE, words, **parameters)


plain_bench = shared_bench(Bench)


def test_samples_in_ros_axes_stamped_by_the_device(plain_bench):
    bench = plain_bench
    bench.wait_for_samples(400)
    times = np.array([stamp_of(sample) for sample in bench.samples])
    assert not (times % PERIOD_NS).any()
    assert np.diff(times).min() > 0
    for sample in bench.samples[:100]:
        assert sample.header.frame_id == "imu_link"
        q, w, a = sample.orientation, sample.angular_velocity, sample.linear_acceleration
        error = Rotation.from_quat((q.x, q.y, q.z, q.w)) * TILT.inv()
        assert error.magnitude() < 5 * FIGURES.heading_error
        assert (w.x, w.y, w.z) == pytest.approx(POSE[1], abs=6 * FIGURES.gyro_noise)
        assert (a.x, a.y, a.z) == pytest.approx(POSE[2], abs=6 * FIGURES.accel_noise)
    scatter = np.var([sample.angular_velocity.x for sample in bench.samples])
    assert bench.samples[0].angular_velocity_covariance[0] == pytest.approx(scatter, rel=0.4)
    scatter = np.var([sample.linear_acceleration.z for sample in bench.samples])
    assert bench.samples[0].linear_acceleration_covariance[8] == pytest.approx(scatter, rel=0.4)

    values = bench.wait_for_good_report()
    assert (values["state"], values["model"], values["baud"]) == (
        "streaming",
        "VN-200T-CR",
        "921600",
    )
    assert float(values["rate"]) > 100.0
    assert (values["crc_errors"], values["missed"], values["reconnects"]) == ("0", "0", "0")
    assert values["changed"].split("; ") == [
        "baud rate was 115200: set to 921600",
        "ASCII output VNYPR was on: turned off",
        "binary output 2 was on at 10 Hz (1,80,01,0009): turned off",
        "binary output 1 was 0,1,00: set to 1,1,01,0131",
    ]


def test_a_deactivated_driver_gives_the_port_back(plain_bench):
    plain_bench.check_deactivation()
    plain_bench.end(signal.SIGINT)
