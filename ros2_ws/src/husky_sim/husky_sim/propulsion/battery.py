"""The pack: open-circuit voltage over charge, resistance, and the one voltage all loads agree on.

V = Voc(charge) - R I, with R = cells * cell resistance + wiring; V is what speed controllers and
power module see. I is the sum of what the loads take *at* V:

- a motor behind throttle d at speed w: i = (d V - e) / R_m with e = w / K, and d i from the bus;
- a motor at its current limit L: a constant power (e + R_m L) L;
- everything else (`battery.idle_power` and what the caller adds): a constant power P.

So V solves V (1 + R sum d^2 / R_m) - (Voc + R sum d e / R_m) + R P / V = 0, a quadratic, once it
is known which motors are limited; that set is found by trying. If constant power asks for more
than the pack can give, the voltage collapses to the point of greatest power: the load gets less.

Charge is counted: charge' = -I / capacity, within 0 and 1. Empty (0), the pack stays at the lower
end of its curve, below the speed controllers' cut-off: the fans stop, small loads go on.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from husky_description import sections
from husky_description.arrays import Array

_TRIES = 8


@njit(cache=True)
def open_circuit_voltage(charge: float, curve: Any) -> float:
    """Voltage without load [V], linear between the points of the curve.

    Args:
        charge: share left; beyond 0 and 1 the ends hold.
        curve: voltage of the pack at evenly spaced charge from 0 to 1 [V].
    """
    last = len(curve) - 1
    place = min(max(charge, 0.0), 1.0) * last
    i = min(int(place), last - 1)
    return float(curve[i] + (place - i) * (curve[i + 1] - curve[i]))


@njit(cache=True)
def motor_current(
    throttle: float, back_emf: float, bus_voltage: float, resistance: float, limit: float
) -> float:
    """Current of a motor [A]; a negative throttle is an open bridge."""
    if throttle < 0.0:
        return 0.0
    return min(max((throttle * bus_voltage - back_emf) / resistance, -limit), limit)


@njit(cache=True)
def bus_voltage(
    open_circuit: float,
    resistance: float,
    guess: float,
    power: float,
    throttle: Any,
    back_emf: Any,
    motor_resistance: float,
    current_limit: float,
    current: Any,
) -> float:
    """Solve the bus; see the module's equations.

    Args:
        open_circuit: Voc [V].
        resistance: of pack and wiring [ohm].
        guess: voltage at which to begin [V].
        power: constant power of other loads [W].
        throttle: (n,) of each motor, negative for an open bridge.
        back_emf: (n,) w / K [V].
        motor_resistance: [ohm].
        current_limit: of a motor [A].
        current: (n,) drawn from the bus by each motor [A], written.

    Returns:
        Voltage of the bus [V].
    """
    v = guess
    for _ in range(_TRIES):
        a, b, p = 1.0, open_circuit, power
        for i in range(len(throttle)):
            d = throttle[i]
            if d < 0.0:
                continue
            e = back_emf[i]
            free = (d * v - e) / motor_resistance
            if abs(free) <= current_limit:
                a += resistance * d * d / motor_resistance
                b += resistance * d * e / motor_resistance
            else:
                limited = math.copysign(current_limit, free)
                p += (e + motor_resistance * limited) * limited
        root = b * b - 4.0 * a * resistance * p
        new = (b + math.sqrt(root)) / (2.0 * a) if root > 0.0 else b / (2.0 * a)
        settled = abs(new - v) <= 1e-12 * open_circuit
        v = new
        if settled:
            break
    for i in range(len(throttle)):
        m = motor_current(throttle[i], back_emf[i], v, motor_resistance, current_limit)
        current[i] = m * (back_emf[i] + motor_resistance * m) / v
    return v


class BatteryPack:
    """A pack: its curve and resistance.

    Attributes:
        curve: (11,) open-circuit voltage of the pack at 0, 10, .. 100 % [V].
        resistance: of cells and wiring [ohm].
        capacity: [A s].
    """

    def __init__(self, section: sections.BatterySection):
        """Take the numbers of the section `battery` of carbon.yaml."""
        self.curve: Array = section.cells * section.cell_voltage
        self.resistance = section.cells * section.cell_resistance + section.wiring_resistance
        self.capacity = section.capacity

    def open_circuit_voltage(self, charge: float) -> float:
        """Voltage without load [V] at a share of charge."""
        return float(open_circuit_voltage(charge, self.curve))
