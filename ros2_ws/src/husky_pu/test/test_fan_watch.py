"""A lost fan is found by its speed and current, and nothing else is taken for one."""

import math

import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_pu.autopilot.fan_watch import FanWatch
from husky_pu.autopilot.mixer import Mixer
from husky_sim.propulsion.propulsion_unit import PropulsionUnit

ROBOT = load_robot()
MIXER = Mixer(ROBOT)
PERIOD = 0.002
LIMITS = {"least": 2.0, "patience": 0.1}


class Bench:
    """The plant's fans, told thrusts, and a watch on them."""

    def __init__(self, charge=1.0):
        self.unit = PropulsionUnit(ROBOT)
        self.unit.set_charge(charge)
        self.watch = FanWatch(MIXER.fan, 4)
        self.told = [0.0] * 4
        self.time = 0.0
        self.found = []
        self.run(1.2, 0.0)

    def run(self, duration, *told):
        """Tell one thrust, or four [N], for a while; return the losses found."""
        self.found = []
        self.told = list(told) * (4 // len(told))
        for _ in range(round(duration / PERIOD)):
            voltage = self.unit.battery_voltage
            pulses = MIXER.pulses(self.told, voltage)
            for _ in range(4):
                self.unit.step(pulses, PERIOD / 4)
            self.time += PERIOD
            lost = self.watch.update(
                self.told,
                self.unit.speed.tolist(),
                self.unit.current.tolist(),
                voltage,
                PERIOD,
                **LIMITS,
            )
            self.found += [(self.time, fan) for fan in lost]
        return self.found


@pytest.mark.parametrize("thrust", [2.5, 7.5, 18.0])
def test_a_dead_fan_is_found_soon(thrust):
    bench = Bench()
    assert bench.run(1.0, thrust) == []
    bench.unit.fail_fan(2)
    failed = bench.time
    ((found, fan),) = bench.run(1.0, thrust)
    assert fan == 2 and 0.1 <= found - failed <= 0.25
    assert bench.watch.ok == [True, True, False, True]
    # It stays lost, and a second one is found too.
    bench.unit.heal(2)
    bench.unit.fail_fan(1)
    assert [fan for _, fan in bench.run(1.0, thrust)] == [1]
    bench.watch.reset()
    assert bench.watch.ok == [True] * 4


def test_a_fan_that_never_starts_is_found():
    bench = Bench()
    bench.unit.fail_fan(0)
    assert [fan for _, fan in bench.run(0.6, 5.0)] == [0]


def test_thrust_that_jumps_and_swings_is_no_loss():
    bench = Bench()
    assert bench.run(0.5, 20.0) == []
    assert bench.run(0.5, 3.0) == []  # braked: currents are negative
    generator = np.random.default_rng(1)
    for _ in range(60):
        assert bench.run(0.1, *generator.uniform(0.0, 20.0, 4)) == []


def test_an_empty_pack_is_no_lost_fan():
    bench = Bench(charge=0.0)
    assert bench.run(4.0, 15.0) == []
    assert bench.unit.thrust.sum() < 5.0


def test_without_telemetry_nothing_is_found():
    watch = FanWatch(MIXER.fan, 4)
    for _ in range(500):
        assert not watch.update([10.0] * 4, [math.nan] * 4, [math.nan] * 4, 22.0, PERIOD, **LIMITS)
