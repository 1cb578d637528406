"""Parameters of the autopilot that the companion relies on: read, compared, never written.

Somebody who answers for safety may have set them, and knows why. So what is not as it must be is
reported, and where thrust could outlive the companion or the pilot's word, arming is refused.
PX4 and ArduPilot announce a parameter that somebody changes later, so what is known stays true.

Source: mavlink.io/en/services/parameter.html; PX4 parameter reference; ArduPilot's GUID_ group.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.companion.telemetry import PX4
from husky_pu.mavlink.frames import Message
from husky_pu.radio.sbus import SbusChannel

ARDUPILOT = 3
"""MAV_AUTOPILOT."""
_ATTEMPTS = 5
_RETRY_AFTER = 0.3
"""Between two requests for what was not answered [s]."""


@dataclass(frozen=True)
class FlightSettingRule:
    """Values that a parameter may have.

    Attributes:
        name: of the parameter.
        why: what another value would do.
        lower, upper: range that is allowed.
        allowed: or the values one by one.
        bits: or bits that must be set.
        unsafe: arming is refused while it is otherwise, or not known.
    """

    name: str
    why: str
    lower: float = 0.0
    upper: float = 0.0
    allowed: tuple[float, ...] = ()
    bits: int = 0
    unsafe: bool = False

    def accepts(self, value: float) -> bool:
        """Return whether a value is allowed; NaN is not."""
        if self.bits:
            return value == int(value) and int(value) & self.bits == self.bits
        if self.allowed:
            return value in self.allowed
        return self.lower <= value <= self.upper

    @property
    def allowance(self) -> str:
        """The allowed values in words."""
        if self.bits:
            return f"a number with bits {self.bits}"
        if self.allowed:
            return " or ".join(f"{value:g}" for value in self.allowed)
        only = self.lower == self.upper
        return f"{self.lower:g}" if only else f"{self.lower:g} to {self.upper:g}"


def rules_of(cells: int) -> dict[int, tuple[FlightSettingRule, ...]]:
    """Return the rules by MAV_AUTOPILOT, for a battery of so many cells."""
    rule = FlightSettingRule
    loss = "it is how long thrust goes on without a companion [s]"
    px4 = [
        rule("COM_OF_LOSS_T", loss, 0.1, 1.0, unsafe=True),
        rule(
            "COM_OBL_RC_ACT",
            "without setpoints it must land, terminate or disarm; others need a position",
            allowed=(4.0, 6.0, 7.0),
            unsafe=True,
        ),
        rule(
            "NAV_RCL_ACT",
            "without the radio it must land, terminate or disarm; others need a position",
            allowed=(3.0, 5.0, 6.0),
            unsafe=True,
        ),
        rule("RC_MAP_KILL_SW", "the pilot has no kill switch", 1.0, 16.0, unsafe=True),
        rule("MC_AIRMODE", "moments raise the thrust of a robot that rests", unsafe=True),
        rule("COM_RC_IN_MODE", "the radio is not heard", allowed=(0.0, 2.0, 3.0)),
        rule("COM_RC_LOSS_T", "it is how long a silent radio goes unnoticed [s]", 0.0, 1.0),
        rule("COM_LOW_BAT_ACT", "an empty battery lands nothing", allowed=(2.0, 3.0)),
        rule("BAT1_N_CELLS", "the battery's charge is told wrong", allowed=(float(cells),)),
        rule("MPC_THR_MAX", "a share of thrust is another force than asked for", 1.0, 1.0),
        rule("FD_FAIL_R", "fans stop on a slope [deg]"),
        rule("FD_FAIL_P", "fans stop on a slope [deg]"),
        rule("PWM_MAIN_DISARM", "disarmed fans may turn [us]", 800.0, 1000.0),
    ]
    for name, channel in (
        ("ROLL", SbusChannel.ROLL),
        ("PITCH", SbusChannel.PITCH),
        ("THROTTLE", SbusChannel.THROTTLE),
        ("YAW", SbusChannel.YAW),
        ("OFFB_SW", SbusChannel.MODE),
        ("ARM_SW", SbusChannel.ARM),
    ):
        why = "rc_transmitter has it on another channel"
        px4.append(rule(f"RC_MAP_{name}", why, allowed=(float(channel + 1),)))
    ardupilot = (
        rule("GUID_OPTIONS", "thrust would be a climb rate", bits=8, unsafe=True),
        rule("GUID_TIMEOUT", loss, 0.1, 1.0, unsafe=True),
    )
    return {PX4: tuple(px4), ARDUPILOT: ardupilot}


class FlightSettings:
    """An autopilot's parameters, and what is wrong with them.

    Attributes:
        autopilot: MAV_AUTOPILOT of its heartbeat, None before.
    """

    def __init__(self, rules: Mapping[int, Sequence[FlightSettingRule]]):
        """Know nothing; `rules` are by MAV_AUTOPILOT, of others nothing is asked."""
        self._by_autopilot = rules
        self.autopilot: int | None = None
        self._rules: dict[str, FlightSettingRule] = {}
        self._values: dict[str, float] = {}
        self._missing: set[str] = set()
        self._attempts = 0
        self._next_at = 0.0

    def begin(self, autopilot: int | None) -> None:
        """An autopilot is there, or there again: read all of its parameters anew."""
        self.autopilot = autopilot
        rules = () if autopilot is None else self._by_autopilot.get(autopilot, ())
        self._rules = {rule.name: rule for rule in rules}
        self._values.clear()
        self._missing = set(self._rules)
        self._attempts = 0
        self._next_at = 0.0

    def due(self, now: float) -> list[str]:
        """Return the parameters to ask for now, which counts as asked."""
        if not self._missing or self._attempts > _ATTEMPTS or now < self._next_at:
            return []
        self._attempts += 1
        self._next_at = now + _RETRY_AFTER
        return [] if self._attempts > _ATTEMPTS else sorted(self._missing)

    @property
    def settled(self) -> bool:
        """True if all have been answered, or asked for often enough."""
        known = self.autopilot is not None and not self._missing
        return known or not self._by_autopilot or self._attempts > _ATTEMPTS

    def note(self, message: Message) -> None:
        """Take PARAM_VALUE, asked for or not, and PARAM_ERROR."""
        name = message.param_id
        if name not in self._rules:
            return
        if message.get_type() == "PARAM_VALUE":
            self._values[name] = self._number(message.param_value, message.param_type)
            self._missing.discard(name)
        elif message.error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST:
            self._missing.discard(name)

    def _number(self, field: float, type_: int) -> float:
        """Return the value in the float field: PX4 puts an integer's bytes there as they are."""
        if self.autopilot == PX4 and type_ == mavlink.MAV_PARAM_TYPE_INT32:
            return float(struct.unpack("<i", struct.pack("<f", field))[0])
        return field

    def problems(self, *, unsafe: bool) -> list[str]:
        """Return what is wrong with the parameters that are unsafe when wrong, or with others.

        A parameter that another version of the autopilot does not have is wrong only when it has
        to be known.
        """
        found = []
        for name, rule in self._rules.items():
            value = self._values.get(name)
            if rule.unsafe is not unsafe or (value is not None and rule.accepts(value)):
                continue
            if value is not None:
                found.append(f"{name} is {value:g}, allowed {rule.allowance}: {rule.why}")
            elif unsafe and self.settled:
                found.append(f"{name} is not told, allowed {rule.allowance}: {rule.why}")
        return found

    @property
    def unread(self) -> list[str]:
        """Parameters that the autopilot has not told."""
        return [name for name in self._rules if name not in self._values]
