"""Targets of the feet in the base frame, and the weight that each stance foot carries."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.gait.state import BodyInGround
from husky_description.arrays import Array
from husky_description.kinematics import LEGS, FootTargets, JointTargets
from husky_description.vectors import (
    cross,
    difference,
    dot,
    scaled,
    solve_symmetric,
    transposed_product,
    vector,
    write,
)

Mask = NDArray[np.bool_]


class ReferenceBody(NamedTuple):
    """The body as it should move over its stance feet, in the frame of the ground."""

    rotation: Array  # (3, 3), body to the frame of the ground
    position: Array  # (3,) m
    velocity: Array  # (3,) m/s
    yaw_rate: float  # rad/s


class FeetInGround(NamedTuple):
    """Where the feet stand and swing, centres, in the frame of the ground."""

    swinging: Mask  # (4,)
    anchor: Array  # (4, 3) m, stance feet
    blend: Array  # (4, 3) m in base, step at touchdown that is being taken up
    swing_position: Array  # (4, 3) m
    swing_velocity: Array  # (4, 3) m/s


class Rolling(NamedTuple):
    """What a tick does to a stance foot."""

    foot_radius: float  # m, of the sphere on which it rolls
    blend_decay: float  # factor of the blend
    dt: float  # s


@njit(cache=True)
def foot_targets(
    feet: FeetInGround,
    body: BodyInGround,
    reference: ReferenceBody,
    joints: JointTargets,
    rolling: Rolling,
    targets: FootTargets,
) -> None:
    """Write foot targets: stance feet in the desired attitude, swing feet in the measured one.

    A stance foot keeps its anchor in the world while the reference body moves over it, in the
    desired attitude, so that position-controlled legs push the body upright. A swing foot must
    reach a place in the world, so that its target takes the attitude that the body really has.

    Anchors and blends of stance feet are updated, positions and velocities of `targets` written;
    `joints` are those of the last tick.
    """
    for leg in range(LEGS):
        position, velocity = targets.position[leg], targets.velocity[leg]
        if feet.swinging[leg]:
            way = difference(vector(feet.swing_position[leg]), vector(body.position))
            rate = difference(vector(feet.swing_velocity[leg]), vector(body.velocity))
            place = transposed_product(body.rotation, way)
            write(position, place)
            turning = cross(vector(body.angular_velocity), place)
            write(velocity, difference(transposed_product(body.rotation, rate), turning))
        else:
            roll_x, roll_y = _roll(reference.rotation, joints, leg, rolling.foot_radius)
            anchor, blend = feet.anchor[leg], feet.blend[leg]
            anchor[0] += roll_x * rolling.dt
            anchor[1] += roll_y * rolling.dt
            way = difference(vector(anchor), vector(reference.position))
            rate = (
                roll_x - reference.velocity[0] + reference.yaw_rate * way[1],
                roll_y - reference.velocity[1] - reference.yaw_rate * way[0],
                -reference.velocity[2],
            )
            write(blend, scaled(rolling.blend_decay, vector(blend)))
            place = transposed_product(reference.rotation, way)
            write(position, (place[0] + blend[0], place[1] + blend[1], place[2] + blend[2]))
            write(velocity, transposed_product(reference.rotation, rate))


@njit(cache=True)
def _roll(
    rotation: Array, joints: JointTargets, leg: int, radius: float
) -> tuple[float, float]:
    """Return the velocity along the ground, m/s, at which a stance foot's sphere rolls on."""
    # The shin's angular velocity turns the sphere: its centre moves on by spin x radius.
    pitch_rate = joints.velocity[3 * leg + 1] + joints.velocity[3 * leg + 2]
    frontal = joints.position[3 * leg]
    spin = (
        joints.velocity[3 * leg],
        pitch_rate * math.cos(frontal),
        pitch_rate * math.sin(frontal),
    )
    return radius * dot(vector(rotation[1]), spin), -radius * dot(vector(rotation[0]), spin)


class Load(NamedTuple):
    """What the stance feet carry together, in axes aligned with the ground."""

    force: float  # N, along the normal
    moment_x: float  # N m, about the ground's x
    moment_y: float  # N m, about its y
    most: float  # N, of one foot


@njit(cache=True)
def _arm(rotation: Array, foot: Array, center: Array) -> tuple[float, float]:
    """Return where a foot stands from the centre of mass, m along x and y of the ground."""
    way = difference(vector(foot), vector(center))
    return dot(vector(rotation[0]), way), dot(vector(rotation[1]), way)


@njit(cache=True)
def distribute_weight(
    foot_in_base: Array,
    center: Array,
    share: Array,
    rotation: Array,
    load: Load,
    foot_force: Array,
) -> None:
    """Write normal ground forces of the stance feet that carry the body, least squares.

    Minimises the sum of f_i^2 / share_i under sum f_i = force, and the roll and pitch moments about
    the centre of mass as far as the feet can make them (two feet cannot tilt the body about their
    own line).

    Args:
        foot_in_base: (4, 3) m.
        center: (3,) m, centre of mass in base.
        share: (4,) 0 for a foot in the air to 1 for a foot fully loaded.
        rotation: (3, 3), base to the frame of the ground.
        load: to be carried.
        foot_force: (4, 3) N on the foot, in base, written.
    """
    s00 = s01 = s02 = s11 = s12 = s22 = 0.0
    for leg in range(LEGS):
        x, y = _arm(rotation, foot_in_base[leg], center)
        # moment of an upward force f at (x, y): M_x = y f, M_y = -x f.
        w = share[leg]
        s00 += w
        s01 += w * y
        s02 -= w * x
        s11 += w * y * y
        s12 -= w * x * y
        s22 += w * x * x
    if s00 < 1e-6:
        foot_force[:] = 0.0
        return
    # Lets go of moments that the feet cannot make.
    soft = s00 + 1e-9, s11 + 2e-3 * s00, s22 + 2e-3 * s00
    carried = load.force, load.moment_x, load.moment_y
    level, across, along = solve_symmetric(soft, (s01, s02, s12), carried)
    for leg in range(LEGS):
        x, y = _arm(rotation, foot_in_base[leg], center)
        force = min(load.most, max(0.0, share[leg] * (level + y * across - x * along)))
        write(foot_force[leg], scaled(force, vector(rotation[2])))


@njit(cache=True)
def lean_forces(rotation: Array, slope_x: float, slope_y: float, foot_force: Array) -> None:
    """Give normal foot forces their share of the tangential load: all in one direction.

    Args:
        rotation: (3, 3), base to the frame of the ground.
        slope_x: tangential over normal force along the ground's x.
        slope_y: the same along y.
        foot_force: (4, 3) N on the foot, in base, along the ground's normal; updated.
    """
    for leg in range(LEGS):
        force = dot(vector(rotation[2]), vector(foot_force[leg]))
        for k in range(3):
            foot_force[leg, k] += force * (slope_x * rotation[0, k] + slope_y * rotation[1, k])


@njit(cache=True)
def internal_load(foot_in_base: Array, force: Array, desired: Array, load: Array) -> None:
    """Share of the feet's load errors that neither carries nor turns the body, for four feet.

    Four stiff legs on the ground press against each other: one diagonal may carry all. This is the
    error of the vertical forces without its mean and its slopes along x and y.

    Args:
        foot_in_base: (4, 3) m.
        force: (4, 3) N, measured, in world.
        desired: (4, 3) N, desired, in base (nearly level).
        load: (4,) N, written; positive for a foot that carries too much.
    """
    # With four feet one direction is left: the null space of [1; x; y], by cofactors.
    for i in range(LEGS):
        a, b, c = (i + 1) % LEGS, (i + 2) % LEGS, (i + 3) % LEGS
        area = (foot_in_base[b, 0] - foot_in_base[a, 0]) * (
            foot_in_base[c, 1] - foot_in_base[a, 1]
        ) - (foot_in_base[b, 1] - foot_in_base[a, 1]) * (foot_in_base[c, 0] - foot_in_base[a, 0])
        load[i] = area if i % 2 == 0 else -area
    square = error = 0.0
    for i in range(LEGS):
        square += load[i] * load[i]
        error += load[i] * (force[i, 2] - desired[i, 2])
    scale = error / square if square > 1e-9 else 0.0
    for i in range(LEGS):
        load[i] *= scale
