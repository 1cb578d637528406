"""The body in one tick: what is measured of it, and what is estimated from that."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from husky_control.estimation.contact import ContactObserver, ContactThresholds, LegLoads
from husky_control.estimation.estimator import Estimator, EstimatorNoise, LegOdometry
from husky_control.gait.stance import Load, distribute_weight
from husky_control.tick_data import TICK, Measurements
from husky_description.arrays import Array
from husky_description.kinematics import LEGS, forward_kinematics, leg_geometry

if TYPE_CHECKING:
    from husky_control.gait.table import GaitClock
    from husky_control.parameters import Parameters
    from husky_description.robot import Robot


TRUST_TIME = 0.02
"""Time in which an unloaded stance foot loses the estimator's trust [s]."""


class SensedBody:
    """Measured and estimated state of the body and its feet.

    Attributes:
        measurements: the last good ones.
        measured: whether there were any.
        rotation_on_ground: (3, 3), base to the frame of the ground: world, or a plane in it.
        foot_in_base: (4, 3) m, measured.
        contacts: of the feet, from the drives' currents.
        estimator: position and velocity of the base, places of the feet.
    """

    def __init__(self, robot: Robot, parameters: Parameters) -> None:
        """Nothing measured; parameters are live."""
        self.measurements = Measurements()
        self.measured = False
        self.rotation_on_ground = np.eye(3)
        self.foot_in_base = np.zeros((LEGS, 3))
        self.contacts = ContactObserver(robot)
        self.estimator = Estimator(robot)
        self._incoming = Measurements()
        self._parameters = parameters
        self._geometry = leg_geometry(robot)
        self._height_on_perch = float(robot.sit_height + robot.foot_radius)
        self._jacobian = np.zeros((LEGS, 3, 3))
        self._foot_force = np.zeros((LEGS, 3))
        self._trust = np.ones(LEGS)
        self._lightness = 1.0
        self._revision = -1
        self.refresh_parameters()

    def refresh_parameters(self) -> None:
        """Take over live parameters that the kernels get as tuples."""
        p = self._parameters
        if p.revision == self._revision:
            return
        self._revision = p.revision
        self._noise = EstimatorNoise(
            p["estimator.acceleration"],
            p["estimator.foot_drift"],
            p["estimator.foot_position"],
            p["estimator.foot_velocity"],
            p["estimator.ground_height"],
            p["estimator.innovation_gate"],
        )
        self.set_lightness(self._lightness)

    def set_lightness(self, share: float) -> None:
        """Let the thresholds of contact shrink with the share of the weight on the feet."""
        p, self._lightness = self._parameters, share
        touchdown = p["contact.touchdown_force"]
        standing = p.get("contact.standing_force", touchdown)
        self._thresholds = ContactThresholds(
            share * touchdown,
            share * p["contact.early_force"],
            share * standing,
            share * p["contact.liftoff_force"],
        )

    @property
    def rotation(self) -> Array:
        """Attitude, base to world (3, 3), measured."""
        return self.measurements.rotation_base_in_world

    def accept(self, measurements: Measurements) -> bool:
        """Take over what a tick measures; return False, and keep the last, if it is not finite."""
        # Copies: the kernels are compiled for these arrays, and the last good ones are kept.
        m = self._incoming
        m.copy_from(measurements)
        if not m.finite:
            return False
        self._incoming, self.measurements = self.measurements, m
        self.measured = True
        forward_kinematics(self._geometry, m.joint_position, self.foot_in_base, self._jacobian)
        return True

    def turn_ground(self, plane: Array) -> None:
        """Express the attitude in the frame of the ground.

        Args:
            plane: (3, 3), world to that frame.
        """
        np.matmul(plane, self.rotation, out=self.rotation_on_ground)

    def feel_contacts(self, swing_progress: Array) -> None:
        """Observe which feet touch the ground, each by its progress (4,) in its swing."""
        m = self.measurements
        loads = LegLoads(
            m.joint_velocity,
            m.joint_torque,
            self._jacobian,
            self.rotation_on_ground,
            swing_progress,
        )
        self.contacts.update(loads, self._thresholds, TICK)

    def estimate_from_feet(self, clock: GaitClock, normal: Array, *, all_stand: bool) -> None:
        """Estimate position and velocity by the feet that stand.

        Args:
            clock: tells which legs stand by the gait.
            normal: (3,) of the ground, in world.
            all_stand: unloaded feet as well: the body may lie on the ground.
        """
        m, contact, trust = self.measurements, self.contacts.contact, self._trust
        decay = TICK / TRUST_TIME
        for leg in range(LEGS):
            if all_stand or (contact[leg] and not clock.swinging[leg]):
                trust[leg] = 1.0
            elif clock.swinging[leg]:
                trust[leg] = 0.0
            else:
                trust[leg] = max(0.0, trust[leg] - decay)
        self.estimator.normal[:] = normal
        measured = LegOdometry(
            self.rotation,
            m.angular_velocity_base_in_base,
            m.specific_force_base,
            self.foot_in_base,
            self._jacobian,
            m.joint_position,
            m.joint_velocity,
            trust,
        )
        self.estimator.update(measured, self._noise, TICK)

    def estimate_at_rest(self) -> None:
        """Begin the filter again, but where it was: the odometry frame has no jumps (REP-105)."""
        estimator = self.estimator
        x, y, _ = estimator.position.tolist()
        estimator.reset(self.foot_in_base, self.rotation)
        estimator.position[:2] = x, y
        estimator.foot_in_world[:, :2] += x, y

    def stay(self) -> None:
        """Hold the estimate where it is, at rest: the body lies on something that does not move."""
        self.place(tuple(self.estimator.position.tolist()), (0.0, 0.0, 0.0))

    def place(self, position: tuple[float, ...], velocity: tuple[float, ...]) -> None:
        """Set position [m] and velocity [m/s] of the base in world, as something else knows it."""
        estimator = self.estimator
        estimator.reset(self.foot_in_base, self.rotation)
        estimator.foot_in_world += np.subtract(position, estimator.position)
        estimator.position[:] = position
        estimator.velocity[:] = velocity

    def rest_on_perch(self) -> None:
        """Know that the perch lies on the ground: feet will find that at its height."""
        estimator = self.estimator
        estimator.ground_height = float(estimator.position[2]) - self._height_on_perch

    def stand_on_level(self) -> None:
        """Know that the ground under the feet is level: they will find it at this height."""
        estimator = self.estimator
        height = float(estimator.foot_in_world[:, 2].mean())
        estimator.ground_height = height - estimator.foot_radius

    def carry(self, weight: float, joint_torque: Array) -> None:
        """Write the torques (12,) [N m] by which four standing feet carry a weight [N]."""
        distribute_weight(
            self.foot_in_base,
            np.zeros(3),
            np.ones(LEGS),
            self.rotation,
            Load(weight, 0.0, 0.0, weight),
            self._foot_force,
        )
        for leg in range(LEGS):
            joint_torque[3 * leg : 3 * leg + 3] = -(self._jacobian[leg].T @ self._foot_force[leg])
