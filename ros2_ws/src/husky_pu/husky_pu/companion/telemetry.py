"""What an autopilot tells, put together: messages in, one report per bundle out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TypeVar

from husky_description.rotation import Quaternion
from husky_pu.mavlink.axes import ros_attitude
from husky_pu.mavlink.frames import Message

T = TypeVar("T")

SATURATED = 32767
"""What a current field of 16 bits shows from 327.67 A on [cA]."""
MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
}
"""PX4's main modes: byte 2 of HEARTBEAT.custom_mode."""
PX4 = 12
"""MAV_AUTOPILOT."""
_ARMED = 0x80
_CUSTOM = 0x01
_FAILSAFE_STATES = (5, 6)
"""MAV_STATE: critical, emergency."""
_WARNING = 4
"""MAV_SEVERITY: this and smaller numbers are warnings and worse."""
_EARLIER = 6
"""Times in a row that went back before the autopilot counts as started again."""
_TEXT_SIZE = 50
_NO_CELL = 65535
_NO_ROTATION: Quaternion = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class BatteryReading:
    """The battery; NaN where the autopilot does not know.

    Attributes:
        voltage: of the pack [V].
        current: drawn from it [A]; a lower bound when saturated.
        remaining: share of the charge, 0 to 1.
        cells: voltages of the cells [V], empty when only the pack's is known.
        saturated: the field was full: 327.67 A or more.
    """

    voltage: float = math.nan
    current: float = math.nan
    remaining: float = math.nan
    cells: tuple[float, ...] = ()
    saturated: bool = False


@dataclass(frozen=True)
class Report:
    """The propulsion unit at one time.

    Attributes:
        boot_us: the autopilot's time since its start [us].
        armed: whether the fans may turn.
        mode: of PX4, e.g. "OFFBOARD".
        failsafe: which one acts, "" for none.
        reason: last status text.
        attitude_desired: FLU to ENU (x, y, z, w).
        attitude: the same as measured.
        collective_desired: share of full thrust, 0 to 1.
        pwm: of the outputs to the fans, the first [us].
        tilt: of the two behind them, the servos of the thrust's axis [us]; 0 for none.
        fan_speed: of the rotors [rad/s]; NaN as long as no speed controller tells.
        fan_ok: false for a fan that is lost.
        battery: see `BatteryReading`.
    """

    boot_us: int = 0
    armed: bool = False
    mode: str = ""
    failsafe: str = ""
    reason: str = ""
    attitude_desired: Quaternion = _NO_ROTATION
    attitude: Quaternion = _NO_ROTATION
    collective_desired: float = 0.0
    pwm: tuple[int, ...] = ()
    tilt: tuple[int, int] = (0, 0)
    fan_speed: tuple[float, ...] = ()
    fan_ok: tuple[bool, ...] = ()
    battery: BatteryReading = BatteryReading()


class Telemetry:
    """Keeps the newest of everything.

    Attributes:
        report: as of the last bundle and what has come since.
        autopilot: MAV_AUTOPILOT of the heartbeat.
        invalid: messages with numbers that are not finite; dropped.
        boots: how often the autopilot's time went back: it was started again.
        warning: the text that has just come, if it was a warning, else "".
    """

    def __init__(self, fans: int) -> None:
        """Nothing is known yet of a unit with so many fans."""
        self._fans, self._unknown = fans, (math.nan,) * fans
        # Those of the fans, then the two of the thrust's axis.
        self._outputs = attrgetter(*(f"servo{number}_raw" for number in range(1, fans + 3)))
        self.report = Report(pwm=(0,) * fans, fan_speed=self._unknown, fan_ok=(True,) * fans)
        self.autopilot = 0
        self.invalid = 0
        self.boots = 0
        self.warning = ""
        self._boot_ms = -1
        self._earlier = 0
        self._failsafe_text = ""
        self._critical = False
        self._has_battery_status = False
        self._escs_tell = False
        self._chunks: dict[int, str] = {}

    def note(self, message: Message) -> bool:
        """Take a message of the autopilot; return whether it completes a bundle."""
        self.warning = ""
        note = _NOTED.get(message.get_type())
        if note is None:
            return False
        numbers = [v for f in message.get_fieldnames() for v in _flat(getattr(message, f))]
        if not all(map(math.isfinite, numbers)):
            self.invalid += 1
            return False
        note(self, message)
        return bool(message.get_type() == "SERVO_OUTPUT_RAW")

    def settle(self, *, armed: bool | None = None, mode: str | None = None) -> None:
        """The autopilot has agreed to this; its next heartbeat will say so too."""
        if armed is not None:
            self.report = replace(self.report, armed=armed)
        if mode is not None:
            self.report = replace(self.report, mode=mode)

    def _boot_time(self, boot_ms: int) -> None:
        # Wraps after 49 days, which is no restart. Nor is a second autopilot of the same id, whose
        # times and the first one's come by turns.
        if self._boot_ms - 100 > boot_ms and self._boot_ms - boot_ms < 1 << 31:
            self._earlier += 1
            if self._earlier < _EARLIER:
                return
            self.boots += 1
            self._critical = False
            self.report = replace(self.report, armed=False, failsafe="", reason="")
        self._earlier = 0
        self._boot_ms = boot_ms

    def _heartbeat(self, message: Message) -> None:
        self.autopilot = message.autopilot
        main = message.custom_mode >> 16 & 0xFF
        named = message.autopilot == PX4 and message.base_mode & _CUSTOM
        self._critical = message.system_status in _FAILSAFE_STATES
        if not self._critical:
            self._failsafe_text = ""
        self.report = replace(
            self.report,
            armed=bool(message.base_mode & _ARMED),
            mode=MODES.get(main, f"mode {main}") if named else f"custom {message.custom_mode}",
            failsafe=self._failsafe(),
        )

    def _failsafe(self) -> str:
        return (self._failsafe_text or "critical") if self._critical else ""

    def _attitude_quaternion(self, message: Message) -> None:
        self._boot_time(message.time_boot_ms)
        q = (message.q1, message.q2, message.q3, message.q4)
        self.report = replace(self.report, attitude=ros_attitude(q))

    def _attitude_target(self, message: Message) -> None:
        self._boot_time(message.time_boot_ms)
        self.report = replace(
            self.report,
            attitude_desired=ros_attitude(message.q),
            collective_desired=message.thrust,
        )

    def _servo_output_raw(self, message: Message) -> None:
        *pwm, pitch, roll = self._outputs(message)
        self.report = replace(
            self.report,
            boot_us=self._unwrap(message.time_usec),
            pwm=tuple(pwm),
            tilt=(pitch, roll),
        )

    def _esc_status(self, message: Message) -> None:
        if self._escs_tell:
            speeds = [rpm * math.pi / 30.0 for rpm in message.rpm]
            speed = _with_batch(self.report.fan_speed, speeds, message.index)
            self.report = replace(self.report, fan_speed=speed)

    def _esc_info(self, message: Message) -> None:
        everyone = (1 << self._fans) - 1
        self._escs_tell = message.info & everyone == everyone
        sound = [flags == 0 for flags in message.failure_flags]
        self.report = replace(
            self.report, fan_ok=_with_batch(self.report.fan_ok, sound, message.index)
        )
        if not self._escs_tell:
            self.report = replace(self.report, fan_speed=self._unknown)

    def _unwrap(self, low_us: int) -> int:
        """Return the time of which the 32 bits are known, near the other messages' [us].

        They wrap after 71 minutes; the other messages count milliseconds.
        """
        if self._boot_ms < 0:
            return low_us
        near = 1000 * self._boot_ms
        return max(0, near + ((low_us - near + (1 << 31)) & 0xFFFFFFFF) - (1 << 31))

    def _battery_status(self, message: Message) -> None:
        if message.id != 0:
            return
        self._has_battery_status = True
        known = [mv for mv in message.voltages if mv != _NO_CELL]
        # Without cells the pack stands in the first place, split where it exceeds 65.534 V.
        cells = tuple(1e-3 * mv for mv in known) if len(known) > 1 and known[0] < 6000 else ()
        self._battery(1e-3 * sum(known) if known else math.nan, message, cells)

    def _sys_status(self, message: Message) -> None:
        if self._has_battery_status:
            return
        millivolts = message.voltage_battery
        self._battery(1e-3 * millivolts if millivolts != _NO_CELL else math.nan, message, ())

    def _battery(self, voltage: float, message: Message, cells: tuple[float, ...]) -> None:
        centi, percent = message.current_battery, message.battery_remaining
        # -1 is unknown; what is below may be a charger or a counter that ran over: not believed.
        battery = BatteryReading(
            voltage,
            1e-2 * centi if centi >= 0 else math.nan,
            1e-2 * percent if 0 <= percent <= 100 else math.nan,
            cells,
            centi >= SATURATED,
        )
        self.report = replace(self.report, battery=battery)

    def _statustext(self, message: Message) -> None:
        text = message.text
        if message.id:
            text = self._chunks.pop(message.id, "") + text
            if len(message.text) == _TEXT_SIZE and len(text) < 10 * _TEXT_SIZE:
                self._chunks = {message.id: text}  # goes on
                return
        if message.severity <= _WARNING:
            self.warning = text
        if "failsafe" in text.lower():
            self._failsafe_text = text
        self.report = replace(self.report, reason=text, failsafe=self._failsafe())


_NOTED = {
    "HEARTBEAT": Telemetry._heartbeat,
    "ATTITUDE_QUATERNION": Telemetry._attitude_quaternion,
    "ATTITUDE_TARGET": Telemetry._attitude_target,
    "SERVO_OUTPUT_RAW": Telemetry._servo_output_raw,
    "ESC_STATUS": Telemetry._esc_status,
    "ESC_INFO": Telemetry._esc_info,
    "BATTERY_STATUS": Telemetry._battery_status,
    "SYS_STATUS": Telemetry._sys_status,
    "STATUSTEXT": Telemetry._statustext,
}


def _with_batch(of_all: tuple[T, ...], batch: Sequence[T], first: int) -> tuple[T, ...]:
    """Return what is known of all fans after a message about those from `first` on."""
    return (*of_all[:first], *batch, *of_all[first + len(batch) :])[: len(of_all)]


def _flat(value: object) -> Sequence[float]:
    """Return the floats in a field."""
    if isinstance(value, float):
        return (value,)
    return [v for v in value if isinstance(v, float)] if isinstance(value, list) else ()
