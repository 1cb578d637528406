"""Master of the servos: enables, commands, watches and stops them, tick by tick.

A tick is `measure` and then `act`. In a tick that begins a cycle of the bus the first reads all
servos and the second writes to all of them; in the others the joints go on at their speeds, and one
servo's health is asked for, whose answer the next tick finds on the line. So the last packet of a
tick is always the master's.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from husky_drivers.cia402 import DriveState, OperationMode
from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.chain import ServoChain
from husky_drivers.dynamixel.commissioning import GARBLED, NO_ANSWER, ServoSetup
from husky_drivers.dynamixel.phases import ServoPhases
from husky_drivers.dynamixel.readings import ServoReadings
from husky_drivers.dynamixel.settings import ServoSettings
from husky_drivers.dynamixel.troubles import ServoTroubles
from husky_drivers.dynamixel.units import ServoUnits
from husky_drivers.joint_master.commanded_master import AxisStatus, CommandedMaster
from husky_drivers.joint_master.phase import Phase
from husky_drivers.joint_master.setting_changes import describe_changes
from husky_runtime import graph
from husky_runtime.ports.port_thread import PORT_ERRORS

_CSP = OperationMode.CYCLIC_SYNCHRONOUS_POSITION
_CST = OperationMode.CYCLIC_SYNCHRONOUS_TORQUE


class ServoMaster(CommandedMaster):
    """Master of one line.

    Attributes:
        readings: the joints and the servos' health.
        troubles: what is wrong with which servo.
    """

    devices, stopping = "servos", "hold"
    unheard = "hold still, if they have followed positions, else stop"
    settings: ServoSettings
    _phases: ServoPhases

    def __init__(self, chain: ServoChain, settings: ServoSettings):
        """Take a line that is not open yet."""
        self._chain = chain
        self._setup = ServoSetup(chain, settings.servo)
        self.readings = ServoReadings(settings)
        self.troubles = ServoTroubles(settings, self.readings)
        phases = ServoPhases(settings, self.readings, self.troubles)
        super().__init__(settings, phases, self.readings)
        self._units = ServoUnits(settings.servo)
        servo = settings.servo
        self._stiffness = self._units.stiffness(servo.position_p)
        self._damping = self._units.damping(servo.position_p, servo.position_d)
        lead = self._units.lead(servo.position_p, servo.position_d)
        self._share = -math.expm1(-servo.cycle / lead) if lead > 0.0 else 1.0
        self._asked: int | None = None  # place of the servo whose answer is on the line
        self._probed = False  # and whether it was lost when it was asked
        self._turn = 0  # place of the servo whose health comes next

    @property
    def expected_working_counter(self) -> int:
        """All servos answer."""
        return len(self.settings.ids)

    @property
    def is_connected(self) -> bool:
        """Whether the line is open."""
        return self._chain.port.is_open

    # -- the line: may block

    def connect(self) -> None:
        """Open the line and set every servo up; raises OSError when the line is not there.

        A servo that cannot be used is none of the line's trouble: it is told, and asked again.
        """
        self._chain.port.open()
        self._seen, self._asked = False, None
        self._phases.enter(Phase.OFF, "not enabled yet")
        for index in range(len(self.settings.joint_names)):
            self._commission(index)
        self._name_strangers()

    def _name_strangers(self) -> None:
        """Where servos do not answer, name those that do and that nobody expects."""
        silent = [i for i, why in self.troubles.unusable.items() if why == NO_ANSWER]
        if not silent:
            return
        strangers = [str(n) for n in self._chain.find() if n not in self.settings.ids]
        also = f"; ids {', '.join(strangers)} answer, which no joint has" if strangers else ""
        for index in silent:
            self.troubles.unusable[index] = NO_ANSWER + also

    @property
    def changes(self) -> list[str]:
        """Changes made in the servos, in sentences."""
        names, changes = self.settings.joint_names, self._setup.changes.values()
        return describe_changes(names, self.devices, changes)

    def disconnect(self, reason: str) -> None:
        """The line is gone, or not wanted any more; nothing is said to the servos."""
        self._chain.port.close()
        self._seen = False
        self.working_counter = 0
        self.readings.torque_on[:] = False
        self._phases.enter(Phase.OFF, reason)

    def stop(self) -> None:
        """Remove torque and close the line."""
        reason = "stopped"
        try:
            if self.is_connected:
                self._chain.sync_write(table.TORQUE_ENABLE, self._all(0))
        except PORT_ERRORS as error:
            reason = str(error)
        self.disconnect(reason)

    def _commission(self, index: int) -> None:
        settings = self.settings
        number, offset = settings.ids[index], settings.homing_offsets[index]
        why = self._setup.commission(index, number, offset)
        if why:
            self.troubles.unusable[index] = why
        else:
            self.troubles.unusable.pop(index, None)
            self.readings.misses[index] = 0

    # -- requests

    def emergency_stop(self, reason: str = "emergency stop") -> None:
        """Let the controller settle, hold still, remove torque; refuse to enable until a reset.

        Pressed again it begins nothing anew.
        """
        if self.emergency_stopped:
            return
        self.emergency_stopped = True
        if self.phase in (Phase.ENABLED, Phase.DAMPING):
            self._phases.enter(Phase.DAMPING, reason)
        else:
            self.disable(reason)
        self._phases.reason = reason

    def _miss_commands(self, reason: str) -> None:
        """Hold still what may be in the air, where positions were asked for; else stop."""
        if self._phases.abandoned:
            return
        if self._mode is _CSP and self.phase in (Phase.ENABLED, Phase.DAMPING):
            self._phases.abandon(reason)
        else:
            super()._miss_commands(reason)

    def restart(self, reason: str) -> None:
        """Time starts again: as for every master; what was asked for is not awaited any more."""
        super().restart(reason)
        self._asked, self._turn = None, 0

    def _reset_devices(self) -> None:
        """Restart servos with an error; raises OSError when the line is gone."""
        faulty = self.readings.alert | (self.readings.hardware_error != 0)
        for index in np.flatnonzero(faulty):
            if index not in self.troubles.unusable:
                self._chain.reboot(self.settings.ids[index])
                self._lose(int(index), "restarts")
        self.readings.alert[:] = False
        self.readings.hardware_error[:] = 0

    # -- the tick

    def measure(self, cycle: bool) -> bool:
        """Bring the joints up to this tick; raises OSError when the line is gone.

        Args:
            cycle: it begins a cycle of the bus.

        Returns:
            Whether the joints are known.
        """
        self._fetch()
        if not cycle:
            self.readings.go_on(graph.TICK_PERIOD)
            return self._seen and self.working_counter > 0
        asked = np.ones(len(self.settings.ids), np.bool_)
        asked[list(self.troubles.unusable)] = False
        ids = [number for number, each in zip(self.settings.ids, asked, strict=True) if each]
        before = [self._chain.garbled[number] for number in self.settings.ids]
        answers = self._chain.sync_read(ids)
        self.working_counter = len(answers)
        self.short_cycles += self.working_counter < len(self.settings.ids)
        # The joints are where they were one tick ago: the ticks between have let them go on.
        self.readings.take_cycle(asked, answers, graph.TICK_PERIOD)
        for index in np.flatnonzero(self.readings.misses >= self.settings.miss_limit):
            if index not in self.troubles.unusable:
                garbled = self._chain.garbled[self.settings.ids[index]] > before[index]
                self._lose(int(index), GARBLED if garbled else NO_ANSWER)
        self._seen = self._seen or self.working_counter > 0
        return self.working_counter > 0

    def act(self, cycle: bool) -> None:
        """Say the last word of this tick, and move the phase on; raises as `measure`.

        Args:
            cycle: as `measure` was told.
        """
        self._age_command()
        self._phases.advance(stopped=self.emergency_stopped, positions=self._mode is _CSP)
        if cycle:
            self._write()
        else:
            self._ask()

    def _write(self) -> None:
        """Write to all servos at once: the one packet of a cycle that nobody answers."""
        enabling, cycles = self.phase is Phase.ENABLING, self._phases.cycles
        register, values = table.GOAL_POSITION, self._all(0)
        if self.phase in (Phase.OFF, Phase.RESETTING):
            register = table.TORQUE_ENABLE
        elif enabling and cycles == 0:
            register = table.BUS_WATCHDOG  # clears one that has bitten
        elif enabling and cycles >= 2 and cycles % 2 == 0:
            register, values = table.TORQUE_ENABLE, self._all(1)
        elif enabling and cycles >= 2:
            register = table.BUS_WATCHDOG
            values = self._all(round(self.settings.watchdog / table.WATCHDOG_UNIT))
        else:
            self._aim()
            values = {
                number: self._units.position_count(angle)
                for number, angle in zip(self.settings.ids, self._target, strict=True)
            }
        self._phases.cycles += 1
        self._chain.sync_write(register, values)

    def _aim(self) -> None:
        """Choose the goals of this cycle, so that the law is `kp (p* - p) + kd (v* - v) + effort`.

        The wire has no place for a velocity or a torque in this mode, and the servo's D gain acts
        on the goal's speed: kp (g - p) + kd (g' - v). So the goal g is p* + (kd v* + effort) / kp
        through a low-pass of the time constant that P and D make, which takes that lead off again.
        Without a position that is wanted, p* is the joint as it is measured.
        """
        settings, position = self.settings, self.readings.position
        phases = self._phases
        if phases.yields:
            self._target += self._share * (position - self._target)
            return
        meant = self._mode is _CSP or self.phase is Phase.ENABLED
        if not (meant and phases.follows(stopped=self.emergency_stopped)):
            begins = phases.cycles == 0 and not phases.abandoned
            if begins or self.phase is Phase.ENABLING:
                np.copyto(self._target, position)  # held from then on
            return
        command, velocity, effort = self._command
        if self._mode is _CST:
            velocity = np.zeros_like(velocity)
        wanted = command if self._mode is _CSP else position
        wanted = wanted + (self._damping * velocity + effort) / self._stiffness
        change = self._share * (wanted - self._target)
        if self._mode is _CSP and self._handover:
            change = self._hand_over(change, settings.servo.cycle)
        goal = self._target + change
        np.clip(goal, settings.position_lower, settings.position_upper, out=self._target)

    def give_sign(self) -> None:
        """Say something on the line that ends no tick: whoever watches it sees that we live."""
        self._chain.ping(self.settings.ids[0])

    # -- health

    def _ask(self) -> None:
        """Ask the next servo how it is; one that is lost and answers is set up again."""
        readings = self.readings
        unread = np.flatnonzero(readings.alert & (readings.hardware_error == 0))
        if len(unread):
            index = int(unread[0])
        else:
            index = self._turn = (self._turn + 1) % len(self.settings.ids)
        self._asked = index
        self._probed = index in self.troubles.unusable
        number = self.settings.ids[index]
        self._chain.ask(number, table.HEALTH_DATA[0], table.HEALTH_DATA[-1])

    def _fetch(self) -> None:
        """Take the answer that the last tick has asked for."""
        index, self._asked = self._asked, None
        if index is None:
            return
        answer = self._chain.fetch()
        if answer is None or answer.servo != self.settings.ids[index]:
            return
        if self._probed:
            self._commission(index)
        elif answer.error == 0:
            self.readings.take_health(index, answer.data)
            self.readings.alert[index] = answer.alert

    def _lose(self, index: int, why: str) -> None:
        self.troubles.unusable[index] = why
        self.readings.stand_still(index)

    # -- words

    def _all(self, value: int) -> dict[int, int]:
        return dict.fromkeys(self.settings.ids, value)

    def _why_not_fit(self) -> str:
        readings = self.readings
        if not self.is_connected:
            return f"no line to the servos: {self.reason}"
        if why := self.troubles.why_not_well(enabled=False):
            return why
        if not self._seen or not readings.health_count.all():
            return "the servos have not been read yet"
        low = np.flatnonzero(readings.voltage < self.settings.low_voltage)
        return self.troubles.describe(low, lambda i: f"{readings.voltage[i]:.1f} V of supply")

    def status(self) -> tuple[AxisStatus, ...]:
        """Every servo as last read, in the words of the drives' message.

        Of CiA 402 a servo knows nothing: the statusword is 0, the state is "operation enabled" with
        torque, else "switch on disabled", or "fault". The error code holds the hardware error bits,
        the mode is the servos' own, and the working counter counts servos that have answered.
        """
        readings, enabled = self.readings, self.phase is Phase.ENABLED
        return tuple(
            AxisStatus(
                joint=name,
                state=self._state_of(i),
                error_code=int(readings.hardware_error[i]),
                error=self.troubles.error_of(i),
                mode_of_operation=int(table.ServoOperatingMode.CURRENT_BASED_POSITION),
                bus_voltage=float(readings.voltage[i]),
                current=float(readings.current[i]),
                following_error=float(self._target[i] - self.position[i]) if enabled else 0.0,
            )
            for i, name in enumerate(self.settings.joint_names)
        )

    def _state_of(self, index: int) -> DriveState:
        if self.troubles.error_of(index):
            return DriveState.FAULT
        on = self.readings.torque_on[index]
        return DriveState.OPERATION_ENABLED if on else DriveState.SWITCH_ON_DISABLED

    def counters(self) -> dict[str, Any]:
        """Return what has been lost on the line, and the servos' extremes."""
        chain, readings = self._chain, self.readings
        return {
            "missed_answers": chain.missed.total(),
            "damaged_answers": chain.damaged,
            "refused_write": chain.refused,
            "changed": "; ".join(self.changes),
            "bytes_sent": chain.port.sent,
            "bytes_received": chain.port.received,
            "hottest_deg_c": f"{readings.temperature.max():.0f}",
            "lowest_voltage": f"{readings.voltage.min():.1f}",
        }
