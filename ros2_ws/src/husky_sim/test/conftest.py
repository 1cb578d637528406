"""Makes what tests share importable under import mode importlib; drives behind a cable."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))


@pytest.fixture(scope="module")
def network():
    """Be in a network of the module's own, with a virtual cable."""
    from own_network import own_network

    with own_network():
        yield


@pytest.fixture(scope="module")
def drives(network):
    """Twelve drives at the far end of the cable."""
    from wired_drives import far_side

    with far_side() as drives:
        yield drives
