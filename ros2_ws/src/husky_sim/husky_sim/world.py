"""The MuJoCo world: robot, ground, and one tick of physics with the drives' servo law in it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_runtime.graph import TICK_PERIOD_NS
from husky_sim.devices.bus_servos.motors import BusServoMotors
from husky_sim.devices.drives.motor import Servos, ServoTiming
from husky_sim.gantry import Gantry
from husky_sim.propulsion.fans_in_world import FansInWorld
from husky_sim.propulsion.propellers_in_world import propulsion_of
from husky_sim.scene import HOLD, WorldOptions, build_scene, physics_step

IMU_PERIOD_NS = 1_250_000
"""Period of the VN-200's output [ns]: 800 Hz (thesis T4)."""
POSE_PERIOD_NS = 5_000_000
"""Period of the T265's poses [ns]: 200 Hz (thesis T4)."""
AIR_DENSITY, AIR_VISCOSITY = 1.204, 1.82e-5
"""Of air that moves, at 20 deg C [kg/m^3, Pa s]."""
STRONGEST_WIND = 20.0
"""Greatest part of the wind along an axis [m/s]."""


class TrueImuSample(NamedTuple):
    """What an ideal IMU at the robot's IMU site feels; plain floats, because it is hot.

    Attributes:
        time_ns: when it was due [ns].
        orientation: of the IMU in world, quaternion (x, y, z, w).
        angular_velocity: in the IMU's axes [rad/s] (3,).
        specific_force: in the IMU's axes [m/s^2] (3,).
    """

    time_ns: int
    orientation: tuple[float, float, float, float]
    angular_velocity: list[float]
    specific_force: list[float]


class PoseSample(NamedTuple):
    """Motion of the base, for the T265; plain floats.

    Attributes:
        time_ns: of the sample [ns].
        position: of base in world [m] (3,).
        orientation: base in world, quaternion (x, y, z, w).
        velocity: of base's origin in world [m/s] (3,).
        angular_velocity: in base [rad/s] (3,).
    """

    time_ns: int
    position: list[float]
    orientation: tuple[float, float, float, float]
    velocity: list[float]
    angular_velocity: list[float]


def _make_servos(robot: Robot, options: WorldOptions) -> Servos | BusServoMotors:
    """Return what moves the robot's joints: the kind that its parameter file has."""
    if robot.legs_carry_propellers:
        return BusServoMotors(robot.bus_servo, len(robot.joint_names), options.timestep)
    return Servos(robot, ServoTiming(step=options.timestep), options.seed)


class World:
    """The simulated world, advanced by ticks of 2 ms.

    Attributes:
        model: compiled MuJoCo model.
        data: its state.
        time_ns: simulated time [ns].
        servos: the drives' power stages, or the servos of a bus, evaluated between physics steps.
        fans: the propulsion unit, or None.
        gantry: the gantry, or None.
        slid: way that each foot has slid over what it touches, see `measure_sliding` [m] (4,).
    """

    def __init__(self, robot: Robot, options: WorldOptions):
        """Build the world and put the robot into its initial posture."""
        self.robot = robot
        self.options = options
        spec = build_scene(robot, options)
        self.model = spec.compile()
        self._spec = spec
        self.data = mujoco.MjData(self.model)
        self._step_physics = physics_step(self.model, options)
        self.servos = _make_servos(robot, options)
        self._substeps = round(TICK_PERIOD_NS / 1e9 / options.timestep)
        self._step_ns = TICK_PERIOD_NS // self._substeps
        self._base = self.model.body("base").id
        self.has_legs = options.body != "unit"
        self.joint_position: Array = np.zeros(12)
        self.joint_velocity: Array = np.zeros(12)
        self._joint_qpos: NDArray[np.intp] | None = None  # and of qvel, where they are no views
        self._joint_qvel: NDArray[np.intp] | None = None
        if self.has_legs:
            self._find_joints()
            self.servos.torque = self.data.ctrl[:12]
        unit = options.body != "robot"
        self.fans = propulsion_of(robot, self.model, self.data) if unit else None
        self.gantry = (
            Gantry(self.model, self.data, options.gantry) if options.gantry is not None else None
        )
        self._hold = self.model.equality(HOLD).id
        self._imu_orientation = self._sensor("imu_orientation")
        self._imu_gyro = self._sensor("imu_gyro")
        self._imu_accelerometer = self._sensor("imu_accelerometer")
        self._foot_geoms = {
            self.model.geom(f"{leg}_foot").id: index
            for index, leg in enumerate(robot.legs)
            if self.has_legs
        }
        self.reset(options.keyframe)

    def _find_joints(self) -> None:
        """Make the joints views of MuJoCo's memory, or copies where the frame's are in between."""
        joints = [self.model.joint(name) for name in self.robot.joint_names]
        qpos = np.array([joint.qposadr[0] for joint in joints])
        qvel = np.array([joint.dofadr[0] for joint in joints])
        if np.array_equal(qpos, np.arange(7, 19)):
            self.joint_position, self.joint_velocity = self.data.qpos[7:19], self.data.qvel[6:18]
        else:
            self._joint_qpos, self._joint_qvel = qpos, qvel

    def _copy_joints(self) -> None:
        """Bring the joints up to date; to be called where they are no views."""
        self.data.qpos.take(self._joint_qpos, out=self.joint_position)
        self.data.qvel.take(self._joint_qvel, out=self.joint_velocity)

    @property
    def scene_xml(self) -> str:
        """The world as MuJoCo XML, to look at or to render recordings with; takes 0.1 s."""
        return str(self._spec.to_xml())

    def _sensor(self, name: str) -> Array:
        sensor = self.model.sensor(name)
        view: Array = self.data.sensordata[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
        return view

    def reset(self, keyframe: str) -> None:
        """Put the robot into a keyframe at time zero.

        Raises:
            ValueError: no such keyframe.
        """
        names = [self.model.key(i).name for i in range(self.model.nkey)]
        if keyframe not in names:
            raise ValueError(f"keyframe is {keyframe!r}, it must be one of {', '.join(names)}")
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(keyframe).id)
        self._place()
        if self.fans is not None:
            self.fans.reset()
        self.hold(self.options.start_held)
        mujoco.mj_forward(self.model, self.data)
        self.time_ns = 0
        self._next_imu_ns = self._next_pose_ns = 0
        self.poses: list[PoseSample] = []
        self._push_until_ns = 0
        self._push_body = self._base
        self.slid = [0.0] * 4
        self._hash = hashlib.sha256()
        self.servos.reset()
        if self._joint_qpos is not None:
            self._copy_joints()
        self.servos.update_state(self.joint_position)

    def _place(self) -> None:
        """Move the base from where the keyframe has it to the start, upright on the surface."""
        options, data = self.options, self.data
        x, z, angle = options.terrain.at(options.start_distance)
        lean = np.array((np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0))
        position, orientation = np.empty(3), np.empty(4)
        mujoco.mju_rotVecQuat(position, data.qpos[0:3], lean)
        mujoco.mju_mulQuat(orientation, lean, data.qpos[3:7])
        data.qpos[0:3] = position + (x, 0.0, z + options.start_height)
        data.qpos[3:7] = orientation

    def hold(self, held: bool) -> None:
        """Hold the base where it is, as strong hands would, or release it."""
        if held:
            row = self.model.eq_data[self._hold]
            row[0:3] = self.data.qpos[0:3]  # in the world, where base's origin ...
            row[3:6] = 0.0  # ... has to be
            mujoco.mju_negQuat(row[6:10], self.data.qpos[3:7])
        self.data.eq_active[self._hold] = held

    @property
    def held(self) -> bool:
        """Whether the base is held in place."""
        return bool(self.data.eq_active[self._hold])

    def step_tick(self) -> list[TrueImuSample]:
        """Advance by 2 ms; return the IMU samples that were due meanwhile."""
        samples: list[TrueImuSample] = []
        model, data, servos = self.model, self.data, self.servos
        position, velocity = self.joint_position, self.joint_velocity
        copied = self._joint_qpos is not None
        if self._push_until_ns and self.time_ns >= self._push_until_ns:
            data.xfrc_applied[self._push_body] = 0.0
            self._push_until_ns = 0
        now = self.time_ns
        step_servos, step_physics = servos.step, self._step_physics
        if self.gantry is not None:
            self.gantry.advance(TICK_PERIOD_NS / 1e9)
        fans = self.fans
        if fans is not None:
            self.poses.clear()
            self._power_drives(fans)
        for _ in range(self._substeps):
            step_servos(position, velocity)
            if fans is not None:
                if self._next_pose_ns <= now:
                    self._next_pose_ns += POSE_PERIOD_NS
                    self.poses.append(self._pose_sample(now))
                fans.step(self._drives_power)
            step_physics(model, data)
            if copied:
                self._copy_joints()
            now += self._step_ns
            # Sensors now hold the state at the start of the step, the newest that a sample that is
            # due before its end can have.
            if self._next_imu_ns < now:
                samples.append(self._imu_sample())
        self.time_ns = now
        servos.update_state(position)
        self._hash.update(data.qpos)
        self._hash.update(data.qvel)
        return samples

    def _imu_sample(self) -> TrueImuSample:
        time_ns = self._next_imu_ns
        self._next_imu_ns += IMU_PERIOD_NS
        w, x, y, z = self._imu_orientation.tolist()
        return TrueImuSample(
            time_ns, (x, y, z, w), self._imu_gyro.tolist(), self._imu_accelerometer.tolist()
        )

    def _power_drives(self, fans: FansInWorld) -> None:
        """The drives hang on the unit's battery: its voltage is theirs, their power its load."""
        self.servos.bus_voltage = fans.unit.battery_voltage
        if isinstance(self.servos, BusServoMotors):
            self._drives_power = self.servos.power
            return
        power = float(self.data.ctrl[:12] @ self.joint_velocity) if self.has_legs else 0.0
        self._drives_power = max(0.0, power)

    def _pose_sample(self, time_ns: int) -> PoseSample:
        q, v = self.data.qpos, self.data.qvel
        w, x, y, z = q[3:7].tolist()
        return PoseSample(time_ns, q[0:3].tolist(), (x, y, z, w), v[0:3].tolist(), v[3:6].tolist())

    def push(self, body: str, force: Array, torque: Array, duration: float) -> None:
        """Apply a wrench to a body from the next tick on.

        Args:
            body: body name, empty for the base.
            force: at the body's centre of mass, in world [N].
            torque: in world [N m].
            duration: [s], rounded up to ticks.

        Raises:
            ValueError: unknown body, numbers that are not finite, or a duration out of range.
        """
        name = body or "base"
        names = [self.model.body(i).name for i in range(1, self.model.nbody)]
        if name not in names:
            raise ValueError(f"body is {name!r}, it must be one of {', '.join(names)}")
        wrench = np.concatenate((force, torque))
        if not np.all(np.isfinite(wrench)) or np.any(np.abs(wrench) > 1e4):
            raise ValueError(f"wrench is {wrench}, it must be finite and below 1e4 N and N m")
        if not 0.0 < duration <= 60.0:
            raise ValueError(f"duration is {duration} s, it must be above 0 and at most 60")
        self.data.xfrc_applied[self._push_body] = 0.0
        self._push_body = self.model.body(name).id
        self.data.xfrc_applied[self._push_body] = wrench
        ticks = int(np.ceil(duration * 1e9 / TICK_PERIOD_NS - 1e-9))
        self._push_until_ns = self.time_ns + ticks * TICK_PERIOD_NS

    def blow(self, wind: Sequence[float]) -> None:
        """Let the air move from now on; without wind the air is left out, as it is at the start.

        Bodies feel MuJoCo's forces of a fluid on boxes of their inertia, propellers on legs a force
        across their axes, too.

        Args:
            wind: in world [m/s] (3,).

        Raises:
            ValueError: it is not three numbers up to `STRONGEST_WIND`.
        """
        air = np.array(wind, float)
        if air.shape != (3,) or not np.all(np.abs(air) <= STRONGEST_WIND):
            raise ValueError(
                f"wind is {list(wind)}, it must be 3 numbers of at most {STRONGEST_WIND:g} m/s"
            )
        option, moves = self.model.opt, bool(air.any())
        option.wind[:] = air
        option.density = AIR_DENSITY if moves else 0.0
        option.viscosity = AIR_VISCOSITY if moves else 0.0
        if self.fans is not None:
            self.fans.wind = air if moves else None

    @property
    def trajectory_sha256(self) -> str:
        """Digest of every state since the last reset."""
        return self._hash.hexdigest()

    @property
    def base_position(self) -> Array:
        """Base origin in world [m], shape (3,)."""
        position: Array = self.data.qpos[0:3]
        return position

    @property
    def base_orientation(self) -> Array:
        """Base in world, quaternion (x, y, z, w)."""
        w, x, y, z = self.data.qpos[3:7]
        return np.array((x, y, z, w))

    @property
    def base_velocity(self) -> Array:
        """Velocity of the base origin in world [m/s], shape (3,)."""
        velocity: Array = self.data.qvel[0:3]
        return velocity

    def base_velocity_in_base(self) -> Array:
        """Return the velocity of the base origin in base axes [m/s], shape (3,)."""
        inverse, velocity = np.empty(4), np.empty(3)
        mujoco.mju_negQuat(inverse, self.data.qpos[3:7])
        mujoco.mju_rotVecQuat(velocity, self.data.qvel[0:3], inverse)
        return velocity

    @property
    def base_angular_velocity(self) -> Array:
        """Angular velocity in base axes [rad/s], shape (3,)."""
        velocity: Array = self.data.qvel[3:6]
        return velocity

    def center_of_mass(self) -> Array:
        """Return the centre of mass of the whole robot in world [m], shape (3,)."""
        center: Array = self.data.subtree_com[self._base]
        return center

    def foot_positions(self) -> Array:
        """Return the foot centres in world [m], shape (4, 3)."""
        return np.array([self.data.geom_xpos[geom] for geom in self._foot_geoms])

    def foot_contacts(self) -> tuple[Array, Array]:
        """Return the force of everything on each foot and the ground's normal there, in world.

        Returns:
            forces: [N] (4, 3).
            normals: (4, 3) unit vectors towards the foot, the mean where a foot touches more than
                one thing, by their forces; zero without contact.
        """
        forces, normals = np.zeros((4, 3)), np.zeros((4, 3))
        wrench = np.zeros(6)
        for index in range(self.data.ncon):
            contact = self.data.contact[index]
            for geom, sign in ((contact.geom1, -1.0), (contact.geom2, 1.0)):
                leg = self._foot_geoms.get(int(geom))
                if leg is not None:
                    mujoco.mj_contactForce(self.model, self.data, index, wrench)
                    # Rows of the contact frame are its axes; the force acts on geom2.
                    frame = contact.frame.reshape(3, 3)
                    forces[leg] += sign * frame.T @ wrench[:3]
                    normals[leg] += sign * wrench[0] * frame[0]
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return forces, np.divide(normals, lengths, out=normals, where=lengths > 0.0)

    def measure_sliding(self) -> None:
        """Add to `slid` what the feet slide in this tick; to be called once a tick.

        The first of a contact's rows in MuJoCo's constraint space is its normal, the next two its
        tangents, so that their velocities are those of the point in contact: a foot that rolls
        does not slide.
        """
        data = self.data
        velocity = data.efc_vel
        for index in range(data.ncon):
            contact = data.contact[index]
            feet = self._foot_geoms
            leg = feet.get(contact.geom1, feet.get(contact.geom2))
            row = contact.efc_address
            if leg is not None and row >= 0:
                sliding = math.hypot(velocity[row + 1], velocity[row + 2])
                self.slid[leg] += sliding * TICK_PERIOD_NS / 1e9

    def foot_forces(self) -> Array:
        """Return the force of everything on each foot, in world [N], shape (4, 3)."""
        return self.foot_contacts()[0]
