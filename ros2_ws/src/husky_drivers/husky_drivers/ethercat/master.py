"""EtherCAT master of the axes: enables, commands, watches and stops them, one exchange a tick.

`exchange` sends one frame and moves the phase machine (`phases`) by one tick. Nothing in it reads a
clock, and nothing waits but for the frame: what is asked of the mailboxes meanwhile is collected
when it has come. A frame that not all drives took part in is not believed (working counter).
"""

from __future__ import annotations

from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_description.settling import Settling
from husky_drivers.cia402 import DriveState, OperationMode, error_name
from husky_drivers.ethercat.axes import AxisSettings, ProcessData
from husky_drivers.ethercat.bus import AlState, Bus
from husky_drivers.ethercat.commissioning import (
    check_al_states,
    commission,
    read_mode,
    recover,
    write_gains,
)
from husky_drivers.ethercat.phases import DrivePhases
from husky_drivers.ethercat.report import describe, why_incomplete
from husky_drivers.joint_master.commanded_master import AxisStatus, CommandedMaster
from husky_drivers.joint_master.phase import Phase
from husky_drivers.joint_master.setting_changes import describe_changes

_CSP = OperationMode.CYCLIC_SYNCHRONOUS_POSITION
_CSV = OperationMode.CYCLIC_SYNCHRONOUS_VELOCITY
_NOBODY = -1
"""Stands for the axis of a reading that counts no more."""
_RECOVER_EVERY = 250
"""Ticks between two attempts to bring drives back to OP, while all are off."""
_REMEMBERED = 64
"""Last commands that are kept: a stop takes the velocity of the body from them."""


class AtOnce(Executor):
    """Runs what it is given before it returns."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return what has come of it."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Master(CommandedMaster):
    """Master of one segment.

    Attributes:
        error_code: last emergency of each drive (n,), 0 after a reset.
        mode_display: mode of operation of each drive as last read (n,).
        settling: the motion of a stop.
        changes: what was changed in the drives at the last set-up, in sentences.
        remembered: the last commands, the newest at the end: position, velocity, effort (m, 3, n).
    """

    devices, stopping = "drives", "put the robot down"
    unheard = "put the robot down, and lose torque"
    settings: AxisSettings
    _phases: DrivePhases

    def __init__(
        self, bus: Bus, settings: AxisSettings, robot: Robot, mailbox: Executor | None = None
    ):
        """Take a bus that is not open yet.

        Args:
            bus: of the drives.
            settings: numbers of the axes.
            robot: that the axes carry.
            mailbox: runs what speaks to mailboxes while frames go round; by default at once, for a
                bus whose mailboxes take no time.
        """
        self._bus = bus
        self._mailbox = AtOnce() if mailbox is None else mailbox
        self._reading: tuple[int, Future[int]] | None = None  # the axis whose mode is being read
        self._recovery: Future[str] | None = None
        self._unrecovered = ""  # why drives did not come back to OP at the last attempt
        self._data = ProcessData(settings)
        phases = DrivePhases(settings, self._describe, self._why_incomplete)
        super().__init__(settings, phases, self._data)
        n = len(settings.joint_names)
        self._sent_mode = _CSV
        self._modes_read = 0  # drives that have shown the mode since enabling began
        self._short_in_a_row = 0
        self._next_poll = 0
        self.settling = Settling(robot)
        self.changes: list[str] = []
        self._ticks_left = 0  # until the axes brake, in a stop
        self.remembered = np.zeros((_REMEMBERED, 3, n))
        self.error_code = np.zeros(n, np.uint16)
        self.mode_display = np.zeros(n, np.int8)

    @property
    def states(self) -> NDArray[np.uint8]:
        """CiA 402 states, values of `DriveState` (n,)."""
        return self._data.states

    @property
    def expected_working_counter(self) -> int:
        """Working counter of a complete exchange."""
        return self._bus.expected_working_counter

    # -- set-up: may block

    def configure(self) -> None:
        """Open the bus and set the drives up, to SAFEOP; raises DriveError."""
        changes = commission(self._bus, self.settings)
        self.changes = describe_changes(self.settings.joint_names, self.devices, changes)

    def start(self) -> None:
        """Bring all drives to OP; raises DriveError when one does not come."""
        self._bus.bring_to(AlState.OP)
        check_al_states(self._bus, self.settings, AlState.OP)

    def stop(self) -> None:
        """Remove torque and close the bus."""
        self._phases.enter(Phase.OFF, "stopped")
        self._write_outputs()
        self._bus.close(self._data.outputs.data)
        self._reading = self._recovery = None

    def set_gains(self, kp: float, kd: float) -> Future[None]:
        """Write the gains of all drives, also while they run [N m/rad, N m s/rad].

        Returns:
            Is done when they are written; has DriveError when a drive refuses, and ValueError when
            a gain is out of its range and nothing is written.
        """
        return self._mailbox.submit(write_gains, self._bus, self.settings, kp, kd)

    def poll_mailbox(self) -> None:
        """Read the mode display of the next axis; call now and then.

        A drive whose fault has no code yet comes first: its emergency message may be waiting.
        """
        unexplained = np.flatnonzero((self.states == DriveState.FAULT) & (self.error_code == 0))
        axis = int(unexplained[0]) if unexplained.size else self._next_poll
        if self._collect_mode(axis) is not None:
            self._next_poll = (axis + 1) % len(self.mode_display)

    def _collect_mode(self, axis: int) -> int | None:
        """Return the axis whose mode display has been read, of late or now; None for none.

        Args:
            axis: is read next, unless another one's display is still awaited.
        """
        if self._reading is None:
            self._reading = axis, self._mailbox.submit(read_mode, self._bus, axis)
        asked, reading = self._reading
        if not reading.done():
            return None
        self._reading = None
        if asked != _NOBODY:
            self.mode_display[asked] = reading.result()
        return asked

    # -- requests: do not block

    def set_command(self, mode: int, position: Any, velocity: Any, effort: Any) -> str:
        """Take the command of a tick, whole or not at all, as `CommandedMaster`; remember it."""
        refusal = super().set_command(mode, position, velocity, effort)
        if not refusal:
            self.remembered[:-1] = self.remembered[1:]
            self.remembered[-1] = self._command
        return refusal

    def enable(self) -> str:
        """Start to enable all drives; returns "" or why not."""
        refusal = super().enable()
        if not refusal:
            self.error_code[:] = 0
        return refusal

    def disable(self, reason: str = "disabled") -> None:
        """Put the robot down, then remove torque; a stop that is under way goes on."""
        if self.phase is Phase.ENABLED:
            self._begin_settling(reason)
        else:
            super().disable(reason)

    def _begin_settling(self, reason: str) -> None:
        """Put down a robot whose joints follow positions; else hold the joints at rest."""
        settings = self.settings
        follows = self._sent_mode is _CSP
        self._ticks_left = settings.settle_ticks if follows else settings.hold_ticks
        if follows:
            body_velocity = self.settling.velocity_of(self.remembered, settings.tick)
            driven = self.states == DriveState.OPERATION_ENABLED
            if self._short_in_a_row:  # what a drive told last may be no longer true
                driven &= [al.status == AlState.OP for al in self._bus.al_states()]
            self.settling.begin(self._target, body_velocity, driven)
        self._phases.enter(Phase.SETTLING, reason)

    @property
    def _settled(self) -> bool:
        """True if a stop has come to the point at which the axes brake."""
        return self._ticks_left <= 0 or (self._sent_mode is _CSP and self.settling.done)

    def _begin_mode(self) -> None:
        super()._begin_mode()
        self._modes_read = 0
        if self._reading is not None:
            self._reading = _NOBODY, self._reading[1]  # it may show the mode of before

    def _reset_devices(self) -> None:
        """Bring lost drives back to OP; then the phase resets their faults."""
        self._begin_recovery()

    # -- recovery of drives that have left OP

    def _begin_recovery(self) -> None:
        if self._recovery is None:
            self._recovery = self._mailbox.submit(recover, self._bus, self.settings)

    def _recover(self) -> bool:
        """Bring drives back now and then while all are off; return whether that goes on."""
        missed = self._short_in_a_row
        if missed and missed % _RECOVER_EVERY == 0 and self.phase is Phase.OFF:
            self._begin_recovery()
        if self._recovery is not None and self._recovery.done():
            self._unrecovered, self._recovery = self._recovery.result(), None
        return self._recovery is not None

    # -- the tick

    def exchange(self) -> bool:
        """Send one frame with the newest command and move on by one tick.

        Returns:
            Whether the frame was complete, so that `position` and the rest are of this tick.
        """
        self._age_command()
        self._write_outputs()
        inputs, self.working_counter = self._bus.exchange(self._data.outputs.data)
        complete = self.working_counter == self._bus.expected_working_counter
        if complete:
            self._short_in_a_row, self._unrecovered = 0, ""
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
            self.error_code[(self.states != DriveState.FAULT) & complete] = 0
        modes_confirmed = self._modes_read == len(self.states)
        if self.phase is Phase.ENABLED and (lost := self._phases.why_lost(self.states)):
            self._begin_settling(lost)
        if self._recover() and self.phase is Phase.RESETTING:
            return (
                complete  # faults are reset, and the time for it begins, when the drives are back
            )
        self._phases.advance(self.states, complete, modes_confirmed, self._settled)
        return complete

    def _confirm_mode(self) -> None:
        """Ask the next drive for its mode: not in the process data, one mailbox access a tick."""
        axis = self._modes_read
        if axis < len(self.states) and self.states[axis] == DriveState.SWITCHED_ON:
            read = self._collect_mode(axis) == axis
            self._modes_read += bool(read and self.mode_display[axis] == self._mode)

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
                self._target += self._hand_over(position - self._target, self.settings.tick)
                velocity = 0.0
            else:
                self._target[:] = position
            self._data.write_targets(self._mode, self._target, velocity, effort)
            return
        if self.phase is Phase.SETTLING:
            self._write_settling()
            return
        enabling = self.phase is Phase.ENABLING
        held = enabling & (self.states == DriveState.OPERATION_ENABLED)
        np.copyto(self._target, self.position, where=~held)
        self._sent_mode = self._mode if enabling else _CSV
        self._data.mode[:] = self._sent_mode
        self._data.controlword[:] = self._phases.controlwords(self.states)
        self._data.write_torque_limit(1 if self._phases.may_have_torque else 0)
        self._data.write_targets(self._sent_mode, self._target, 0.0, 0.0)

    def _write_settling(self) -> None:
        self._ticks_left -= 1
        self._data.controlword[:] = self._phases.controlwords(self.states)
        if self._sent_mode is _CSP:
            self.settling.advance(self.settings.tick)
            self._target[:] = self.settling.joint_position
            self._data.write_targets(_CSP, self._target, self.settling.joint_velocity, 0.0)
            return
        self._sent_mode = _CSV
        self._data.mode[:] = _CSV
        self._target[:] = self.position
        self._data.write_targets(_CSV, self._target, 0.0, 0.0)

    # -- words

    def status(self) -> tuple[AxisStatus, ...]:
        """Every drive as of the last complete exchange."""
        rows = self._data.inputs.fields
        opened = self._data.safe_torque_off
        powered = self.phase in (Phase.ENABLED, Phase.SETTLING)
        follows = powered and self._sent_mode is _CSP
        return tuple(
            AxisStatus(
                joint=name,
                statusword=int(rows["statusword"][i]),
                state=DriveState(int(self.states[i])),
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

    def _why_not_fit(self) -> str:
        faulty = self.states == DriveState.FAULT
        opened = self._data.safe_torque_off
        if not self._seen or self._short_in_a_row:
            return self._why_incomplete()
        if faulty.any():
            return self._describe(faulty)
        if opened.any():
            names = (self.settings.joint_names[i] for i in np.flatnonzero(opened))
            return f"safe torque off: {', '.join(names)}"
        return ""

    def counters(self) -> dict[str, Any]:
        """Return what was changed in the drives."""
        return {"changed": "; ".join(self.changes)}

    def _describe(self, which: NDArray[np.bool_]) -> str:
        return describe(self.settings, which, self.states, self.error_code)

    def _why_incomplete(self) -> str:
        why = why_incomplete(self._bus, self.settings, self.working_counter)
        return f"{why}; not taken back: {self._unrecovered}" if self._unrecovered else why
