"""Stamps from the device's clock on a host whose clock drifts and whose reads come late."""

import numpy as np
import pytest

from husky_drivers.vn200.clock import DeviceClock, HostClock

PERIOD = 1_250_000
EPOCH = 1_700_000_000_000_000_000


def run(clock, seconds, drift, start=0, seed=0, offset=EPOCH):
    """Return stamp error [s] and arrival delay [s] of each sample."""
    generator = np.random.default_rng(seed)
    errors, delays = [], []
    for tick in range(start, start + int(seconds * 800)):
        device = tick * PERIOD
        true = offset + round(device * (1.0 + drift))
        late = generator.random() < 0.02
        delay = 600_000 + generator.exponential(100_000) + late * generator.uniform(0, 15e6)
        stamp = clock.stamp(device, true + int(delay))
        errors.append((stamp - true) * 1e-9)
        delays.append(delay * 1e-9)
    return np.array(errors), np.array(delays)


def test_the_devices_own_time():
    assert DeviceClock().stamp(5, 10**18) == 5


@pytest.mark.parametrize("drift", [0.0, 50e-6, -50e-6])
def test_jitter_is_taken_out_and_drift_followed(drift):
    clock = HostClock(latency=600e-6)
    errors, delays = run(clock, 60.0, drift)
    settled = errors[10 * 800 :]
    assert np.abs(settled).max() < 50e-6  # arrival jitters by 15 ms
    assert (delays - 600e-6)[10 * 800 :].max() > 0.014
    assert clock.drift == pytest.approx(drift, abs=3e-6)
    assert clock.resets == 0


def test_stamps_never_go_back():
    clock = HostClock()
    generator = np.random.default_rng(3)
    stamps = [
        clock.stamp(tick * PERIOD, EPOCH + tick * PERIOD + int(generator.exponential(2e6)))
        for tick in range(8000)
    ]
    assert np.diff(stamps).min() > 0


def test_a_device_that_starts_again_is_mapped_anew():
    clock = HostClock(latency=600e-6)
    run(clock, 5.0, 0.0)
    errors, _ = run(clock, 5.0, 0.0, offset=EPOCH + 20 * 10**9, seed=1)
    assert clock.resets == 1
    assert np.abs(errors[800:]).max() < 100e-6


@pytest.mark.parametrize("jump", [3_600_000_000_000, -3_600_000_000_000])
def test_a_host_clock_that_is_set_is_followed(jump):
    clock = HostClock(latency=600e-6)
    run(clock, 5.0, 0.0)
    errors, _ = run(clock, 5.0, 0.0, start=4000, offset=EPOCH + jump, seed=1)
    assert np.abs(errors[2 * 800 :]).max() < 100e-6


def test_one_late_read_does_not_move_the_mapping():
    clock = HostClock()
    run(clock, 5.0, 0.0)
    device = 4000 * PERIOD
    stamp = clock.stamp(device, EPOCH + device + 200_000_000)  # the process was stopped for 0.2 s
    assert stamp - EPOCH - device == pytest.approx(600_000, abs=100_000)
    assert clock.resets == 0
