"""Cascaded attitude control: a quaternion law gives rates, a PID of the rates gives moments.

The structure is PX4's: `mc_att_control` (Brescianini, Hehn and D'Andrea, "Nonlinear quadrocopter
attitude control", ETH 2013, with the tilt before the heading) and `mc_rate_control`. All moments
are shares of what the mixer can give about an axis, -1 to 1, in FRD body axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from husky_description.rotation import Quaternion, Vector, conjugate, multiply


@dataclass(frozen=True)
class ControlGains:
    """Gains about roll, pitch and yaw.

    Attributes:
        attitude: rates per error [1/s].
        yaw_weight: how much the heading counts beside the tilt, 0 to 1.
        rate_limit: of the rates that the attitude law asks for [rad/s].
        proportional: moment share per rate error [s/rad].
        integral: the same per angle of error [1/rad].
        derivative: the same per angular acceleration [s^2/rad]; it leads the fans' lag.
        integral_limit: of the moment share of the integral.
        cutoff: of the derivative's low-pass filter [Hz].
    """

    attitude: Vector
    yaw_weight: float
    rate_limit: Vector
    proportional: Vector
    integral: Vector
    derivative: Vector
    integral_limit: Vector
    cutoff: float


def rate_demand(attitude: Quaternion, desired: Quaternion, gains: ControlGains) -> Vector:
    """Return the rates in the body that turn it towards the desired attitude [rad/s].

    Args:
        attitude: quaternion (x, y, z, w), body to NED.
        desired: the same.
        gains: see `ControlGains`.
    """
    # Tilt first: the shortest turn that brings the body's z axis where it is wanted.
    ex, ey, ez, ew = multiply(conjugate(attitude), desired)
    # The desired z axis in the body.
    zx, zy, zz = 2 * (ex * ez + ew * ey), 2 * (ey * ez - ew * ex), 1 - 2 * (ex * ex + ey * ey)
    if zz > -1 + 1e-6:
        scale = 1.0 / math.sqrt(2 * (1 + zz))
        tilt: Quaternion = (-zy * scale, zx * scale, 0.0, 0.5 / scale)
        # What is left is a turn about z alone.
        _, _, rz, rw = multiply(conjugate(tilt), (ex, ey, ez, ew))
        half = math.atan2(rz, rw) if rw >= 0.0 else math.atan2(-rz, -rw)
        half *= gains.yaw_weight
        ex, ey, ez, ew = multiply(tilt, (0.0, 0.0, math.sin(half), math.cos(half)))
    sign = 2.0 if ew >= 0.0 else -2.0
    kx, ky, kz = gains.attitude
    # The yaw gain has the weight in it already: undo it, as PX4 does.
    kz = kz / max(gains.yaw_weight, 0.05)
    lx, ly, lz = gains.rate_limit
    return (
        max(-lx, min(lx, sign * kx * ex)),
        max(-ly, min(ly, sign * ky * ey)),
        max(-lz, min(lz, sign * kz * ez)),
    )


class RateControl:
    """PID on angular rates with the derivative on the measurement, and integrals that stay sane."""

    def __init__(self) -> None:
        """Start at rest."""
        self.integral = [0.0, 0.0, 0.0]
        self._rates: Vector | None = None
        self._accelerations = [0.0, 0.0, 0.0]

    def reset_integral(self) -> None:
        """Forget the integrals: the unit stands on something, or its fans are off."""
        self.integral = [0.0, 0.0, 0.0]

    def reset(self) -> None:
        """Forget everything."""
        self.__init__()  # type: ignore[misc]

    def update(
        self, rates: Vector, demand: Vector, gains: ControlGains, dt: float, *, integrate: bool
    ) -> Vector:
        """Return the moments, -1 to 1.

        Args:
            rates: measured [rad/s].
            demand: wanted [rad/s].
            gains: see `ControlGains`.
            dt: since the last call [s].
            integrate: False freezes the integrals.
        """
        last = self._rates if self._rates is not None else rates
        self._rates = rates
        blend = dt / (dt + 1.0 / (2.0 * math.pi * gains.cutoff))
        moments = [0.0, 0.0, 0.0]
        for axis in range(3):
            rate = rates[axis]
            error = demand[axis] - rate
            slope = self._accelerations[axis]
            slope += blend * ((rate - last[axis]) / dt - slope)
            self._accelerations[axis] = slope
            wanted = (
                gains.proportional[axis] * error
                + self.integral[axis]
                - gains.derivative[axis] * slope
            )
            moment = max(-1.0, min(1.0, wanted))
            moments[axis] = moment
            # Anti-windup: an integral does not grow into a saturation.
            if integrate and (moment == wanted or error * wanted < 0.0):
                limit = gains.integral_limit[axis]
                grown = self.integral[axis] + gains.integral[axis] * error * dt
                self.integral[axis] = max(-limit, min(limit, grown))
        return (moments[0], moments[1], moments[2])
