"""The emulated VN-200: what it measures, its noise, its faults."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vn200_bench import FIGURES, LEVEL, SILENT, Bench, packets

from husky_description.rotation import swap_body, swap_world_and_body
from husky_sim.devices.vn200.device import Vn200Device


# Measurement ------------------------------------------------------------------------------------
def test_axes_by_rotation_matrices():
    """World ENU and body FLU go in; NED and FRD come out, checked by matrices."""
    bench = Bench().stream()
    ned = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    frd = np.diag([1, -1, -1])
    generator = np.random.default_rng(5)
    for rotation in Rotation.random(30, random_state=5):
        rate, force = generator.normal(size=3), 9.81 * generator.normal(size=3)
        pose = (tuple(rotation.as_quat()), tuple(rate), tuple(force))
        (values,) = packets(bench.run(1, pose))
        attitude = Rotation.from_quat(values[1:5]).as_matrix()
        assert np.allclose(attitude, ned @ rotation.as_matrix() @ frd, atol=1e-6)  # float32
        assert np.allclose(values[5:8], frd @ rate, atol=1e-6)
        assert np.allclose(values[8:11], frd @ force, atol=1e-5)


def test_arrays_are_taken_too():
    bench = Bench().stream()
    as_arrays = tuple(np.array(part) for part in LEVEL)
    assert bench.run(1, as_arrays)[12:] == Bench().stream().run(1)[12:]


def test_values_beyond_the_range_saturate():
    bench = Bench().stream()
    (values,) = packets(bench.run(1, (LEVEL[0], (1e6, -1e300, 0.0), (math.inf, -1e9, math.nan))))
    assert values[5:7] == pytest.approx((FIGURES.gyro_range, FIGURES.gyro_range))
    assert values[8:10] == pytest.approx((FIGURES.accel_range, FIGURES.accel_range))


def test_the_same_seed_gives_the_same_bytes_whatever_is_said():
    first, second, third = (Bench(FIGURES, seed).stream() for seed in (7, 7, 8))
    second.say("VNASY,0")
    silent = second.run(50)
    second.say("VNASY,1")
    data = first.run(200)
    assert silent == b""
    assert data[50 * 54 :] == second.run(150)
    assert data != third.run(200)


def test_a_world_that_starts_again_gives_the_same_bytes_and_keeps_the_settings():
    bench = Bench(FIGURES, 7).stream()
    first = bench.run(900)
    bench.device.restart(7)
    bench.tick = 0
    assert bench.run(900) == first
    bench.device.restart(8)
    bench.tick = 0
    assert bench.run(900) != first


# Noise ------------------------------------------------------------------------------------------
def test_the_reported_attitude_is_off_by_the_figures():
    errors = []
    truth = Rotation.from_euler("xyz", [0.1, -0.2, 2.0])
    for seed in range(300):
        bench = Bench(FIGURES, seed).stream()
        (values,) = packets(bench.run(1, (tuple(truth.as_quat()), LEVEL[1], LEVEL[2])))
        reported = Rotation.from_quat(swap_world_and_body(values[1:5]))
        errors.append((reported * truth.inv()).as_rotvec())
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    assert rms[:2] == pytest.approx([FIGURES.tilt_error] * 2, rel=0.15)
    assert rms[2] == pytest.approx(FIGURES.heading_error, rel=0.15)


def test_noise_reaches_the_right_numbers():
    """Rates and forces on the wire scatter by the figures, about what was put in."""
    bench = Bench(FIGURES, 2).stream()
    values = np.array(packets(bench.run(8000)))
    rate = np.array([swap_body(row) for row in values[:, 5:8]])
    force = np.array([swap_body(row) for row in values[:, 8:11]])
    assert rate.std(axis=0) == pytest.approx([FIGURES.gyro_noise] * 3, rel=0.05)
    assert force.std(axis=0) == pytest.approx([FIGURES.accel_noise] * 3, rel=0.05)
    assert np.abs(rate.mean(axis=0)).max() < 5 * FIGURES.gyro_bias
    assert np.abs(force.mean(axis=0) - [0, 0, 9.81]).max() < 5 * FIGURES.accel_bias


# Faults -----------------------------------------------------------------------------------------
def test_faults_do_what_they_say_and_end():
    clean = Bench(FIGURES, 4).stream().run(400)
    for fault in ("stop", "flip_bits", "repeat", "garbage", "truncate"):
        bench = Bench(FIGURES, 4).stream()
        start = bench.run(100)
        bench.device.inject(fault)
        damaged = bench.run(200)
        bench.device.inject("")
        end = bench.run(100)
        assert start + end == clean[: 100 * 54] + clean[300 * 54 :], fault
        good = packets(damaged)
        if fault == "stop":
            assert damaged == b""
        elif fault == "flip_bits":  # one bit each on average: e^-1 of the packets are whole
            assert len(good) == pytest.approx(200 * math.exp(-1.0), abs=30)
        elif fault == "repeat":
            assert len(good) == 200 and set(good) == {good[0]} == {packets(start)[-1]}
        elif fault == "garbage":
            assert len(good) == 200 and len(damaged) > 220 * 54
        else:
            assert len(good) == pytest.approx(100, abs=25)


def test_faults_come_from_the_seed():
    def damaged(seed):
        bench = Bench(SILENT, seed).stream()
        bench.device.inject("flip_bits")
        return bench.run(50)

    assert damaged(1) == damaged(1) != damaged(2)


def test_a_stopped_device_answers_nothing():
    bench = Bench()
    bench.device.inject("stop")
    assert bench.say("VNRRG,01") == []
    bench.device.inject("")
    assert bench.say("VNRRG,01") == ["$VNRRG,01,VN-200T-CR*31"]


def test_a_power_cycle_falls_back_to_the_flash_memory():
    bench = Bench(reset_time=0.01).stream()
    bench.run(5)
    bench.device.inject("power_cycle")
    assert bench.device.baud == 115200
    bench.run(10)
    assert b"$VNYPR" in bench.run(40)


def test_unknown_faults_are_refused_by_name():
    device = Vn200Device(SILENT)
    with pytest.raises(ValueError, match="no fault 'melt'; there are stop, flip_bits, repeat"):
        device.inject("melt")
    with pytest.raises(
        ValueError, match=r"intensity of truncate is 2, it must be within 0 and 1\.0"
    ):
        device.inject("truncate", 2)
