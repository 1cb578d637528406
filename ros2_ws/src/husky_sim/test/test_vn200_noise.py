"""Is the emulated IMU's noise what was ordered? Spectrum, rms and autocorrelation."""

import dataclasses
import math

import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_drivers.vn200.imu import ImuFigures
from husky_sim.devices.vn200.noise import ImuNoise

FIGURES = ImuFigures.of(load_robot().imu)


def rows(figures, seed, count):
    noise = ImuNoise(figures, seed)
    return np.array([noise.next() for _ in range(count)])


def test_white_noise_has_the_density_of_the_figures():
    """One-sided spectral density by Welch's method, 200 s: its mean is good to 1 %."""
    from scipy.signal import welch  # here, else each worker takes half a second to collect this

    data = rows(FIGURES, 1, 160_000)
    frequency, power = welch(data[:, :6], fs=800.0, nperseg=800, axis=0)
    density = np.sqrt(power[(frequency > 5) & (frequency < 395)].mean(axis=0))
    assert density[:3] == pytest.approx([FIGURES.gyro_noise_density] * 3, rel=0.02)
    assert density[3:] == pytest.approx([FIGURES.accel_noise_density] * 3, rel=0.02)
    correlation = np.corrcoef(data[:, :6].T) - np.eye(6)
    assert np.abs(correlation).max() < 0.02  # 1 / sqrt(160000) = 0.0025, and slow biases


def test_biases_and_attitude_error_have_the_rms_of_the_figures():
    """400 devices, three axes each: the rms is good to 2 %."""
    quiet = dataclasses.replace(FIGURES, gyro_noise_density=0.0, accel_noise_density=0.0)
    first = np.array([ImuNoise(quiet, seed).next() for seed in range(400)])
    rms = np.sqrt((first**2).mean(axis=0))
    assert np.sqrt((rms[0:3] ** 2).mean()) == pytest.approx(FIGURES.gyro_bias, rel=0.08)
    assert np.sqrt((rms[3:6] ** 2).mean()) == pytest.approx(FIGURES.accel_bias, rel=0.08)
    assert 2 * np.sqrt((rms[6:8] ** 2).mean()) == pytest.approx(FIGURES.tilt_error, rel=0.1)
    assert 2 * rms[8] == pytest.approx(FIGURES.heading_error, rel=0.15)


def test_biases_stay_and_wander_as_a_gauss_markov_process():
    """Autocorrelation over 2000 time constants, across blocks: exp(-lag / time constant)."""
    fast = dataclasses.replace(
        FIGURES, gyro_noise_density=0.0, accel_noise_density=0.0, bias_correlation_time=0.2
    )
    bias = rows(fast, 3, 320_000)[:, :6]
    assert np.sqrt((bias[:, :3] ** 2).mean()) == pytest.approx(FIGURES.gyro_bias, rel=0.05)
    for lag, expected in ((16, math.exp(-0.1)), (160, math.exp(-1.0)), (480, math.exp(-3.0))):
        correlation = (bias[:-lag] * bias[lag:]).mean(axis=0) / (bias**2).mean(axis=0)
        assert correlation.mean() == pytest.approx(expected, abs=0.05)


def test_equal_seeds_give_equal_noise_and_others_do_not():
    assert np.array_equal(rows(FIGURES, 1, 2000), rows(FIGURES, 1, 2000))
    correlation = np.corrcoef(rows(FIGURES, 1, 20_000)[:, 0], rows(FIGURES, 2, 20_000)[:, 0])
    assert abs(correlation[0, 1]) < 0.05  # 1 / sqrt(20000) = 0.007


def test_blocks_join_without_a_jump():
    """The slow part moves no more between blocks than within them."""
    quiet = dataclasses.replace(FIGURES, gyro_noise_density=0.0, accel_noise_density=0.0)
    steps = np.abs(np.diff(rows(quiet, 5, 8000), axis=0))
    assert (steps[799::800].max(axis=0) < 2.0 * steps.max(axis=0)).all()
    assert (steps[799::800].mean(axis=0) < 3.0 * steps.mean(axis=0)).all()


def test_a_correlation_time_below_a_sample_is_refused():
    fast = dataclasses.replace(FIGURES, attitude_correlation_time=1e-4)
    with pytest.raises(ValueError, match=r"correlation time of the IMU is 0\.0001 s"):
        ImuNoise(fast, 0)
