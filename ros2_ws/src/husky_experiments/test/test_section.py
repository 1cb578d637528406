"""The Poincare section: which steps are used, and whether an unstable map is told."""

import numpy as np
import pytest

from husky_control.gait.stability import fit_return_map
from husky_experiments.metrics.poincare_section import STATE, undisturbed_pairs, upper_modulus


def test_a_push_spoils_the_steps_that_it_overlaps():
    times = np.arange(6) * 0.4  # sections at 0, 0.4, ..., 2.0
    # A push from 0.75 to 0.85 reaches from the second pair into the third.
    assert undisturbed_pairs(times, np.array([0.75]), 0.1).tolist() == [0, 3, 4]


def test_without_pushes_every_step_counts():
    assert undisturbed_pairs(np.arange(4.0), np.array([]), 0.1).tolist() == [0, 1, 2]


def steps_of_a_map(modulus: float, seed: int, size: int, count: int):
    """Return states and successors of a map with one eigenvalue of a modulus, the others small.

    Its axes are oblique; pushes excite it every fourth step, and noise as strong as they acts in
    each step.
    """
    random = np.random.default_rng(seed)
    eigenvalues = random.uniform(-0.6, 0.6, size)
    eigenvalues[0] = modulus
    axes = np.linalg.qr(random.normal(size=(size, size)))[0] * random.uniform(0.5, 2.0, size)
    jacobian = axes @ np.diag(eigenvalues) @ np.linalg.inv(axes)
    state, pairs = np.zeros(size), []
    while len(pairs) < count:
        state = state + random.normal(size=size)
        for _ in range(3):
            successor = jacobian @ state + random.normal(size=size)
            pairs.append((state, successor))
            state = successor
    states, successors = np.array(pairs[:count]).transpose(1, 0, 2)
    return states, successors


MAPS = 6


def test_the_point_estimate_passes_unstable_maps():
    """So that the test of the interval means something: of 130 steps it sees no difference."""
    passed = [
        fit_return_map(*steps_of_a_map(1.01, seed, 9, 130)).spectral_radius < 0.999
        for seed in range(40)
    ]
    assert sum(passed) > 15


@pytest.mark.parametrize(("modulus", "passes"), [(0.9, True), (1.01, False)])
def test_the_interval_tells_stable_from_unstable_maps(modulus: float, passes: bool):
    """With as many states and steps as the experiment has; 95 % sure, so one in twenty may miss."""
    right = [
        (upper_modulus(*steps_of_a_map(modulus, seed, len(STATE), 310)) < 0.999) is passes
        for seed in range(MAPS)
    ]
    assert sum(right) >= MAPS - 1


def test_steps_that_fit_no_map_are_not_stable():
    still = np.zeros((40, 3))
    assert upper_modulus(still, still) == np.inf
