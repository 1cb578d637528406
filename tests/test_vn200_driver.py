"""The process `vn200_driver` against the emulated device on a pseudo-terminal."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu

from husky_description import graph
from husky_description.nodes import qos, stamps
from husky_description.pty_port import PtyPort
from husky_description.robot import load_robot
from husky_drivers.vn200_imu import ImuFigures
from husky_sim.vn200_device import Vn200Device, Vn200Options

pytestmark = pytest.mark.graph

PERIOD_NS = 1_250_000
FIGURES = ImuFigures.of(load_robot().imu)
TILT = Rotation.from_euler("xyz", [0.2, -0.1, 2.5])
POSE = (tuple(TILT.as_quat()), (0.5, -0.25, 1.0), (1.0, 2.0, 9.0))


class World(threading.Thread):
    """Serves the device at about its own pace."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.device = Vn200Device(FIGURES, 5, Vn200Options(reset_time=0.0))
        self.port = port
        self.lock = threading.Lock()
        self.running = True

    def run(self):
        tick = 0
        while self.running:
            tick += 1
            with self.lock:
                self.device.sample(tick * PERIOD_NS, *POSE)
                self.port.service(self.device)
            time.sleep(0.00125)


class Bench:
    """Device, driver process and a listening node, in a ROS domain of their own."""

    def __init__(self, directory, **parameters):
        self.domain = 1 + os.getpid() % 100
        self.port = PtyPort(directory / "vn200")
        self.world = World(self.port)
        self.world.start()
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = Node("listener", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.samples = []
        self.reports = []
        self.node.create_subscription(Imu, graph.IMU, self.samples.append, qos.CONTROL)
        self.node.create_subscription(
            DiagnosticArray,
            graph.DIAGNOSTICS,
            lambda message: self.reports.append(message.status[0]),
            qos.STATUS,
        )
        self.process = self.start(port=str(self.port.path), **parameters)

    def start(self, **parameters):
        settings = [word for item in parameters.items() for word in ("-p", "{}:={}".format(*item))]
        environment = dict(os.environ)
        environment["ROS_DOMAIN_ID"] = str(self.domain)
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
        return subprocess.Popen(
            [sys.executable, "-m", "husky_drivers.nodes.vn200_driver", "--ros-args", *settings],
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )

    def wait(self, condition, what):
        """Spin until something is true, as long as it takes on a slow machine."""
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, (
                f"waited in vain: {what}; last report {self.reports[-1:]}"
            )
            assert self.process.poll() is None, self.process.communicate()[1]
            self.executor.spin_once(timeout_sec=0.1)

    def wait_for_samples(self, count=100):
        self.samples.clear()
        self.wait(lambda: len(self.samples) >= count, f"{count} samples")

    def wait_for_report(self, condition, what):
        self.reports.clear()
        self.wait(lambda: self.reports and condition(self.reports[-1]), what)
        return {pair.key: pair.value for pair in self.reports[-1].values}

    def call(self, service_type, name, request):
        client = self.node.create_client(service_type, f"/{graph.VN200_DRIVER}/{name}")
        self.wait(client.service_is_ready, f"service {name}")
        future = client.call_async(request)
        self.wait(future.done, f"answer of {name}")
        return future.result()

    def change_state(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        assert self.call(ChangeState, "change_state", request).success

    def lifecycle_state(self):
        return self.call(GetState, "get_state", GetState.Request()).current_state.id

    def end(self, number=signal.SIGTERM):
        """Return the exit code."""
        self.process.send_signal(number)
        try:
            return self.process.wait(30.0)
        finally:
            self.process.kill()

    def close(self):
        self.process.kill()
        self.process.communicate()
        self.world.running = False
        self.world.join()
        self.port.close()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def bench(tmp_path, request):
    bench = Bench(tmp_path, **getattr(request, "param", {}))
    yield bench
    bench.close()


def test_samples_in_ros_axes_stamped_by_the_device(bench):
    bench.wait_for_samples(400)
    times = np.array([stamps.to_ns(sample.header.stamp) for sample in bench.samples])
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

    values = bench.wait_for_report(lambda s: s.level == DiagnosticStatus.OK, "a good report")
    assert (values["state"], values["model"], values["baud"]) == (
        "streaming",
        "VN-200T-CR",
        "921600",
    )
    assert float(values["rate"]) > 100.0
    assert (values["crc_errors"], values["missed"], values["reconnects"]) == ("0", "0", "0")


def test_faults_of_line_and_device_are_reported_and_survived(bench):
    bench.wait_for_samples()
    with bench.world.lock:
        bench.port.unplug()
    bench.wait_for_report(lambda s: s.level == DiagnosticStatus.ERROR, "a report of the lost port")
    with bench.world.lock:
        bench.port.replug()
    bench.wait_for_samples()
    with bench.world.lock:
        bench.world.device.inject("truncate")
    values = bench.wait_for_report(lambda s: "damaged" in s.message, "a report of damage")
    assert int(values["truncated"]) > 0
    assert int(values["reconnects"]) == 1
    with bench.world.lock:
        bench.world.device.inject("power_cycle")
    bench.wait_for_samples()
    bench.wait_for_report(lambda s: s.level == DiagnosticStatus.OK, "a good report")


def test_a_deactivated_driver_gives_the_port_back(bench):
    bench.wait_for_samples()
    assert bench.lifecycle_state() == State.PRIMARY_STATE_ACTIVE
    bench.change_state(Transition.TRANSITION_DEACTIVATE)
    bench.wait(lambda: not bench.port.connected, "the port to be closed")
    assert bench.lifecycle_state() == State.PRIMARY_STATE_INACTIVE
    bench.change_state(Transition.TRANSITION_ACTIVATE)
    bench.wait_for_samples()
    assert bench.end(signal.SIGINT) == 0


@pytest.mark.parametrize("bench", [{"autostart": "false"}], indirect=True)
def test_without_autostart_it_waits_to_be_told(bench):
    assert bench.lifecycle_state() == State.PRIMARY_STATE_UNCONFIGURED
    assert not bench.port.connected
    bench.change_state(Transition.TRANSITION_CONFIGURE)
    bench.change_state(Transition.TRANSITION_ACTIVATE)
    bench.wait_for_samples()
    bench.change_state(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    bench.wait(lambda: not bench.port.connected, "the port to be closed")
    assert bench.end() == 0


@pytest.mark.parametrize("bench", [{"clock": "host"}], indirect=True)
def test_stamps_of_the_hosts_clock(bench):
    bench.wait_for_samples(200)
    times = np.array([stamps.to_ns(sample.header.stamp) for sample in bench.samples])
    assert np.diff(times).min() > 0
    assert abs(times[-1] - time.time_ns()) < 30 * 10**9
    assert bench.end() == 0


def test_bad_parameters_end_it_with_a_sentence(bench):
    bench.process.kill()
    bench.process.communicate()
    for parameters, words in (
        ({"rate": 300}, "rate is 300 Hz, it must be a divisor of 800"),
        ({"clock": "sundial"}, "parameter clock is 'sundial', it must be one of device, host"),
        ({"baud": 115200}, "fit into 115200 baud up to 213 Hz"),
    ):
        bench.process = bench.start(**parameters)
        _, errors = bench.process.communicate(timeout=60.0)
        assert bench.process.returncode == 1
        assert words in errors
