"""README's shell blocks, pasted line by line, in real time, on a machine that keeps it."""

import os

import pasted
import pytest
from starvation import while_the_machine_keeps_up

pytestmark = [
    pytest.mark.graph,
    pytest.mark.realtime,
    pytest.mark.timeout(900),
]
four_cores = pytest.mark.skipif(
    (os.cpu_count() or 1) < 4, reason="the unit in real time wants four cores"
)


def test_look_inside(alone, tmp_path):
    while_the_machine_keeps_up(lambda: pasted.look_inside("realtime", tmp_path / "log"))


@four_cores
def test_with_the_propulsion_unit(domain):
    while_the_machine_keeps_up(lambda: pasted.with_the_propulsion_unit("realtime"))
