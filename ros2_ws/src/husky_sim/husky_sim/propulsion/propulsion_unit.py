"""The propulsion unit in the plant: pulses in, a wrench on the body out, step by step.

Per step: speed controllers (`esc`) look at pulse and bus voltage; bus voltage and currents are
solved together at the rotors' speeds (`battery`); the rotors move on (`fan`); charge is counted.
Fan i stands at `robot.fan_position[i]` and pushes along base z:

    force = (0, 0, T_i), moment = r_i x force + (0, 0, -spin_i (share c w_i^2 + J w_i')),

the last term being what the motor's torque leaves on the body: drag and spin-up, friction in the
bearings stays inside. Fans are ordered as `robot.rotor_names`. No noise: same pulses, same wrench.
Propellers that the legs carry have no fixed place: of them thrust and torque count
(`PropellersInWorld`).
Gyroscopic moments of the rotors are left out: in pairs they cancel at equal speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.robot import Robot
from husky_sim.propulsion.battery import (
    BatteryPack,
    bus_voltage,
    motor_current,
    open_circuit_voltage,
)
from husky_sim.propulsion.esc import ESC, esc_constants, step_esc
from husky_sim.propulsion.fan import next_speed

MAX_STEP = 0.002
"""Longest step [s]; a quarter of the rotors' own time constant."""

UNIT = np.dtype(
    [
        # constants
        ("thrust_coefficient", "f8"),  # N s^2
        ("drag_coefficient", "f8"),  # N m s^2
        ("speed_constant", "f8"),  # rad/s/V
        ("motor_resistance", "f8"),  # ohm
        ("no_load_current", "f8"),  # A
        ("inertia", "f8"),  # kg m^2
        ("body_torque_share", "f8"),
        ("current_limit", "f8"),  # A
        ("pack_resistance", "f8"),  # ohm
        ("capacity", "f8"),  # A s
        ("idle_power", "f8"),  # W
        # state
        ("charge", "f8"),
        ("voltage", "f8"),  # V
        ("current", "f8"),  # A
    ],
    align=True,
)
"""Numbers of the unit that are not one per fan."""

FAN = np.dtype(
    [
        ("x", "f8"),  # in base, m
        ("y", "f8"),  # m
        ("spin", "f8"),  # sense about base z
        ("pulse", "f8"),  # us
        ("speed", "f8"),  # of the rotor, rad/s
        ("thrust", "f8"),  # N
        ("torque", "f8"),  # on what carries it, against the spin, N m
        ("current", "f8"),  # from the bus, A
        ("throttle", "f8"),  # after the speed controller
        ("back_emf", "f8"),  # at the start of the step, V
    ],
    align=True,
)
"""One fan: where it is, what it is told, what it does."""


@njit(cache=True)
def _is_sound(fans: Any, dt: float, load: float) -> bool:
    for i in range(len(fans)):
        if not np.isfinite(fans[i].pulse):
            return False
    return bool(0.0 < dt <= MAX_STEP and 0.0 <= load < np.inf)


@njit(cache=True)
def _turn(fan: Any, u: Any, dt: float) -> None:
    """Move a rotor on by `dt` [s]."""
    motor = motor_current(
        fan.throttle, fan.back_emf, u.voltage, u.motor_resistance, u.current_limit
    )
    before = fan.speed
    fan.speed = next_speed(
        before,
        motor,
        dt,
        1.0 / u.speed_constant,
        u.no_load_current,
        u.drag_coefficient,
        u.inertia,
    )
    square = fan.speed * fan.speed
    fan.thrust = u.thrust_coefficient * square
    torque = u.body_torque_share * u.drag_coefficient * square
    fan.torque = torque + u.inertia * (fan.speed - before) / dt


@njit(cache=True)
def step_unit(
    unit: Any,
    fans: Any,
    escs: Any,
    esc_shared: Any,
    curve: Array,
    dt: float,
    load: float,
    wrench: Array,
) -> bool:
    """Advance everything by `dt`; see the module. Returns False, untouched, on a bad argument.

    Args:
        unit: (1,) record of `UNIT`.
        fans: (n,) records of `FAN`.
        escs: (n,) records of `esc.ESC`.
        esc_shared: (1,) record of `esc.ESC_CONSTANTS`.
        curve: open-circuit voltage [V] over charge.
        dt: [s].
        load: power of other loads [W].
        wrench: (6,) in base, written.
    """
    u, c = unit[0], esc_shared[0]
    if not _is_sound(fans, dt, load):
        return False
    for i in range(len(fans)):
        fans[i].throttle = step_esc(escs[i], fans[i].pulse, u.voltage, dt, c)
        fans[i].back_emf = fans[i].speed / u.speed_constant
    open_circuit = open_circuit_voltage(u.charge, curve)
    u.voltage = bus_voltage(
        open_circuit,
        u.pack_resistance,
        u.voltage,
        u.idle_power + load,
        fans.throttle,
        fans.back_emf,
        u.motor_resistance,
        u.current_limit,
        fans.current,
    )
    u.current = (open_circuit - u.voltage) / u.pack_resistance
    u.charge = min(max(u.charge - u.current * dt / u.capacity, 0.0), 1.0)
    wrench[:] = 0.0
    for i in range(len(fans)):
        fan = fans[i]
        _turn(fan, u, dt)
        wrench[2] += fan.thrust
        wrench[3] += fan.y * fan.thrust
        wrench[4] -= fan.x * fan.thrust
        wrench[5] -= fan.spin * fan.torque
    return True


class PropulsionUnit:
    """The fans, their speed controllers and the pack.

    Attributes:
        speed: (n,) of the rotors [rad/s]; all arrays are overwritten by `step`.
        thrust: (n,) [N].
        torque: (n,) of fan and rotor on what carries them, against the spin [N m].
        current: (n,) that each speed controller takes from the bus [A], negative while it brakes.
        wrench_in_base: (6,) force [N] and moment about base's origin [N m], in base.
        battery: the pack's curve and resistance.
        fan: the fans' coefficients.
    """

    def __init__(self, robot: Robot):
        """Unarmed, rotors at rest, pack full; compiles, so that no step waits."""
        self.fan = FanModel.of(robot)
        self.battery = BatteryPack(robot.battery)
        self._unit = np.zeros(1, UNIT)
        u = self._unit[0]
        u["thrust_coefficient"] = self.fan.thrust_coefficient
        u["drag_coefficient"] = self.fan.drag_coefficient
        u["speed_constant"] = self.fan.speed_constant
        u["motor_resistance"] = self.fan.resistance
        u["no_load_current"] = self.fan.no_load_current
        u["inertia"] = self.fan.inertia
        u["body_torque_share"] = self.fan.body_torque_share
        u["current_limit"] = robot.esc.current_limit
        u["pack_resistance"] = self.battery.resistance
        u["capacity"] = self.battery.capacity
        u["idle_power"] = robot.battery.idle_power
        self._count = len(robot.rotor_names)
        self._escs = np.zeros(self._count, ESC)
        self._esc_shared = esc_constants(robot)
        self._fans = np.zeros(self._count, FAN)
        if robot.legs_carry_propellers:
            self._fans["spin"] = robot.propellers.spin
        else:
            self._fans["x"], self._fans["y"] = robot.fan_position[:, 0], robot.fan_position[:, 1]
            self._fans["spin"] = robot.fans.spin
        self.speed: Array = self._fans["speed"]
        self.thrust: Array = self._fans["thrust"]
        self.torque: Array = self._fans["torque"]
        self.current: Array = self._fans["current"]
        self.wrench_in_base = np.zeros(6)
        self.reset()
        self.step(np.zeros(self._count), 0.0005)
        self.reset()

    @property
    def fans(self) -> NDArray[np.void]:
        """(n,) records `FAN`, to look at."""
        return self._fans

    @property
    def battery_voltage(self) -> float:
        """Of the bus, behind pack and wiring [V]."""
        return float(self._unit[0]["voltage"])

    @property
    def battery_current(self) -> float:
        """Out of the pack, all loads [A]."""
        return float(self._unit[0]["current"])

    @property
    def battery_charge(self) -> float:
        """Share of charge left, 0 to 1."""
        return float(self._unit[0]["charge"])

    @property
    def escs(self) -> NDArray[np.void]:
        """(n,) records `esc.ESC`, to look at."""
        return self._escs

    def step(self, pwm: Sequence[float] | NDArray[Any], dt: float, load: float = 0.0) -> Array:
        """Advance by one physics step.

        Args:
            pwm: (n,) pulse widths [us]; 0, or what is no pulse, for none.
            dt: [s], at most `MAX_STEP`.
            load: power the bus gives beside fans and `battery.idle_power` [W] >= 0.

        Returns:
            `wrench_in_base`.

        Raises:
            ValueError: a number is not finite, not allowed or missing; nothing has moved.
        """
        if np.shape(pwm) == (self._count,):
            self._fans["pulse"] = pwm
            moved = step_unit(
                self._unit,
                self._fans,
                self._escs,
                self._esc_shared,
                self.battery.curve,
                float(dt),
                float(load),
                self.wrench_in_base,
            )
            if moved:
                return self.wrench_in_base
        raise ValueError(
            f"pwm {pwm!r} is not {self._count} finite numbers, or dt {dt!r} not within "
            f"(0, {MAX_STEP}] s, or load {load!r} not finite or negative"
        )

    def reset(self) -> None:
        """As after power-on: unarmed, at rest, healthy, full pack."""
        self._escs[:] = 0
        self._escs["limit"] = 1.0
        for array in (self.speed, self.thrust, self.torque, self.current, self.wrench_in_base):
            array[:] = 0.0
        self.set_charge(1.0)

    def fail_fan(self, index: int) -> None:
        """Lose a fan: its bridge stays open and the rotor coasts down, until `heal` or `reset`."""
        self._escs[self._fan(index)]["failed"] = 1

    def heal(self, index: int | None = None) -> None:
        """Give a fan back, or all; its throttle comes up through the lag."""
        chosen = slice(None) if index is None else self._fan(index)
        self._escs["failed"][chosen] = 0

    def set_charge(self, share: float) -> None:
        """Set the pack's charge, 0 to 1, without load; raises ValueError outside."""
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"charge: {share!r} is outside the allowed range [0, 1]")
        self._unit[0]["charge"] = share
        self._unit[0]["voltage"] = self.battery.open_circuit_voltage(share)
        self._unit[0]["current"] = 0.0

    def _fan(self, index: int) -> int:
        if not 0 <= index < self._count:
            raise ValueError(f"fan: {index!r} is outside the allowed range [0, {self._count - 1}]")
        return index
