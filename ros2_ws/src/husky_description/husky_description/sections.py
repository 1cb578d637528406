"""Sections of a robot's file as frozen dataclasses, each number with its allowed range.

SI units and radians; sources of the values stand in carbon.yaml and beta.yaml.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from husky_description.arrays import Array
from husky_description.parameters import choice, count, frozen, named, number, vector
from husky_description.rotation import from_roll_pitch_yaw, rotate


@dataclass(frozen=True, eq=False)
class BodySection:
    """Torso: mass [kg], principal inertia [kg m^2] (3,), centre of mass in base [m] (3,)."""

    mass: Annotated[float, number(0.1, 50.0)]
    inertia: Annotated[Array, vector(3, 1e-5, 5.0)]
    center_of_mass: Annotated[Array, vector(3, -0.2, 0.2)]


@dataclass(frozen=True, eq=False)
class BoxSection:
    """Box in base: position of its centre [m] (3,), edge lengths along x, y, z [m] (3,)."""

    position: Annotated[Array, vector(3, -0.5, 0.5)]
    size: Annotated[Array, vector(3, 0.001, 1.0)]


@dataclass(frozen=True, eq=False)
class LegSection:
    """One leg, all four alike: lengths and radii [m], masses [kg]."""

    hip_x: Annotated[float, number(0.05, 1.0)]
    hip_y: Annotated[float, number(0.0, 0.5)]
    lateral_offset: Annotated[float, number(0.0, 0.3)]
    thigh_link: Annotated[float, number(0.01, 1.0)]
    ankle_link: Annotated[float, number(0.0, 1.0)]
    calf_link: Annotated[float, number(0.01, 1.0)]
    rod_offset: Annotated[float, number(0.0, 0.3)]
    foot_radius: Annotated[float, number(0.002, 0.1)]
    hip_mass: Annotated[float, number(1e-3, 10.0)]
    thigh_mass: Annotated[float, number(1e-3, 10.0)]
    shin_mass: Annotated[float, number(1e-3, 10.0)]
    hip_radius: Annotated[float, number(0.002, 0.2)]
    hip_length: Annotated[float, number(0.002, 0.4)]
    tube_outer_radius: Annotated[float, number(0.001, 0.1)]
    tube_inner_radius: Annotated[float, number(0.0, 0.1)]


@dataclass(frozen=True, eq=False)
class JointsSection:
    """Ranges [rad] of one leg's joints and the velocity limit of all [rad/s]."""

    hip_frontal_outward: Annotated[float, number(0.0, 3.14159)]
    hip_frontal_inward: Annotated[float, number(0.0, 3.14159)]
    hip_sagittal: Annotated[Array, vector(2, -3.14159, 3.14159)]
    knee: Annotated[Array, vector(2, -3.14159, 3.14159)]
    velocity_limit: Annotated[float, number(0.1, 200.0)]


@dataclass(frozen=True, eq=False)
class ContactSection:
    """Contact of the robot with anything: friction coefficients [-, m, m], MuJoCo's solref."""

    friction: Annotated[float, number(0.0, 3.0)]
    friction_torsional: Annotated[float, number(0.0, 0.1)]
    friction_rolling: Annotated[float, number(0.0, 0.1)]
    time_constant: Annotated[float, number(0.001, 0.1)]
    damping_ratio: Annotated[float, number(0.1, 10.0)]


SOFTEST_FRAME = 10.0
"""Least eigenfrequency of a frame that bends [Hz]."""


@dataclass(frozen=True, eq=False)
class FrameSection:
    """Bending of the frame at each hip, see `frame_compliance`.

    Eigenfrequency of the body on its four standing legs with blocked joints and feet that are held
    [Hz], 0 for a stiff frame; damping ratio of that mode [-].
    """

    frequency: Annotated[float, number(0.0, 40.0)]
    damping_ratio: Annotated[float, number(0.0, 1.0)]

    def check(self) -> None:
        """Refuse a frame that is too soft.

        Raises:
            ValueError: names the key and what is allowed.
        """
        if 0.0 < self.frequency < SOFTEST_FRAME:
            raise ValueError(
                f"frame.frequency: {self.frequency:g} Hz is neither 0, for a stiff frame, nor "
                f"within [{SOFTEST_FRAME:g}, 40]"
            )


@dataclass(frozen=True, eq=False)
class PostureSection:
    """Named postures: base above the foot centres when standing, perch above ground sitting [m]."""

    stand_height: Annotated[float, number(0.05, 2.0)]
    perch_clearance: Annotated[float, number(-0.01, 0.1)]


@dataclass(frozen=True, eq=False)
class SizeSection:
    """Length of the legs and mass over those of the robot that the gains were found on [-]."""

    length: Annotated[float, number(0.1, 10.0)]
    mass: Annotated[float, number(0.01, 100.0)]


@dataclass(frozen=True, eq=False)
class ServoSection:
    """Position law of a drive, joint side: kp [N m/rad], kd [N m s/rad], torque_limit [N m]."""

    kp: Annotated[float, number(0.0, 5000.0)]
    kd: Annotated[float, number(0.0, 200.0)]
    torque_limit: Annotated[float, number(0.1, 100.0)]


@dataclass(frozen=True, eq=False)
class MotorSection:
    """Motor: [rad/s/V], [N m/A of phase amplitude], [ohm], [H], [-], [kg m^2 at the joint]."""

    speed_constant: Annotated[float, number(1.0, 1000.0)]
    torque_constant: Annotated[float, number(1e-4, 1.0)]
    phase_resistance: Annotated[float, number(1e-3, 10.0)]
    phase_inductance: Annotated[float, number(1e-7, 1e-2)]
    pole_pairs: Annotated[int, count(1, 50)]
    armature: Annotated[float, number(0.0, 1.0)]


@dataclass(frozen=True, eq=False)
class GearSection:
    """Gear: ratio [-], efficiency [-], torque ratings at the joint [N m], input speed [rad/s]."""

    ratio: Annotated[float, number(1.0, 200.0)]
    efficiency: Annotated[float, number(0.05, 1.0)]
    rated_torque: Annotated[float, number(0.01, 100.0)]
    repeated_peak_torque: Annotated[float, number(0.01, 200.0)]
    momentary_peak_torque: Annotated[float, number(0.01, 400.0)]
    ratcheting_torque: Annotated[float, number(0.01, 1000.0)]
    input_speed_limit: Annotated[float, number(1.0, 5000.0)]


@dataclass(frozen=True, eq=False)
class EncoderSection:
    """Magnetic encoder on the motor shaft: bits [-], accuracy [rad at the motor]."""

    bits: Annotated[int, count(4, 24)]
    accuracy: Annotated[float, number(0.0, 0.1)]

    @property
    def counts_per_motor_turn(self) -> int:
        """Counts per turn of the motor shaft."""
        return 1 << self.bits


@dataclass(frozen=True, eq=False)
class DriveSection:
    """Drive: [V], currents [A], times [s], following error [rad at the joint]."""

    bus_voltage: Annotated[float, number(1.0, 100.0)]
    continuous_current: Annotated[float, number(0.1, 100.0)]
    peak_current: Annotated[float, number(0.1, 200.0)]
    peak_duration: Annotated[float, number(0.0, 60.0)]
    cycle: Annotated[float, number(1e-5, 1e-2)]
    watchdog: Annotated[float, number(1e-3, 10.0)]
    following_error_window: Annotated[float, number(1e-3, 6.3)]
    following_error_time: Annotated[float, number(0.0, 10.0)]


@dataclass(frozen=True, eq=False)
class ImuSection:
    """IMU: pose in base [m, rad], rate [Hz], noise densities, biases and ranges (SI)."""

    position: Annotated[Array, vector(3, -0.5, 0.5)]
    rpy: Annotated[Array, vector(3, -3.15, 3.15)]
    rate: Annotated[float, number(1.0, 10000.0)]
    gyro_noise_density: Annotated[float, number(0.0, 0.1)]
    accel_noise_density: Annotated[float, number(0.0, 1.0)]
    gyro_bias: Annotated[float, number(0.0, 1.0)]
    accel_bias: Annotated[float, number(0.0, 5.0)]
    accel_bias_walk: Annotated[float, number(0.0, 1.0)]
    gyro_range: Annotated[float, number(0.1, 1000.0)]
    accel_range: Annotated[float, number(10.0, 10000.0)]


@dataclass(frozen=True, eq=False)
class T265Section:
    """Tracking camera: pose in base [m, rad], size of its case [m], rate [Hz], errors (SI)."""

    position: Annotated[Array, vector(3, -0.5, 0.5)]
    rpy: Annotated[Array, vector(3, -3.15, 3.15)]
    size: Annotated[Array, vector(3, 0.001, 0.5)]
    rate: Annotated[float, number(1.0, 1000.0)]
    drift: Annotated[float, number(0.0, 0.1)]
    drift_length: Annotated[float, number(0.1, 1e6)]
    position_noise: Annotated[float, number(0.0, 0.1)]
    attitude_noise: Annotated[float, number(0.0, 0.1)]
    velocity_noise: Annotated[float, number(0.0, 1.0)]
    angular_velocity_noise: Annotated[float, number(0.0, 1.0)]
    acceleration_noise: Annotated[float, number(0.0, 10.0)]
    warm_up: Annotated[float, number(0.0, 60.0)]
    fast_rotation: Annotated[float, number(0.1, 100.0)]


@dataclass(frozen=True, eq=False)
class D435Section:
    """Depth camera: pose in base [m, rad], case [m], mass [kg], image, errors (SI).

    The pose is that of camera_link, which as in realsense-ros is where depth is measured from: the
    optical centre of the left imager, x along the view. `depth_offset` is its place from the centre
    of the case, along its own axes [m].

    Width and height of the image [pixels]; its field of view, horizontal and vertical [rad]; rate
    [Hz]; baseline of the imagers [m]; latency from the middle of the exposure to the host [s];
    least and greatest depth [m]. At the depth d its standard deviation is noise_floor [m] +
    noise_gain [1/m] (d - noise_range [m])^2 along the optical axis and lateral_noise [-] d across;
    there is always some, as a driver takes equal images for those of a stuck camera. Shares [-]:
    pixels that have no depth, blocks of 8 by 8 pixels that have none, and pixels at an edge whose
    depth lies between both sides.
    """

    position: Annotated[Array, vector(3, -0.5, 0.5)]
    rpy: Annotated[Array, vector(3, -3.15, 3.15)]
    size: Annotated[Array, vector(3, 0.001, 0.5)]
    mass: Annotated[float, number(0.001, 2.0)]
    depth_offset: Annotated[Array, vector(3, -0.25, 0.25)]
    width: Annotated[int, count(8, 1280)]
    height: Annotated[int, count(8, 720)]
    field_of_view: Annotated[Array, vector(2, 0.1, 2.8)]
    rate: Annotated[float, number(0.1, 90.0)]
    baseline: Annotated[float, number(0.001, 0.5)]
    latency: Annotated[float, number(0.0, 1.0)]
    range: Annotated[Array, vector(2, 0.01, 100.0)]
    noise_floor: Annotated[float, number(1e-4, 0.1)]
    noise_gain: Annotated[float, number(0.0, 0.1)]
    noise_range: Annotated[float, number(0.0, 10.0)]
    lateral_noise: Annotated[float, number(0.0, 0.1)]
    dropout: Annotated[float, number(0.0, 1.0)]
    hole: Annotated[float, number(0.0, 1.0)]
    flying_pixels: Annotated[float, number(0.0, 1.0)]

    @cached_property
    def center(self) -> Array:
        """Centre of the case, which is that of its mass, in base [m] (3,)."""
        roll, pitch, yaw = self.rpy.tolist()
        x, y, z = self.depth_offset.tolist()
        return frozen(self.position - rotate(from_roll_pitch_yaw(roll, pitch, yaw), (x, y, z)))

    def check(self) -> None:
        """Refuse a range without depths.

        Raises:
            ValueError: names the key and what is wrong.
        """
        near, far = self.range
        if near >= far:
            raise ValueError(f"d435.range: least depth {near:g} is not below the greatest, {far:g}")


MOUNTINGS = ("fixed", "vectoring")
"""How the fans may be mounted: along base z, or on a gimbal at the centre of mass."""


@dataclass(frozen=True, eq=False)
class GimbalSection:
    """Axis of the vectored thrust: limits both ways [rad], rate [rad/s], lag [s].

    It turns by the pitch about base y, then by the roll about the x axis so turned.
    """

    pitch_limit: Annotated[float, number(0.01, 3.14159)]
    roll_limit: Annotated[float, number(0.01, 1.5)]
    rate: Annotated[float, number(0.1, 100.0)]
    lag: Annotated[float, number(0.0, 1.0)]


MOST_FANS = 8
"""As many speed controllers as ESC_INFO of MAVLink has bits for."""
_LEAST_APART = 0.1
"""Least singular value of what equal thrusts do, each axis of length 1: below, one is lost."""


@dataclass(frozen=True, eq=False)
class RotorSection:
    """One ducted fan: its axis in base [m], its sense of rotation about base z, -1 or 1."""

    x: Annotated[float, number(-1.0, 1.0)]
    y: Annotated[float, number(-1.0, 1.0)]
    spin: Annotated[float, number(-1.0, 1.0)]


@dataclass(frozen=True, eq=False)
class FansSection:
    """Equal ducted fans at height z in base, each at its place, thrust along base z; lengths [m].

    `mounting`, one of `MOUNTINGS`, says whether that is so: "vectoring" is the thesis's force at
    the centre of mass in any direction (T25), which no robot has.

    Flow area [m^2], air density [kg/m^3], and at full throttle on `voltage` [V]: thrust [N], speed
    [rad/s], efficiency [-]. Resistance [ohm], no-load current [A], inertia of the rotor [kg m^2],
    share of the drag torque left on the body [-].
    """

    rotors: Annotated[Mapping[str, RotorSection], named(RotorSection, 4, MOST_FANS)]
    mounting: Annotated[str, choice(*MOUNTINGS)]
    z: Annotated[float, number(-0.5, 0.5)]
    inner_radius: Annotated[float, number(0.005, 0.3)]
    outer_radius: Annotated[float, number(0.005, 0.3)]
    height: Annotated[float, number(0.005, 0.5)]
    flow_area: Annotated[float, number(1e-5, 0.3)]
    air_density: Annotated[float, number(0.3, 1.5)]
    max_thrust: Annotated[float, number(0.5, 200.0)]
    voltage: Annotated[float, number(3.0, 100.0)]
    max_speed: Annotated[float, number(100.0, 20000.0)]
    efficiency: Annotated[float, number(0.05, 0.95)]
    resistance: Annotated[float, number(1e-3, 1.0)]
    no_load_current: Annotated[float, number(0.0, 20.0)]
    rotor_inertia: Annotated[float, number(1e-6, 1e-2)]
    body_torque_share: Annotated[float, number(0.01, 1.0)]

    @cached_property
    def place(self) -> Array:
        """Where the axes stand in base, x and y [m] (n, 2)."""
        return frozen([(rotor.x, rotor.y) for rotor in self.rotors.values()])

    @cached_property
    def spin(self) -> Array:
        """Senses of rotation about base z (n,)."""
        return frozen([rotor.spin for rotor in self.rotors.values()])

    @property
    def reach(self) -> Array:
        """Greatest distances of the axes from base's origin along x and y [m] (2,)."""
        return np.asarray(np.abs(self.place).max(axis=0))

    def check(self) -> None:
        """Refuse numbers that contradict each other.

        Raises:
            ValueError: names the key and what is wrong.
        """
        places = list(map(tuple, self.place.tolist()))
        for name, (x, y) in zip(self.rotors, places, strict=True):
            if (x, -y) not in places:
                raise ValueError(
                    f"fans.rotors.{name}: at ({x:g}, {y:g}) m and none at ({x:g}, {-y:g}): left "
                    "and right must be alike"
                )
        apart = np.linalg.norm(self.place[:, None] - self.place, axis=2)
        if apart[~np.eye(len(places), dtype=bool)].min() < 2.0 * self.outer_radius:
            raise ValueError(f"fans.rotors: at {places} m two of radius fans.outer_radius overlap")
        if np.any(np.abs(self.spin) != 1.0) or abs(self.spin.sum()) > len(places) % 2:
            raise ValueError(
                f"fans.rotors: spin is {self.spin.tolist()}: each is 1 or -1, as many one way as "
                "the other"
            )
        rows = np.column_stack((np.ones(len(places)), self.place, self.spin))
        lengths = np.linalg.norm(rows, axis=0)
        if lengths.min() <= 0.0 or np.linalg.svd(rows / lengths)[1].min() < _LEAST_APART:
            raise ValueError(
                f"fans.rotors: at {places} m with spin {self.spin.tolist()} their thrusts cannot "
                "make roll, pitch and yaw apart from each other"
            )
        if not self.no_load_current < self.full_current < self.voltage / self.resistance:
            raise ValueError(
                f"fans.max_thrust: {self.max_thrust:g} N through fans.flow_area of air of "
                f"fans.air_density takes {self.full_current:.1f} A at fans.efficiency, it must be "
                f"more than fans.no_load_current, {self.no_load_current:g} A, and less than "
                f"fans.voltage / fans.resistance, {self.voltage / self.resistance:.0f} A"
            )

    @property
    def full_current(self) -> float:
        """Current at full throttle on `voltage` [A]: jet power over efficiency and voltage."""
        flow = self.air_density * self.flow_area
        jet_power = self.max_thrust * math.sqrt(self.max_thrust / flow) / 2.0
        return jet_power / (self.efficiency * self.voltage)


@dataclass(frozen=True, eq=False)
class EscSection:
    """Speed controller of a fan: pulses [us], times [s], current [A], cut-off [V], [1/(V s)].

    `telemetry` is 1 when it tells its speed and current.
    """

    pulse_low: Annotated[float, number(800.0, 1500.0)]
    pulse_high: Annotated[float, number(1500.0, 2200.0)]
    pulse_start: Annotated[float, number(800.0, 1500.0)]
    arming_time: Annotated[float, number(0.0, 10.0)]
    pulse_timeout: Annotated[float, number(1e-3, 2.0)]
    throttle_lag: Annotated[float, number(0.0, 2.0)]
    current_limit: Annotated[float, number(1.0, 500.0)]
    cutoff_cell_voltage: Annotated[float, number(0.0, 4.0)]
    cutoff_gain: Annotated[float, number(0.0, 10.0)]
    telemetry: Annotated[int, count(0, 1)]


@dataclass(frozen=True, eq=False)
class BatterySection:
    """Pack: cells in series, capacity [A s], open-circuit voltage of a cell over charge [V].

    That voltage stands at 0, 10, .. 100 % of charge. Resistance of a cell and of the wiring [ohm];
    constant power of everything but the fans [W].
    """

    cells: Annotated[int, count(1, 24)]
    capacity: Annotated[float, number(100.0, 1e6)]
    cell_voltage: Annotated[Array, vector(11, 1.0, 5.0)]
    cell_resistance: Annotated[float, number(1e-5, 0.1)]
    wiring_resistance: Annotated[float, number(0.0, 0.1)]
    idle_power: Annotated[float, number(0.0, 500.0)]
