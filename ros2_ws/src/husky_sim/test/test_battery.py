"""Pack and bus against a root finder, closed forms and Kirchhoff's sum."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from husky_description.robot import load_robot
from husky_sim.propulsion.battery import BatteryPack, bus_voltage, motor_current

ROBOT = load_robot()
PACK = BatteryPack(ROBOT.battery)
R_MOTOR, LIMIT = ROBOT.fans.resistance, ROBOT.esc.current_limit
THROTTLES = st.lists(st.one_of(st.just(-1.0), st.floats(0.0, 1.0)), min_size=4, max_size=4)
BACK_EMF = st.lists(st.floats(0.0, 24.0), min_size=4, max_size=4)


def solve(voc, throttle, back_emf, power=40.0, resistance=PACK.resistance, guess=None):
    current = np.zeros(4)
    voltage = bus_voltage(
        voc,
        resistance,
        voc if guess is None else guess,
        power,
        np.array(throttle),
        np.array(back_emf),
        R_MOTOR,
        LIMIT,
        current,
    )
    return voltage, current


def taken(voltage, throttle, back_emf, power=40.0):
    """Current of all loads at a voltage, straight from what each of them is [A]."""
    total = power / voltage
    for d, e in zip(throttle, back_emf, strict=True):
        if d >= 0.0:
            m = np.clip((d * voltage - e) / R_MOTOR, -LIMIT, LIMIT)
            total += m * (e + R_MOTOR * m) / voltage
    return total


@given(st.floats(0.0, 1.0))
def test_curve_is_interpolated_and_rises(charge):
    points = 6 * ROBOT.battery.cell_voltage
    assert PACK.open_circuit_voltage(charge) == pytest.approx(
        np.interp(charge, np.linspace(0, 1, 11), points)
    )
    assert points[0] <= PACK.open_circuit_voltage(charge) <= points[-1]


def test_ends_of_the_curve():
    assert PACK.open_circuit_voltage(1.0) == pytest.approx(25.2)
    assert PACK.open_circuit_voltage(0.0) == pytest.approx(18.0)
    assert PACK.open_circuit_voltage(7.0) == PACK.open_circuit_voltage(1.0)
    assert PACK.open_circuit_voltage(-1.0) == PACK.open_circuit_voltage(0.0)


@settings(max_examples=300)
@given(st.floats(18.0, 25.2), THROTTLES, BACK_EMF, st.floats(10.0, 26.0))
@example(25.2, [1.0] * 4, [0.0] * 4, 25.2)  # all at the limit
@example(25.2, [0.0] * 4, [24.0] * 4, 25.2)  # all brake at the limit
@example(25.2, [1.0, 0.0, -1.0, 0.5], [0.0, 24.0, 24.0, 12.0], 25.2)
def test_bus_agrees_with_a_root_finder(voc, throttle, back_emf, guess):
    def excess(v):
        return voc - PACK.resistance * taken(v, throttle, back_emf) - v

    expected = brentq(excess, voc / 2, 1.5 * voc, xtol=1e-12)
    voltage, current = solve(voc, throttle, back_emf, guess=guess)
    assert voltage == pytest.approx(expected, abs=1e-8)
    total = current.sum() + 40.0 / voltage
    assert voltage == pytest.approx(voc - PACK.resistance * total, abs=1e-8)


@given(st.floats(18.0, 25.2), st.floats(0.0, 5000.0))
def test_constant_power_alone_is_the_upper_root(voc, power):
    voltage, current = solve(voc, [-1.0] * 4, [0.0] * 4, power)
    assert not current.any()
    assert voltage * (voc - voltage) / PACK.resistance == pytest.approx(power, rel=1e-7, abs=1e-7)
    assert voltage >= voc / 2


def test_more_than_the_pack_can_give_collapses_to_its_greatest_power():
    greatest = 20.0**2 / (4 * PACK.resistance)
    assert solve(20.0, [-1.0] * 4, [0.0] * 4, 1.5 * greatest)[0] == pytest.approx(10.0)
    assert solve(20.0, [-1.0] * 4, [0.0] * 4, greatest * (1 - 1e-6))[0] == pytest.approx(
        10, rel=2e-3
    )


@given(st.floats(0.0, 1.0), st.floats(0.0, 24.0), st.floats(10.0, 26.0))
def test_current_of_a_motor_keeps_its_limit(throttle, back_emf, voltage):
    current = motor_current(throttle, back_emf, voltage, R_MOTOR, LIMIT)
    assert abs(current) <= LIMIT
    assert motor_current(-1.0, back_emf, voltage, R_MOTOR, LIMIT) == 0.0


def test_resistance_is_cells_and_wiring():
    assert PACK.resistance == pytest.approx(6 * 0.0015 + 0.003)
    without = BatteryPack(load_robot(battery__wiring_resistance=0.0).battery)
    assert without.resistance == pytest.approx(0.009)
    assert math.isclose(PACK.capacity, 5.0 * 3600)
