"""One tick of the low-level controller: measurements in, joint command out (500 Hz)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from husky_control.gait.stance import lean_forces
from husky_control.gait.table import GAITS
from husky_control.modes.behaviour import Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.modes.table import TRANSITIONS, Mode, ModeMachine, Transition, modes_of
from husky_control.parameters import Parameters, table_of
from husky_control.tick_data import TICK, Counters, JointCommand, Measurements
from husky_description.kinematics import LEGS

if TYPE_CHECKING:
    from husky_control.planning.plan import Plan
    from husky_description.robot import Robot

_REHEARSAL = (
    ("stand_up", 1000),
    ("walk", 200),
    ("stand", 500),
    ("wair", 20),
    ("stand", 20),
    ("sit", 20),
)  # modes and ticks in each, before the first real tick


class Controller:
    """The pure controller of one robot; the node only carries messages to and from it.

    Attributes:
        robot: its numbers.
        parameters: live.
        context: what its modes share: estimate, reference, fans.
        present: object of the present mode.
        command: of the last tick.
        watch: the velocity command over time.
        body: the body, measured and estimated.
        walking: legs of a robot that stands or walks, and what they are to follow.
        assist: help by the fans on the flat.
        climbing: plane and thrust on an incline.
        hover: flight on the fans.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: Parameters | None = None,
        *,
        warm_up: bool = True,
        modes: Iterable[Mode] | None = None,
        transitions: Iterable[Transition] = TRANSITIONS,
    ) -> None:
        """A controller in passive; compiles its kernels, so that the first tick is not late."""
        self.robot = robot
        self.parameters = parameters or Parameters.of(robot)
        self.context = context = ModeContext(robot, self.parameters)
        self.command, self.watch = context.command, context.watch
        self.body, self.walking = context.body, context.walking
        self.assist, self.climbing, self.hover = context.assist, context.climbing, context.hover
        own = modes_of(robot) if modes is None else modes
        self._modes = {mode: mode.behaviour(mode.value, context) for mode in own}
        self._machine = ModeMachine(self._holds, self._modes, transitions)
        self.present = self._modes[self.mode]
        if warm_up:
            rehearse(robot)

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self._machine.mode

    @property
    def reason(self) -> str:
        """What has led to the present mode, or changed the robot's mind within it, in words."""
        return self.context.reason

    @property
    def counters(self) -> Counters:
        """Counts of what has happened."""
        return self.context.counters

    # Requests -----------------------------------------------------------------------------------
    def allowed_requests(self) -> dict[Mode, tuple[str, ...]]:
        """Return the robot's modes, and what may be asked for in each, conditions aside."""
        return {mode: self._machine.allowed_requests(mode) for mode in self._modes}

    def request_mode(self, name: str) -> tuple[bool, str]:
        """Ask for a mode; returns whether it was accepted, and a message."""
        if name in ("stand", "stand_up"):
            self.watch.hold()
        answer = self.present.answer(name) or self._change(name, f"{name} requested")
        self.watch.leads = self.watch.leads and not answer[0]
        self.counters.refused_requests += not answer[0]
        return answer

    def request_gait(self, name: str) -> tuple[bool, str]:
        """Ask for a gait; while walking it changes in a stand between."""
        if name not in GAITS:
            self.counters.refused_requests += 1
            return False, f"there is no gait '{name}'; there are {', '.join(GAITS)}"
        return self.present.change_gait(name)

    def take_plan(self, plan: Plan) -> tuple[bool, str]:
        """Climb by a plan from now on; refuse one that is not for this robot, with the reason."""
        try:
            self.climbing.follow(plan)
        except ValueError as error:
            self.counters.refused_requests += 1
            return False, str(error)
        self.context.reason = f"plan for {math.degrees(plan.slope):.0f} deg"
        return True, self.reason

    def lose_drives(self, reason: str) -> bool:
        """The drives will follow nothing any more; return whether that has changed the mode."""
        mode = self.mode
        if self.present.active:
            self._follow((Event.FAULT, reason))
        return self.mode is not mode

    def set_velocity_command(self, vx: float, vy: float, yaw_rate: float) -> tuple[bool, str]:
        """Set the velocity command, m/s and rad/s in the base's heading frame.

        A command that is not finite or out of range is refused whole; the last one stays. In modes
        that walk one below `command.zero_speed` and `command.zero_yaw_rate` is zero. Where `watch`
        allows it a command that is not zero sets a standing robot in motion, and zero ends that.
        """
        velocity = self.present.without_creep((vx, vy, yaw_rate))
        refusal = self.present.refuse_velocity(velocity)
        if refusal:
            self.counters.refused_velocity_commands += 1
            return False, refusal
        wakes = self.watch.hear(any(velocity), bool(self.present.wakes_to))
        if wakes and self.present.wakes_to:
            accepted, message = self._change(self.present.wakes_to, "velocity command")
            if not accepted:
                return False, message
            self.watch.leads = True
        stays = self.present.drive(velocity, wakes=wakes)
        return not stays, stays

    # The tick -----------------------------------------------------------------------------------
    def tick(self, measurements: Measurements) -> JointCommand:
        """One period of 2 ms: estimate, judge, decide, command."""
        c, body = self.context, self.context.body
        c.counters.ticks += 1
        body.refresh_parameters()
        if not body.accept(measurements):
            c.counters.bad_measurements += 1
            c.assist.reset()
            if self.present.active:
                self._follow((Event.FAULT, "a measurement is not finite"))
            return self._output()
        body.turn_ground(c.climbing.plane)
        body.feel_contacts(self.present.clock.swing_progress)
        self.present.estimate()
        m = body.measurements
        if self.present.active:
            reason = c.safety.check(m, self.present.lean(), TICK)
            if reason is not None:
                self._follow((Event.FAULT, reason))
        c.assist.tick(
            self.present.assisted,
            m.fans_available,
            body.rotation,
            m.angular_velocity_base_in_base,
            TICK,
            disarmed=m.fans_disarmed,
        )
        self._follow(self.present.prepare())
        return self._output()

    def _output(self) -> JointCommand:
        self.hover.fade(TICK)
        self.watch.count(int(self.context.parameters["command.timeout"] / TICK + 1e-6))
        self._follow(self.present.tick(self.command))
        return self.context.safety.limit(self.command)

    # Transitions --------------------------------------------------------------------------------
    def _holds(self, condition: str) -> bool:
        return bool(getattr(self.present, condition))

    def _change(self, name: str, reason: str) -> tuple[bool, str]:
        """Take the transition that a request names, if it is allowed now."""
        row, message = self._machine.request(name)
        if row is not None:
            self.context.request = name
            self._enter(row, reason)
        return row is not None, message

    def _follow(self, happening: Happening | None) -> None:
        """Take the transition of what has happened, if the table has one."""
        if happening is None:
            return
        event, reason = happening
        before = self.mode
        row = self._machine.raise_event(event)
        if row is not None and (row.target is not before or reason != self.reason):
            self.counters.faults += event is Event.FAULT
            self._enter(row, reason)

    def _enter(self, row: Transition, reason: str) -> None:
        """Go over to the mode that a transition has led to."""
        self.context.reason = reason
        before, self.present = self.present, self._modes[row.target]
        wish = before.leave(row.event)
        self.present.enter(row.event)
        if wish:
            leads = self.watch.leads
            self.request_mode(wish)
            self.watch.leads = leads


def rehearse(robot: Robot) -> None:
    """Stand, walk and sit with a controller of its own: numba compiles now.

    Raises:
        RuntimeError: a mode is refused.
    """
    table = table_of(robot)
    quick = {
        "stand.duration": table["stand.duration"].lower,
        "stand.joint_speed": table["stand.joint_speed"].upper,
    }
    rehearsal = Controller(robot, Parameters.of(robot, quick), warm_up=False)
    lean_forces(np.eye(3), 0.0, 0.0, np.zeros((LEGS, 3)))
    m = Measurements(drives_operational=True)
    m.joint_position[:] = robot.sit_joint_position
    own = {mode.value for mode in modes_of(robot)}
    for mode, ticks in _REHEARSAL:
        if mode not in own or mode == rehearsal.mode.value:
            continue
        rehearsal.tick(m)
        accepted, message = rehearsal.request_mode(mode)
        if not accepted:
            raise RuntimeError(f"the rehearsal of {mode} has failed: {message}")
        for _ in range(ticks):
            # Feet press on the ground with what the controller asks of them.
            m.joint_torque[:] = rehearsal.tick(m).effort
            m.joint_position[:] = rehearsal.command.position
