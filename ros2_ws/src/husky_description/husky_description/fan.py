"""Coefficients of a rotor, ducted or not, and its steady state: thrust k w^2 and what it costs.

- Thrust T = k w^2. The jet of a duct that does not contract: T = rho A v^2, its power
  P = rho A v^3 / 2 = T^1.5 / (2 sqrt(rho A)) (momentum theory, hover).
- Drag torque of the rotor Q = c w^2: Q w = P / rotor efficiency, so Q / T = c / k is constant.
- Motor seen from direct current: u = w / K + R i, torque (i - i0) / K; u = throttle * bus voltage
  (a chopper without loss beside R), so the bus gives throttle * i. Full bridge: i may be negative
  (the rotor is braked and feeds back); an open bridge has i = 0.

k, c, K of a ducted fan follow from thrust, speed, efficiency, R and i0 at full throttle on
`fans.voltage`. An open propeller's k and c are those that fit the maker's static table best; its
jet contracts to half of the disc, so rho A stands for half of the disc's area.
Hover values; a rotor in fast axial flow loses thrust, which is not modelled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from husky_description.arrays import Array
from husky_description.propellers import PropellersSection
from husky_description.robot import Robot
from husky_description.sections import FansSection

_AIR_DENSITY = 1.225
"""Standard atmosphere at sea level [kg/m^3]."""


@dataclass(frozen=True)
class FanModel:
    """Coefficients of a rotor and its steady state.

    Attributes:
        thrust_coefficient: k [N s^2].
        drag_coefficient: c [N m s^2].
        speed_constant: K [rad/s/V]; the torque constant is 1 / K [N m/A].
        resistance: R [ohm].
        no_load_current: i0 [A].
        inertia: J [kg m^2].
        rotor_efficiency: jet power over shaft power [-].
        jet_factor: jet power = jet_factor * T^1.5 [W/N^1.5].
        moment_per_thrust: steady moment on the body over thrust, against the spin [m].
        body_torque_share: of the drag torque that the flow does not give back to the vanes [-].
        max_thrust: of one at full throttle on the nominal voltage [N].
    """

    thrust_coefficient: float
    drag_coefficient: float
    speed_constant: float
    resistance: float
    no_load_current: float
    inertia: float
    rotor_efficiency: float
    jet_factor: float
    moment_per_thrust: float
    body_torque_share: float
    max_thrust: float

    @staticmethod
    def of(robot: Robot) -> FanModel:
        """Return the coefficients of the robot's rotors, which are alike."""
        if robot.legs_carry_propellers:
            return FanModel.from_propellers(robot.propellers)
        return FanModel.from_section(robot.fans)

    @staticmethod
    def from_propellers(propellers: PropellersSection) -> FanModel:
        """Fit the coefficients to the static table of the section `propellers` of beta.yaml.

        The fit is of least relative error: hover and full throttle count alike.
        """
        thrust = _relative_fit(propellers.speed**2, propellers.thrust)
        drag = _relative_fit(propellers.speed**2, propellers.torque)
        disc = math.pi * propellers.diameter**2 / 4.0
        jet_factor = 0.5 / math.sqrt(_AIR_DENSITY * disc / 2.0)
        speed = propellers.full_speed
        jet_power = jet_factor * (thrust * speed**2) ** 1.5
        return FanModel(
            thrust_coefficient=thrust,
            drag_coefficient=drag,
            speed_constant=propellers.speed_constant,
            resistance=propellers.resistance,
            no_load_current=propellers.no_load_current,
            inertia=propellers.rotor_inertia,
            rotor_efficiency=jet_power / (drag * speed**3),
            jet_factor=jet_factor,
            moment_per_thrust=drag / thrust,
            body_torque_share=1.0,
            max_thrust=thrust * speed**2,
        )

    @staticmethod
    def from_section(fans: FansSection) -> FanModel:
        """Derive the coefficients from the section `fans` of carbon.yaml."""
        current = fans.full_current
        speed_constant = fans.max_speed / (fans.voltage - fans.resistance * current)
        torque = (current - fans.no_load_current) / speed_constant
        jet_factor = 0.5 / math.sqrt(fans.air_density * fans.flow_area)
        jet_power = jet_factor * fans.max_thrust * math.sqrt(fans.max_thrust)
        return FanModel(
            thrust_coefficient=fans.max_thrust / fans.max_speed**2,
            drag_coefficient=torque / fans.max_speed**2,
            speed_constant=speed_constant,
            resistance=fans.resistance,
            no_load_current=fans.no_load_current,
            inertia=fans.rotor_inertia,
            rotor_efficiency=jet_power / (torque * fans.max_speed),
            jet_factor=jet_factor,
            moment_per_thrust=fans.body_torque_share * torque / fans.max_thrust,
            body_torque_share=fans.body_torque_share,
            max_thrust=fans.max_thrust,
        )

    def jet_power(self, thrust: float) -> float:
        """Least power that makes a thrust [W]; thrust [N] >= 0."""
        return self.jet_factor * thrust * math.sqrt(thrust)

    def steady_current(self, thrust: float) -> float:
        """Motor current that keeps a thrust [A]; thrust [N] >= 0."""
        torque = self.drag_coefficient / self.thrust_coefficient * thrust
        return self.no_load_current + torque * self.speed_constant

    def steady_voltage(self, thrust: float) -> float:
        """Motor voltage (throttle times bus voltage) that keeps a thrust [V]; thrust [N] >= 0.

        At no thrust, what just overcomes friction.
        """
        speed = math.sqrt(thrust / self.thrust_coefficient)
        return speed / self.speed_constant + self.resistance * self.steady_current(thrust)

    def electrical_power(self, thrust: float) -> float:
        """Power that keeps a thrust [W]; thrust [N] >= 0."""
        return self.steady_voltage(thrust) * self.steady_current(thrust)

    def steady_thrust(self, motor_voltage: float) -> float:
        """Thrust that a motor voltage [V] keeps [N], inverse of `steady_voltage`."""
        surplus = motor_voltage - self.resistance * self.no_load_current
        if surplus <= 0.0:
            return 0.0
        # a w^2 + w / K = surplus, in the form that does not cancel
        a = self.resistance * self.drag_coefficient * self.speed_constant
        slope = 1.0 / self.speed_constant
        speed = 2.0 * surplus / (slope + math.sqrt(slope * slope + 4.0 * a * surplus))
        return self.thrust_coefficient * speed * speed


def _relative_fit(x: Array, y: Array) -> float:
    """Return the slope a of y = a x that makes the relative errors least."""
    ratio = x / y
    return float(ratio.sum() / (ratio @ ratio))
