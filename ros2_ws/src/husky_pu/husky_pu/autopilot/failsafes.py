"""Fail-safes: which one acts, and what it does. The table stands in docs/flight_controller.md."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from husky_pu.autopilot.battery import BatteryLevel
from husky_pu.autopilot.flight_parameters import FlightParameters
from husky_pu.autopilot.state import Motion


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
    """Level, thrust ramps to 0 within HKY_FS_RAMP, then disarm; with MPC_LAND_SPEED, in the air,
    at that speed to the ground before."""
    TERMINATE = "terminate"
    """Fans off at once; no arming until the termination is lifted."""
    DISARM = "disarm"
    """Fans off at once."""


@dataclass(frozen=True)
class FlightSituation:
    """What the pre-arm checks and the fail-safes look at.

    Attributes:
        mode: of flight.
        motion: of the unit, and what of its sensors can be believed.
        tilted_for: how long roll or pitch have been beyond FD_FAIL_R, FD_FAIL_P [s].
        battery_connected: the power module says something that can be true.
        battery: its warning now.
        battery_warned: its gravest warning of this flight.
        kill: the kill switch is on.
        terminated: a termination has not been lifted.
        sticks_seen: sticks have come since boot.
        sticks_alive: and still do.
        throttle: of the stick, 0 to 1.
        stream_alive: setpoints come at 2 Hz or faster.
        setpoint_age: since the last accepted setpoint [s].
        setpoint_thrust: that they ask for, 0 to 1.
        fans_lost: how many fans are.
    """

    mode: FlightMode
    motion: Motion
    tilted_for: float
    battery_connected: bool
    battery: BatteryLevel
    battery_warned: BatteryLevel
    kill: bool
    terminated: bool
    sticks_seen: bool
    sticks_alive: bool
    throttle: float
    stream_alive: bool
    setpoint_age: float
    setpoint_thrust: float
    fans_lost: int


_OFFBOARD_REACTIONS = {4: Reaction.DESCEND, 6: Reaction.TERMINATE, 7: Reaction.DISARM}
_RC_REACTIONS = {3: Reaction.DESCEND, 5: Reaction.TERMINATE, 6: Reaction.DISARM}
_RC_DOES_NOT_MATTER = 4
"""Bit of COM_RCL_EXCEPT for OFFBOARD."""


def judge(
    situation: FlightSituation, parameters: FlightParameters
) -> tuple[Cause, Reaction] | None:
    """Return the gravest fail-safe that has to act while armed, or None."""
    s, p = situation, parameters
    if s.tilted_for > p["FD_FAIL_R_TTRI"]:
        return Cause.TILT, Reaction.TERMINATE
    if s.motion.sensors_lost:
        return Cause.SENSORS, Reaction.DESCEND
    if s.battery_warned >= BatteryLevel.CRITICAL and p["COM_LOW_BAT_ACT"] > 0:
        return Cause.BATTERY, Reaction.DESCEND
    if s.fans_lost > (0 if p["COM_ACT_FAIL_ACT"] else 1):
        return Cause.FANS, Reaction.DESCEND
    offboard = s.mode is FlightMode.OFFBOARD
    if offboard and s.setpoint_age > p["COM_OF_LOSS_T"]:
        reaction = _OFFBOARD_REACTIONS.get(int(p["COM_OBL_RC_ACT"]), Reaction.DESCEND)
        return Cause.OFFBOARD_LOSS, reaction
    excepted = offboard and int(p["COM_RCL_EXCEPT"]) & _RC_DOES_NOT_MATTER
    if s.sticks_seen and not s.sticks_alive and not excepted:
        return Cause.RC_LOSS, _RC_REACTIONS.get(int(p["NAV_RCL_ACT"]), Reaction.DESCEND)
    return None
