"""One tick of the low-level controller: measurements in, joint command out (500 Hz)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from husky_control.assist import ThrustAssist
from husky_control.contact import ContactObserver, ContactThresholds
from husky_control.estimator import GRAVITY, Estimator, EstimatorNoise
from husky_control.gait import GAITS
from husky_control.hover import AIRBORNE, Hover
from husky_control.incline_walk import InclineWalk
from husky_control.kinematics import JOINTS, LEGS, Kinematics, forward_kinematics
from husky_control.modes import ACTIVE, Event, Mode, ModeMachine, Transition
from husky_control.parameters import Parameters
from husky_control.posture import PostureMove, Postures
from husky_control.rotation import matrix_from_quaternion, tilt_of, yaw_of
from husky_control.safety import Safety, all_finite, limit_command
from husky_control.stance import distribute_weight, lean_forces
from husky_control.suspended import Suspended
from husky_control.tick_data import (
    CYCLIC_POSITION,
    CYCLIC_TORQUE,
    CYCLIC_VELOCITY,
    Counters,
    JointCommand,
    Measurements,
)
from husky_control.walking import Walking

if TYPE_CHECKING:
    from husky_control.plan import Plan
    from husky_description.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TICK = 0.002  # s
REST_SPEED = 0.08  # m/s, below which a standing body is at rest
REST_RATE = 0.3  # rad/s, likewise
_REHEARSAL = (
    ("stand_up", 1000), ("walk", 200), ("stand", 500), ("wair", 20), ("stand", 20), ("sit", 20)
)  # modes and ticks in each, before the first real tick
TRUST_TIME = 0.02  # s, in which an unloaded stance foot loses the estimator's trust


class Controller:
    """The pure controller of one robot; the node only carries messages to and from it."""

    def __init__(
        self, robot: Robot, parameters: Parameters | None = None, *, warm_up: bool = True
    ) -> None:
        """A controller in passive; compiles its kernels, so that the first tick is not late."""
        self.robot = robot
        self.parameters = parameters or Parameters()
        self.counters = Counters()
        self.command = JointCommand()
        self.reason = "started"
        self._kinematics = Kinematics(robot)
        self._geometry = self._kinematics.geometry
        self._machine = ModeMachine(self._holds)
        self._safety = Safety(robot, self.parameters)
        self._contacts = ContactObserver(robot)
        self._estimator = Estimator(robot)
        self._gait_name = "trot"
        self._walking = Walking(robot, self.parameters, self.parameters.gait(self._gait_name))
        self._move = PostureMove()
        self._postures = Postures(robot)
        self._suspended = Suspended(robot, self.parameters.gait(self._gait_name))
        self.assist = ThrustAssist(robot, self.parameters)
        self.hover = Hover(robot)
        self.wair = InclineWalk(robot, self.parameters, self._walking)
        self.climbing = self.wair.climbing
        self._fly_posture = np.zeros(JOINTS)
        self._fly_start = np.zeros(3)  # m, estimated position of the body before take-off
        self._pending_gait: str | None = None
        self._silent_ticks = 0
        # Copies: the kernels are compiled for these arrays, and the last good ones are kept.
        self._measurements = Measurements()
        self._incoming = Measurements()
        self._measured = False
        self._lower = np.array(robot.joint_lower, dtype=np.float64)
        self._upper = np.array(robot.joint_upper, dtype=np.float64)
        self._velocity_limit = np.array(robot.joint_velocity_limit, dtype=np.float64)
        self._torque_limit = np.array(robot.joint_torque_limit, dtype=np.float64)
        self._rotation = np.eye(3)
        self._rotation_on_plane = np.eye(3)
        self._foot_in_base = np.zeros((LEGS, 3))
        self._jacobian = np.zeros((LEGS, 3, 3))
        self._foot_force = np.zeros((LEGS, 3))
        self._center = np.zeros(3)
        self._trust = np.ones(LEGS)
        self._share = np.ones(LEGS)
        self._revision = -1
        self._refresh_parameters()
        if warm_up:
            self._warm_up()

    # ---------------------------------------------------------------- requests

    def request_mode(self, name: str) -> tuple[bool, str]:
        """Ask for a mode; returns whether it was accepted, and a message."""
        if name == "stand" and self.mode is Mode.WALK:
            self._walking.stop_stepping()
            self._pending_gait = None
            return True, "stopping"
        if name == "stand" and self.mode is Mode.WAIR:
            left, message = self.wair.leave()
            self.counters.refused_requests += not left
            return left, message
        if name == "stand" and self.mode is Mode.FLY:
            self.hover.land()
            return True, "landing"
        if name == "hang" and self.mode is Mode.TREAD:
            self._suspended.stop()
            return True, "stopping"
        row, message = self._machine.request(name)
        if row is None:
            self.counters.refused_requests += 1
            return False, message
        self._enter(row, f"{name} requested")
        return True, message

    def request_gait(self, name: str) -> tuple[bool, str]:
        """Ask for a gait; while walking it changes in a stand between."""
        if name not in GAITS:
            self.counters.refused_requests += 1
            return False, f"there is no gait '{name}'; there are {', '.join(GAITS)}"
        if self.mode is Mode.WALK and name != self._gait_name:
            self._pending_gait = name
            self._walking.stop_stepping()
            return True, f"changing to {name} through stand"
        self._gait_name = name
        return True, name

    def take_plan(self, plan: Plan) -> tuple[bool, str]:
        """Climb by a plan from now on; refuse one that is not for this robot, with the reason."""
        try:
            self.climbing.take(plan)
        except ValueError as error:
            self.counters.refused_requests += 1
            return False, str(error)
        self.reason = f"plan for {math.degrees(plan.slope):.0f} deg"
        return True, f"plan for {math.degrees(plan.slope):.0f} deg"

    def set_velocity_command(self, vx: float, vy: float, yaw_rate: float) -> tuple[bool, str]:
        """Set the velocity command, m/s and rad/s in the base's heading frame.

        A command that is not finite or out of range is refused whole; the last one stays.
        """
        p = self.parameters
        gait = "climb" if self.mode is Mode.WAIR else self._gait_name
        forward = p[f"gait.{gait}.max_speed"]
        checks = (
            ("vx", vx, forward, "m/s"),
            ("vy", vy, min(forward, p["command.max_lateral_speed"]), "m/s"),
            ("yaw_rate", yaw_rate, p["command.max_yaw_rate"], "rad/s"),
        )
        for name, value, limit, unit in checks:
            if not math.isfinite(value) or abs(value) > limit:
                self.counters.refused_velocity_commands += 1
                return False, f"{name} must be within +-{limit:g} {unit}, not {value}"
        if self.mode is Mode.WAIR and self.wair.only_down and vx > 0.0:
            self.counters.refused_velocity_commands += 1
            return False, f"vx must not be above 0 with a fan lost on an incline, not {vx}"
        self._silent_ticks = 0
        if self.mode is Mode.WAIR and (vx or vy or yaw_rate):
            self.wair.step_again(self._estimator.position)
        if self.mode in (Mode.WALK, Mode.WAIR) and self._walking.stepping:
            self._walking.reference.command[:] = vx, vy, yaw_rate
        return True, ""

    # --------------------------------------------------------------- telemetry

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self._machine.mode

    @property
    def gait(self) -> str:
        """Name of the gait that is walked or will be."""
        return self._gait_name

    @property
    def phase(self) -> float:
        """Phase of the gait, 0 to 1."""
        clock = self._suspended.clock if self.mode is Mode.TREAD else self._walking.clock
        return clock.phase

    @property
    def settled(self) -> bool:
        """Whether the motion of stand_up or sit has ended; True in every other mode."""
        return self._move.done if self.mode in (Mode.STAND_UP, Mode.SIT) else True

    @property
    def position_base_in_world(self) -> Array:
        """Estimated base position, (3,) m in the odometry frame."""
        return self._estimator.position

    @property
    def velocity_base_in_world(self) -> Array:
        """Estimated base velocity, (3,) m/s."""
        return self._estimator.velocity

    @property
    def orientation_base_in_world(self) -> Array:
        """Measured base orientation, quaternion (x, y, z, w)."""
        return self._measurements.orientation_base_in_world

    @property
    def thrust_in_base(self) -> Array:
        """Force asked of the fans outside of flight, (3,) N in base."""
        force: Array = self._rotation.T @ self.climbing.thrust
        force[2] += self.assist.force
        return force

    @property
    def forward(self) -> Array:
        """Unit vector in world along the body's x axis, (3,)."""
        return self._rotation[:, 0]

    @property
    def contact(self) -> Mask:
        """Detected contacts, (4,) bool."""
        return self._contacts.contact

    @property
    def foot_force_in_world(self) -> Array:
        """Estimated ground forces on the feet, (4, 3) N."""
        return self._contacts.foot_force @ self.climbing.plane

    @property
    def stance(self) -> Mask:
        """Legs that the gait has on the ground, (4,) bool."""
        clock = self._suspended.clock if self.mode is Mode.TREAD else self._walking.clock
        stance: Mask = ~clock.swinging
        return stance

    @property
    def foot_in_base(self) -> Array:
        """Measured foot centres, (4, 3) m in base."""
        return self._foot_in_base

    @property
    def desired_joint_position(self) -> Array:
        """Joint targets of the last tick, (12,) rad."""
        return self.command.position

    @property
    def desired_position(self) -> Array:
        """Reference body position in world, (3,) m."""
        return self._walking.body_position @ self.climbing.plane

    @property
    def desired_velocity(self) -> Array:
        """Reference body velocity in world, (3,) m/s."""
        return self._walking.body_velocity @ self.climbing.plane

    @property
    def commanded_velocity(self) -> Array:
        """Velocity command after its ramp: (vx, vy, yaw rate) in m/s and rad/s."""
        return self._walking.reference.ramped

    # -------------------------------------------------------------------- tick

    def tick(self, measurements: Measurements) -> JointCommand:
        """One period of 2 ms: estimate, judge, decide, command."""
        self.counters.ticks += 1
        self._refresh_parameters()
        m = self._incoming
        m.take(measurements)
        if not self._finite(m):
            self.counters.bad_measurements += 1
            self.assist.reset()
            if self.mode in ACTIVE:
                self._trip("a measurement is not finite")
            return self._limited(self._output())
        self._incoming, self._measurements = self._measurements, m
        self._measured = True
        matrix_from_quaternion(m.orientation_base_in_world, self._rotation)
        forward_kinematics(
            self._geometry, m.joint_position, self._foot_in_base, self._jacobian
        )
        np.matmul(self.climbing.plane, self._rotation, out=self._rotation_on_plane)
        self._estimate(m)
        if self.mode in ACTIVE:
            reason = self._safety.check(
                m.joint_position,
                m.joint_torque,
                self._lean(),
                m.joint_age_ticks,
                m.imu_age,
                m.drives_operational,
                TICK,
            )
            if reason is not None:
                self._trip(reason)
        if self.mode is Mode.FLY and not m.fans_available:
            self._trip("the fans are lost in flight")
        self.assist.tick(
            self.mode in (Mode.STAND, Mode.WALK),
            m.fans_available,
            self._rotation,
            m.angular_velocity_base_in_base,
            TICK,
        )
        if self.mode is Mode.WAIR:
            self._climb(m.fans_limit if m.fans_available else 0.0)
        else:
            self.climbing.fade(TICK)
            self._walking.thrust[2] = self.assist.lift_in_world(self._rotation)
        return self._limited(self._output())

    def _lean(self) -> float:
        """Angle of the body's z axis from where it shall point: up, or what an incline asks for."""
        if not self.climbing.active:
            return tilt_of(self._rotation)
        wanted = self._walking.body_rotation[:, 2]
        cosine = float(self._rotation_on_plane[:, 2] @ wanted)
        lean = math.acos(min(1.0, max(-1.0, cosine)))
        # A robot that has crouched may slide down to where it is flat.
        return min(lean, tilt_of(self._rotation)) if self.mode is Mode.SIT else lean

    def _estimate(self, m: Measurements) -> None:
        clock = self._walking.clock
        self._contacts.update(
            m.joint_velocity,
            m.joint_torque,
            self._jacobian,
            self._rotation_on_plane,
            clock.swing_progress,
            self._thresholds,
            TICK,
        )
        if self.mode not in ACTIVE or self.mode in (Mode.HANG, Mode.TREAD):
            self._estimator.reset(self._foot_in_base, self._rotation)
            return
        if self.mode is Mode.FLY and self.hover.phase in AIRBORNE:
            self._estimate_in_flight()
            return
        self._trust_feet()
        self._estimator.normal[:] = self.climbing.normal
        self._estimator.update(
            self._rotation,
            m.angular_velocity_base_in_base,
            m.specific_force_base,
            self._foot_in_base,
            self._jacobian,
            m.joint_position,
            m.joint_velocity,
            self._trust,
            self._noise,
            TICK,
        )

    def _estimate_in_flight(self) -> None:
        """The feet tell nothing: the body is where the flight has brought it."""
        estimator, hover = self._estimator, self.hover
        yaw = yaw_of(self._rotation)
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, _ = hover.error.tolist()
        vx, vy, vz = hover.velocity.tolist()
        estimator.reset(self._foot_in_base, self._rotation)
        start = self._fly_start
        place = (
            start[0] - c * x + s * y,
            start[1] - s * x - c * y,
            start[2] + hover.height,
        )
        estimator.foot_in_world += np.subtract(place, estimator.position)
        estimator.position[:] = place
        estimator.velocity[:] = c * vx - s * vy, s * vx + c * vy, vz

    def _trust_feet(self) -> None:
        """How much each foot tells about the base: standing by the gait and loaded by its current.

        Getting up and down the body may lie on the ground, and the feet, unloaded, still stand.
        """
        clock, contact, trust = self._walking.clock, self._contacts.contact, self._trust
        rising = self.mode is Mode.STAND_UP or self.mode is Mode.SIT
        decay = TICK / TRUST_TIME
        for leg in range(LEGS):
            if rising or (contact[leg] and not clock.swinging[leg]):
                trust[leg] = 1.0
            elif clock.swinging[leg]:
                trust[leg] = 0.0
            else:
                trust[leg] = max(0.0, trust[leg] - decay)

    def _limited(self, command: JointCommand) -> JointCommand:
        """Keep a command within the joints' limits: the drives refuse one that is not, whole."""
        limit_command(
            command.position, command.velocity, command.effort,
            self._lower, self._upper, self._velocity_limit, self._torque_limit,
        )
        return command

    def _output(self) -> JointCommand:
        mode, command = self.mode, self.command
        if mode is Mode.STAND_UP or mode is Mode.SIT:
            self._move.tick(TICK)
            self._weigh()
            command.mode_of_operation = CYCLIC_POSITION
            command.position[:] = self._move.joint_position
            command.velocity[:] = self._move.joint_velocity
            if mode is Mode.STAND_UP and self._move.done:
                self._follow_event(Event.DONE, "body raised")
        elif mode is Mode.STAND or mode is Mode.WALK or mode is Mode.WAIR:
            self._walk()
            command.mode_of_operation = CYCLIC_POSITION
            command.position[:] = self._walking.joint_position
            command.velocity[:] = self._walking.joint_velocity
            command.effort[:] = self._walking.joint_torque
        elif mode is Mode.FLY:
            self._fly()
        elif mode is Mode.HANG or mode is Mode.TREAD:
            self._suspended.tick(TICK)
            command.mode_of_operation = CYCLIC_POSITION
            command.position[:] = self._suspended.joint_position
            command.velocity[:] = self._suspended.joint_velocity
            command.effort.fill(0.0)
            if mode is Mode.TREAD and self._suspended.at_rest:
                self._follow_event(Event.DONE, "feet down")
        else:
            if self.hover.active:
                self.hover.fade(TICK)
            # Positions follow the joints, so that the next mode starts without a jump.
            command.position[:] = self._measurements.joint_position
            command.velocity.fill(0.0)
            command.effort.fill(0.0)
            command.mode_of_operation = (
                CYCLIC_VELOCITY if mode is Mode.DAMPING else CYCLIC_TORQUE
            )
        return command

    def _walk(self) -> None:
        m, walking = self._measurements, self._walking
        plane = self.climbing.plane
        if self.mode is Mode.WALK or self.mode is Mode.WAIR:
            self._silent_ticks += 1
            if walking.stepping and self._silent_ticks * TICK > self.parameters["command.timeout"]:
                self.counters.command_timeouts += 1
                walking.stop_stepping()
                self.reason = "velocity command silent"
        walking.tick(
            self._rotation_on_plane,
            m.angular_velocity_base_in_base,
            plane @ self._estimator.position,
            plane @ self._estimator.velocity,
            self._foot_in_base,
            self._estimator.foot_in_world @ plane.T,
            self._contacts.contact,
            self._contacts.foot_force,
            TICK,
        )
        self.counters.out_of_reach = walking.out_of_reach
        if self.mode is Mode.WALK and walking.stopped:
            self._follow_event(Event.DONE, "feet down")
        if self.mode is Mode.WAIR and self.wair.leaving and self._holds("level"):
            self._follow_event(Event.DONE, "level, feet down")

    def _climb(self, limit: float) -> None:
        """Mode wair: turn the ground's frame to the incline; the fans can make `limit` newtons."""
        standing = self._contacts.contact & ~self._walking.clock.swinging
        self.wair.tick(
            self._estimator.foot_in_world,
            self._estimator.velocity,
            self._rotation,
            standing,
            self._silent_ticks * TICK,
            limit,
            TICK,
        )
        np.matmul(self.climbing.plane, self._rotation, out=self._rotation_on_plane)
        light, full = self.wair.lightness, self._full_thresholds
        self._thresholds = ContactThresholds(
            light * full.touchdown, light * full.early, light * full.liftoff
        )
        if self.climbing.lost:
            self._follow_event(Event.LOST, "the fans are lost on an incline: crouching")

    def _fly(self) -> None:
        """Fly, or spool up and down; the legs keep their posture and carry what the fans do not."""
        m, hover, command = self._measurements, self.hover, self.command
        note = hover.note
        hover.tick(
            m.time, m.pose, self._rotation, m.specific_force_base,
            int(self._contacts.contact.sum()), yaw_of(self._rotation), TICK,
        )
        if hover.note != note:
            self.reason = hover.note
        carried = max(0.0, hover.weight - hover.lift * float(self._rotation[2, 2]))
        command.mode_of_operation = CYCLIC_POSITION
        command.position[:] = self._fly_posture
        command.velocity.fill(0.0)
        self._carry(carried)
        if hover.done:
            self._follow_event(Event.DONE, hover.failed or "landed")

    def _weigh(self) -> None:
        """Torque feed-forward of standing up and sitting down: the legs take over the weight."""
        move, lifting = self._move, self.mode is Mode.STAND_UP
        if lifting:
            part = move.progress if move.on_last_way else 0.0
        else:
            part = 1.0 - move.progress if move.on_first_way else 0.0
        self._carry(self._walking.mass * GRAVITY * min(1.0, 4.0 * part))

    def _carry(self, weight: float) -> None:
        """Torques that let four standing feet carry a weight [N]."""
        distribute_weight(
            self._foot_in_base, self._center, self._share, self._rotation, weight, 0.0, 0.0, weight,
            self._foot_force,
        )
        for leg in range(LEGS):
            self.command.effort[3 * leg : 3 * leg + 3] = -(
                self._jacobian[leg].T @ self._foot_force[leg]
            )

    # ------------------------------------------------------------- transitions

    def _enter(self, row: Transition, reason: str) -> None:
        """Prepare the mode that a transition has led to."""
        self.reason = reason
        mode = row.target
        if mode is Mode.STAND_UP:
            start = self._measurements.joint_position
            if Mode.SIT in row.sources:
                start = self._move.joint_position
            self._safety.reset()
            self._walking.clock.swinging.fill(False)
            self._walking.clock.swing_progress.fill(-1.0)
            self._rise(start)
        elif mode is Mode.SIT:
            self._descend(self.command.position, lost=row.event is Event.LOST)
        elif mode is Mode.STAND and row.event is Event.DONE and Mode.STAND_UP in row.sources:
            forward_kinematics(
                self._geometry, self._move.joint_position, self._foot_force, self._jacobian
            )
            self._walking.begin(
                self._rotation,
                self._estimator.position,
                self._foot_force,
                self.parameters.gait(self._gait_name),
            )
        elif mode is Mode.HANG and Mode.PASSIVE in row.sources:
            start, posture = self._measurements.joint_position, self._stand_posture()
            self._safety.reset()
            self._suspended.begin(start, posture, self._gather_time(start, posture))
        elif mode is Mode.TREAD:
            self._suspended.tread(self.parameters.gait(self._gait_name))
        elif mode is Mode.FLY:
            self._take_off()
        elif mode is Mode.WAIR:
            self._silent_ticks = 0
            self.wair.begin(self._estimator.foot_in_world)
        elif mode is Mode.STAND and Mode.WAIR in row.sources:
            self.wair.level()
            self._thresholds = self._full_thresholds
        elif mode is Mode.STAND and Mode.FLY in row.sources:
            self._stand_again()
        elif mode is Mode.WALK:
            self._silent_ticks = 0
            self._walking.start_stepping(
                self.parameters.gait(self._gait_name), self._estimator.position
            )

        if mode in (Mode.DAMPING, Mode.EMERGENCY_STOP):
            self.assist.withhold()
        # A robot that crouches on an incline keeps its frame.
        if mode not in (Mode.WAIR, Mode.STAND, Mode.SIT) and self.climbing.active:
            self.wair.level()
            self._thresholds = self._full_thresholds
        if mode not in (Mode.FLY, Mode.STAND) and self.hover.active:
            self.hover.end(at_once=mode is Mode.EMERGENCY_STOP)

    def _take_off(self) -> None:
        """Begin a flight from standing; the fans go on with what they help already."""
        m, yaw = self._measurements, yaw_of(self._rotation)
        self._fly_posture[:] = self.command.position
        self._fly_start[:] = self._estimator.position
        fans_yaw = m.fans_yaw if math.isfinite(m.fans_yaw) else yaw
        self.hover.begin(m.pose, yaw, fans_yaw, self.assist.force)
        self.assist.reset()

    def _stand_again(self) -> None:
        """The flight is over: stand on the posture that it ended in."""
        self.hover.finish()
        forward_kinematics(self._geometry, self._fly_posture, self._foot_force, self._jacobian)
        self._walking.thrust.fill(0.0)
        self._walking.begin(
            self._rotation,
            self._estimator.position,
            self._foot_force,
            self.parameters.gait(self._gait_name),
        )

    def _follow_event(self, event: Event, reason: str) -> None:
        row = self._machine.raise_event(event)
        if row is None:
            return
        self._enter(row, reason)
        if row.target is Mode.STAND and self._pending_gait is not None:
            self._gait_name, self._pending_gait = self._pending_gait, None
            self.request_mode("walk")

    def _trip(self, reason: str) -> None:
        row = self._machine.raise_event(Event.FAULT)
        if row is not None:
            self.counters.faults += 1
            self._enter(row, reason)

    def _holds(self, condition: str) -> bool:
        """Conditions of the mode machine."""
        m = self._measurements
        if condition == "drives_operational":
            return m.drives_operational
        if condition == "measurements_fresh":
            return self._measured and self._safety.stale(m.joint_age_ticks, m.imu_age) is None
        if condition == "upright":
            return tilt_of(self._rotation) < self.parameters["safety.max_tilt"]
        if condition == "stopped":
            return self._walking.stopped
        if condition == "level":
            return self.wair.is_level
        if condition == "at_rest":
            speed = math.hypot(*self._estimator.velocity[:2])
            turning = math.hypot(*m.angular_velocity_base_in_base)
            return speed < REST_SPEED and turning < REST_RATE
        if condition == "fans_available":
            return m.fans_available
        if condition == "pose_fresh":
            return m.pose.usable(m.time)
        if condition == "landed":
            return self.hover.done
        if condition == "posture_reached":
            return self._suspended.ready
        if condition == "feet_still":
            return self._suspended.at_rest
        raise KeyError(condition)

    # ------------------------------------------------------------------- parts

    def _gather_time(self, start: Array, end: Array) -> float:
        """Time to go between two postures at the gathering speed, s."""
        furthest = float(np.abs(np.asarray(end) - np.asarray(start)).max())
        # A minimum-jerk motion peaks at 15/8 of its mean speed.
        return max(0.2, 1.875 * furthest / self.parameters["stand.joint_speed"])

    def _stand_posture(self) -> Array:
        """Joint positions to stand up to."""
        p = self.parameters
        return self._postures.stand(p["stand.lateral_spread"], p["stand.height_offset"])

    def _rise(self, start: Array) -> None:
        """Stand up: the feet go to their places while the body lies, and lift it straight up."""
        *before, up = self._postures.ways_up(start, self._stand_posture())
        durations = [self._gather_time(way[0], way[-1]) for way in before]
        self._move.start([*before, up], [*durations, self.parameters["stand.duration"]])

    def _descend(self, start: Array, *, lost: bool) -> None:
        """Sit down onto the perch between the feet, then gather them; or crouch, wide and soon."""
        p = self.parameters
        if lost:
            self._move.start([np.stack((start, self._postures.crouch()))], [p["wair.crouch_time"]])
            return
        down, *after = self._postures.ways_down(start)
        durations = [self._gather_time(way[0], way[-1]) for way in after]
        self._move.start([down, *after], [p["stand.duration"], *durations])

    def _refresh_parameters(self) -> None:
        """Take over live parameters that the kernels get as tuples."""
        p = self.parameters
        if p.revision == self._revision:
            return
        self._revision = p.revision
        self._full_thresholds = ContactThresholds(
            p["contact.touchdown_force"], p["contact.early_force"], p["contact.liftoff_force"]
        )
        self._thresholds = self._full_thresholds
        self._noise = EstimatorNoise(
            p["estimator.acceleration"],
            p["estimator.foot_drift"],
            p["estimator.foot_position"],
            p["estimator.foot_velocity"],
            p["estimator.ground_height"],
            p["estimator.innovation_gate"],
        )

    @staticmethod
    def _finite(m: Measurements) -> bool:
        """Whether every number of a measurement is finite."""
        return math.isfinite(m.imu_age) and all_finite(
            m.joint_position,
            m.joint_velocity,
            m.joint_torque,
            m.orientation_base_in_world,
            m.angular_velocity_base_in_base,
            m.specific_force_base,
        )

    def _warm_up(self) -> None:
        """Rehearse standing, walking and sitting with a second controller: numba compiles now."""
        parameters = Parameters({"stand.duration": 0.5, "stand.joint_speed": 5.0})
        rehearsal = Controller(self.robot, parameters, warm_up=False)
        lean_forces(np.eye(3), 0.0, 0.0, np.zeros((LEGS, 3)))
        m = Measurements(drives_operational=True)
        m.joint_position[:] = self.robot.sit_joint_position
        for mode, ticks in _REHEARSAL:
            rehearsal.tick(m)
            accepted, message = rehearsal.request_mode(mode)
            if not accepted:
                raise RuntimeError(f"the rehearsal of {mode} has failed: {message}")
            for _ in range(ticks):
                # Feet press on the ground with what the controller asks of them.
                m.joint_torque[:] = rehearsal.tick(m).effort
                m.joint_position[:] = rehearsal.command.position
