"""Ducted fan against momentum theory, power balances and closed-form run-down."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_description.fan import FanModel
from husky_description.robot import load_robot
from husky_sim.propulsion.fan import next_speed

SECTION = load_robot().fans
FAN = FanModel.from_section(SECTION)
THRUSTS = st.floats(0.0, 40.0)


@given(THRUSTS)
def test_jet_power_is_that_of_the_air_that_is_moved(thrust):
    flow = SECTION.air_density * SECTION.flow_area
    velocity = math.sqrt(thrust / flow)
    mass_per_second = flow * velocity
    assert mass_per_second * velocity == pytest.approx(thrust)  # the momentum that leaves
    assert FAN.jet_power(thrust) == pytest.approx(mass_per_second * velocity**2 / 2)


def test_full_throttle_on_the_rated_voltage_is_what_the_file_says():
    assert FAN.steady_voltage(20.0) == pytest.approx(22.2)
    assert FAN.steady_thrust(22.2) == pytest.approx(20.0)
    assert FAN.electrical_power(20.0) == pytest.approx(737.711 / 0.55, rel=1e-5)
    assert FAN.jet_power(20.0) / FAN.electrical_power(20.0) == pytest.approx(0.55)


@given(THRUSTS)
def test_power_goes_into_jet_swirl_friction_and_heat(thrust):
    current = FAN.steady_current(thrust)
    speed = math.sqrt(thrust / FAN.thrust_coefficient)
    heat = FAN.resistance * current**2
    friction = FAN.no_load_current * speed / FAN.speed_constant
    shaft = FAN.jet_power(thrust) / FAN.rotor_efficiency
    assert FAN.electrical_power(thrust) == pytest.approx(heat + friction + shaft)
    assert FAN.electrical_power(thrust) >= FAN.jet_power(thrust)


@given(THRUSTS)
def test_steady_thrust_inverts_steady_voltage(thrust):
    assert FAN.steady_thrust(FAN.steady_voltage(thrust)) == pytest.approx(thrust, abs=1e-9)


def test_no_thrust_below_the_voltage_that_overcomes_friction():
    assert FAN.steady_thrust(FAN.resistance * FAN.no_load_current) == 0.0
    assert FAN.steady_thrust(-3.0) == 0.0


def run_down(friction, dt=1e-5, time=0.2, start=4000.0):
    speed, current = start, 0.0
    for _ in range(round(time / dt)):
        speed = next_speed(
            speed,
            current,
            dt,
            1.0 / FAN.speed_constant,
            friction,
            FAN.drag_coefficient,
            FAN.inertia,
        )
    return speed


def test_run_down_without_friction_is_hyperbolic():
    expected = 4000.0 / (1.0 + FAN.drag_coefficient * 4000.0 * 0.2 / FAN.inertia)
    assert run_down(0.0) == pytest.approx(expected, rel=2e-4)  # explicit step of 1e-5 s


def test_run_down_with_friction_is_a_tangent_and_stops():
    f, c, j = FAN.no_load_current / FAN.speed_constant, FAN.drag_coefficient, FAN.inertia
    angle = math.atan(4000.0 * math.sqrt(c / f)) - math.sqrt(f * c) * 0.2 / j
    assert run_down(FAN.no_load_current) == pytest.approx(
        math.sqrt(f / c) * math.tan(angle), rel=3e-4
    )
    stop = j / math.sqrt(f * c) * math.atan(4000.0 * math.sqrt(c / f))
    assert run_down(FAN.no_load_current, time=1.001 * stop) == 0.0
    assert run_down(FAN.no_load_current, time=0.95 * stop) > 0.0


@given(st.floats(0.0, 6000.0), st.floats(-95.0, 95.0), st.floats(1e-6, 2e-3))
def test_nothing_turns_a_rotor_backwards(speed, current, dt):
    after = next_speed(speed, current, dt, 1.0 / FAN.speed_constant, 3.0, 1.4e-8, FAN.inertia)
    assert 0.0 <= after < math.inf


def test_vanes_take_their_share_of_the_moment():
    half = FanModel.from_section(load_robot(fans__body_torque_share=0.5).fans)
    assert half.moment_per_thrust == pytest.approx(FAN.moment_per_thrust / 2)
    assert half.electrical_power(10.0) == pytest.approx(FAN.electrical_power(10.0))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("fans__resistance", 0.5),  # 44 A at most
        ("fans__no_load_current", 80.0),
        ("battery__cell_voltage", [3.0] * 11),
        ("esc__pulse_start", 900.0),
    ],
)
def test_impossible_numbers_are_refused_by_name(key, value):
    name = "esc.pulse_low" if key == "esc__pulse_start" else key.replace("__", ".")
    with pytest.raises(ValueError, match=name):
        load_robot(**{key: value})


def test_more_friction_than_current_is_refused():
    with pytest.raises(ValueError, match="no_load_current"):
        load_robot(fans__max_thrust=1.0, fans__no_load_current=19.0)
