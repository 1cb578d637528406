"""README's shell blocks, pasted line by line, in lockstep."""

import pasted
import pytest

pytestmark = pytest.mark.graph


@pytest.mark.slow
def test_look_inside(alone, tmp_path):
    pasted.look_inside("lockstep", tmp_path / "log")


@pytest.mark.slow
def test_with_the_propulsion_unit(alone):
    pasted.with_the_propulsion_unit("lockstep")
