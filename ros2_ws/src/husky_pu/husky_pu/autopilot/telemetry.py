"""What the flight controller tells over MAVLink: one function for each message, and its rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import common as mavlink

from husky_description.rotation import Quaternion, to_roll_pitch_yaw
from husky_pu import VERSION
from husky_pu.autopilot import arming
from husky_pu.autopilot import component_metadata as component_files
from husky_pu.autopilot.attitude_estimator import AttitudeEstimator
from husky_pu.autopilot.battery import BatteryMonitor
from husky_pu.autopilot.failsafes import FlightMode
from husky_pu.autopilot.flight import FlightLogic
from husky_pu.autopilot.flight_parameters import FlightParameters
from husky_pu.autopilot.imu import SensorSample
from husky_pu.autopilot.mavlink_ftp import crc32
from husky_pu.autopilot.rc import StickInput
from husky_pu.autopilot.setpoints import SetpointStream
from husky_pu.mavlink.dialect import (
    COMPONENT_METADATA,
    ESC_BATCH,
    ESC_FAILURE_GENERIC,
    ESC_INFO,
    ESC_STATUS,
    PROTOCOL_VERSION,
    ComponentMetadata,
    EscInfo,
    EscStatus,
    ProtocolVersion,
)

Message: TypeAlias = Any
"""A message of the dialect."""

MAIN_MODES = {FlightMode.OFFBOARD: 6, FlightMode.STABILIZED: 7}
"""PX4's main modes: byte 2 of HEARTBEAT.custom_mode, parameter 2 of DO_SET_MODE."""
_BASE_MODES = {
    FlightMode.OFFBOARD: 1 | 4 | 8 | 16,  # custom, auto, guided, stabilize
    FlightMode.STABILIZED: 1 | 16 | 64,  # custom, stabilize, manual input
}
_ARMED = 128
_SATURATED = 32767
"""Greatest current in a field of 16 bits [cA]: 327.67 A, which the fans can exceed. It stays
there; a reader takes it for "at least so much"."""
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT  # the messages; there are no items
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_VERSION = 1 << 24 | 14 << 16 | 3 << 8 | 255
"""PX4 1.14.3, release: whose behaviour this follows."""
_GYRO, _ACCEL, _MAG, _PRESSURE = 1, 2, 4, 8
_RATES, _ATTITUDE, _MOTORS, _RADIO = 1024, 2048, 32768, 65536
_FENCE, _BATTERY, _PREARM = 1 << 20, 1 << 25, 1 << 28
_UNUSED = 65535
_NO_TEMPERATURE = 32767
_OUTPUTS = 16
"""Of SERVO_OUTPUT_RAW."""


@dataclass
class Vehicle:
    """All there is to tell about.

    Attributes:
        parameters: of the flight controller.
        stream: of setpoints.
        input: of sticks.
        battery: what is left.
        estimator: attitude.
        logic: arming, modes, fail-safes.
        sensors: last good measurement.
        time_ns: the clock, boot at 0 [ns].
        pwm: pulses to the fans [us].
        tilt: pulses to the servos of the thrust's axis [us], 0 for none.
        damaged: frames that were bad, on all links.
        boot_unix: when the clock stood at 0 [s since 1970].
        files: what the file transfer protocol serves, by path.
    """

    parameters: FlightParameters
    stream: SetpointStream
    input: StickInput
    battery: BatteryMonitor
    estimator: AttitudeEstimator
    logic: FlightLogic
    sensors: SensorSample
    time_ns: int = 0
    pwm: tuple[int, ...] = ()
    tilt: tuple[int, int] = (0, 0)
    damaged: int = 0
    boot_unix: float = 0.0
    files: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def boot_ms(self) -> int:
        """Clock as most messages carry it [ms]."""
        return self.time_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def boot_us(self) -> int:
        """Clock as the others do [us]."""
        return self.time_ns // 1000

    @property
    def heartbeat_state(self) -> tuple[int, int, int]:
        """Base mode, custom mode and system status of the heartbeat."""
        logic = self.logic
        base = _BASE_MODES[logic.mode] | (_ARMED if logic.armed else 0)
        if logic.terminated:
            status = mavlink.MAV_STATE_FLIGHT_TERMINATION
        elif logic.failsafe is not None:
            status = mavlink.MAV_STATE_CRITICAL
        elif logic.armed:
            status = mavlink.MAV_STATE_ACTIVE
        else:
            ready = self.estimator.aligned
            status = mavlink.MAV_STATE_STANDBY if ready else mavlink.MAV_STATE_BOOT
        return base, MAIN_MODES[logic.mode] << 16, status


def scalar_first(q: Quaternion) -> list[float]:
    """Return (w, x, y, z) of (x, y, z, w)."""
    return [q[3], q[0], q[1], q[2]]


def heartbeat(v: Vehicle) -> Message:
    """HEARTBEAT of a PX4 quadrotor."""
    base, custom, status = v.heartbeat_state
    return mavlink.MAVLink_heartbeat_message(
        int(v.parameters["MAV_TYPE"]), mavlink.MAV_AUTOPILOT_PX4, base, custom, status, 3
    )


def attitude(v: Vehicle) -> Message:
    """ATTITUDE."""
    return mavlink.MAVLink_attitude_message(
        v.boot_ms, *to_roll_pitch_yaw(v.estimator.attitude), *v.estimator.rates
    )


def attitude_quaternion(v: Vehicle) -> Message:
    """ATTITUDE_QUATERNION."""
    return mavlink.MAVLink_attitude_quaternion_message(
        v.boot_ms, *scalar_first(v.estimator.attitude), *v.estimator.rates
    )


def attitude_target(v: Vehicle) -> Message:
    """ATTITUDE_TARGET: what the control loops follow, after every limit."""
    logic = v.logic
    return mavlink.MAVLink_attitude_target_message(
        v.boot_ms, 0, scalar_first(logic.attitude_desired), *logic.rates_desired, logic.thrust
    )


def highres_imu(v: Vehicle) -> Message:
    """HIGHRES_IMU: measurements as they are."""
    s = v.sensors
    hectopascal = 0.01 * s.pressure
    above = 44330.0 * (1.0 - (max(s.pressure, 0.0) / 101325.0) ** 0.190263)
    return mavlink.MAVLink_highres_imu_message(
        v.boot_us,
        *s.specific_force,
        *s.angular_velocity,
        *s.magnetic_field,
        hectopascal,
        0.0,
        above,
        0.0,
        0x007 | 0x038 | 0x1C0 | 0x200 | 0x800,
    )


def _centiampere(current: float) -> int:
    return max(0, min(_SATURATED, round(100.0 * current)))


def _percent(share: float) -> int:
    return round(100.0 * share) if math.isfinite(share) else -1


def sys_status(v: Vehicle) -> Message:
    """SYS_STATUS; the pre-arm bit is healthy when nothing speaks against arming."""
    battery, logic = v.battery, v.logic
    situation = logic.situation
    motion = situation.motion
    present = _GYRO | _ACCEL | _MAG | _PRESSURE | _RATES | _ATTITUDE | _MOTORS | _BATTERY | _PREARM
    healthy = _PRESSURE | _RATES | _MOTORS | _FENCE  # without a fence none is crossed
    healthy |= _GYRO | _ACCEL if motion.sensors_ok else 0
    healthy |= _MAG if motion.compass_ok else 0
    healthy |= _ATTITUDE if motion.aligned else 0
    healthy |= _BATTERY if situation.battery_connected and not situation.battery else 0
    healthy |= 0 if arming.refusals(situation, v.parameters) else _PREARM
    if v.input.seen:
        present |= _RADIO
        healthy |= _RADIO if situation.sticks_alive else 0
    return mavlink.MAVLink_sys_status_message(
        present,
        present,
        healthy,
        0,
        max(0, min(_UNUSED - 1, round(1000.0 * battery.voltage))),
        _centiampere(battery.current),
        _percent(battery.remaining),
        0,
        v.damaged & 0xFFFF,
        0,
        0,
        0,
        0,
    )


def battery_status(v: Vehicle) -> Message:
    """BATTERY_STATUS; the pack's voltage is shared out evenly among its cells."""
    battery = v.battery
    cells = min(10, int(v.parameters["BAT1_N_CELLS"]))
    cell = max(0, min(_UNUSED - 1, round(1000.0 * battery.voltage / cells)))
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        [cell] * cells + [_UNUSED] * (10 - cells),
        _centiampere(battery.current),
        round(battery.consumed / 3.6),
        round(battery.energy / 100.0),
        _percent(battery.remaining),
        0,
        1 + battery.level,
    )


def rc_channels(v: Vehicle) -> Message:
    """RC_CHANNELS: what the sticks said last."""
    pulses = [round(pulse) for pulse in v.input.pulses]
    padded = pulses + [_UNUSED] * (18 - len(pulses))
    lost = v.input.silent(1e-9 * v.time_ns)
    return mavlink.MAVLink_rc_channels_message(v.boot_ms, len(pulses), *padded, 0 if lost else 254)


def servo_output_raw(v: Vehicle) -> Message:
    """SERVO_OUTPUT_RAW: fans, tilt servos; its clock has 32 bits and wraps after 71 minutes."""
    outputs = (*v.pwm, *v.tilt)
    unused = (0,) * (_OUTPUTS - len(outputs))
    return mavlink.MAVLink_servo_output_raw_message(v.boot_us & 0xFFFFFFFF, 0, *outputs, *unused)


def esc_status(v: Vehicle) -> list[Message]:
    """ESC_STATUS: what the speed controllers tell; zero without their telemetry."""
    s = v.sensors
    rpm = [round(_known(speed) * 30.0 / math.pi) for speed in s.fan_speed]
    current = [_known(i) for i in s.fan_current]
    voltage = [v.battery.voltage if _tells(v) else 0.0] * len(rpm)
    return [
        EscStatus(first, v.boot_us, _four(rpm, first), _four(voltage, first), _four(current, first))
        for first in range(0, len(rpm), ESC_BATCH)
    ]


def esc_info(v: Vehicle) -> list[Message]:
    """ESC_INFO: which fans are lost; all are online if they tell something."""
    flags = [0 if ok else ESC_FAILURE_GENERIC for ok in v.logic.fans_ok]
    count, cold = len(flags), [_NO_TEMPERATURE] * ESC_BATCH
    online = (1 << count) - 1 if _tells(v) else 0
    return [
        EscInfo(first, v.boot_us, 0, count, 0, online, _four(flags, first), [0] * ESC_BATCH, cold)
        for first in range(0, count, ESC_BATCH)
    ]


def _four(values: Sequence[float], first: int) -> list[float]:
    """Return what a message says of four speed controllers, zero for those that are not there."""
    some = list(values[first : first + ESC_BATCH])
    return some + [0] * (ESC_BATCH - len(some))


def _tells(v: Vehicle) -> bool:
    return math.isfinite(sum(v.sensors.fan_speed))


def _known(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def extended_sys_state(v: Vehicle) -> Message:
    """EXTENDED_SYS_STATE: in the air means that there is thrust."""
    flying = v.logic.thrust > v.parameters["HKY_INT_THR"]
    landed = mavlink.MAV_LANDED_STATE_IN_AIR if flying else mavlink.MAV_LANDED_STATE_ON_GROUND
    return mavlink.MAVLink_extended_sys_state_message(0, landed)


def system_time(v: Vehicle) -> Message:
    """SYSTEM_TIME: that of the host at boot, from there by the flight controller's clock."""
    return mavlink.MAVLink_system_time_message(round(1e6 * v.boot_unix) + v.boot_us, v.boot_ms)


def autopilot_version(v: Vehicle) -> Message:
    """AUTOPILOT_VERSION."""
    none = [0] * 8
    custom = [*reversed(VERSION), 0, 0, 0, 0, 0]  # the vendor's version, patch first (PX4)
    return mavlink.MAVLink_autopilot_version_message(
        _CAPABILITIES, _VERSION, 0, 0, 0, custom, none, none, 0, 0, 0x4875736B79
    )


def protocol_version(v: Vehicle) -> Message:
    """PROTOCOL_VERSION: speaks MAVLink 2, reads 1 as well."""
    return ProtocolVersion(200, 100, 200, [0] * 8, [0] * 8)


def component_metadata(v: Vehicle) -> Message:
    """COMPONENT_METADATA: where the general file is."""
    address = component_files.uri(component_files.GENERAL).encode()
    checksum = crc32(v.files.get(component_files.GENERAL, b""))
    return ComponentMetadata(v.boot_ms, checksum, address)


def mission_current(v: Vehicle) -> Message:
    """MISSION_CURRENT: there is none."""
    return mavlink.MAVLink_mission_current_message(0, 0, mavlink.MISSION_STATE_NO_MISSION, 0)


@dataclass(frozen=True)
class Stream:
    """A message that is sent by itself or on request.

    Attributes:
        make: builds it, or the several that say it together.
        rate: by default [Hz], 0 for only on request.
    """

    make: Callable[[Vehicle], Message | list[Message]]
    rate: float

    def messages(self, vehicle: Vehicle) -> list[Message]:
        """Return what there is to send now."""
        made = self.make(vehicle)
        return made if isinstance(made, list) else [made]


STREAMS: dict[int, Stream] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Stream(heartbeat, 1.0),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: Stream(system_time, 1.0),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: Stream(autopilot_version, 0.0),
    PROTOCOL_VERSION: Stream(protocol_version, 0.0),
    COMPONENT_METADATA: Stream(component_metadata, 0.0),
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: Stream(mission_current, 0.0),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: Stream(extended_sys_state, 1.0),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: Stream(sys_status, 5.0),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: Stream(battery_status, 5.0),
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: Stream(rc_channels, 5.0),
    ESC_INFO: Stream(esc_info, 0.0),
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: Stream(highres_imu, 20.0),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: Stream(attitude, 20.0),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: Stream(attitude_quaternion, 50.0),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: Stream(attitude_target, 50.0),
    ESC_STATUS: Stream(esc_status, 0.0),
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: Stream(servo_output_raw, 50.0),
}
"""Every message by its id, in the order of a bundle: SERVO_OUTPUT_RAW closes it.

ESC_INFO and ESC_STATUS go to who asks for them, as `pixhawk_bridge` does: to others whose dialect
lacks them (pymavlink's) each would be a frame lost.
"""
