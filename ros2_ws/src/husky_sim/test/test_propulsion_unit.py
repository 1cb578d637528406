"""The unit as a whole: spool-up, energy, charge, wrench, faults, thrust to weight."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_sim.propulsion import propulsion_figures
from husky_sim.propulsion.propulsion_figures import (
    armed_unit,
    full_throttle,
    hover_time,
    least_charge_to_hover,
    rise_time,
)
from husky_sim.propulsion.propulsion_unit import MAX_STEP, PropulsionUnit

ROBOT = load_robot()
WEIGHT = ROBOT.mass * GRAVITY
DT = 0.0005
LOW = np.full(4, 1000, np.uint16)
HALF = np.full(4, 1500, np.uint16)
FULL = np.full(4, 2000, np.uint16)
NONE = np.zeros(4, np.uint16)


def run(unit, pwm, time, dt=DT):
    for _ in range(round(time / dt)):
        unit.step(pwm, dt)
    return unit


def state(unit):
    return np.concatenate(
        (
            unit.speed,
            unit.thrust,
            unit.current,
            unit.wrench_in_base,
            [unit.battery_voltage, unit.battery_current, unit.battery_charge],
        )
    )


def test_stands_still_until_armed():
    unit = run(PropulsionUnit(ROBOT), FULL, 2.0)
    assert not unit.thrust.any() and not unit.escs["armed"].any()
    idle = ROBOT.battery.idle_power
    assert unit.battery_voltage * unit.battery_current == pytest.approx(idle)
    assert run(unit, LOW, 1.1).escs["armed"].all()
    assert run(unit, HALF, 0.5).thrust.min() > 5.0


@pytest.mark.parametrize(
    ("start", "end"), [(1000, 2000), (1000, 1500), (1500, 1550), (1500, 1700), (1600, 1400)]
)
def test_rotors_make_63_percent_in_about_80_ms(start, end):
    assert rise_time(ROBOT, start, end) == pytest.approx(0.080, abs=0.010)


def test_rotors_also_slow_down_in_time():
    assert rise_time(ROBOT, 2000, 1000) == pytest.approx(0.080, abs=0.020)


def test_voltage_is_open_circuit_less_current_times_resistance():
    unit = armed_unit(ROBOT)
    for pwm in (HALF, FULL, LOW, FULL):
        for _ in range(200):
            voc = unit.battery.open_circuit_voltage(unit.battery_charge)
            unit.step(pwm, DT)
            sag = unit.battery.resistance * unit.battery_current
            assert unit.battery_voltage == pytest.approx(voc - sag, abs=1e-12)
            loads = unit.current.sum() + ROBOT.battery.idle_power / unit.battery_voltage
            assert unit.battery_current == pytest.approx(loads, abs=1e-7)


def test_spool_up_sags_and_surges_and_comes_back():
    unit = run(armed_unit(ROBOT), LOW, 0.1)
    rest, idle = unit.battery_voltage, unit.battery_current
    run(unit, HALF, 0.5)
    assert unit.battery_voltage < rest - 0.3
    assert unit.battery_current > idle + 30.0
    run(unit, LOW, 1.5)
    assert unit.battery_current == pytest.approx(idle, rel=0.01)
    voc = unit.battery.open_circuit_voltage(unit.battery_charge)
    assert rest - unit.battery_voltage == pytest.approx(25.2 - voc, abs=2e-3)


def test_energy_out_of_the_pack_is_accounted_for():
    unit, fan, dt = armed_unit(ROBOT), armed_unit(ROBOT).fan, 1e-4
    chemical = heat = jet_and_swirl = friction = idle = 0.0
    for k in range(6000):
        voc = unit.battery.open_circuit_voltage(unit.battery_charge)
        before = unit.speed.copy()
        unit.step(FULL if k < 4000 else HALF, dt)
        motor = (
            (unit.speed - before) / dt * fan.inertia + fan.drag_coefficient * before**2
        ) * fan.speed_constant + fan.no_load_current
        chemical += voc * unit.battery_current * dt
        heat += unit.battery.resistance * unit.battery_current**2 * dt
        heat += fan.resistance * (motor**2).sum() * dt
        thrust = fan.thrust_coefficient * before**2
        jet_and_swirl += (fan.jet_factor * thrust**1.5).sum() / fan.rotor_efficiency * dt
        friction += fan.no_load_current / fan.speed_constant * before.sum() * dt
        idle += ROBOT.battery.idle_power * dt
    kinetic = fan.inertia * (unit.speed**2).sum() / 2
    total = heat + jet_and_swirl + friction + idle + kinetic
    # the explicit step of 0.1 ms leaves less than a thousandth
    assert chemical == pytest.approx(total, rel=1e-3)
    assert chemical > jet_and_swirl


@pytest.mark.parametrize("pulse", [1100, 1300, 1500, 1800, 2000])
def test_electrical_power_exceeds_that_of_the_jet(pulse):
    unit = run(armed_unit(ROBOT), np.full(4, pulse), 0.6)
    jet = sum(unit.fan.jet_power(t) for t in unit.thrust)
    electrical = unit.battery_voltage * unit.current.sum()
    assert electrical == pytest.approx(
        sum(unit.fan.electrical_power(t) for t in unit.thrust), rel=2e-3
    )  # steady but for the pack running down
    assert 0.0 < jet < 0.56 * electrical


def test_charge_is_the_integral_of_the_current():
    unit, drawn = armed_unit(ROBOT, 0.9), 0.0
    for k in range(4000):
        unit.step(FULL if k % 1000 < 500 else HALF, DT)
        drawn += unit.battery_current * DT
    assert 0.9 - unit.battery_charge == pytest.approx(drawn / 18000.0, rel=1e-9)
    assert unit.battery_charge < 0.9


def test_braking_rotors_charge_the_pack_by_what_they_feed_back():
    unit = run(armed_unit(load_robot(battery__idle_power=0.0), 0.5), FULL, 0.5)
    charge, fed = unit.battery_charge, 0.0
    kinetic = unit.fan.inertia * (unit.speed**2).sum() / 2
    for _ in range(200):
        unit.step(LOW, DT)
        charge -= unit.battery_current * DT / 18000.0
        fed -= min(unit.battery_current, 0.0) * unit.battery_voltage * DT
        assert unit.battery_charge == pytest.approx(charge, abs=1e-12)
    assert 0.05 * kinetic < fed < kinetic


def thrust_with_sag(charge):
    """Four fans at full throttle, from one equation for the bus voltage [N]."""
    unit = PropulsionUnit(ROBOT)
    voc, fan = unit.battery.open_circuit_voltage(charge), unit.fan

    def excess(v):
        each = fan.steady_current(fan.steady_thrust(v))
        return voc - unit.battery.resistance * (4 * each + ROBOT.battery.idle_power / v) - v

    return 4 * fan.steady_thrust(brentq(excess, 5.0, voc))


@pytest.mark.parametrize("charge", [1.0, 0.9, 0.7, 0.5])
def test_thrust_with_sag_agrees_with_the_steady_equations(charge):
    # 0.6 s at 240 A take 0.8 % of the charge: up to 0.05 V of open circuit
    thrust = full_throttle(ROBOT, charge).wrench_in_base[2]
    assert thrust == pytest.approx(thrust_with_sag(charge), rel=0.006)


def test_hover_is_possible_on_a_full_pack_only():
    assert 1.04 < thrust_with_sag(1.0) / WEIGHT < 1.12
    assert thrust_with_sag(0.7) < WEIGHT
    least = least_charge_to_hover(ROBOT)
    assert thrust_with_sag(least) == pytest.approx(WEIGHT, rel=0.006)
    # constant power from full to there: charge / mean current
    assert hover_time(ROBOT) == pytest.approx((1 - least) * 18000.0 / 222.0, rel=0.05)


@settings(max_examples=25)
@given(st.lists(st.integers(1000, 2000), min_size=4, max_size=4))
def test_wrench_is_that_of_forces_at_the_fans(pwm):
    unit = run(armed_unit(ROBOT), np.array(pwm, float), 0.1)
    before = unit.speed.copy()
    wrench = unit.step(pwm, DT)
    force = np.column_stack((np.zeros((4, 2)), unit.thrust))
    drag = unit.fan.drag_coefficient * unit.speed**2
    torque = drag + unit.fan.inertia * (unit.speed - before) / DT
    moment = np.cross(ROBOT.fan_position, force).sum(axis=0)
    moment[2] -= (np.array([1, -1, -1, 1]) * torque).sum()
    np.testing.assert_allclose(wrench, np.concatenate((force.sum(axis=0), moment)), atol=1e-9)


def test_equal_fans_make_no_moment():
    unit = armed_unit(ROBOT)
    for _ in range(400):
        wrench = unit.step(FULL, DT)
        assert np.abs(wrench[[0, 1, 3, 4, 5]]).max() < 1e-12


@pytest.mark.parametrize("fan", range(4))
def test_reaction_is_opposite_to_the_spin(fan):
    pwm = np.full(4, 1000.0)
    pwm[fan] = 1600.0
    unit = run(armed_unit(ROBOT), pwm, 0.6)
    spin = ROBOT.fans.spin[fan]
    moment = -spin * unit.fan.moment_per_thrust * unit.thrust[fan]
    assert unit.wrench_in_base[5] == pytest.approx(moment, rel=1e-3)


def test_lost_fan_coasts_and_comes_back_through_the_lag():
    unit = run(armed_unit(ROBOT), HALF, 0.5)
    unit.fail_fan(2)
    step = unit.step(HALF, DT)[2]
    assert step == pytest.approx(unit.thrust.sum()) and unit.thrust[2] > 6.0  # no jump
    run(unit, HALF, 1.0)
    assert unit.thrust[2] < 0.01 * unit.thrust[0] and unit.current[2] == 0.0
    assert unit.wrench_in_base[3] < 0.0 or ROBOT.fan_position[2, 1] < 0.0
    unit.heal(2)
    before = unit.thrust[2]
    for _ in range(1000):
        unit.step(HALF, DT)
        assert unit.thrust[2] - before < 0.15
        before = unit.thrust[2]
    assert unit.thrust[2] == pytest.approx(unit.thrust[0], rel=0.01)
    unit.fail_fan(0)
    unit.fail_fan(1)
    unit.heal()
    assert not unit.escs["failed"].any()


@pytest.mark.parametrize("index", [-1, 4])
def test_unknown_fan_is_refused(index):
    unit = PropulsionUnit(ROBOT)
    with pytest.raises(ValueError, match="fan"):
        unit.fail_fan(index)
    with pytest.raises(ValueError, match="fan"):
        unit.heal(index)


def test_no_pulses_stop_the_fans_within_two_seconds():
    unit = run(armed_unit(ROBOT), FULL, 0.5)
    run(unit, NONE, 2.0)
    assert not unit.thrust.any()
    assert not run(unit, FULL, 1.0).thrust.any()  # does not come back by itself


def test_an_empty_pack_stops_the_fans_and_keeps_small_loads():
    unit = run(armed_unit(ROBOT), FULL, 0.5)
    unit.set_charge(0.0)
    before = unit.wrench_in_base[2]
    for _ in range(4000):
        thrust = unit.step(FULL, DT)[2]
        assert thrust <= before + 1e-9
        before = thrust
    assert before == 0.0 and unit.battery_charge == 0.0
    assert unit.battery_voltage * unit.battery_current == pytest.approx(40.0)


def test_a_weak_pack_settles_at_the_cut_off():
    robot = load_robot(battery__cell_resistance=0.004)
    unit = run(armed_unit(robot, 0.5), FULL, 3.0)
    assert unit.battery_voltage == pytest.approx(6 * 3.2, abs=0.02)
    assert 20.0 < unit.wrench_in_base[2] < 62.0


def test_sag_lowers_thrust():
    alone, pwm = armed_unit(ROBOT), np.full(4, 1000.0)
    pwm[0] = 2000.0
    run(alone, pwm, 0.6)
    together = run(armed_unit(ROBOT), FULL, 0.6)
    assert together.thrust[0] < alone.thrust[0] - 2.0
    loaded = armed_unit(ROBOT)
    for _ in range(1200):
        loaded.step(FULL, DT, load=500.0)
    assert loaded.thrust[0] < together.thrust[0]


@pytest.mark.parametrize(
    ("pwm", "dt", "load"),
    [
        ([1500, 1500, math.nan, 1500], DT, 0.0),
        ([1500, math.inf, 1500, 1500], DT, 0.0),
        ([1500, 1500, 1500], DT, 0.0),
        (np.full((4, 1), 1500.0), DT, 0.0),
        (HALF, 0.0, 0.0),
        (HALF, -DT, 0.0),
        (HALF, math.nan, 0.0),
        (HALF, 2 * MAX_STEP, 0.0),
        (HALF, DT, -1.0),
        (HALF, DT, math.nan),
        (HALF, DT, math.inf),
    ],
)
def test_bad_arguments_are_refused_and_change_nothing(pwm, dt, load):
    unit = run(armed_unit(ROBOT), HALF, 0.2)
    before, escs = state(unit), unit.escs.copy()
    with pytest.raises(ValueError, match="pwm"):
        unit.step(pwm, dt, load)
    assert (state(unit) == before).all() and (unit.escs == escs).all()


@pytest.mark.parametrize("share", [-0.1, 1.1, math.nan])
def test_impossible_charge_is_refused(share):
    with pytest.raises(ValueError, match="charge"):
        PropulsionUnit(ROBOT).set_charge(share)


def test_reset_gives_the_same_trajectory_bit_for_bit():
    unit = PropulsionUnit(ROBOT)
    trajectories = []
    for _ in range(2):
        states = []
        for k in range(3500):
            pulse = 1000 if k < 2100 else 1000 + (k * 37) % 1000
            states.append(state_after(unit, np.full(4, pulse), k))
        trajectories.append(np.array(states))
        unit.fail_fan(3)
        unit.reset()
    assert (trajectories[0] == trajectories[1]).all()
    assert trajectories[0][-1].any()


def state_after(unit, pwm, k):
    if k == 3000:
        unit.fail_fan(1)
    unit.step(pwm, DT)
    return state(unit)


@settings(max_examples=25)
@given(
    st.lists(
        st.tuples(st.lists(st.integers(0, 2500), min_size=4, max_size=4), st.integers(1, 200)),
        max_size=6,
    ),
    st.floats(0.0, 1.0),
    st.sampled_from([0.0005, 0.001, 0.002]),
)
def test_whatever_the_pulses_the_state_stays_physical(segments, charge, dt):
    unit = armed_unit(ROBOT, charge)
    for pwm, steps in segments:
        for _ in range(steps):
            unit.step(np.array(pwm), dt)
            assert np.isfinite(state(unit)).all()
            assert (unit.thrust >= 0.0).all() and (unit.thrust < 30.0).all()
            assert 10.0 < unit.battery_voltage < 30.0
            assert 0.0 <= unit.battery_charge <= 1.0


def test_types_of_pulses_do_not_matter():
    pwm = [1200, 1400, 1600, 1800]
    ends = [
        state(run(armed_unit(ROBOT), kind, 0.2))
        for kind in (pwm, np.array(pwm, np.uint16), np.array(pwm, np.float64), np.array(pwm))
    ]
    assert all((end == ends[0]).all() for end in ends)


def test_documented_figures_are_computed(capsys):
    document = Path(__file__).parents[4] / "docs/propulsion_physics.md"
    text = document.read_text(encoding="utf-8")
    propulsion_figures.main()
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert len(rows) > 20
    assert [row for row in rows if row not in text] == []
