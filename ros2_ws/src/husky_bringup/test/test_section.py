"""The Poincare section: which steps are used."""

import numpy as np

from husky_bringup.section import undisturbed_pairs


def test_a_push_spoils_the_steps_that_it_overlaps():
    times = np.arange(6) * 0.4  # sections at 0, 0.4, ..., 2.0
    # A push from 0.75 to 0.85 reaches from the second pair into the third.
    assert undisturbed_pairs(times, np.array([0.75]), 0.1).tolist() == [0, 3, 4]


def test_without_pushes_every_step_counts():
    assert undisturbed_pairs(np.arange(4.0), np.array([]), 0.1).tolist() == [0, 1, 2]
