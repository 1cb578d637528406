"""Mode `balance`: one leg, or two across from each other, become arms while the others stand.

Dynamic morphing, which the thesis names: the body leans until the leg is free, the leg folds and
splays, its propeller spins up, and then holds the body where feet alone would let it tip. With two
legs the body balances on the line between two feet: the propellers' difference holds it. Arms that
tilt about the hips' frontal axes keep the propellers' drag from turning it (T21).

Each step is begun only when what it stands on was measured; the way back goes through the same
steps. Without its propellers the robot puts its legs down at once.
"""

from __future__ import annotations

import math

import numpy as np

from husky_control.flight.knee_thrust import (
    Edge,
    SingleRotors,
    edge_of,
    pair_thrusts,
    thrust_for_margin,
)
from husky_control.flight.thrust_vectoring import TILT_LIMIT
from husky_control.gait.stance import Load, distribute_weight
from husky_control.modes.balance_steps import BalanceStep, BalanceSteps, legs_of
from husky_control.modes.behaviour import STOPS, Behaviour, Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.modes.levelling import Levelling, turn_to_level
from husky_control.posture import PostureMove
from husky_control.rotation import tilt_of, wrap_angle, yaw_of
from husky_control.slew import slewed
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand
from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.kinematics import LEGS, Kinematics
from husky_description.rotor_geometry import rotor_geometry

LAW_TICKS = 5
"""Between two looks at the balance: thrust is asked for at 100 Hz."""
LEVEL = math.radians(6.0)
"""Greatest tilt at which a step is begun [rad]."""
FREE = 3.0
"""Load below which a foot has left the ground [N]."""
FOLLOWED = 0.12
"""Greatest distance of a joint from where it was told to be [rad]."""
PATIENCE = 1.0
"""Time that a guard is waited for before the robot goes back [s]."""
PUT_DOWN_TIME = 0.40
"""In which legs come down when the propellers are lost [s]."""
TILT_SHARE = 0.1
"""Of what the joints can do at most, for a hip that tilts its propeller."""
LOWEST = 0.006
"""Least margin that the feet alone must have before the first leg is lifted [m]."""
NEAR = 0.10
"""Way of a foot to where its ground is expected, from which on it is felt for [m]."""
TOUCH_TIME = 0.2
"""In which the others end a step whose foot was felt early [s]."""


class Balance(Behaviour):
    """Goes up and down its steps.

    Attributes:
        thrust: asked of each propeller (4,) [N].
        pressure: centre of pressure inside of the edge as asked for [m]; nan before a propeller
            works.
        inside: centre of mass inside of the edge, by the measured joints [m].
    """

    answers = frozenset({"stand", "balance"}) | STOPS

    def __init__(self, name: str, context: ModeContext) -> None:
        """Standing."""
        super().__init__(name, context)
        robot, morph = context.robot, context.morph
        assert morph is not None
        self._robot = robot
        self._weight = float(robot.mass) * GRAVITY
        self._most = 0.9 * FanModel.of(robot).max_thrust
        self._planner, self._kinematics = BalanceSteps(robot, morph), Kinematics(robot)
        self._rotors = SingleRotors(robot)
        self._tilt_speed = TILT_SHARE * robot.joint_speed
        self._drag = FanModel.of(robot).moment_per_thrust * np.array(robot.propellers.spin)
        self._move = PostureMove()
        self._steps: list[BalanceStep] = []
        self.thrust, self._least, self._tilt = np.zeros((3, LEGS))
        self._share, self._near, self._effort = np.ones(LEGS), np.ones(LEGS), np.zeros(12)
        self._levelling = Levelling()
        self.pressure, self.inside = math.nan, 0.0
        self._begin()

    def _begin(self) -> None:
        self._at, self._goal, self._waited, self._ticks = 0, 0, 0.0, 0
        self._yaw = 0.0
        self._legs: tuple[int, ...] = (0,)
        self._dropping = self._sinking = False
        self._ended, self._stop = "back on four feet", ""
        for each in (self.thrust, self._least, self._tilt):
            each.fill(0.0)
        self._levelling.reset()
        self._landing = -1
        self._share.fill(1.0)
        self._near.fill(1.0)

    # Entry, leave -------------------------------------------------------------------------------
    def enter(self, event: Event) -> None:
        """Plan the steps from where the robot stands; with a fault, lie down."""
        c, p = self.context, self.context.parameters
        if event is Event.FAULT:
            self._stop = self._stop or "damping"
            self._lie_down()
            return
        self._begin()
        self._legs = legs_of(p["balance.legs"])
        self._yaw = yaw_of(c.body.rotation)
        self._effort[:] = c.command.effort
        start = c.command.position.copy()
        try:
            self._steps = self._planner.plan(
                start, self._legs, p["balance.margin"], p["balance.beyond"]
            )
        except ValueError as error:
            self._steps = [BalanceStep("standing", start, 0.0)]
            self._ended = f"no way to balance: {error}"
        self._goal = len(self._steps) - 1
        self._move.start([], [])
        self._move.joint_position[:] = start

    def leave(self, event: Event) -> str:
        """Propellers off; stand or lie as the legs are now, and stop, if that is wanted or due."""
        c = self.context
        if event is Event.FAULT:
            return ""
        c.assist.reset()
        c.walking.clock.swinging.fill(False)
        c.walking.clock.swing_progress.fill(-1.0)
        if event is Event.DONE:
            c.stand_on(self._move.joint_position + self._stretch)
        return self._stop if event is Event.DONE else ""

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Go back, when asked to stand; go on again, when asked for the mode itself.

        A stop waits for legs that are not on the ground.
        """
        if request not in self.answers or (request in STOPS and not self._lifted):
            return None
        if request in STOPS:
            self._stop = request
            self._lie_down()
            return True, f"it puts its legs and its body down; {request} follows"
        if self._dropping:
            return (request == "stand" and not self._sinking), "it puts its legs down"
        self._goal = 0 if request == "stand" else len(self._steps) - 1
        return True, "going back to stand" if request == "stand" else "going on"

    def change_gait(self, name: str) -> tuple[bool, str]:
        """Not now."""
        return False, f"it is in mode {self.name}"

    # Estimate -----------------------------------------------------------------------------------
    def estimate(self) -> None:
        """Estimate by the feet that stand; one that was not felt yet needs the load of a step."""
        clock, felt = self.context.walking.clock, self.context.body.contacts.contact
        lifted = self._lifted
        for leg in range(LEGS):
            clock.swinging[leg] = leg in lifted
            clock.swing_progress[leg] = 0.6 if leg in lifted or not felt[leg] else -1.0
        super().estimate()

    @property
    def _lifted(self) -> set[int]:
        """Legs in the air, or on their way up or down."""
        last = self._steps[self._at]
        heading = self._steps[self._toward]
        landing = {self._landing} if self._landing >= 0 else set()
        return set(last.lifted) | set(heading.lifted) | landing

    @property
    def _stretch(self) -> Array:
        """What levels the body, in the joints of legs that stand or come down (12,) [rad]."""
        return np.repeat(self._near, 3) * self._levelling.joints

    @property
    def _toward(self) -> int:
        """The step that is gone to, or has been reached."""
        if self._dropping:
            return 0
        return self._at + int(np.sign(self._goal - self._at)) * (not self._move.done)

    # Tick ---------------------------------------------------------------------------------------
    def prepare(self) -> Happening | None:
        """Put the legs down at once when a propeller that works is lost."""
        super().prepare()
        m = self.context.body.measurements
        works = self._at > 0 and any(
            step.working for step in (self._steps[self._at], self._steps[self._toward])
        )
        if works and not self._dropping and (not self.fans_available or m.fans_lost >= 0):
            self.context.reason = "the propellers are lost: it puts its legs down"
            self._put_down()
        return None

    def _put_down(self) -> None:
        """Put legs that are not on the ground down at once, then lean back."""
        if self._dropping:
            return
        self._goal, self._dropping, ways, times = 0, True, [], []
        if self._lifted:
            now, shifted = self.context.command.position - self._stretch, self._steps[1].posture
            ways = [np.stack((now, shifted)), np.stack((shifted, self._steps[0].posture))]
            times = [PUT_DOWN_TIME, self._steps[1].time]
        self._move.start(ways, times)

    def _lie_down(self) -> None:
        """Put all legs down at once and the body onto its perch, for it is to let go."""
        if self._sinking:
            return
        c = self.context
        self._goal, self._dropping, self._sinking = 0, True, True
        now, low = c.command.position - self._stretch, c.postures.low(c.stand_posture())
        self._move.start([np.stack((now, low))], [PUT_DOWN_TIME])

    def tick(self, command: JointCommand) -> Happening | None:
        """Go on along the steps, hold the balance."""
        c, move = self.context, self._move
        if self._landing >= 0:
            self._feel_for_ground()
        if move.done:
            ended = self._next()
            if ended is not None:
                return ended
        move.tick(TICK)
        if self._ticks % LAW_TICKS == 0:
            self._balance(LAW_TICKS * TICK)
        self._ticks += 1
        force, moment = self._rotors.wrench(self.thrust)
        c.assist.ask(force, moment)
        command.mode_of_operation = CYCLIC_POSITION
        command.position[:] = move.joint_position + self._stretch
        command.position[0::3] += self._tilt
        command.velocity[:] = move.joint_velocity
        command.effort[:] = self._effort
        return None

    def _next(self) -> Happening | None:
        """Begin the next step when its guard holds; go back when it does not for too long."""
        c = self.context
        if self._dropping:
            return (Event.DONE, "legs put down")
        if self._goal == self._at:
            return (Event.DONE, self._ended) if self._goal == 0 else None
        step = 1 if self._goal > self._at else -1
        refusal = self._guard(self._at + step) if step > 0 else ""
        if refusal:
            self._waited += TICK
            if self._waited > PATIENCE:
                self._goal, self._waited = 0, 0.0
                c.reason = self._ended = f"{self._steps[self._at + 1].what} given up: {refusal}"
            return None
        self._waited = 0.0
        way = np.stack((self._move.joint_position, self._steps[self._at + step].posture))
        further = self._steps[max(self._at, self._at + step)]
        self._move.start([way], [further.time])
        self._at += step
        self._landing = further.clears if step < 0 else -1
        return None

    def _feel_for_ground(self) -> None:
        """End the way of a leg that comes down where its foot is felt: others may have sunk."""
        leg, touched = self._landing, self._move.joint_position.copy()
        if self._move.done:
            self._landing = -1
        elif self.context.body.contacts.contact[leg]:
            ends = self._planner.standing_earlier(self._steps[: self._at + 1], leg, touched, NEAR)
            if ends:
                self._steps[: self._at + 1] = ends
                self._move.start([np.stack((touched, ends[-1].posture))], [TOUCH_TIME])
                self._landing = -1

    def _guard(self, place: int) -> str:
        """Return why a step cannot begin yet, "" if it can."""
        c, before, step = self.context, self._steps[self._at], self._steps[place]
        m = c.body.measurements
        load = c.body.contacts.foot_force[:, 2]
        away = np.abs(m.joint_position - c.command.position).max()
        if not self.fans_available or m.fans_lost >= 0:
            return "the propellers are not armed or do not follow"
        if tilt_of(c.body.rotation) > LEVEL:
            return "the body is tilted"
        if away > FOLLOWED:
            return f"a joint is {away:.2f} rad from where it was told to be"
        if before.clears >= 0 and load[before.clears] > FREE:
            return f"the foot still bears {load[before.clears]:.1f} N"
        lifts_first = step.lifted and not before.lifted
        if lifts_first and self.inside < LOWEST:
            return f"the centre of mass is {1e3 * self.inside:.0f} mm inside of the edge"
        return ""

    # Balance ------------------------------------------------------------------------------------
    def _balance(self, dt: float) -> None:
        """Reckon thrusts, tilts of the arms and torques of the legs, dt s after the last ones."""
        body, p = self.context.body, self.context.parameters
        m, r = body.measurements, body.rotation
        geometry = rotor_geometry(self._robot, m.joint_position)
        feet, jacobian = self._kinematics.foot_positions_and_jacobians(m.joint_position)
        center = self._kinematics.center_of_mass(m.joint_position)
        first, step = self._legs[0], self._steps[self._at]
        rotor, axis = (geometry.position + center) @ r.T, geometry.axis @ r.T
        edge = edge_of(feet @ r.T, first, r @ center, rotor, axis)
        self.inside = edge.inside
        working = () if self._dropping else step.working
        for leg in range(LEGS):
            wanted = p["balance.idle_thrust"] if leg in working else 0.0
            rise = p["balance.idle_thrust"] / 0.3 * dt
            self._least[leg] = slewed(self._least[leg], wanted, rise)
        self._push(edge, step, r, working)
        self._vector(geometry.position[:, 0], working, dt)
        lifted = set() if self._dropping else set(step.lifted)
        for leg in range(LEGS):
            comes_down = leg not in lifted
            stands = comes_down and (leg != self._landing or self._dropping)
            self._share[leg] = slewed(self._share[leg], float(stands), dt / 0.25)
            self._near[leg] = slewed(self._near[leg], float(comes_down), dt / 0.25)
        if not self._dropping:
            back = turn_to_level(r, None if self._share.sum() > 2.5 else edge.axis)
            self._levelling.turn(p["balance.levelling"] * dt * back, feet, jacobian, self._share)
        self._carry(feet, jacobian, center, geometry.position, geometry.axis)

    def _push(self, edge: Edge, step: BalanceStep, r: Array, working: tuple[int, ...]) -> None:
        """Set the thrusts: what statics ask for, and what brings the body back to level."""
        p, first = self.context.parameters, self._legs[0]
        leaning = float(r[:, 2] @ edge.inward)
        turning = float(
            (r @ self.context.body.measurements.angular_velocity_base_in_base) @ edge.axis
        )
        moment = -p["balance.stiffness"] * leaning - p["balance.damping"] * turning
        self.thrust[:] = self._least
        if len(step.lifted) == 2 and working:
            wanted = moment - self._weight * edge.inside
            least = float(self._least[first]), float(self._least[first ^ 3])
            self.thrust[:] = pair_thrusts(edge, first, wanted, least)
        elif working:
            need = thrust_for_margin(edge, first, self._weight, step.pressure)
            more = moment / float(edge.lever[first])
            self.thrust[first] = max(self._least[first], need + (more if need > 0.0 else 0.0))
        np.clip(self.thrust, 0.0, self._most, out=self.thrust)
        self.pressure = edge.pressure(self._weight, self.thrust) if working else math.nan

    def _vector(self, ahead: Array, working: tuple[int, ...], dt: float) -> None:
        """Tilt working arms so that their thrusts take the drags' yaw moment and hold the heading.

        Args:
            ahead: place of each propeller ahead of the centre of mass (4,) [m].
            working: legs whose propellers work.
            dt: [s].
        """
        c, p = self.context, self.context.parameters
        share = p["balance.thrust_vectoring"]
        yaw = wrap_angle(self._yaw - yaw_of(c.body.rotation))
        rate = float(c.body.measurements.angular_velocity_base_in_base[2])
        hold = p["balance.yaw_stiffness"] * yaw - p["balance.yaw_damping"] * rate
        moment = hold / max(1, len(working))
        for leg in range(LEGS):
            wanted = 0.0
            if leg in working and self.thrust[leg] > 0.2:
                wanted = -share * (moment / self.thrust[leg] + self._drag[leg]) / ahead[leg]
                wanted = min(TILT_LIMIT, max(-TILT_LIMIT, wanted))
            most = self._tilt_speed * dt
            self._tilt[leg] = slewed(self._tilt[leg], wanted, most)

    def _carry(
        self, feet: Array, jacobian: Array, center: Array, place: Array, axis: Array
    ) -> None:
        """Write the torques by which the standing legs carry what the propellers do not."""
        r, force = self.context.body.rotation, np.zeros((LEGS, 3))
        push = self.thrust[:, None] * axis
        moment = r @ np.cross(place, push).sum(axis=0)
        weight = self._weight - float((r @ push.sum(axis=0))[2])
        load = Load(weight, -float(moment[0]), -float(moment[1]), weight)
        distribute_weight(feet, center, self._share, r, load, force)
        for leg in range(LEGS):
            self._effort[3 * leg : 3 * leg + 3] = -(jacobian[leg].T @ force[leg])

    # Report -------------------------------------------------------------------------------------
    @property
    def settled(self) -> bool:
        """Whether the last step has been reached."""
        return bool(self._steps) and self._move.done and self._at == self._goal > 0

    @property
    def doing(self) -> str:
        """What it is doing, in words."""
        return self._steps[self._at].what if self._steps else ""
