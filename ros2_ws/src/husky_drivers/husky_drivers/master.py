"""EtherCAT master of the axes: enables, commands, watches and stops them, one exchange a tick.

`exchange` sends one frame and moves the phase machine (`phases`) by one tick. Nothing in it blocks
or reads a clock. A frame that not all drives took part in is not believed (working counter).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_drivers.axes import Array, ProcessData, Settings
from husky_drivers.bus import AlState, Bus
from husky_drivers.cia402 import Mode, State, error_name
from husky_drivers.commissioning import check_al_states, commission, read_mode, write_gains
from husky_drivers.phases import Phase, Phases
from husky_drivers.report import CYCLIC_MODES, AxisStatus, describe, why_incomplete, why_refused

__all__ = ["Master", "Phase"]

_CSP, _CSV, _CST = CYCLIC_MODES


class Master:
    """Master of one segment.

    Attributes:
        settings: numbers of the axes.
        emergency_stopped: latched by `emergency_stop`.
        working_counter: of the last exchange.
        short_cycles: exchanges that were incomplete.
        refused_commands: commands refused whole.
        error_code: last emergency of each drive (n,), 0 after a reset.
        mode_display: mode of operation of each drive as last read (n,).
    """

    def __init__(self, bus: Bus, settings: Settings):
        """Take a bus that is not open yet."""
        self._bus = bus
        self.settings = settings
        n = len(settings.joint_names)
        self._data = ProcessData(settings)
        limits = (settings.velocity_limit, settings.torque_limit)
        self._lower = np.concatenate((settings.position_lower, *(-limit for limit in limits)))
        self._upper = np.concatenate((settings.position_upper, *limits))
        self._phases = Phases(settings, self._describe, self._why_incomplete)
        self._command = np.zeros((3, n))  # position, velocity, effort
        self._mode = _CSV  # of the command
        self._silence = settings.command_timeout_ticks  # exchanges since the last command
        self._sent_mode = _CSV
        self._target = np.zeros(n)  # position target that was sent [rad]
        self._handover = False  # the target has still to close on the command
        self._modes_read = 0  # drives that have shown the mode since enabling began
        self._short_in_a_row = 0
        self._seen = False  # there has been a complete exchange
        self._next_poll = 0

        self.emergency_stopped = False
        self.working_counter = 0
        self.short_cycles = 0
        self.refused_commands = 0
        self.error_code = np.zeros(n, np.uint16)
        self.mode_display = np.zeros(n, np.int8)

    @property
    def phase(self) -> Phase:
        """What the master does."""
        return self._phases.phase

    @property
    def reason(self) -> str:
        """Why the drives are not enabled, "" when they are."""
        return self._phases.reason

    @property
    def position(self) -> Array:
        """Joint positions as of the last complete exchange [rad] (n,)."""
        return self._data.position

    @property
    def velocity(self) -> Array:
        """Joint velocities, the drives' estimates [rad/s] (n,)."""
        return self._data.velocity

    @property
    def effort(self) -> Array:
        """Joint torques that the motor currents make at the gear's efficiency [N m] (n,)."""
        return self._data.effort

    @property
    def states(self) -> NDArray[np.uint8]:
        """CiA 402 states, values of `State` (n,)."""
        return self._data.states

    # -- set-up: may block

    def configure(self) -> None:
        """Open the bus and set the drives up, to SAFEOP; raises DriveError."""
        commission(self._bus, self.settings)

    def start(self) -> None:
        """Bring all drives to OP; raises DriveError when one does not come."""
        self._bus.request_state(AlState.OP)
        for _ in range(self.settings.transition_timeout_ticks):
            if self.exchange():
                break
        check_al_states(self._bus, self.settings, AlState.OP)
        self.short_cycles = 0

    def stop(self) -> None:
        """Remove torque and close the bus."""
        self._phases.enter(Phase.OFF, "stopped")
        self._write_outputs()
        self._bus.exchange(self._data.outputs.data)
        self._bus.close()

    def set_gains(self, kp: float, kd: float) -> None:
        """Write the gains of all drives, also while they run [N m/rad, N m s/rad].

        Raises:
            ValueError: when a gain is out of its range; nothing is written.
            DriveError: when a drive refuses.
        """
        write_gains(self._bus, self.settings, kp, kd)

    def poll_mailbox(self) -> None:
        """Read the mode display of the next axis; call now and then, where blocking is fine."""
        axis = self._next_poll
        self._next_poll = (axis + 1) % len(self.mode_display)
        self.mode_display[axis] = read_mode(self._bus, axis)

    # -- requests: do not block

    def set_command(self, mode: int, position: Any, velocity: Any, effort: Any) -> str:
        """Take the command of a tick, whole or not at all.

        Args:
            mode: 8, 9 or 10 (CSP, CSV, CST).
            position: (n,) target [rad].
            velocity: (n,) offset (CSP) or target (CSV) [rad/s].
            effort: (n,) offset (CSP, CSV) or target (CST) [N m].

        Returns:
            "", or why the command was refused.
        """
        values = np.concatenate((position, velocity, effort))
        # written so that NaN is refused too
        if (
            mode not in CYCLIC_MODES
            or values.shape != self._lower.shape
            or not ((values >= self._lower) & (values <= self._upper)).all()
        ):
            self.refused_commands += 1
            return why_refused(self.settings, mode, position, velocity, effort)
        if mode != self._mode:
            self._mode = Mode(mode)
            self._handover = True
            self._modes_read = 0
        self._command[:] = values.reshape(self._command.shape)
        self._silence = 0
        return ""

    def enable(self) -> str:
        """Start to enable all drives; returns "" or why not."""
        refusal = self._why_not_enable()
        if not refusal:
            self.error_code[:] = 0
            self._modes_read = 0
            self._handover = True
            self._phases.enter(Phase.ENABLING, "enabling")
        return refusal

    def disable(self, reason: str = "disabled") -> None:
        """Brake and remove torque."""
        if self.phase in (Phase.ENABLING, Phase.ENABLED, Phase.DAMPING):
            self._phases.enter(Phase.QUICK_STOP, reason)

    def emergency_stop(self, reason: str = "emergency stop") -> None:
        """Brake, remove torque, and refuse to enable until `reset_faults`."""
        self.emergency_stopped = True
        self.disable(reason)
        self._phases.reason = reason

    def restart(self, reason: str) -> None:
        """Time starts again: forget the command and take torque off with the next frame."""
        self._silence = self.settings.command_timeout_ticks
        self._phases.enter(Phase.OFF, reason)

    def reset_faults(self) -> str:
        """Release the emergency stop, bring lost drives back to OP, reset faults; "" or why not."""
        if self.phase not in (Phase.OFF, Phase.RESETTING):
            return f"drives are not off: {self.phase.value}"
        self.emergency_stopped = False
        for axis in range(len(self.states)):
            if self._bus.al_status(axis) & 0x0F == AlState.SAFEOP:
                self._bus.request_state(AlState.SAFEOP, axis)  # acknowledges the error
                self._bus.request_state(AlState.OP, axis)
        self._phases.enter(Phase.RESETTING, "resetting faults")
        return ""

    # -- the tick

    def exchange(self) -> bool:
        """Send one frame with the newest command and move on by one tick.

        Returns:
            Whether the frame was complete, so that `position` and the rest are of this tick.
        """
        if self._silence >= self.settings.command_timeout_ticks:
            self.disable("no joint command")
        self._silence += 1
        self._write_outputs()
        inputs, self.working_counter = self._bus.exchange(self._data.outputs.data)
        complete = self.working_counter == self._bus.expected_working_counter
        if complete:
            self._short_in_a_row = 0
            self._data.read(inputs)
            self._seen = True
        else:
            self.short_cycles += 1
            self._short_in_a_row += 1
            if self._short_in_a_row == self.settings.short_cycle_limit:
                self.disable(self._why_incomplete())
        for emergency in self._bus.emergencies():
            self.error_code[emergency.position] = emergency.error_code
        if self._phases.switching_on:
            self._confirm_mode()
        if self.phase is Phase.RESETTING:
            self.error_code[(self.states != State.FAULT) & complete] = 0
        modes_confirmed = self._modes_read == len(self.states)
        self._phases.advance(self.states, complete, modes_confirmed)
        return complete

    def _confirm_mode(self) -> None:
        """Ask the next drive for its mode: not in the process data, one mailbox access a tick."""
        axis = self._modes_read
        if axis < len(self.states) and self.states[axis] == State.SWITCHED_ON:
            self.mode_display[axis] = read_mode(self._bus, axis)
            self._modes_read += bool(self.mode_display[axis] == self._mode)

    def _write_outputs(self) -> None:
        if self.phase is Phase.ENABLED:
            position, effort = self._command[0], self._command[2]
            velocity: Array | float = self._command[1]
            if self._sent_mode is not self._mode:
                self._sent_mode = self._mode
                self._data.mode[:] = self._mode
            if self._mode is not _CSP:
                self._target[:] = self.position
            elif self._handover:
                velocity = self._hand_over(position)
            else:
                self._target[:] = position
            self._data.write_targets(self._mode, self._target, velocity, effort)
            return
        enabling = self.phase is Phase.ENABLING
        held = enabling & (self.states == State.OPERATION_ENABLED)
        np.copyto(self._target, self.position, where=~held)
        self._sent_mode = self._mode if enabling else _CSV
        self._data.mode[:] = self._sent_mode
        self._data.controlword[:] = self._phases.controlwords(self.states)
        self._data.write_torque_limit(1 if self._phases.may_have_torque else 0)
        self._data.write_targets(self._sent_mode, self._target, 0.0, 0.0)

    def _hand_over(self, position: Array) -> float:
        """Let the position target close on the command; returns the velocity to send [rad/s]."""
        step = self.settings.handover_velocity * self.settings.tick
        change = np.clip(position - self._target, -step, step)
        self._target += change
        self._handover = bool(np.abs(change).max() >= step)
        return 0.0

    # -- words

    def status(self) -> tuple[AxisStatus, ...]:
        """Every drive as of the last complete exchange."""
        rows = self._data.inputs.fields
        opened = self._data.safe_torque_off
        follows = self.phase is Phase.ENABLED and self._sent_mode is _CSP
        return tuple(
            AxisStatus(
                joint=name,
                statusword=int(rows["statusword"][i]),
                state=State(int(self.states[i])),
                error_code=int(self.error_code[i]),
                error=error_name(int(self.error_code[i])) if self.error_code[i] else "",
                mode_of_operation=int(self.mode_display[i]),
                safe_torque_off=self._seen and bool(opened[i]),
                bus_voltage=float(rows["bus_voltage"][i]) * 1e-3,
                current=float(rows["current"][i]) * self.settings.current_per_permille,
                following_error=float(self._target[i] - self.position[i]) if follows else 0.0,
            )
            for i, name in enumerate(self.settings.joint_names)
        )

    def _why_not_enable(self) -> str:
        s = self.settings
        faulty = self.states == State.FAULT
        opened = self._data.safe_torque_off
        away = np.abs(self._command[0] - self.position)
        if self.phase is not Phase.OFF:
            return f"drives are not off: {self.phase.value}"
        if self.emergency_stopped:
            return "emergency stop is latched; reset faults first"
        if not self._seen or self._short_in_a_row:
            return self._why_incomplete()
        if faulty.any():
            return self._describe(faulty)
        if opened.any():
            names = (s.joint_names[i] for i in np.flatnonzero(opened))
            return f"safe torque off: {', '.join(names)}"
        if self._silence >= s.command_timeout_ticks:
            return "no joint command: the controller must send before the drives are enabled"
        if self._mode is _CSP and not away.max() <= s.enable_window:
            worst = int(away.argmax())
            return (
                f"{s.joint_names[worst]}: target is {away[worst]:.3f} rad from the joint, "
                f"allowed is {s.enable_window:.3f} rad"
            )
        return ""

    def _describe(self, which: NDArray[np.bool_]) -> str:
        return describe(self.settings, which, self.states, self.error_code)

    def _why_incomplete(self) -> str:
        return why_incomplete(self._bus, self.settings, self.working_counter)
