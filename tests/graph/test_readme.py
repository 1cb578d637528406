"""README's shell blocks, pasted line by line, in lockstep."""

import pasted
import pytest
from ros_domain import own_domain

pytestmark = pytest.mark.graph


@pytest.fixture
def alone(request):
    """A domain in which nobody else is seen: README says which nodes there are."""
    with own_domain(request.node.nodeid) as number:
        yield number


@pytest.mark.slow
def test_look_inside(alone, tmp_path):
    pasted.look_inside("lockstep", tmp_path / "log")


@pytest.mark.slow
def test_with_the_propulsion_unit(alone):
    pasted.with_the_propulsion_unit("lockstep")
