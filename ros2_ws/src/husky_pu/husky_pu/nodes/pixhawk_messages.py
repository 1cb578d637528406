"""ROS messages of the propulsion unit: commands in, reports of the autopilot out."""

from __future__ import annotations

import math

from sensor_msgs.msg import BatteryState

from husky_msgs.msg import PropulsionCommand, PropulsionState
from husky_pu.companion.bridge import ThrustCommand
from husky_pu.companion.propulsion_force import Force
from husky_pu.companion.telemetry import Report
from husky_runtime import graph
from husky_runtime.nodes import stamps


def thrust_command(message: PropulsionCommand) -> ThrustCommand:
    """Return a command as the pure part takes it."""
    q, force, moment = message.attitude, message.force, message.moment
    return ThrustCommand(
        stamps.to_ns(message.stamp),
        message.kind,
        (q.x, q.y, q.z, q.w),
        (force.x, force.y, force.z),
        (moment.x, moment.y, moment.z),
    )


def state_message(report: Report, force: Force, stamp_ns: int, connected: bool) -> PropulsionState:
    """Return the unit's state.

    Args:
        report: what the autopilot told last.
        force: what follows from it.
        stamp_ns: of that [ns].
        connected: whether the autopilot is heard.
    """
    state = PropulsionState()
    stamps.fill(state.stamp, stamp_ns)
    state.connected = connected
    state.armed = report.armed
    state.mode, state.failsafe, state.reason = report.mode, report.failsafe, report.reason
    for quaternion, values in (
        (state.attitude_desired, report.attitude_desired),
        (state.attitude, report.attitude),
    ):
        quaternion.x, quaternion.y, quaternion.z, quaternion.w = values
    state.collective_desired = report.collective_desired
    state.pwm = report.pwm
    state.tilt = force.tilt
    state.force.x, state.force.y, state.force.z = force.force
    state.fan_speed = report.fan_speed
    state.fan_ok = report.fan_ok
    state.thrust_limit = force.limit
    state.voltage, state.current = report.battery.voltage, report.battery.current
    return state


def battery_message(report: Report, stamp_ns: int) -> BatteryState:
    """Return the battery as ROS tells it: a current that is drawn is negative."""
    battery = report.battery
    message = BatteryState()
    stamps.fill(message.header.stamp, stamp_ns)
    message.header.frame_id = graph.FRAME_BASE
    message.voltage = battery.voltage
    message.current = -battery.current
    message.percentage = battery.remaining
    message.temperature = message.charge = message.capacity = message.design_capacity = math.nan
    message.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    message.power_supply_health = BatteryState.POWER_SUPPLY_HEALTH_UNKNOWN
    message.power_supply_technology = BatteryState.POWER_SUPPLY_TECHNOLOGY_LIPO
    message.present = not math.isnan(battery.voltage)
    message.cell_voltage = list(battery.cells)
    return message
