"""Shell blocks of README, first day and operator, pasted line by line, in lockstep."""

import pasted
import pytest

pytestmark = pytest.mark.graph


@pytest.mark.slow
def test_look_inside(alone, tmp_path):
    """One graph for README, first day and operator."""

    def first_day(paste):
        pasted.first_day(paste, tmp_path)

    pasted.look_inside("lockstep", tmp_path / "log", first_day, pasted.operator)


@pytest.mark.slow
def test_with_the_propulsion_unit(alone):
    pasted.with_the_propulsion_unit("lockstep")


@pytest.mark.slow
def test_hand_flight(alone, tmp_path):
    pasted.hand_flight("lockstep", tmp_path / "log")
