"""Trotting under the gantry: oscillations are told from a heading that wanders."""

import numpy as np
import pytest

from husky_experiments.catalogue.pu_trot import tilt_oscillation, without_drift


def test_a_wandering_heading_is_no_oscillation():
    """Over five seconds it turns by 6 deg, ever faster; it swings by 0.4 deg at 2.94 Hz."""
    time = np.arange(500) / 100.0
    swing = np.radians(0.4) * np.sin(2 * np.pi * 2.94 * time)
    found = without_drift(np.radians(0.24) * time**2 + swing)
    assert np.degrees(found.std()) == pytest.approx(0.4 / np.sqrt(2), rel=0.02)
    assert np.degrees(without_drift(np.radians(0.24) * time**2)).std() < 1e-9


def test_oscillations_of_roll_and_pitch_count_over_all_spans_without_what_wanders():
    time = np.arange(500) / 100.0
    swing = np.sin(2 * np.pi * 2.94 * time)
    still = np.column_stack((0.1 * time, 0.02 * time**2, swing))
    swings = np.column_stack((0.3 * swing + 0.1 * time, 0.4 * swing, swing))
    found = tilt_oscillation([np.radians(swings), np.radians(still)])
    assert found == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2.0 / 4.0), rel=0.02)
    assert tilt_oscillation([np.radians(still)]) < 1e-9
