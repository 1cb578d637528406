"""The simulated D435 on its wire, by way of the driver's own code: frames, messages, faults."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_description.robot import load_robot
from husky_drivers.d435.wire import START, FrameParser, encode, taken
from husky_sim.devices.d435.device import FAULTS, D435Device

FIGURES = load_robot().d435
SHAPE = FIGURES.height, FIGURES.width
PERIOD_NS = 100_000_000
PIXELS = SHAPE[0] * SHAPE[1]


def picture(number):
    """A picture of a scene beyond the dirt, other for each number."""
    pixels = 1000 + (np.arange(PIXELS) * (7 + number)) % 4000
    return pixels.reshape(SHAPE).astype(np.uint16)


def listening(fault="", intensity=None, seed=1):
    device = D435Device(FIGURES, seed)
    device.feed(START)
    device.inject(fault, intensity)
    return device


def send(device, number):
    """Send a picture; return the frames that arrive."""
    sent = device.send(number, number * PERIOD_NS, picture(number))
    frames = FrameParser().feed(device.take_output())
    assert [frame.number for frame in frames] == ([] if sent is None else [sent])
    return frames


def depth_of(device, number):
    return send(device, number)[0].depth


# The wire ---------------------------------------------------------------------------------------
def test_frames_arrive_as_they_were_taken():
    device = listening()
    for number in range(3):
        (frame,) = send(device, number)
        assert (frame.number, frame.time_ns) == (number, number * PERIOD_NS)
        assert np.array_equal(frame.millimetres(), picture(number))
        assert frame.intrinsics == pytest.approx(device.intrinsics)  # as floats of 32 bits
        assert frame.intrinsics[:2] == SHAPE[::-1]


def test_nothing_is_sent_to_a_host_that_does_not_listen():
    device = D435Device(FIGURES)
    assert send(device, 0) == [] and not device.streaming
    device.feed(START)
    assert [frame.number for frame in send(device, 1)] == [1]
    device.restart(2)
    assert device.streaming and send(device, 0)


def test_output_that_nobody_takes_is_bounded():
    device = listening()
    numbers = [device.send(number, 0, picture(0)) for number in range(40)]
    frame_size = len(encode(FrameParser().feed(device.take_output())[0]))
    fits = math.ceil((1 << 20) / frame_size)
    assert numbers == [*range(fits), *[None] * (40 - fits)]


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.one_of(st.integers(0, 2**32 - 1).map(taken), st.binary(max_size=12)), max_size=6),
    st.lists(st.integers(0, 80), max_size=6),
    st.booleans(),
)
def test_messages_may_come_in_pieces(messages, cuts, starts):
    """And with noise between them: pieces are heard as the whole is."""
    said = b"".join([*messages, START if starts else b"", *messages[::-1]])
    pieces = np.split(np.frombuffer(said, np.uint8), sorted(cuts))
    device, whole = D435Device(FIGURES), D435Device(FIGURES)
    for piece in pieces:
        device.feed(piece.tobytes())
    whole.feed(said)
    assert (device.streaming, device.taken) == (whole.streaming, whole.taken)
    assert device.streaming == (START in said)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=5), st.integers(1, 12))
def test_the_last_number_that_was_taken_counts(numbers, size):
    device = D435Device(FIGURES)
    assert device.taken == -1
    said = b"".join(taken(number) for number in numbers)
    for at in range(0, len(said), size):
        device.feed(said[at : at + size])
    assert device.taken == numbers[-1]


# Faults -----------------------------------------------------------------------------------------
def test_frozen_it_sends_nothing_and_then_goes_on():
    device = listening("freeze")
    assert send(device, 0) == [] and send(device, 1) == []
    device.inject("")
    (frame,) = send(device, 2)
    assert frame.number == 2 and np.array_equal(frame.depth, picture(2))


def test_stuck_it_repeats_its_last_image():
    device = listening()
    send(device, 0)
    device.inject("stuck")
    for number in (1, 2):
        (frame,) = send(device, number)
        assert (frame.number, frame.time_ns) == (number, number * PERIOD_NS)
        assert np.array_equal(frame.depth, picture(0))
    device.restart(1)
    assert np.array_equal(depth_of(device, 0), picture(0))
    assert np.array_equal(depth_of(device, 1), picture(0)), "a restart leaves the fault"
    device.inject("")
    assert np.array_equal(depth_of(device, 2), picture(2))


def test_covered_it_has_no_depth():
    assert not depth_of(listening("cover"), 0).any()


@pytest.mark.parametrize(("intensity", "share"), [(None, 0.2), (0.6, 0.6), (0.0, 0.0), (1.0, 1.0)])
def test_dirt_is_near_and_stays_where_it_is(intensity, share):
    device = listening("dirt", intensity)
    first, second = depth_of(device, 0), depth_of(device, 1)
    dirty = first != picture(0)
    assert np.array_equal(dirty, second != picture(1))
    assert dirty.sum() == round(share * PIXELS)
    assert np.all((first[dirty] >= 200) & (first[dirty] <= 500))
    if 0.0 < share < 1.0:
        assert not np.array_equal(first[dirty], second[dirty])
        # A spot: hardly a pixel has not the same beside it.
        assert np.mean(dirty[:, 1:] != dirty[:, :-1]) < 0.05
        bigger = depth_of(listening("dirt", 0.8), 0) != picture(0)
        assert np.all(bigger[dirty])
        assert not np.array_equal(depth_of(listening("dirt", intensity, 2), 0), first)


@pytest.mark.parametrize(("intensity", "share"), [(None, 0.3), (0.05, 0.05), (1.0, 1.0)])
def test_noise_is_anywhere_within_the_range(intensity, share):
    depth = depth_of(listening("noise", intensity), 0)
    wrong = depth != picture(0)
    bound = 5.0 * np.sqrt(share * (1.0 - share) / PIXELS) + 1e-3  # some are right by chance
    assert wrong.mean() == pytest.approx(share, abs=bound)
    near, far = 1e3 * FIGURES.range
    assert depth[wrong].min() >= near and depth[wrong].max() <= far
    spread = (far - near) / np.sqrt(12.0)
    middle = depth[wrong].mean()
    assert middle == pytest.approx((near + far) / 2, abs=6.0 * spread / np.sqrt(wrong.sum()))


@pytest.mark.parametrize(("intensity", "share"), [(None, 0.5), (0.1, 0.1), (0.0, 0.0), (1.0, 1.0)])
def test_garbage_is_no_frame_and_the_next_one_is_found(intensity, share):
    device, parser = listening("garbage", intensity), FrameParser()
    count, whole, frames = 40, [], []
    for number in range(count):
        sent = device.send(number, 0, picture(number))
        whole += [] if sent is None else [sent]
        frames += parser.feed(device.take_output())
    assert [frame.number for frame in frames] == whole
    assert all(np.array_equal(frame.depth, picture(frame.number)) for frame in frames)
    bound = 4.0 * np.sqrt(count * share * (1.0 - share))
    assert len(whole) == pytest.approx(count * (1.0 - share), abs=bound)
    assert parser.counters.bytes == count * len(encode(frames[0])) if frames else not whole


def test_a_power_cycle_counts_from_zero_and_its_time_goes_on():
    device = listening()
    send(device, 0)
    device.feed(taken(0))
    device.inject("power_cycle")
    assert device.taken == -1
    for number, frame_number in ((7, 0), (8, 1)):
        (frame,) = send(device, number)
        assert (frame.number, frame.time_ns) == (frame_number, number * PERIOD_NS)
        assert np.array_equal(frame.depth, picture(number))

    device.inject("power_cycle")
    assert send(device, 9)[0].number == 0


def test_after_a_reset_of_the_world_no_number_comes_again():
    """So a late `taken` answers no new frame; gaps stay gaps."""
    device = listening()
    send(device, 0)
    send(device, 3)
    device.restart(1)
    assert [send(device, number)[0].number for number in (0, 1, 5)] == [4, 5, 9]


@pytest.mark.parametrize("fault", ["", "dirt", "noise", "garbage"])
def test_a_frame_is_the_seeds(fault):
    """Whenever the host started to listen, and whatever failed before."""
    device = listening(fault, seed=5)
    frames = [device.send(k, 0, picture(k)) is not None for k in range(6)]
    data = device.take_output()
    late = D435Device(FIGURES, 9)
    late.inject("noise")
    late.send(0, 0, picture(3))
    late.feed(START)
    late.send(0, 0, picture(3))
    late.take_output()
    late.inject("power_cycle")  # frames count from 0
    late.inject(fault)
    late.restart(5)
    assert [late.send(k, 0, picture(k)) is not None for k in range(6)] == frames
    assert late.take_output() == data
    if fault:
        other = listening(fault, seed=6)
        for k in range(6):
            other.send(k, 0, picture(k))
        assert other.take_output() != data


def test_faults_are_refused_with_what_there_is():
    device = listening("cover")
    with pytest.raises(ValueError, match=f"no fault 'fog'; there are {', '.join(FAULTS)}"):
        device.inject("fog")
    for intensity in (-0.1, math.nan, 1.1):
        with pytest.raises(ValueError, match="must be within 0 and 1"):
            device.inject("dirt", intensity)
    assert not depth_of(device, 0).any(), "the fault from before stays"
