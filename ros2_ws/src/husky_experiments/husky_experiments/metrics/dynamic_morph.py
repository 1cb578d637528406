"""What a recording says of a robot some of whose legs are arms while the others stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_experiments.metrics import measures
from husky_experiments.metrics.morph import center_of_mass
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Mask

SPLAYED = 0.20
"""Height of a foot above which its leg counts as an arm [m]."""


@dataclass(frozen=True, eq=False)
class Balancing:
    """One morph of some legs, there and back, over time (n rows).

    Attributes:
        time: [s] (n,).
        foot: height of each foot's centre [m] (n, 4).
        inside: true centre of mass inside of the line of the two feet beside the first leg [m].
        tilt: of the body [rad] (n,).
        yaw: from the start [rad] (n,).
        thrust: of each propeller [N] (n, 4).
        hip: measured angles of the hip frontal joints [rad] (n, 4).
    """

    time: Array
    foot: Array
    inside: Array
    tilt: Array
    yaw: Array
    thrust: Array
    hip: Array

    def arms(self, legs: tuple[int, ...]) -> float:
        """Return for how long all these legs were arms [s]."""
        held: Mask = self.foot[:, list(legs)].min(axis=1) > SPLAYED
        return float(held[:-1] @ np.diff(self.time))

    def rate(self, leg: int) -> float:
        """Return how fast a leg becomes an arm: mean of the middle four fifths [rad/s]."""
        turned = np.abs(self.hip[:, leg] - self.hip[0, leg])
        begin, end = (self.time[np.argmax(turned > part * turned.max())] for part in (0.1, 0.9))
        return float(0.8 * turned.max() / (end - begin))


def balancing(
    recording: Recording, robot: Robot, legs: tuple[int, ...], start: float, end: float
) -> Balancing:
    """Return what happened between two times [s] to a robot whose legs `legs` became arms."""
    base, contacts, fans = recording.base.between(start, end), recording.contacts, recording.fans
    joints, time = recording.joints, base.time
    first = legs[0]
    feet = contacts.position[measures.nearest(contacts.time, time)]
    joint_position = joints.position[measures.nearest(joints.time, time)]
    centers = base.position + Rotation.from_quat(base.orientation).apply(
        center_of_mass(robot, joint_position)
    )
    begin, across = feet[:, first ^ 1, :2], feet[:, first ^ 2, :2] - feet[:, first ^ 1, :2]
    normal = np.column_stack((-across[:, 1], across[:, 0]))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    turns = Rotation.from_quat(base.orientation)
    hip = (base.position + turns.apply(np.array(robot.hip_position[first])))[:, :2] - begin
    normal *= -np.sign(np.einsum("ni,ni->n", normal, hip))[:, None]  # away from the first leg
    inside = np.einsum("ni,ni->n", normal, centers[:, :2] - begin)
    yaw = base.rpy[:, 2]
    return Balancing(
        time,
        feet[:, :, 2],
        inside,
        measures.tilt(base.orientation),
        yaw - yaw[0],
        fans.thrust[measures.nearest(fans.time, time)],
        joint_position[:, 0::3],
    )
