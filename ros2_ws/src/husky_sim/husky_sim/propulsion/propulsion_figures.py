"""Figures of the propulsion unit, computed: `python -m husky_sim.propulsion.propulsion_figures`."""

from __future__ import annotations

import math
import timeit

import numpy as np

from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.robot import Robot, load_robot
from husky_sim.propulsion.propulsion_unit import PropulsionUnit

STEP = 0.0005
PACKS: dict[str, dict[str, float]] = {
    "none": {},
    "`battery.capacity` 28800 (8 Ah, at the same mass)": {"battery__capacity": 28800.0},
    "`battery.cell_resistance` 0.001": {"battery__cell_resistance": 0.001},
    "`payload_mass` 0.68 (robot of 7.0 kg)": {"payload_mass": 0.68},
    "`battery.cells` 7": {"battery__cells": 7},
}
"""Overrides of carbon.yaml to compare."""


def armed_unit(robot: Robot, charge: float = 1.0) -> PropulsionUnit:
    """A unit at rest with a charge (0 to 1), its speed controllers armed by low pulses."""
    unit = PropulsionUnit(robot)
    for _ in range(math.ceil(robot.esc.arming_time / STEP) + 1):
        unit.step(np.full(len(unit.speed), robot.esc.pulse_low), STEP)
    unit.set_charge(charge)
    return unit


def full_throttle(robot: Robot, charge: float) -> PropulsionUnit:
    """A unit 0.6 s after all pulses went to their high end, rotors settled."""
    unit = armed_unit(robot, charge)
    for _ in range(1200):
        unit.step(np.full(len(unit.speed), robot.esc.pulse_high), STEP)
    return unit


def rise_time(robot: Robot, start: float, end: float) -> float:
    """Time in which the rotors make 63.2 % of a step between two pulse widths [us]; [s]."""
    unit = armed_unit(robot)
    speeds: list[float] = []
    for pulse in (start, end):
        speeds = []
        for _ in range(2000):
            unit.step(np.full(len(unit.speed), pulse), STEP)
            speeds.append(unit.speed[0])
        if pulse == start:
            first = speeds[-1]
    share = (np.array(speeds) - first) / (speeds[-1] - first)
    return float((np.argmax(share >= 1.0 - math.exp(-1.0)) + 1) * STEP)


def least_charge_to_hover(robot: Robot) -> float:
    """Least charge (0 to 1) at which full throttle carries the robot; inf if none does."""
    weight = robot.mass * GRAVITY
    if full_throttle(robot, 1.0).wrench_in_base[2] < weight:
        return math.inf
    low, high = 0.0, 1.0
    while high - low > 1e-3:
        middle = (low + high) / 2.0
        enough = full_throttle(robot, middle).wrench_in_base[2] >= weight
        low, high = (low, middle) if enough else (middle, high)
    return high


def hover_time(robot: Robot) -> float:
    """How long a full pack hovers the robot at constant weight, all fans alike [s]."""
    unit, fan = PropulsionUnit(robot), FanModel.from_section(robot.fans)
    share = robot.mass / len(unit.speed)
    power = len(unit.speed) * fan.electrical_power(share * GRAVITY) + robot.battery.idle_power
    motor_voltage = fan.steady_voltage(share * GRAVITY)
    charge, time, dt = 1.0, 0.0, 0.05
    r = unit.battery.resistance
    while charge > 0.0:
        voc = unit.battery.open_circuit_voltage(charge)
        root = voc * voc - 4.0 * r * power
        voltage = (voc + math.sqrt(root)) / 2.0 if root > 0.0 else 0.0
        if voltage < motor_voltage:
            break
        charge -= power / voltage * dt / unit.battery.capacity
        time += dt
    return time


def main() -> None:
    """Print the figures that stand in docs/propulsion_physics.md, and the cost of a step."""
    robot = load_robot()
    fan, weight = FanModel.from_section(robot.fans), robot.mass * GRAVITY
    print(
        f"fan: k {fan.thrust_coefficient:.4g} N s^2, c {fan.drag_coefficient:.4g} N m s^2, ", end=""
    )
    print(f"K {fan.speed_constant:.1f} rad/s/V ({fan.speed_constant * 30 / math.pi:.0f} rpm/V)")
    print(f"rotor efficiency {fan.rotor_efficiency:.3f}, ", end="")
    print(f"moment per thrust {1e3 * fan.moment_per_thrust:.2f} mm")
    print("\n| thrust of one fan N | jet W | electrical W | efficiency | motor V | motor A | rpm |")
    print("|---|---|---|---|---|---|---|")
    for thrust in (1.0, 2.5, 5.0, 10.0, 15.0, weight / 4.0, 20.0):
        jet, electrical = fan.jet_power(thrust), fan.electrical_power(thrust)
        rpm = math.sqrt(thrust / fan.thrust_coefficient) * 30.0 / math.pi
        print(f"| {thrust:.2f} | {jet:.0f} | {electrical:.0f} | {jet / electrical:.2f} ", end="")
        print(f"| {fan.steady_voltage(thrust):.2f} | {fan.steady_current(thrust):.1f} ", end="")
        print(f"| {rpm:.0f} |")
    print(
        f"\n63 % of the speed: 1000 to 2000 us {1e3 * rise_time(robot, 1000, 2000):.1f} ms, ",
        end="",
    )
    print(f"1000 to 1500 us {1e3 * rise_time(robot, 1000, 1500):.1f} ms, ", end="")
    print(f"1500 to 1550 us {1e3 * rise_time(robot, 1500, 1550):.1f} ms, ", end="")
    print(f"2000 to 1000 us {1e3 * rise_time(robot, 2000, 1000):.1f} ms")
    print("\n| charge | open circuit V | bus V | pack A | thrust N | thrust / weight |")
    print("|---|---|---|---|---|---|")
    for charge in (1.0, 0.9, 0.8, 0.7, 0.5, 0.3, 0.1):
        unit = full_throttle(robot, charge)
        voc = unit.battery.open_circuit_voltage(charge)
        print(f"| {charge:.1f} | {voc:.2f} | {unit.battery_voltage:.2f} ", end="")
        print(f"| {unit.battery_current:.1f} | {unit.wrench_in_base[2]:.1f} ", end="")
        print(f"| {unit.wrench_in_base[2] / weight:.2f} |")
    print(f"\nweight {weight:.1f} N at {robot.mass} kg\n")
    print("| override | full pack: thrust / weight | hovers above charge | from full s |")
    print("|---|---|---|---|")
    for name, override in PACKS.items():
        other = load_robot(None, **override)
        ratio = full_throttle(other, 1.0).wrench_in_base[2] / (other.mass * GRAVITY)
        print(f"| {name} | {ratio:.2f} | {least_charge_to_hover(other):.2f} ", end="")
        print(f"| {hover_time(other):.0f} |")
    print()
    unit = armed_unit(robot)
    pulses = np.full(len(unit.speed), 1500, np.uint16)
    cost = min(timeit.repeat(lambda: unit.step(pulses, STEP), number=2000, repeat=7)) / 2000
    print(f"a step costs {1e6 * cost:.1f} us on this machine")


if __name__ == "__main__":
    main()
