"""Fail-safes: which one acts, and what it does. The table stands in docs/flight_controller.md."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from husky_pu.autopilot_battery import BatteryLevel
from husky_pu.flight_parameters import FlightParameters


class FlightMode(Enum):
    """Modes, by the names of PX4."""

    STABILIZED = "STABILIZED"
    OFFBOARD = "OFFBOARD"


class Cause(Enum):
    """Why a fail-safe acts; the values are what status texts say."""

    TERMINATION = "flight termination"
    KILL = "kill switch"
    TILT = "attitude failure"
    SENSORS = "sensors lost"
    BATTERY = "battery critical"
    FANS = "fans lost"
    OFFBOARD_LOSS = "offboard lost"
    RC_LOSS = "manual control lost"


class Reaction(Enum):
    """What happens."""

    DESCEND = "descend"
    """Level, thrust ramps to 0 within HKY_FS_RAMP, then disarm."""
    TERMINATE = "terminate"
    """Fans off at once; no arming until the termination is lifted."""
    DISARM = "disarm"
    """Fans off at once."""


@dataclass(frozen=True)
class Health:
    """What the fail-safes look at.

    Attributes:
        mode: of flight.
        sensors_lost: gyro or accelerometer say nothing that can be true.
        tilted_for: how long roll or pitch have been beyond FD_FAIL_R, FD_FAIL_P [s].
        battery: warning.
        setpoint_age: since the last accepted setpoint [s].
        sticks_seen: sticks have come since boot.
        sticks_lost: and now do not.
        fans_lost: how many fans are.
    """

    mode: FlightMode
    sensors_lost: bool
    tilted_for: float
    battery: BatteryLevel
    setpoint_age: float
    sticks_seen: bool
    sticks_lost: bool
    fans_lost: int = 0


_OFFBOARD_REACTIONS = {4: Reaction.DESCEND, 6: Reaction.TERMINATE, 7: Reaction.DISARM}
_RC_REACTIONS = {3: Reaction.DESCEND, 5: Reaction.TERMINATE, 6: Reaction.DISARM}
_RC_DOES_NOT_MATTER = 4
"""Bit of COM_RCL_EXCEPT for OFFBOARD."""


def judge(health: Health, parameters: FlightParameters) -> tuple[Cause, Reaction] | None:
    """Return the gravest fail-safe that has to act while armed, or None."""
    p = parameters
    if health.tilted_for > p["FD_FAIL_R_TTRI"]:
        return Cause.TILT, Reaction.TERMINATE
    if health.sensors_lost:
        return Cause.SENSORS, Reaction.DESCEND
    if health.battery >= BatteryLevel.CRITICAL and p["COM_LOW_BAT_ACT"] > 0:
        return Cause.BATTERY, Reaction.DESCEND
    if health.fans_lost > 1:
        return Cause.FANS, Reaction.DESCEND
    offboard = health.mode is FlightMode.OFFBOARD
    if offboard and health.setpoint_age > p["COM_OF_LOSS_T"]:
        reaction = _OFFBOARD_REACTIONS.get(int(p["COM_OBL_RC_ACT"]), Reaction.DESCEND)
        return Cause.OFFBOARD_LOSS, reaction
    excepted = offboard and int(p["COM_RCL_EXCEPT"]) & _RC_DOES_NOT_MATTER
    if health.sticks_seen and health.sticks_lost and not excepted:
        return Cause.RC_LOSS, _RC_REACTIONS.get(int(p["NAV_RCL_ACT"]), Reaction.DESCEND)
    return None
