"""The driver's session and the emulated device on one wire, in simulated time, with faults.

The last tests run the driver's thread on a pseudo-terminal.
"""

import dataclasses
import math
import threading
import time
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_description.rotation import swap_body, swap_world_and_body
from husky_drivers.vn200 import link as link_module
from husky_drivers.vn200.binary import IMU_LAYOUT, BinaryOutput
from husky_drivers.vn200.imu import GravityCheck, ImuFigures
from husky_drivers.vn200.link import Vn200Link
from husky_drivers.vn200.protocol import BAUDS, AsyncType, encode_ascii
from husky_drivers.vn200.session import SessionConfig, SessionState, Vn200Session
from husky_runtime.ports.pty_port import PtyPort, receive
from husky_sim.devices.vn200.device import Vn200Device, Vn200Options
from husky_sim.devices.vn200.registers import Vn200Settings

FIGURES = ImuFigures.of(load_robot().imu)
PERIOD = 0.00125
TILT = Rotation.from_euler("xyz", [0.2, -0.1, 2.5])
POSE = (tuple(TILT.as_quat()), (0.5, -0.25, 1.0), (1.0, 2.0, 9.0))


class Wire:
    """Session and device, joined by a UART each; one step is one sample.

    Without the plug both talk on and are not heard, as with a cut cable behind a USB adapter.
    """

    def __init__(self, **options):
        self.device = Vn200Device(FIGURES, 3, Vn200Options(**options))
        self.session = Vn200Session(SessionConfig())
        self.now = 0.0
        self.ticks = 0
        self.samples = []
        self.plugged = True
        self.session.start(0.0)

    def step(self):
        self.ticks += 1
        self.now = self.ticks * PERIOD
        session, device = self.session, self.device
        device.sample(round(self.now * 1e9), *POSE)
        if self.now >= session.deadline:
            sent = session.poll(self.now)
            if sent and self.plugged:
                device.feed(receive(sent, session.baud, device.baud))
        output = device.take_output()
        if output and self.plugged:
            arrived = receive(output, device.baud, session.baud)
            self.samples += session.feed(arrived, self.now)
        if session.reopen_wanted:
            session.start(self.now)

    def run(self, duration):
        for _ in range(round(duration / PERIOD)):
            self.step()

    def time_to_stream(self, limit=3.0):
        start = self.now
        count = len(self.samples)
        while len(self.samples) <= count or self.session.state is not SessionState.STREAMING:
            assert self.now - start < limit, f"still {self.session.state.value}"
            self.step()
        return self.now - start


def streaming_wire(**options):
    wire = Wire(**options)
    wire.time_to_stream()
    wire.run(0.05)
    return wire


@pytest.mark.parametrize("at_new", [False, True])
def test_from_power_on_to_samples_without_a_gap(at_new):
    wire = Wire(replies_at_new_baud=at_new)
    assert wire.time_to_stream() < 0.5
    first = wire.ticks
    wire.run(1.0)
    times = [int(values[0]) for values in wire.samples]
    assert times == [round(tick * PERIOD * 1e9) for tick in range(first, wire.ticks + 1)]
    assert wire.session.samples.counters.missed == 0
    assert wire.session.parser.counters.crc_errors == 0


def test_the_samples_are_the_world_in_ros_axes_but_for_noise():
    wire = streaming_wire()
    _, x, y, z, w, *rest = wire.samples[-1]
    error = Rotation.from_quat(swap_world_and_body((x, y, z, w))) * TILT.inv()
    assert error.magnitude() < 5 * FIGURES.heading_error
    assert swap_body(tuple(rest[:3])) == pytest.approx(POSE[1], abs=6 * FIGURES.gyro_noise)
    assert swap_body(tuple(rest[3:])) == pytest.approx(POSE[2], abs=6 * FIGURES.accel_noise)


@pytest.mark.parametrize("baud", [b for b in BAUDS if b >= 19200])
def test_a_device_left_at_any_rate_is_found(baud):
    """9600 baud cannot carry the factory's 40 Hz of YPR: the device refuses it itself."""
    wire = Wire()
    wire.device.feed(encode_ascii(f"VNWRG,05,{baud}"))
    while wire.device.baud != baud:
        wire.device.take_output()
    assert wire.time_to_stream() < 1.5


# What somebody has saved in the device ------------------------------------------------------------
def output(text):
    return BinaryOutput.from_fields(text.split(","))


OFF = output("0,1,00")


@pytest.mark.parametrize(
    "saved",
    [
        # Beside 800 Hz of ours this is 880 kbit/s more than the line has: "insufficient baud rate".
        {"baud": 921600, "outputs": (OFF, output("1,1,05,0139,0600"), OFF)},
        {"outputs": (output("1,80,01,0009"), output("1,80,01,0008"), output("3,40,01,0010"))},
        {"baud": 460800, "async_rate": 200, "async_type": AsyncType.QTN},
        {"protocol": (2, 1, 0, 0, 2, 0, 0)},
        {"protocol": (0, 0, 0, 0, 0, 0, 2)},
    ],
)
def test_whatever_is_saved_nothing_but_our_packets_is_on_the_line(saved):
    wire = Wire(saved=Vn200Settings(**saved))
    assert wire.time_to_stream() < 0.5
    before = dataclasses.replace(wire.session.parser.counters)
    wire.run(0.2)
    counters = wire.session.parser.counters
    assert counters.packet_bytes - before.packet_bytes == counters.bytes - before.bytes == 160 * 54
    assert wire.session.setup.changes


def test_a_device_refuses_more_output_than_its_line_carries():
    """Else the case before would show nothing."""
    wire = Wire(saved=Vn200Settings(baud=921600, outputs=(OFF, output("1,1,05,0139,0600"), OFF)))
    wire.device.feed(encode_ascii("VNWRG,75,1,1,01,0131"))
    assert b"$VNERR,0C*02\r\n" in wire.device.take_output()


def test_output_that_others_turn_on_later_is_counted_as_garbage():
    wire = streaming_wire()
    before = wire.session.parser.counters.garbage_bytes
    wire.device.feed(encode_ascii("VNWRG,76,1,4,01,0009"))
    wire.run(1.0)
    assert wire.session.state is SessionState.STREAMING
    assert wire.session.parser.counters.garbage_bytes - before == pytest.approx(200 * 26, abs=52)


def test_a_turned_frame_turns_all_samples_and_is_refused():
    rows = (0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    wire = Wire(saved=Vn200Settings(frame=rows))
    wire.run(1.0)
    assert wire.session.state is SessionState.CONFIGURING
    assert wire.session.problem.startswith("reference frame rotation (register 26) is 0,1,0,-1,")
    wire.device.feed(encode_ascii("VNWRG,26,1,0,0,0,1,0,0,0,1") + encode_ascii("VNWNV"))
    wire.device.feed(encode_ascii("VNRST"))
    assert wire.time_to_stream() < 1.5
    assert swap_body(wire.samples[-1][8:]) == pytest.approx(POSE[2], abs=6 * FIGURES.accel_noise)


@pytest.mark.parametrize("tared", [False, True])
def test_a_tare_shows_in_the_direction_of_gravity(tared):
    """A device 17 deg off level that is told to call that level; ten samples a second for 20 s."""
    device = Vn200Device(FIGURES, 3)
    check = GravityCheck()
    tilt = Rotation.from_euler("xyz", [0.3, 0.0, 2.0])
    pose = (tuple(tilt.as_quat()), (0.0, 0.0, 0.0), tuple(tilt.inv().apply((0.0, 0.0, 9.81))))
    device.sample(0, *pose)
    if tared:
        device.feed(encode_ascii("VNTAR"))
    device.feed(encode_ascii("VNWRG,06,0") + encode_ascii("VNWRG,05,921600"))
    device.take_output()
    device.take_output()
    device.feed(encode_ascii("VNWRG,75,1,1,01,0131"))
    device.take_output()
    for tick in range(1, 200):
        device.sample(tick * 100_000_000, *pose)
        check.take(IMU_LAYOUT.unpack_from(device.take_output()))
        if tick == 150:  # the mean has 0.8 of its weight after 10 ln 5 = 16.1 s
            assert math.isnan(check.angle) and not check.disagrees
    assert check.angle == pytest.approx(0.3 if tared else 0.0, abs=4 * FIGURES.tilt_error)
    assert check.disagrees is tared


@pytest.mark.parametrize(
    ("fault", "share"), [("garbage", 0.95), ("truncate", 0.35), ("flip_bits", 0.25)]
)
def test_damage_costs_samples_and_nothing_else(fault, share):
    wire = streaming_wire()
    wire.device.inject(fault)
    before = len(wire.samples)
    wire.run(1.0)
    got = len(wire.samples) - before
    assert got > share * 800
    assert wire.session.state is SessionState.STREAMING
    counters = wire.session.parser.counters
    assert counters.garbage_bytes > 1000
    wire.device.inject("")
    before = len(wire.samples)
    wire.run(0.5)
    assert len(wire.samples) - before >= 399  # at most the first is hidden by what was cut before
    assert all(abs(values[10] - wire.samples[0][10]) < 1.0 for values in wire.samples)


def test_a_stopped_device_is_noticed_and_back_within_a_second():
    wire = streaming_wire()
    wire.device.inject("stop")
    wire.run(0.06)
    assert wire.session.state is SessionState.STALE
    wire.run(2.0)
    wire.device.inject("")
    assert wire.time_to_stream() < 1.0


def test_a_frozen_device_yields_no_samples_and_is_back_at_once():
    wire = streaming_wire()
    wire.device.inject("repeat")
    before = len(wire.samples)
    wire.run(1.0)
    assert len(wire.samples) == before
    assert wire.session.state is SessionState.STALE
    wire.device.inject("")
    assert wire.time_to_stream() < 0.01


def test_a_power_cycle_is_survived():
    wire = streaming_wire()
    wire.device.inject("power_cycle")
    wire.run(0.05 + 2 * PERIOD)
    assert wire.time_to_stream() < 1.0


def test_a_power_cycle_of_a_device_that_keeps_quiet_is_survived():
    """Nothing tells of the wrong rate then but the want of answers."""
    wire = streaming_wire()
    wire.device.feed(encode_ascii("VNRFS"))
    wire.run(0.06)
    wire.device.feed(encode_ascii("VNWRG,06,0"))
    wire.device.feed(encode_ascii("VNWNV"))
    wire.run(0.5)
    assert wire.time_to_stream() < 1.0
    assert wire.device.streaming


@pytest.mark.parametrize("pause", [0.02, 0.4, 3.0])
def test_an_unplugged_line_is_back_within_a_second(pause):
    wire = streaming_wire()
    wire.plugged = False
    wire.run(pause)
    wire.plugged = True
    assert wire.time_to_stream() < 1.0


@settings(max_examples=60)
@given(
    cuts=st.lists(st.tuples(st.integers(0, 300), st.integers(1, 900)), min_size=1, max_size=3),
    at_new=st.booleans(),
)
def test_a_line_cut_at_any_moment_of_the_dialogue_is_back_within_a_second(cuts, at_new):
    wire = Wire(replies_at_new_baud=at_new)
    for plugged, unplugged in cuts:
        wire.plugged = True
        wire.run(plugged * PERIOD)
        wire.plugged = False
        wire.run(unplugged * PERIOD)
    wire.plugged = True
    assert wire.time_to_stream() < 1.0


def test_all_packets_damaged_for_a_while():
    wire = streaming_wire()
    wire.device.inject("flip_bits", 50.0)
    wire.run(2.0)
    wire.device.inject("")
    assert wire.time_to_stream() < 1.5


# The thread and the pseudo-terminal -------------------------------------------------------------
class World(threading.Thread):
    """Serves a device on a port at about its own pace."""

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
                self.device.sample(tick * 1_250_000, *POSE)
                self.port.service(self.device)
            time.sleep(PERIOD)


class Reader:
    """A link with its samples; waits for things, as long as it takes."""

    def __init__(self, path, config=None, **options):
        self.samples = []
        self.states = []
        self.link = Vn200Link(
            str(path),
            config or SessionConfig(),
            lambda values, host_ns: self.samples.append(values),
            on_state=self.states.append,
            **options,
        )
        self.link.start()

    def wait(self, condition, what):
        end = time.monotonic() + 30.0
        while not condition():
            assert time.monotonic() < end, f"waited in vain: {what}; states {self.states}"
            time.sleep(0.005)

    def wait_for_samples(self, count=50):
        target = len(self.samples) + count
        self.wait(lambda: len(self.samples) >= target, f"{count} samples")


@pytest.fixture
def bench(tmp_path):
    with PtyPort(tmp_path / "vn200") as port:
        world = World(port)
        world.start()
        reader = Reader(port.path)
        yield world, reader
        reader.link.stop()
        world.running = False
        world.join()


def test_the_link_streams_from_a_pseudo_terminal(bench):
    _, reader = bench
    reader.wait_for_samples(200)
    assert reader.link.state == "streaming"
    assert reader.link.session.setup.model == "VN-200T-CR"
    assert reader.link.connections == 1


def test_the_link_comes_back_after_the_plug_was_pulled(bench):
    world, reader = bench
    reader.wait_for_samples()
    with world.lock:
        world.port.unplug()
    reader.wait(lambda: not reader.link.connected and reader.link.error, "the loss to be seen")
    assert reader.link.state == "no port"
    count = len(reader.samples)
    time.sleep(0.1)
    assert len(reader.samples) == count
    with world.lock:
        world.port.replug()
    reader.wait_for_samples()
    assert reader.link.connections == 2
    assert reader.link.error == ""


def test_the_link_follows_a_power_cycle_to_another_rate(bench):
    world, reader = bench
    reader.wait_for_samples()
    with world.lock:
        world.device.inject("power_cycle")
        assert world.device.baud == 115200
    reader.wait_for_samples()
    with world.lock:
        assert world.device.baud == 921600


def test_a_link_that_was_stopped_with_a_silent_device_does_not_open_its_port_again(
    tmp_path, monkeypatch
):
    """The world stands still; then the driver is stopped for 20 s, twice its patience."""
    looks, stopped = [], [0.0]

    def monotonic():
        looks.append(stopped[0])
        return time.monotonic() + stopped[0]

    clock = SimpleNamespace(monotonic=monotonic, time_ns=time.time_ns)
    monkeypatch.setattr(link_module, "time", clock)
    with PtyPort(tmp_path / "vn200") as port:
        world = World(port)
        world.start()
        reader = Reader(port.path, SessionConfig(silence_timeout=10.0), longest_look=0.1)
        reader.wait_for_samples()
        with world.lock:
            reader.wait(lambda: reader.link.session.state is SessionState.STALE, "no sample")
            stopped[0] = 20.0
            reader.wait(lambda: looks[-5:] == [20.0] * 5, "looks after the stop")
        reader.wait_for_samples()
        assert reader.link.connections == 1
        reader.link.stop()
        world.running = False
        world.join()


def test_the_link_waits_for_a_port_that_is_not_there_yet(tmp_path):
    path = tmp_path / "later"
    reader = Reader(path)
    reader.wait(lambda: reader.states, "the first report")
    assert reader.states[0] == f"no port: waiting for {path}"
    with PtyPort(path) as port:
        world = World(port)
        world.start()
        reader.wait_for_samples()
        reader.link.stop()
        world.running = False
        world.join()


def test_the_link_stops_whatever_it_is_doing(tmp_path):
    for _ in range(3):
        Reader(tmp_path / "nothing").link.stop()
    with PtyPort(tmp_path / "mute") as port:
        reader = Reader(port.path)
        reader.wait(lambda: reader.link.connected, "the port to be opened")
        reader.link.stop()
    assert not [thread for thread in threading.enumerate() if thread.name == "vn200"]
