"""The process `rc_transmitter` with a joystick, a clock and a pseudo-terminal as the line."""

import os
import subprocess
import sys
import time

import pytest

pytest.importorskip("rclpy")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Joy

from husky_description import graph
from husky_description.nodes import qos, stamps
from husky_description.pty_port import PtyPort
from husky_pu.sbus import BAUD, Channel, SbusParser

pytestmark = pytest.mark.graph

STICKS = [0.0, -1.0, 0.0, -0.5, 0.0]
BUTTONS = [0, 0, 0, 0, 0, 0, 0, 1]


class Bench:
    """The far end of the line, the process, and a node that is joystick and clock."""

    def __init__(self, directory, **parameters):
        self.domain = 1 + os.getpid() % 100
        self.port = PtyPort(directory / "sbus")
        self.parser = SbusParser()
        self.frames, self.reports = [], []
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = Node("tester", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.joy_publisher = self.node.create_publisher(Joy, graph.JOY, qos.COMMAND)
        self.clock_publisher = self.node.create_publisher(Clock, graph.CLOCK, qos.CLOCK)
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
            [sys.executable, "-m", "husky_pu.nodes.rc_transmitter", "--ros-args", *settings],
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )

    def step(self):
        self.executor.spin_once(timeout_sec=0.01)
        self.frames += self.parser.feed(self.port.read(BAUD))

    def wait(self, condition, what, each=lambda: None):
        """Spin until something is true, as long as it takes on a slow machine."""
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, f"waited in vain: {what}; {self.reports[-1:]}"
            assert self.process.poll() is None, self.process.communicate()[1]
            each()
            self.step()

    def joy(self, axes=STICKS, buttons=BUTTONS):
        self.joy_publisher.publish(Joy(axes=axes, buttons=buttons))

    def clock(self, milliseconds):
        """Publish a time and wait until every frame that it makes due is here."""
        message = Clock()
        stamps.fill(message.clock, 1_000_000 * milliseconds)
        self.clock_publisher.publish(message)

    def discover(self):
        self.wait(
            lambda: (
                self.clock_publisher.get_subscription_count()
                and self.joy_publisher.get_subscription_count()
            ),
            "the node's subscriptions",
        )
        self.clock(0)
        self.wait(lambda: self.reports, "a report")

    def close(self):
        self.process.kill()
        self.process.wait()
        self.port.close()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def bench(tmp_path, request):
    bench = Bench(tmp_path, **getattr(request, "param", {}))
    yield bench
    bench.close()


def test_in_lockstep_each_14_ms_of_the_clock_has_its_frame(bench):
    bench.discover()
    sent = 0
    for time_ms in range(10, 1010, 10):
        bench.clock(time_ms)
        due = (time_ms + 10) // 14
        bench.wait(lambda due=due: len(bench.frames) >= due, f"frame {due} at {time_ms} ms")
        assert len(bench.frames) == due
        sent = due
    assert sent == 72
    assert all(frame.failsafe for frame in bench.frames)  # there was no joystick
    assert bench.frames[-1].pulses[Channel.THROTTLE] == 1000
    bench.clock(10)  # the world is reset
    bench.wait(lambda: len(bench.frames) > sent, "a frame of the new time")
    assert (bench.parser.garbage_bytes, bench.port.host_baud) == (0, BAUD)


@pytest.mark.parametrize("bench", [{"time": "hardware"}], indirect=True)
def test_sticks_failsafe_and_a_line_that_vanishes(bench):
    bench.wait(
        lambda: bench.frames and not bench.frames[-1].failsafe, "sticks in a frame", bench.joy
    )
    found = bench.frames[-1].pulses
    assert found[Channel.THROTTLE] == 1000
    assert found[Channel.ROLL] == pytest.approx(1745, abs=1)
    assert found[Channel.ARM] == 2000
    bench.wait(lambda: bench.frames[-1].failsafe, "failsafe without a joystick")
    assert bench.frames[-1].frame_lost
    bench.reports.clear()
    bench.wait(
        lambda: bench.reports and "refused" in str(bench.reports[-1]) and any(
            pair.key == "refusal" and "is nan" in pair.value for pair in bench.reports[-1].values
        ),
        "a report of a refused message",
        lambda: bench.joy([float("nan")] * 5),
    )  # fmt: skip
    assert bench.frames[-1].failsafe
    bench.port.unplug()
    bench.reports.clear()
    bench.wait(
        lambda: any(report.level == DiagnosticStatus.ERROR for report in bench.reports),
        "a report of the lost line",
    )
    bench.port.replug()
    count = len(bench.frames)
    bench.wait(lambda: len(bench.frames) > count + 10, "frames on the new line")
    bench.process.terminate()
    assert bench.process.wait(30.0) == 0


def test_a_bad_period_ends_it_with_a_sentence(bench):
    bench.process.kill()
    bench.process.wait()
    bench.process = bench.start(period=0.01)
    _, errors = bench.process.communicate(timeout=60.0)
    assert bench.process.returncode == 1
    assert "parameter period is 0.01 s, it must be 0.007 or 0.014 s" in errors
