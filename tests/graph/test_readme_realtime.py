"""README's shell block for the unit, pasted in real time, on a machine that keeps it."""

import os

import pasted
import pytest
from starvation import while_the_machine_keeps_up

pytestmark = [
    pytest.mark.graph,
    pytest.mark.realtime,
    pytest.mark.timeout(900),
    pytest.mark.skipif((os.cpu_count() or 1) < 4, reason="the unit in real time wants four cores"),
]


def test_with_the_propulsion_unit(domain):
    while_the_machine_keeps_up(lambda: pasted.with_the_propulsion_unit("realtime"))
