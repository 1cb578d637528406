"""Master of joints that are commanded every tick: what it takes, refuses and stops for.

The wire below is a subclass's: `ethercat.master` for drives, `dynamixel.servo_master` for servos.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from husky_description.arrays import Array
from husky_drivers.cia402 import DriveState, OperationMode
from husky_drivers.joint_master.phase import Phase, PhaseMachine
from husky_drivers.joint_master.settings import CYCLIC_MODES, JointSettings, why_refused

_CSP = OperationMode.CYCLIC_SYNCHRONOUS_POSITION


@dataclass(frozen=True)
class AxisStatus:
    """One joint's actuator, field by field as husky_msgs/DriveStatus: A, V, rad."""

    joint: str
    state: DriveState
    error_code: int
    error: str
    mode_of_operation: int
    bus_voltage: float
    current: float
    following_error: float
    statusword: int = 0
    safe_torque_off: bool = False


class MeasuredJoints(Protocol):
    """Joints as a wire has last told them, each (n,), renewed in place."""

    position: Array
    velocity: Array
    effort: Array


class CommandedMaster(ABC):
    """Holds the newest command, and the phases that it may act in.

    Attributes:
        devices: what stands at the joints, in words.
        stopping: what they do before they lose torque, in words.
        unheard: what they do when no command has come for too long, in words.
        settings: numbers of the joints.
        emergency_stopped: latched by `emergency_stop`.
        working_counter: of the last exchange, `expected_working_counter` when all took part.
        short_cycles: exchanges that were incomplete.
        refused_commands: commands refused whole.
    """

    devices: ClassVar[str]
    stopping: ClassVar[str]
    unheard: ClassVar[str]

    def __init__(self, settings: JointSettings, phases: PhaseMachine, joints: MeasuredJoints):
        """Take a wire that is not open yet.

        Args:
            settings: ranges of a command, and patience.
            phases: of this wire.
            joints: where the wire tells them.
        """
        self.settings, self._phases, self._joints = settings, phases, joints
        limits = (settings.velocity_limit, settings.torque_limit)
        self._lower = np.concatenate((settings.position_lower, *(-limit for limit in limits)))
        self._upper = np.concatenate((settings.position_upper, *limits))
        n = len(settings.joint_names)
        self._command = np.zeros((3, n))  # position, velocity, effort
        self._mode = _CSP  # of the command
        self._silence = settings.command_timeout_ticks  # ticks since the last command
        self._target = np.zeros(n)  # position target that was sent [rad]
        self._handover = False  # the target has still to close on the command
        self._seen = False  # the joints have been measured
        self.emergency_stopped = False
        self.working_counter = 0
        self.short_cycles = 0
        self.refused_commands = 0

    @property
    def phase(self) -> Phase:
        """What the master does."""
        return self._phases.phase

    @property
    def reason(self) -> str:
        """Why the joints are not enabled, "" when they are."""
        return self._phases.reason

    @property
    def position(self) -> Array:
        """Joint positions as last measured [rad] (n,)."""
        return self._joints.position

    @property
    def velocity(self) -> Array:
        """Joint velocities, the devices' estimates [rad/s] (n,)."""
        return self._joints.velocity

    @property
    def effort(self) -> Array:
        """Joint torques that the motor currents make behind the gears [N m] (n,)."""
        return self._joints.effort

    # -- what is the wire's

    @property
    @abstractmethod
    def expected_working_counter(self) -> int:
        """Working counter of a complete exchange."""

    @property
    def is_connected(self) -> bool:
        """Whether there is a wire to speak on."""
        return True

    @abstractmethod
    def stop(self) -> None:
        """Remove torque and close the wire."""

    @abstractmethod
    def status(self) -> tuple[AxisStatus, ...]:
        """Every device as last heard."""

    def counters(self) -> dict[str, Any]:
        """Return what else the wire counts or measures, by name, for diagnostics."""
        return {}

    @abstractmethod
    def _reset_devices(self) -> None:
        """Ask the devices to leave their faults."""

    @abstractmethod
    def _why_not_fit(self) -> str:
        """Say what of wire or devices is against enabling, "" when nothing is."""

    # -- requests

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
            self._mode = OperationMode(mode)
            self._begin_mode()
        self._command[:] = values.reshape(self._command.shape)
        self._silence = 0
        return ""

    def enable(self) -> str:
        """Start to enable all joints; returns "" or why not."""
        refusal = self._why_not_enable()
        if not refusal:
            self._begin_mode()
            self._phases.enter(Phase.ENABLING, "enabling")
        return refusal

    def disable(self, reason: str = "disabled") -> None:
        """Stop the joints and remove torque."""
        if self.phase in (Phase.ENABLING, Phase.ENABLED, Phase.DAMPING):
            self._phases.enter(Phase.QUICK_STOP, reason)

    def emergency_stop(self, reason: str = "emergency stop") -> None:
        """Bring the joints to rest, then remove torque (category 1 of IEC 60204-1).

        Enabling is refused until `reset_faults`.
        """
        self.emergency_stopped = True
        self.disable(reason)
        self._phases.reason = reason

    def cut(self, reason: str) -> None:
        """Remove torque with the next exchange (category 0): what the joints hold up falls.

        Enabling is refused until `reset_faults`.
        """
        self.emergency_stopped = True
        self._phases.enter(Phase.OFF, reason)

    def restart(self, reason: str) -> None:
        """Time starts again: forget the command and take torque off with the next exchange."""
        self._silence = self.settings.command_timeout_ticks
        self._phases.enter(Phase.OFF, reason)

    def reset_faults(self) -> str:
        """Release the emergency stop and bring faulty devices back; "" or why not."""
        if self.phase not in (Phase.OFF, Phase.RESETTING):
            return f"{self.devices} are not off: {self.phase.value}"
        self.emergency_stopped = False
        self._reset_devices()
        self._phases.enter(Phase.RESETTING, "resetting faults")
        return ""

    # -- for the wire

    def _begin_mode(self) -> None:
        """A mode of operation begins: targets start at the joints."""
        self._handover = True

    def _age_command(self) -> None:
        """Act when no command has come for too long; call once a tick."""
        if self._silence >= self.settings.command_timeout_ticks:
            self._miss_commands("no joint command")
        self._silence += 1

    def _miss_commands(self, reason: str) -> None:
        """Stop: nobody says any more what the joints are to do."""
        self.disable(reason)

    def _hand_over(self, change: Array, period: float) -> Array:
        """Bound the change of targets while they close on the command.

        Args:
            change: wanted [rad] (n,).
            period: in which they change [s].
        """
        step = self.settings.handover_velocity * period
        bounded: Array = np.clip(change, -step, step)
        self._handover = bool(np.abs(bounded).max() >= step)
        return bounded

    def _why_not_enable(self) -> str:
        s = self.settings
        if self.phase is not Phase.OFF:
            return f"{self.devices} are not off: {self.phase.value}"
        if self.emergency_stopped:
            return "emergency stop is latched; reset faults first"
        if why := self._why_not_fit():
            return why
        if self._silence >= s.command_timeout_ticks:
            return (
                f"no joint command: the controller must send before the {self.devices} are enabled"
            )
        away = np.abs(self._command[0] - self.position)
        if self._mode is _CSP and not away.max() <= s.enable_window:
            worst = int(away.argmax())
            return (
                f"{s.joint_names[worst]}: target is {away[worst]:.3f} rad from the joint, "
                f"allowed is {s.enable_window:.3f} rad"
            )
        return ""
