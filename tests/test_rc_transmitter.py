"""The process `rc_transmitter` with a joystick, a clock and a pseudo-terminal as the line."""

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from node_bench import NodeBench, assert_refused, values_of
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Joy

from husky_pu.radio.sbus import BAUD, SbusChannel, SbusParser
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.ports.pty_port import PtyPort

pytestmark = pytest.mark.graph

MODULE = "husky_pu.nodes.rc_transmitter"
STICKS = [0.0, -1.0, 0.0, -0.5, 0.0]
BUTTONS = [0, 0, 0, 0, 0, 0, 0, 1]


class Bench(NodeBench):
    """The far end of the line, the process, and a node that is joystick and clock."""

    def __init__(self, domain, directory, **parameters):
        super().__init__(domain, directory, MODULE)
        self.port = PtyPort(directory / "sbus")
        self.parser = SbusParser()
        self.frames = []
        self.joy_publisher = self.node.create_publisher(Joy, graph.JOY, qos.COMMAND)
        self.clock_publisher = self.node.create_publisher(Clock, graph.CLOCK, qos.CLOCK)
        self.start(port=self.port.path, **parameters)

    def wait(self, condition, what, each=lambda: None, timeout=0.01):
        def read():
            self.frames += self.parser.feed(self.port.read(BAUD))
            each()

        super().wait(condition, what, read, timeout)

    def joy(self, axes=STICKS, buttons=BUTTONS):
        self.joy_publisher.publish(Joy(axes=axes, buttons=buttons))

    def clock(self, milliseconds):
        """Publish a time."""
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

    def _give_back(self):
        self.port.close()
        super()._give_back()


@pytest.fixture
def bench(domain, tmp_path, request):
    bench = Bench(domain, tmp_path, **getattr(request, "param", {}))
    yield bench
    bench.close()


def test_in_lockstep_each_14_ms_of_the_clock_has_its_frame(bench):
    bench.discover()
    sent = 0
    for time_ms in range(10, 1010, 10):
        bench.clock(time_ms)
        due = (time_ms + 10) // 14
        bench.wait(
            lambda due=due: len(bench.frames) >= due,
            f"frame {due} at {time_ms} ms",
            lambda time_ms=time_ms: bench.clock(time_ms),  # it may be lost
        )
        assert len(bench.frames) == due
        sent = due
    assert sent == 72
    assert all(frame.failsafe for frame in bench.frames)  # there was no joystick
    assert bench.frames[-1].pulses[SbusChannel.THROTTLE] == 1000
    bench.wait(  # the world is reset
        lambda: len(bench.frames) > sent, "a frame of the new time", lambda: bench.clock(10)
    )
    assert (bench.parser.garbage_bytes, bench.port.host_baud) == (0, BAUD)


@pytest.mark.parametrize("bench", [{"time": "hardware"}], indirect=True)
def test_sticks_failsafe_and_a_line_that_vanishes(bench):
    bench.wait(
        lambda: bench.frames and not bench.frames[-1].failsafe, "sticks in a frame", bench.joy
    )
    found = bench.frames[-1].pulses
    assert found[SbusChannel.THROTTLE] == 1000
    assert found[SbusChannel.ROLL] == pytest.approx(1745, abs=1)
    assert found[SbusChannel.ARM] == 2000
    bench.wait(lambda: bench.frames[-1].failsafe, "failsafe without a joystick")
    assert bench.frames[-1].frame_lost
    bench.wait_for_report(
        lambda report: values_of(report)["refused_messages"] != "0",
        "a report of a refused message",
        lambda: bench.joy([float("nan")] * 5),
    )
    assert bench.frames[-1].failsafe
    bench.port.unplug()
    bench.wait_for_report(lambda r: r.level == DiagnosticStatus.ERROR, "a report of the lost line")
    bench.port.replug()
    count = len(bench.frames)
    bench.wait(lambda: len(bench.frames) > count + 10, "frames on the new line")


def test_a_bad_period_ends_it_with_a_sentence(domain):
    words = "parameter period is 0.01 s, it must be 0.007 or 0.014 s"
    assert_refused(MODULE, words, period=0.01)
