"""The driver's thread and the simulated T265 on a pseudo-terminal, with faults."""

import time

import pytest

from husky_description.robot import load_robot
from husky_drivers.t265.link import CameraState, LinkConfig, T265Link
from husky_drivers.t265.sim import SimBackend
from husky_drivers.t265.wire import BAUD
from husky_runtime.ports.pty_port import PtyPort
from husky_sim.devices.t265.device import T265Device

FIGURES = load_robot().t265
PERIOD_NS = 5_000_000
LEVEL = (0.0, 0.0, 0.0, 1.0)
ZERO = (0.0, 0.0, 0.0)


class Line:
    """A device on a port, and the driver's link at the other end."""

    def __init__(self, directory, **config):
        self.device = T265Device(FIGURES)
        self.port = PtyPort(directory / "t265")
        self.frames, self.events = [], []
        self.world_time = None
        self.link = T265Link(
            SimBackend(str(self.port.path)),
            LinkConfig(**config),
            lambda frame, host_ns: self.frames.append(frame),
            self.events.append,
            lambda: self.world_time,
        )
        self.tick = 0
        self.link.start()

    def run_until(self, condition, what):
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, f"waited in vain: {what}; {self.events}"
            self.device.sample(self.tick * PERIOD_NS, ZERO, LEVEL, ZERO, ZERO)
            self.tick += 1
            self.port.service(self.device)
            time.sleep(0.002)

    def frames_come(self):
        count = len(self.frames)
        self.run_until(lambda: len(self.frames) > count + 20, "frames")


PATIENT = {"stale_after": 1.0, "silence_timeout": 60.0}
"""A machine that stalls is no frozen device."""


@pytest.fixture
def line(tmp_path, request):
    line = Line(tmp_path, **getattr(request, "param", {}))
    yield line
    line.link.stop()
    line.port.close()


@pytest.mark.parametrize("line", [PATIENT], indirect=True)
def test_the_link_streams_survives_the_plug_and_ends(line):
    assert line.device.baud == BAUD
    line.frames_come()
    assert line.device.streaming
    numbers = [frame.number for frame in line.frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) or line.port.dropped
    line.port.unplug()
    line.run_until(lambda: line.link.state is CameraState.NO_DEVICE, "the loss")
    assert line.link.error
    line.port.replug()
    line.frames_come()
    assert (line.link.connections, line.link.error) == (2, "")
    counters = line.link.backend.counters()
    line.port.write(b"garbage \xa5\x65\x60\x00 garbage", BAUD)
    line.frames_come()
    assert line.link.backend.counters()["garbage_bytes"] > counters["garbage_bytes"]
    line.link.stop()
    line.run_until(lambda: not line.port.connected, "the port to be given back")
    assert line.link.state is CameraState.STOPPED


@pytest.mark.parametrize("line", [PATIENT], indirect=True)
def test_the_link_tells_of_what_the_tracking_does(line):
    line.run_until(lambda: line.link.state is CameraState.TRACKING, "tracking")
    line.device.inject("lost")
    line.run_until(lambda: line.link.state is CameraState.LOST, "lost")
    line.device.inject("freeze")
    line.run_until(lambda: line.link.state is CameraState.FROZEN, "frozen")
    line.device.inject("")
    line.run_until(lambda: line.link.state is CameraState.TRACKING, "tracking again")
    line.device.inject("jump", 5.0)
    line.run_until(lambda: line.link.gate.counters.jumps, "a jump")
    assert line.link.times_frozen >= 1
    assert line.link.connections == 1
    said = [event for event in line.events if not event.startswith("no device")]
    assert said[:4] == [
        "waiting for the first frame",
        "tracking, low confidence",
        "tracking",
        "tracking lost",
    ]
    assert any(event.startswith("the pose has jumped by") for event in said)


@pytest.mark.parametrize("line", [{"silence_timeout": 0.3}], indirect=True)
def test_a_silent_device_is_opened_again(line):
    line.frames_come()
    line.device.inject("freeze")
    line.run_until(lambda: line.link.connections >= 3, "the device to be opened again")
    line.device.inject("")
    line.frames_come()


@pytest.mark.parametrize("line", [{"silence_timeout": 0.3}], indirect=True)
def test_a_device_whose_world_stands_still_is_kept(line):
    """However long that is: nobody can tell a late frame from one that is not due."""
    line.frames_come()
    line.world_time = 1e-9 * line.tick * PERIOD_NS
    time.sleep(1.0)
    assert (line.link.connections, line.link.times_frozen) == (1, 0)
    line.device.inject("freeze")

    def reopened():
        line.world_time += 0.002
        return line.link.connections > 1

    line.run_until(reopened, "the device to be opened again")
