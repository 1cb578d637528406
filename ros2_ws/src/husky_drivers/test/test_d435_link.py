"""The D435's gate and its link: which frames are good, and what the driver does with each."""

import errno
import math
import socket
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from husky_drivers import camera_link
from husky_drivers.camera_link import CameraState
from husky_drivers.d435.frames import DepthFrame, Intrinsics
from husky_drivers.d435.gate import DepthGate, Verdict
from husky_drivers.d435.link import D435Link, DepthLinkConfig
from husky_drivers.d435.sim import SimBackend

GOOD, COVERED, STUCK = Verdict.GOOD, Verdict.COVERED, Verdict.STUCK
REPEATED, INVALID = Verdict.REPEATED, Verdict.INVALID
PINHOLE = Intrinsics(10, 8, 7.0, 7.0, 4.5, 3.5)
DARK = np.zeros((8, 10), np.uint16)


def picture(number):
    """A picture, other for each number, half of it without depth."""
    depth = np.random.default_rng(number).integers(500, 2000, (8, 10)).astype(np.uint16)
    depth[:, :5] = 0
    return depth


def frame_of(number, depth=None, time_ms=None, **other):
    return DepthFrame(
        number=number,
        time_ms=1000.0 + 100.0 * number if time_ms is None else time_ms,
        intrinsics=other.get("intrinsics", PINHOLE),
        depth_unit=other.get("depth_unit", 1e-3),
        depth=picture(number) if depth is None else depth,
    )


# The gate ---------------------------------------------------------------------------------------
def judged(gate, *frames):
    return [gate.judge(frame) for frame in frames]


def test_frames_in_order_are_good_and_gaps_are_counted():
    gate = DepthGate()
    assert judged(gate, *map(frame_of, (3, 4, 7, 8))) == [GOOD] * 4
    assert (gate.counters.good, gate.counters.missed) == (4, 2)
    assert gate.valid == 0.5


def test_the_same_image_with_a_new_time_is_stuck_until_another_comes():
    gate = DepthGate()
    frames = [frame_of(0), *(frame_of(k, picture(0)) for k in (1, 2, 3)), frame_of(4)]
    assert judged(gate, *frames) == [GOOD, STUCK, STUCK, STUCK, GOOD]
    assert (gate.counters.good, gate.counters.stuck, gate.counters.missed) == (2, 3, 0)


@pytest.mark.parametrize(("valid", "verdict"), [(0, COVERED), (3, COVERED), (4, GOOD), (80, GOOD)])
def test_an_image_with_hardly_any_depth_is_covered(valid, verdict):
    """The limit is a share of 5 %: 4 of the 80 pixels."""
    depth = DARK.copy()
    depth.flat[:valid] = 700
    gate = DepthGate()
    assert judged(gate, frame_of(0), frame_of(1, depth)) == [GOOD, verdict]
    assert (gate.counters.good, gate.counters.covered) == (2, verdict is COVERED)
    assert gate.valid == valid / 80


@pytest.mark.parametrize("least_valid", [0.0, 0.05])
def test_images_without_any_depth_are_covered_and_never_stuck(least_valid):
    gate = DepthGate(least_valid)
    assert judged(gate, *(frame_of(k, DARK) for k in range(3))) == [COVERED] * 3


def test_a_time_that_stands_still_is_a_repeat():
    gate = DepthGate()
    again = replace(frame_of(3), time_ms=frame_of(2).time_ms)
    frames = [frame_of(1), frame_of(2), frame_of(2), again, frame_of(1), frame_of(3)]
    assert judged(gate, *frames) == [GOOD, GOOD, REPEATED, REPEATED, REPEATED, GOOD]
    assert (gate.counters.repeated, gate.counters.missed) == (3, 0)


def test_a_camera_that_starts_again_is_believed():
    """At once near its time 0, else once it has gone on for some frames."""
    gate = DepthGate()
    assert judged(gate, frame_of(50), frame_of(0, picture(50), time_ms=400.0)) == [GOOD, GOOD]
    assert judged(gate, frame_of(1, time_ms=500.0)) == [GOOD]
    assert gate.counters.clock_restarts == 1
    assert judged(gate, frame_of(50)) == [GOOD]
    later = judged(gate, *(frame_of(k, time_ms=600.0 + 100.0 * k) for k in range(8)))
    assert later == [REPEATED] * 4 + [GOOD] * 4
    assert gate.counters.clock_restarts == 2


@pytest.mark.parametrize(
    "changes",
    [
        *({"intrinsics": PINHOLE._replace(**{key: value})}
          for key in ("fx", "fy") for value in (0.0, -7.0, math.nan, math.inf)),
        *({"intrinsics": PINHOLE._replace(**{key: value})}
          for key in ("cx", "cy") for value in (math.nan, -math.inf)),
        {"intrinsics": PINHOLE._replace(width=8, height=10)},
        *({"depth_unit": unit} for unit in (0.0, -1e-3, 1.0, math.nan)),
        *({"time_ms": time_ms} for time_ms in (-1.0, math.nan, math.inf)),
    ],
)  # fmt: skip
def test_an_impossible_frame_is_dropped_and_changes_nothing(changes):
    gate = DepthGate()
    bad = frame_of(1, **changes)
    assert judged(gate, bad, frame_of(0), bad, frame_of(1)) == [INVALID, GOOD, INVALID, GOOD]
    assert (gate.counters.invalid, gate.counters.good) == (2, 2)


# The link ---------------------------------------------------------------------------------------
class Script:
    """A backend that does, poll by poll, what it is told; the clock goes by 0.1 s at each.

    A step is a list of frames, an error to raise, or what is called. `open` takes its next error.
    """

    path = "script"
    retry_period = 0.0

    def __init__(self, steps, openings=()):
        self.steps, self.openings = list(steps), list(openings)
        self.now, self.taken_numbers, self.closed = 0.0, [], 0
        self.over = threading.Event()

    def open(self):
        if self.openings and (error := self.openings.pop(0)):
            raise error

    def poll(self, timeout):
        if not self.steps:
            self.over.set()
            time.sleep(0.001)
            return ()
        self.now += 0.1
        step = self.steps.pop(0)
        if isinstance(step, OSError):
            raise step
        return (step() or ()) if callable(step) else step

    def taken(self, frame):
        self.taken_numbers.append(frame.number)

    def close(self):
        self.closed += 1

    def counters(self):
        return {}


@pytest.fixture
def play(monkeypatch):
    """Run a link through a script; return it with what it has handed out and said."""

    def run(steps, openings=(), **config):
        script = Script(steps, openings)
        clock = SimpleNamespace(monotonic=lambda: script.now, time_ns=lambda: 12)
        monkeypatch.setattr(camera_link, "time", clock)
        out, events = [], []
        world = config.pop("world_time", lambda: None)
        link = D435Link(
            script,
            DepthLinkConfig(**config),
            lambda frame, host_ns: out.append((frame.number, host_ns)),
            events.append,
            world,
        )
        link.start()
        assert script.over.wait(60.0), f"the script is not over; {events}"
        state = link.state
        link.stop()
        assert link.state is CameraState.STOPPED
        return SimpleNamespace(link=link, script=script, out=out, events=events, state=state)

    return run


def test_every_frame_is_taken_and_the_good_ones_are_handed_out(play):
    frames = [
        frame_of(0),
        frame_of(1, picture(0)),
        frame_of(2, depth_unit=1.0),
        frame_of(2, DARK),
        frame_of(2),
        frame_of(3),
    ]
    played = play([frames[:2], frames[2:]])
    assert played.out == [(0, 12), (2, 12), (3, 12)]
    assert played.script.taken_numbers == [0, 1, 2, 2, 2, 3]


def test_the_states_of_a_stream(play):
    quiet = [[]] * 6  # 0.6 s
    played = play(
        [
            [frame_of(0)],
            [frame_of(1, picture(0))],
            [frame_of(2, DARK)],
            *quiet,
            [frame_of(3)],
            *[[frame_of(3)]] * 6,
        ]
    )
    assert played.events == [
        "waiting for the first frame",
        "streaming",
        "stuck",
        "covered",
        "frozen",
        "streaming",
        "frozen",  # repeats are no new frames
    ]
    assert (played.link.times_frozen, played.link.connections) == (2, 1)


def test_a_device_that_is_gone_is_opened_again(play):
    gone = OSError(errno.ECONNRESET, "hung up")
    missing = OSError(errno.ENOENT, "no such socket")
    played = play([[frame_of(0)], gone, [frame_of(0, time_ms=1.0)]], [missing, None, missing])
    assert played.out == [(0, 12), (0, 12)]
    assert played.events == [
        "no device: no such socket",
        "waiting for the first frame",
        "streaming",
        "no device: hung up",
        "no device: no such socket",
        "waiting for the first frame",
        "streaming",
    ]
    assert (played.link.connections, played.link.error, played.script.closed) == (2, "", 4)
    assert played.state is CameraState.STREAMING


def test_a_silent_device_is_opened_again(play):
    played = play([[frame_of(0)], *[[]] * 12], silence_timeout=1.0)
    assert played.link.connections == 2
    assert "no device: no frame for 1 s" in played.events
    assert played.state is CameraState.WAITING


def test_a_device_whose_world_stands_still_is_kept(play):
    played = play([[frame_of(0)], *[[]] * 50], silence_timeout=1.0, world_time=lambda: 1.0)
    assert (played.link.connections, played.link.times_frozen) == (1, 0)
    assert played.state is CameraState.STREAMING


def test_a_socket_that_accepts_nobody_does_not_hold_the_driver_up(tmp_path):
    """A world that stands still leaves connections in the queue; the next one is an error."""
    path = str(tmp_path / "d435")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen(1)
        backend = SimBackend(path)
        with pytest.raises(BlockingIOError):
            for _ in range(10):
                backend.open()
                backend.close()
        backend.close()
