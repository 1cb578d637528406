"""The simulated Pixhawk without a wire and without ROS: sensors and bytes in, pulses and bytes out.

Each tick of 2 ms: measure, estimate, decide, control, mix, tell.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from husky_description.gimbal import Gimbal, into_unit
from husky_description.gravity import GRAVITY
from husky_description.rotation import Vector, tilt_of
from husky_pu.autopilot.attitude_control import ControlGains
from husky_pu.autopilot.attitude_estimator import (
    AttitudeEstimator,
    EstimatorWeights,
)
from husky_pu.autopilot.battery import BatteryMonitor
from husky_pu.autopilot.component_metadata import component_files
from husky_pu.autopilot.fan_watch import FanWatch
from husky_pu.autopilot.flight import FlightLogic
from husky_pu.autopilot.flight_parameters import FlightParameters
from husky_pu.autopilot.imu import AutopilotImu, ImuErrors, SensorSample
from husky_pu.autopilot.mavlink_server import MavlinkServer
from husky_pu.autopilot.rc import StickInput
from husky_pu.autopilot.rotor_thrust import RotorThrust
from husky_pu.autopilot.setpoints import SetpointStream
from husky_pu.autopilot.state import Motion
from husky_pu.autopilot.telemetry import Vehicle

PERIOD = 0.002
"""Of a tick [s]."""
_LONGEST_STEP = 0.01
"""Longest time that filters and integrals step at once [s]."""
_GYRO_RANGE, _ACCEL_RANGE, _MAG_RANGE = 40.0, 200.0, 20.0
"""Beyond, a number cannot be true [rad/s, m/s^2, gauss]; the sensors end at 35, 157 and 2."""
_LEAST_FIELD = 0.05
"""Weakest field that is one [gauss]."""
_REST_RATE, _REST_TIME = 0.03, 1.0
"""Slower for so long without thrust is at rest, see `AttitudeEstimator` [rad/s, s]."""
_VOLTAGE_TIME = 0.05
"""Time constant of the voltage that the mixer reckons with [s]."""
_LEAST_VOLTAGE = 5.0
"""Below it the mixer reckons with the nominal voltage [V]."""
_RATE_BANDWIDTH = (10.0, 10.0, 4.0)
"""Crossover of the rate loops that default gains aim at [rad/s]; the fans' lag is 0.08 s."""


@dataclass(frozen=True)
class AutopilotConfig:
    """What differs between vehicles and runs.

    Attributes:
        inertia: about roll, pitch and yaw of all that flies together [kg m^2]; the default
            parameters of the rate loops follow from it.
        errors: of the sensors.
        seed: of those errors.
        parameters: defaults that differ from the table's.
        kept: parameters that were set by hand before this process, see `FlightParameters`.
        overrides: parameters that hold in this process, see the same.
        signing_key: 32 bytes, empty for no signing.
        lockstep: see `husky_pu.autopilot.mavlink_server`.
        gimbal: turns the thrust's axis; None for fans that are fixed.
    """

    inertia: Vector = (0.03, 0.03, 0.05)
    errors: ImuErrors = field(default_factory=ImuErrors)
    seed: int = 0
    parameters: Mapping[str, float] = field(default_factory=dict)
    kept: Mapping[str, float] = field(default_factory=dict)
    overrides: Mapping[str, float] = field(default_factory=dict)
    signing_key: bytes = b""
    lockstep: bool = False
    gimbal: Gimbal | None = None


def rate_gains(inertia: Sequence[float], moment_scale: Sequence[float]) -> dict[str, float]:
    """Return default parameters of the rate loops.

    With the derivative D = J the fans' lag acts as if halved on twice the inertia, and
    P = 2 J w, I = P w / 10 cross over at w (yaw: D = 0, P = J w).

    Args:
        inertia: (3,) [kg m^2].
        moment_scale: (3,) that a full moment share means [N m].
    """
    gains: dict[str, float] = {}
    names = ("MC_ROLLRATE", "MC_PITCHRATE", "MC_YAWRATE")
    for name, j, scale, w in zip(names, inertia, moment_scale, _RATE_BANDWIDTH, strict=True):
        lead = name != "MC_YAWRATE"
        share = float(j / scale)
        gains[f"{name}_P"] = min((2.0 if lead else 1.0) * w * share, 5.0)
        gains[f"{name}_I"] = min(gains[f"{name}_P"] * w / 10.0, 10.0)
        gains[f"{name}_D"] = min(share, 1.0) if lead else 0.0
    return gains


class Autopilot:
    """The flight controller.

    Attributes:
        mixer: of the rotors.
        parameters: of the flight controller; they outlast a restart.
        vehicle: everything it knows.
        server: its side of MAVLink.
    """

    def __init__(
        self,
        mixer: RotorThrust,
        config: AutopilotConfig | None = None,
        unix_time: Callable[[], float] = time.time,
    ):
        """Power it on.

        Args:
            mixer: of the rotors.
            config: see `AutopilotConfig`.
            unix_time: stamps signatures, and is told as the time of boot [s since 1970];
                nothing else.

        Raises:
            ParameterError: a parameter of the configuration is unknown or out of range.
        """
        self.config = config if config is not None else AutopilotConfig()
        self.mixer = mixer
        self._inverse: list[list[float]] = np.linalg.pinv(mixer.effectiveness).tolist()
        self._unknown = (math.nan,) * len(mixer.names)
        self._scale = [float(scale) for scale in mixer.moment_scale]
        self.parameters = FlightParameters(
            {**rate_gains(self.config.inertia, self._scale), **self.config.parameters},
            self.config.kept,
            self.config.overrides,
        )
        self._files = component_files(self.parameters.defaults)
        self._unix_time = unix_time
        self.vehicle = self._power_on()
        self.server = MavlinkServer(
            self.vehicle,
            lockstep=self.config.lockstep,
            signing_key=self.config.signing_key,
            unix_time=unix_time,
        )

    def _power_on(self) -> Vehicle:
        p = self.parameters
        self._imu = AutopilotImu(self.config.errors, self.config.seed)
        stream, input_, battery = SetpointStream(), StickInput(p), BatteryMonitor(p)
        self._motion = Motion()
        self._last_ns = -1
        self._bad_for = 0.0
        self._moved_at = 0.0
        self._turned_at = 0.0
        self._voltage = 0.0
        self._read_changes = -1
        self._watch = FanWatch(self.mixer.fan, len(self.mixer.names))
        self._told = [0.0] * len(self.mixer.names)
        nowhere: Vector = (0.0, 0.0, 0.0)
        return Vehicle(
            p,
            stream,
            input_,
            battery,
            AttitudeEstimator(),
            FlightLogic(p, stream, input_, battery, self.mixer.names, self.config.gimbal),
            SensorSample(
                0, nowhere, nowhere, nowhere, 0.0, 0.0, 0.0, self._unknown, self._unknown
            ),
            files=self._files,
        )

    def restart(self) -> None:
        """Start anew, disarmed, at any time; parameters and links stay."""
        self.vehicle = self._power_on()
        self.server.restart(self.vehicle)

    # Bytes --------------------------------------------------------------------------------------
    def receive(self, data: bytes, link: Hashable) -> None:
        """Take any bytes from a link; they act at once, or in lockstep when their time comes."""
        self.server.receive(data, link)

    def take_output(self, link: Hashable) -> bytes:
        """Return the bytes to put on a link since the last call."""
        return self.server.links.take_output(link)

    def receive_rc(
        self, pulses: Sequence[float], *, failsafe: bool = False, lost: bool = False
    ) -> None:
        """Take a frame of the radio receiver.

        Args:
            pulses: widths of 16 channels [us].
            failsafe: the receiver has lost the transmitter.
            lost: the receiver has missed this frame.
        """
        now = 1e-9 * self.vehicle.time_ns
        self.vehicle.input.radio(pulses, now, failsafe=failsafe, lost=lost)

    # The tick -----------------------------------------------------------------------------------
    def tick(self, sensors: SensorSample) -> tuple[int, ...]:
        """Answer true sensor values with pulses to the fans, ordered as the mixer's names [us].

        Args:
            sensors: later than the last; what is not finite counts as a sensor that is lost, and
                fans that it says nothing of as fans without telemetry.
        """
        if not sensors.fan_speed:
            sensors = sensors._replace(fan_speed=self._unknown, fan_current=self._unknown)
        vehicle = self.vehicle
        if self._last_ns < 0:
            vehicle.boot_unix = self._unix_time() - 1e-9 * sensors.time_ns
        step = 1e-9 * (sensors.time_ns - self._last_ns) if self._last_ns >= 0 else PERIOD
        self._last_ns = vehicle.time_ns = sensors.time_ns
        dt = max(1e-4, min(_LONGEST_STEP, step))
        now = 1e-9 * sensors.time_ns
        self._read_parameters()
        self.server.release()
        self._measure(sensors, now, step, dt)
        self._watch_fans(sensors, dt)
        vehicle.logic.decide(now, dt, self._motion, self._gains)
        vehicle.pwm = self._mix()
        if self.config.gimbal is not None:
            vehicle.tilt = self.config.gimbal.pulses(vehicle.logic.tilt)
        self.server.send_due()
        return vehicle.pwm

    def _measure(self, true: SensorSample, now: float, step: float, dt: float) -> None:
        """Measure, judge the measurement, estimate."""
        vehicle, motion = self.vehicle, self._motion
        sample = self._imu.measure(true)
        gx, gy, gz = gyro = sample.angular_velocity
        ax, ay, az = accel = sample.specific_force
        hx, hy, hz = mag = sample.magnetic_field
        # Comparisons with what is not a number are false.
        good = abs(gx) + abs(gy) + abs(gz) < 3 * _GYRO_RANGE
        good = good and abs(ax) + abs(ay) + abs(az) < 3 * _ACCEL_RANGE
        compass = _LEAST_FIELD < math.sqrt(hx * hx + hy * hy + hz * hz) < _MAG_RANGE
        vehicle.battery.update(sample.battery_voltage, sample.battery_current, dt)
        share = dt / (dt + _VOLTAGE_TIME) if self._voltage else 1.0
        self._voltage += share * (vehicle.battery.voltage - self._voltage)
        loss_time = self.parameters["HKY_GYR_LOSS"]
        gap = step > loss_time
        self._bad_for = 0.0 if good and not gap else self._bad_for + step
        motion.sensors_ok, motion.compass_ok = good, compass
        motion.sensors_lost = self._bad_for > loss_time
        if not good:
            self._moved_at = self._turned_at = now
            motion.still_for = 0.0
            return
        vehicle.sensors = sample if math.isfinite(sample.pressure) else sample._replace(pressure=0)
        estimator = vehicle.estimator
        bx, by, bz = estimator.gyro_bias
        rate = max(abs(gx - bx), abs(gy - by), abs(gz - bz))
        if rate > _REST_RATE or abs(math.sqrt(ax * ax + ay * ay + az * az) - GRAVITY) > 1.0:
            self._turned_at = now
        if rate > self.parameters["HKY_ARM_GYR"]:
            self._moved_at = now
        flying = vehicle.logic.thrust > self.parameters["HKY_INT_THR"]
        at_rest = not flying and now - self._turned_at > _REST_TIME
        field_ = mag if compass else (0.0, 0.0, 0.0)
        estimator.update(gyro, accel, field_, dt, at_rest=at_rest)
        motion.attitude, motion.rates = estimator.attitude, estimator.rates
        motion.aligned = estimator.aligned
        motion.still_for = now - self._moved_at
        motion.tilt = tilt_of(estimator.attitude)
        if self.parameters["MPC_LAND_SPEED"] > 0.0 and motion.aligned:
            motion.speed.update(estimator.attitude, accel, sample.pressure, dt)

    def _watch_fans(self, sensors: SensorSample, dt: float) -> None:
        """Compare what the speed controllers tell with what they were told."""
        p, logic = self.parameters, self.vehicle.logic
        if not logic.armed or not p["FD_ACT_EN"]:
            self._watch.reset()
            return
        for fan in self._watch.update(
            self._told,
            sensors.fan_speed,
            sensors.fan_current,
            self._voltage,
            dt,
            least=p["FD_ACT_MOT_THR"] * self.mixer.max_thrust,
            patience=1e-3 * p["FD_ACT_MOT_TOUT"],
        ):
            logic.lose_fan(fan)

    def _mix(self) -> tuple[int, ...]:
        """Return the pulses for what the flight logic wants."""
        logic = self.vehicle.logic
        if not logic.armed:
            self._told = [0.0] * len(self._told)
            return (int(self.parameters["PWM_MAIN_DISARM"]),) * len(self._told)
        roll, pitch, yaw = logic.moments
        sx, sy, sz = self._scale
        voltage = self._voltage if self._voltage > _LEAST_VOLTAGE else None
        collective = logic.thrust * self.mixer.max_collective
        moment = (roll * sx, -pitch * sy, -yaw * sz)  # FRD to FLU
        if self.config.gimbal is not None:
            moment = into_unit(logic.tilt, moment)
        x, y, z = moment
        left = logic.fans_ok if self.parameters["CA_FAILURE_MODE"] else [True] * len(self._told)
        thrusts: Any = [f * collective + g * x + h * y + i * z for f, g, h, i in self._inverse]
        if min(thrusts) < 0.0 or max(thrusts) > self.mixer.thrust_limit(voltage) or not all(left):
            # Something has to give way.
            rise = math.inf if logic.may_rise else 0.0
            thrusts = self.mixer.allocate(collective, moment, voltage, left, rise=rise)
        self._told[:] = thrusts
        return tuple(self.mixer.pulses(thrusts, voltage).tolist())

    def _read_parameters(self) -> None:
        """Read what control uses, once after each change."""
        p = self.parameters
        if p.changes == self._read_changes:
            return
        self._read_changes = p.changes

        def three(*names: str) -> Vector:
            x, y, z = (float(p[name]) for name in names)
            return (x, y, z)

        def axes(suffix: str) -> Vector:
            return three(*(f"MC_{axis}RATE_{suffix}" for axis in ("ROLL", "PITCH", "YAW")))

        roll, pitch, yaw = (math.radians(limit) for limit in axes("MAX"))
        self._gains = ControlGains(
            attitude=three("MC_ROLL_P", "MC_PITCH_P", "MC_YAW_P"),
            yaw_weight=p["MC_YAW_WEIGHT"],
            rate_limit=(roll, pitch, yaw),
            proportional=axes("P"),
            integral=axes("I"),
            derivative=axes("D"),
            integral_limit=three("MC_RR_INT_LIM", "MC_PR_INT_LIM", "MC_YR_INT_LIM"),
            cutoff=p["IMU_DGYRO_CUTOFF"],
        )
        self.vehicle.estimator.weights = EstimatorWeights(
            accel=p["ATT_W_ACC"],
            mag=p["ATT_W_MAG"],
            gyro_bias=p["ATT_W_GYRO_BIAS"],
            bias_limit=p["ATT_BIAS_MAX"],
            declination=math.radians(p["ATT_MAG_DECL"]),
        )
