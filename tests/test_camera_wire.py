"""The plant's wire of the depth camera against the driver's backend, without a graph."""

import dataclasses
import threading
import types

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.parameter import Parameter

from husky_description.robot import load_robot
from husky_drivers.d435.sim import SimBackend
from husky_runtime import graph
from husky_sim.nodes.camera_wire import CameraWire
from husky_sim.scene import WorldOptions
from husky_sim.world import World

ROBOT = load_robot()
PERIOD_NS = round(1e9 / ROBOT.d435.rate)
DUE_NS = PERIOD_NS + round(1e9 * ROBOT.d435.latency)
"""When the first image is sent [ns]."""
LATEST_NS = DUE_NS + 20_000_000
"""When the world waits for the driver, unless it has taken the image [ns]."""
GRACE = 0.5


@pytest.fixture(scope="module")
def context(domain):
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    yield context
    context.try_shutdown()


@pytest.fixture(scope="module")
def world():
    return World(ROBOT, WorldOptions(keyframe="stand"))


class Bench:
    """A world that stands still but for its time, the camera's wire, and the driver's end."""

    def __init__(self, context, world, path, lockstep, rate):
        port = Parameter("d435_port", value=str(path))
        self.node = rclpy.create_node("plant", context=context, parameter_overrides=[port])
        robot = dataclasses.replace(ROBOT, d435=dataclasses.replace(ROBOT.d435, rate=rate))
        self.world = types.SimpleNamespace(
            has_legs=True, robot=robot, model=world.model, data=world.data, time_ns=0
        )
        self.wire = CameraWire(self.node, self.world, 1, GRACE, lockstep)
        self.driver = SimBackend(str(path))
        self.connect()

    def connect(self):
        self.driver.open()
        self.wire.service()

    def advance_to(self, time_ns):
        """Tick on; return the time of the first tick that was not ready, None if all were."""
        waits = None
        while self.world.time_ns < time_ns:
            self.world.time_ns += graph.TICK_PERIOD_NS
            self.wire.advance()
            if waits is None and not self.wire.ready():
                waits = self.world.time_ns
        return waits

    def take(self):
        """Read frames and say that they are taken; return them."""
        frames = list(self.driver.poll(0.0))
        for frame in frames:
            self.driver.taken(frame)
        self.wire.service()
        return frames

    def reset(self):
        self.world.time_ns = 0
        self.wire.restart(1)

    def close(self):
        self.driver.close()
        self.wire.close()
        self.node.destroy_node()


@pytest.fixture
def make_bench(context, world, tmp_path):
    benches = []

    def make(lockstep=True, rate=ROBOT.d435.rate):
        benches.append(Bench(context, world, tmp_path / "d435", lockstep, rate))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


def test_the_world_waits_until_the_driver_has_taken_the_image(make_bench):
    bench = make_bench()
    assert bench.wire.is_set_up()
    assert bench.advance_to(LATEST_NS) == LATEST_NS
    (frame,) = bench.driver.poll(0.0)
    bench.wire.service()
    assert frame.time_ns == PERIOD_NS and not bench.wire.ready()
    bench.driver.taken(frame)
    assert bench.wire.service() and bench.wire.ready()
    assert bench.advance_to(LATEST_NS + PERIOD_NS) == LATEST_NS + PERIOD_NS
    assert [frame.number for frame in bench.take()] == [1]
    assert bench.wire.ready() and bench.wire.peer.losses == 0


@pytest.mark.parametrize("rate", [30.0, 60.0, 90.0])
def test_the_world_waits_before_the_next_image(make_bench, rate):
    bench = make_bench(rate=rate)
    assert bench.wire.is_set_up()
    period, latency = round(1e9 / rate), round(1e9 * ROBOT.d435.latency)
    waits = bench.advance_to(period + latency + period - graph.TICK_PERIOD_NS)
    assert period + latency < waits


def test_a_silent_driver_is_given_up(make_bench):
    """By a clock of the test's; it is awaited again as soon as it takes an image."""
    bench = make_bench()
    assert bench.wire.is_set_up()
    bench.advance_to(LATEST_NS)
    for step in range(100):
        bench.wire.await_answer(0.01 * step)
        assert bench.wire.ready() == (bench.wire.peer.losses > 0)
    assert bench.wire.peer.losses == 1
    bench.take()
    assert bench.advance_to(LATEST_NS + PERIOD_NS) == LATEST_NS + PERIOD_NS


def test_a_driver_that_comes_back_is_waited_for_again(make_bench):
    """An image that went nowhere is not waited for."""
    bench = make_bench()
    assert bench.wire.is_set_up()
    bench.advance_to(DUE_NS)
    bench.take()
    bench.wire.inject("d435", "unplug")
    assert bench.advance_to(LATEST_NS + PERIOD_NS) is None
    bench.wire.inject("d435", "")
    assert bench.advance_to(LATEST_NS + 2 * PERIOD_NS) is None
    bench.connect()
    assert bench.wire.ready()
    assert bench.advance_to(LATEST_NS + 3 * PERIOD_NS) == LATEST_NS + 3 * PERIOD_NS
    assert [frame.number for frame in bench.take()] == [3]
    assert bench.wire.ready() and bench.wire.peer.losses == 0


def test_an_image_on_its_way_to_a_driver_that_leaves_is_not_waited_for(make_bench):
    bench = make_bench()
    assert bench.wire.is_set_up()
    assert bench.advance_to(LATEST_NS) == LATEST_NS
    bench.driver.close()
    bench.wire.service()
    assert bench.wire.ready()


def test_a_reset_with_an_image_under_way(make_bench):
    """The image of the old run never comes, and its numbers do not come again."""
    bench = make_bench()
    assert bench.wire.is_set_up()
    bench.advance_to(DUE_NS)
    bench.take()
    bench.advance_to(2 * PERIOD_NS + graph.TICK_PERIOD_NS)
    bench.reset()
    assert bench.wire.is_set_up() and bench.wire.ready()
    assert bench.advance_to(LATEST_NS) == LATEST_NS
    (frame,) = bench.take()
    assert (frame.number, frame.time_ns) == (1, PERIOD_NS)


def test_a_reset_waits_for_a_driver_that_has_gone(make_bench):
    bench = make_bench()
    assert bench.wire.is_set_up()
    bench.driver.close()
    bench.wire.service()
    bench.reset()
    assert not bench.wire.is_set_up()
    bench.connect()
    assert bench.wire.is_set_up()


def test_in_realtime_exposures_that_the_rays_cannot_keep_up_with_are_left_out(make_bench):
    bench = make_bench(lockstep=False)
    cast, go_on = bench.wire._optics.image, threading.Event()

    def slow(*arguments):
        go_on.wait(60.0)
        return cast(*arguments)

    bench.wire._optics.image = slow
    assert bench.advance_to(10 * PERIOD_NS) is None and not bench.take()
    go_on.set()
    bench.wire._thread.submit(int).result(60.0)
    bench.advance_to(10 * PERIOD_NS + DUE_NS)
    numbers = [frame.number for frame in bench.take()]
    assert numbers[:2] == [0, 1] and len(numbers) <= 3


def test_there_is_no_camera_without_its_robot(make_bench):
    world = types.SimpleNamespace(has_legs=False)
    with pytest.raises(ValueError, match="camera is true, but body is 'unit'"):
        CameraWire(make_bench().node, world, 0, GRACE, True)
