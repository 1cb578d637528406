"""One cycle of the simulated Gold Twitter drives, compiled: time, frames and power stages.

A drive is one record of `drive_record.DRIVE`; the kernels walk over all of them. Units are the
drive's own: encoder counts, counts/s, amperes, seconds. A tick is `advance` (the drive's own time
passes and it looks at its motor), then `process_frame` (a frame passes through), then
`power_stages` (what the power stages do until the next tick). The state machine is the table of
`husky_drivers.cia402`; here stand the things a table cannot say: slow-downs, protections,
what is refused.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from husky_drivers.cia402 import (
    STATUSWORDS,
    Control,
    DriveCommand,
    DriveState,
    OperationMode,
    Status,
)
from husky_drivers.ethercat.bus import AL_ERROR, AlState
from husky_drivers.ethercat.pdo import STO_RELEASED
from husky_sim.devices.drives.servo_law import OFF, POSITION, TORQUE, VELOCITY

UNDERVOLTAGE, OVERVOLTAGE, HEARTBEAT, POSITION_TRACKING, SAFE_TORQUE_OFF = (
    0x3120,
    0x3310,
    0x8130,
    0x8611,
    0xFF20,
)
_SAFEOP, _OP = int(AlState.SAFEOP), int(AlState.OP)
_STARTING, _DISABLED = int(DriveState.NOT_READY_TO_SWITCH_ON), int(DriveState.SWITCH_ON_DISABLED)
_READY, _ON, _ENABLED = (
    int(DriveState.READY_TO_SWITCH_ON),
    int(DriveState.SWITCHED_ON),
    int(DriveState.OPERATION_ENABLED),
)
_STOP, _REACTION, _FAULT = (
    int(DriveState.QUICK_STOP_ACTIVE),
    int(DriveState.FAULT_REACTION_ACTIVE),
    int(DriveState.FAULT),
)
_CSP, _CSV, _CST = (
    int(OperationMode.CYCLIC_SYNCHRONOUS_POSITION),
    int(OperationMode.CYCLIC_SYNCHRONOUS_VELOCITY),
    int(OperationMode.CYCLIC_SYNCHRONOUS_TORQUE),
)
_RESET, _ENABLE = int(DriveCommand.FAULT_RESET), int(DriveCommand.ENABLE_OPERATION)
_RESET_BIT, _HALT_BIT = int(Control.FAULT_RESET), int(Control.HALT)
_VOLTAGE, _REMOTE, _LIMIT, _FOLLOWS, _FAR = (
    Status.VOLTAGE,
    Status.REMOTE,
    Status.INTERNAL_LIMIT,
    Status.FOLLOWS_COMMAND,
    Status.FOLLOWING_ERROR,
)
_STATUS = tuple(STATUSWORDS[DriveState(s)].value for s in range(DriveState.UNKNOWN))
_WATCHDOG_CODE = 0x001B
_TINY = 1e-9


@njit(cache=True)
def _release(d: Any, state: int) -> None:
    """Enter a state without torque."""
    d.state = state
    d.slowing = 0
    d.halted = 0
    d.demand_velocity = 0.0
    d.following_time = 0.0


@njit(cache=True)
def _slow_down(d: Any, state: int, end: int, ramp: int) -> None:
    """Enter a state and ramp the speed to zero; ramp 1 is the profile's, 2 the quick stop's."""
    if d.slowing == 0:
        d.demand_velocity = d.velocity
    d.state = state
    d.slowing = 1
    d.slow_end = end
    d.slow_deceleration = d.deceleration if ramp == 1 else d.quick_stop_deceleration


@njit(cache=True)
def trip(d: Any, code: int) -> None:
    """Transition 13: a fault. Only faults that leave motor and feedback usable may ramp."""
    if d.state == _FAULT or (d.state == _REACTION and code == d.error_code):
        return
    d.error_code = code
    d.emergency = 1
    soft = 0x8100 <= code < 0x8700 and code != 0x8311
    moving = d.state == _ENABLED or d.state == _STOP
    if moving and soft and d.fault_option != 0:
        _slow_down(d, _REACTION, _FAULT, d.fault_option)
    else:
        _release(d, _FAULT)


@njit(cache=True)
def abort_connection(d: Any) -> None:
    """The drive has left OP: object 0x6007. Torque goes unless the option asks for a ramp."""
    if d.state != _ENABLED and d.state != _STOP:
        return
    if d.abort_option == 1:
        trip(d, HEARTBEAT)
        _release(d, _FAULT)
    elif d.abort_option == 3:
        _slow_down(d, _STOP, _DISABLED, 2)
    else:
        _release(d, _DISABLED)


@njit(cache=True)
def _finish_slow_down(d: Any, dt: float) -> None:
    step = d.slow_deceleration * dt
    if abs(d.demand_velocity) > step:
        d.demand_velocity -= step if d.demand_velocity > 0.0 else -step
        return
    d.demand_velocity = 0.0
    if d.slow_end != d.state:
        _release(d, d.slow_end)


@njit(cache=True)
def _limit_current(d: Any, dt: float) -> None:
    """Peak current for a while, then continuous until the mean falls below 90 % of it.

    First-order filter whose time constant lets a step from 0 to the peak last `peak_duration`
    (Elmo command reference, CL[1], PL[1], PL[2]).
    """
    peak = d.peak_ratio * d.rated_current
    if peak <= d.rated_current or d.peak_duration <= 0.0:
        d.limited = 1 if peak > d.rated_current else 0
        return
    tau = -d.peak_duration / np.log(1.0 - d.rated_current / peak)
    d.mean_current += (abs(d.current) - d.mean_current) * -np.expm1(-dt / tau)
    if d.mean_current >= d.rated_current * (1.0 - _TINY):
        d.limited = 1
    elif d.mean_current < 0.9 * d.rated_current:
        d.limited = 0


@njit(cache=True)
def _protect(d: Any, dt: float) -> None:
    if d.state == _ENABLED and d.mode == _CSP and d.slowing == 0:
        far = abs(d.target_position - d.position) > d.following_window
        d.following_time = d.following_time + dt if far else 0.0
        if far and d.following_time >= d.following_timeout - _TINY:
            trip(d, POSITION_TRACKING)
    moving = d.state == _ENABLED or d.state == _STOP or d.state == _REACTION
    if d.bus_voltage > d.overvoltage:
        trip(d, OVERVOLTAGE)
    elif moving and d.bus_voltage < d.undervoltage:
        trip(d, UNDERVOLTAGE)
    if d.injected_fault != 0:
        trip(d, d.injected_fault)


@njit(cache=True)
def _interrupt(d: Any) -> None:
    """Safe torque off and the fall seen under disturbed frame timing: both without a command."""
    moving = d.state == _ENABLED or d.state == _STOP or d.state == _REACTION
    if d.sto != 0 and moving:
        if d.error_code == 0:
            d.error_code = SAFE_TORQUE_OFF
        d.emergency = 1
        _release(d, _FAULT if d.state == _REACTION else d.sto_state)
    if d.disturbed != 0 and d.state == _ENABLED:
        d.disturbed = 0
        _release(d, _DISABLED)


@njit(cache=True)
def advance(
    drives: Any, position: Any, velocity: Any, current: Any, bus_voltage: float, dt: float
) -> None:
    """Let time pass in all drives.

    Args:
        drives: records of `DRIVE`.
        position: of the motors [counts].
        velocity: of the motors [counts/s].
        current: of the motors [A].
        bus_voltage: [V].
        dt: [s].
    """
    for i in range(len(drives)):
        d = drives[i]
        d.position = position[i]
        d.velocity = velocity[i]
        d.current = current[i]
        d.bus_voltage = bus_voltage
        if d.unpowered:
            continue
        if d.state == _STARTING:
            d.starting -= dt
            if d.starting <= _TINY:
                d.state = _DISABLED
        if d.al_status == _OP:
            d.watchdog_left -= dt
            if d.watchdog_left <= _TINY:
                d.al_status = _SAFEOP | AL_ERROR
                d.al_status_code = _WATCHDOG_CODE
                abort_connection(d)
        _protect(d, dt)
        _limit_current(d, dt)
        if d.slowing != 0:
            _finish_slow_down(d, dt)
        _interrupt(d)


@njit(cache=True)
def _halt_or_go(d: Any, halt: int) -> None:
    """Stay enabled: halt, or follow the targets again (which calls off any slow-down)."""
    if halt and d.halted == 0:
        _slow_down(d, _ENABLED, _ENABLED, d.halt_option)
        d.halted = 1
    elif not halt:
        d.slowing = 0
        d.halted = 0


@njit(cache=True)
def _obey(d: Any, controlword: int, next_state: Any, commands: Any) -> None:
    rising = controlword & ~d.controlword & _RESET_BIT
    d.controlword = controlword
    command = _RESET if rising else commands[controlword & 0xFF]
    target = next_state[d.state, command]
    if target == d.state:
        if d.state == _ENABLED and command == _ENABLE:
            _halt_or_go(d, controlword & _HALT_BIT)
        return
    if d.state == _ENABLED and d.slowing and target == d.slow_end:
        return
    if d.state == _FAULT:
        cause = d.injected_fault != 0 or d.bus_voltage > d.overvoltage
        if cause or (d.sto != 0 and d.error_code == SAFE_TORQUE_OFF):
            return
    if target == _ENABLED:
        if d.sto != 0 or d.mode == 0 or (d.state == _STOP and d.quick_stop_option < 5):
            return
        _release(d, _ENABLED)
        d.error_code = 0
    elif d.state == _ENABLED and target == _STOP:
        if d.quick_stop_option == 0:
            _release(d, _DISABLED)
        else:
            stays = d.quick_stop_option >= 5
            _slow_down(d, _STOP, _STOP if stays else _DISABLED, (d.quick_stop_option - 1) % 4 + 1)
            d.halted = 0
    elif d.state == _ENABLED and target == _READY and d.shutdown_option == 1:
        _slow_down(d, _ENABLED, _READY, 1)
        d.halted = 0
    elif d.state == _ENABLED and target == _ON and d.disable_option == 1:
        _slow_down(d, _ENABLED, _ON, 1)
        d.halted = 0
    else:
        if d.state == _FAULT:
            d.error_code = 0
        _release(d, target)


@njit(cache=True)
def _read_outputs(d: Any, frame: Any) -> None:
    d.target_position = frame.target_position
    d.target_velocity = frame.target_velocity
    amperes = d.rated_current * 1e-3
    d.target_current = frame.target_torque * amperes
    d.current_offset = frame.torque_offset * amperes
    d.max_torque = frame.max_torque * amperes
    mode = frame.mode_of_operation
    if mode in (_CSP, _CSV, _CST):
        d.mode = mode


@njit(cache=True)
def statusword(d: Any) -> int:
    """Statusword of a drive."""
    word: int = _STATUS[d.state] | _REMOTE
    if d.bus_voltage >= d.undervoltage:
        word |= _VOLTAGE
    if d.limited:
        word |= _LIMIT
    if d.state == _ENABLED and d.slowing == 0:
        word |= _FOLLOWS
        if d.following_time > 0.0:
            word |= _FAR
    return word


@njit(cache=True)
def _write_inputs(d: Any, frame: Any) -> None:
    frame.position = int(d.position)
    frame.velocity = int(d.velocity)
    frame.digital_inputs = 0 if d.sto else STO_RELEASED
    frame.statusword = statusword(d)
    permille = np.rint(d.current / d.rated_current * 1e3)
    frame.current = int(min(max(permille, -32768.0), 32767.0))
    frame.bus_voltage = int(max(np.rint(d.bus_voltage * 1e3), 0.0))


@njit(cache=True)
def _take_outputs(d: Any, frame: Any, next_state: Any, commands: Any) -> None:
    d.watchdog_left = d.watchdog
    _read_outputs(d, frame)
    _obey(d, frame.controlword, next_state, commands)


@njit(cache=True)
def process_frame(drives: Any, outputs: Any, inputs: Any, next_state: Any, commands: Any) -> int:
    """Pass a frame through all drives: each puts its inputs in, then takes its outputs.

    Args:
        drives: records of `DRIVE`.
        outputs: process image, records of `pdo.RX`.
        inputs: process image, records of `pdo.TX`, written.
        next_state: `cia402.NEXT_STATE`.
        commands: `cia402.COMMAND_OF_CONTROLWORD`.

    Returns:
        The working counter.
    """
    counter = 0
    for i in range(len(drives)):
        d = drives[i]
        if d.away or d.al_status & 0x0F < _SAFEOP:
            continue
        _write_inputs(d, inputs[i])
        counter += 1
        if d.al_status == _OP:
            _take_outputs(d, outputs[i], next_state, commands)
            counter += 2
    return counter


@njit(cache=True)
def put_inputs(drives: Any, inputs: Any) -> int:
    """Put in what `process_frame` puts in, for a bus that brings outputs apart from it.

    Args:
        drives: records of `DRIVE`.
        inputs: process image, records of `pdo.TX`, written.

    Returns:
        Number of drives that have an emergency message waiting.
    """
    waiting = 0
    for i in range(len(drives)):
        d = drives[i]
        waiting += d.emergency != 0
        if not d.away and d.al_status & 0x0F >= _SAFEOP:
            _write_inputs(d, inputs[i])
    return waiting


@njit(cache=True)
def take_outputs(drives: Any, outputs: Any, reached: Any, next_state: Any, commands: Any) -> None:
    """Take outputs as `process_frame` does in the drives that they reached.

    Args:
        drives: records of `DRIVE`.
        outputs: process image, records of `pdo.RX`.
        reached: (n,) 1 for a drive whose outputs have come.
        next_state: `cia402.NEXT_STATE`.
        commands: `cia402.COMMAND_OF_CONTROLWORD`.
    """
    for i in range(len(drives)):
        d = drives[i]
        if reached[i] and not d.away and d.al_status == _OP:
            _take_outputs(d, outputs[i], next_state, commands)


@njit(cache=True)
def power_stages(drives: Any, counts_per_radian: float, torque_per_ampere: float, out: Any) -> None:
    """Say what each power stage does until the next tick, on the joint side.

    Args:
        drives: records of `DRIVE`.
        counts_per_radian: encoder counts per radian of the joint.
        torque_per_ampere: joint torque per motor current [N m/A].
        out: records of `segment.SERVO_COMMAND`, written.
    """
    for i in range(len(drives)):
        d = drives[i]
        o = out[i]
        o.kind = OFF
        o.torque = 0.0
        o.position = d.target_position / counts_per_radian
        o.velocity = d.demand_velocity / counts_per_radian
        o.kd = d.velocity_gain * counts_per_radian * torque_per_ampere
        o.kp = d.position_gain * o.kd
        limit = d.rated_current if d.limited else d.peak_ratio * d.rated_current
        o.torque_limit = min(limit, d.max_torque) * torque_per_ampere
        if d.slowing != 0 and d.state >= _ENABLED and d.state <= _REACTION:
            o.kind = VELOCITY
        elif d.state == _ENABLED:
            o.velocity = d.target_velocity / counts_per_radian
            o.torque = d.current_offset * torque_per_ampere
            if d.mode == _CSP:
                o.kind = POSITION
            elif d.mode == _CSV:
                o.kind = VELOCITY
            elif d.mode == _CST:
                o.kind = TORQUE
                o.torque += d.target_current * torque_per_ampere
