"""Targets of the feet in the base frame, and the weight that each stance foot carries."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.kinematics import LEGS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@njit(cache=True)
def foot_targets(
    swinging: Mask,
    rotation: Array,
    rotation_desired: Array,
    position: Array,
    velocity: Array,
    angular_velocity: Array,
    reference_position: Array,
    reference_velocity: Array,
    yaw_rate: float,
    foot_radius: float,
    joint_position: Array,
    joint_velocity: Array,
    dt: float,
    anchor: Array,
    swing_position: Array,
    swing_velocity: Array,
    blend: Array,
    blend_decay: float,
    target: Array,
    target_velocity: Array,
) -> None:
    """Foot targets in base: stance feet in the desired attitude, swing feet in the measured one.

    A stance foot keeps its anchor in the world while the reference body moves over it, in the
    desired attitude, so that position-controlled legs push the body upright. A swing foot must
    reach a place in the world, so that its target takes the attitude that the body really has.

    Args:
        swinging: (4,) bool.
        rotation: (3, 3), base to world, measured.
        rotation_desired: (3, 3), base to world, desired.
        position: (3,) m, base in world, estimated.
        velocity: (3,) m/s, base in world, estimated.
        angular_velocity: (3,) rad/s in base, measured.
        reference_position: (3,) m, reference body in world.
        reference_velocity: (3,) m/s, reference body in world.
        yaw_rate: rad/s, of the reference body.
        foot_radius: m; a stance foot rolls on its sphere.
        joint_position: (12,) rad, targets of the last tick.
        joint_velocity: (12,) rad/s, targets of the last tick.
        dt: s.
        anchor: (4, 3) m, stance foot centres in the reference body's world, updated.
        swing_position: (4, 3) m in world.
        swing_velocity: (4, 3) m/s in world.
        blend: (4, 3) m in base, step at touchdown that is being taken up, updated.
        blend_decay: factor of blend per tick.
        target: (4, 3) m in base, written.
        target_velocity: (4, 3) m/s relative to the base, in base, written.
    """
    w = angular_velocity
    for leg in range(LEGS):
        if swinging[leg]:
            d0 = swing_position[leg, 0] - position[0]
            d1 = swing_position[leg, 1] - position[1]
            d2 = swing_position[leg, 2] - position[2]
            v0 = swing_velocity[leg, 0] - velocity[0]
            v1 = swing_velocity[leg, 1] - velocity[1]
            v2 = swing_velocity[leg, 2] - velocity[2]
            for i in range(3):
                target[leg, i] = (
                    rotation[0, i] * d0 + rotation[1, i] * d1 + rotation[2, i] * d2
                )
                target_velocity[leg, i] = (
                    rotation[0, i] * v0 + rotation[1, i] * v1 + rotation[2, i] * v2
                )
            t0, t1, t2 = target[leg, 0], target[leg, 1], target[leg, 2]
            target_velocity[leg, 0] -= w[1] * t2 - w[2] * t1
            target_velocity[leg, 1] -= w[2] * t0 - w[0] * t2
            target_velocity[leg, 2] -= w[0] * t1 - w[1] * t0
        else:
            # The shin's angular velocity turns the sphere: its centre moves on by spin x radius.
            frontal_rate = joint_velocity[3 * leg]
            pitch_rate = joint_velocity[3 * leg + 1] + joint_velocity[3 * leg + 2]
            sy = pitch_rate * math.cos(joint_position[3 * leg])
            sz = pitch_rate * math.sin(joint_position[3 * leg])
            r = rotation_desired
            roll0 = foot_radius * (r[1, 0] * frontal_rate + r[1, 1] * sy + r[1, 2] * sz)
            roll1 = -foot_radius * (r[0, 0] * frontal_rate + r[0, 1] * sy + r[0, 2] * sz)
            anchor[leg, 0] += roll0 * dt
            anchor[leg, 1] += roll1 * dt
            d0 = anchor[leg, 0] - reference_position[0]
            d1 = anchor[leg, 1] - reference_position[1]
            d2 = anchor[leg, 2] - reference_position[2]
            v0 = roll0 - reference_velocity[0] + yaw_rate * d1
            v1 = roll1 - reference_velocity[1] - yaw_rate * d0
            v2 = -reference_velocity[2]
            for i in range(3):
                r0, r1, r2 = rotation_desired[0, i], rotation_desired[1, i], rotation_desired[2, i]
                blend[leg, i] *= blend_decay
                target[leg, i] = r0 * d0 + r1 * d1 + r2 * d2 + blend[leg, i]
                target_velocity[leg, i] = r0 * v0 + r1 * v1 + r2 * v2


@njit(cache=True)
def distribute_weight(
    foot_in_base: Array,
    center: Array,
    share: Array,
    rotation: Array,
    force: float,
    moment_x: float,
    moment_y: float,
    most: float,
    foot_force: Array,
) -> None:
    """Vertical ground forces of the stance feet that carry the body, least squares.

    Minimises the sum of f_i^2 / share_i under sum f_i = force, and the roll and pitch moments about
    the centre of mass as far as the feet can make them (two feet cannot tilt the body about their
    own line).

    Args:
        foot_in_base: (4, 3) m.
        center: (3,) m, centre of mass in base.
        share: (4,) 0 for a foot in the air to 1 for a foot fully loaded.
        rotation: (3, 3), base to world.
        force: N, upward.
        moment_x: N m about the world's x axis.
        moment_y: N m, the same about y.
        most: N, of one foot.
        foot_force: (4, 3) N on the foot, in base, written.
    """
    # Feet relative to the centre of mass in axes that are aligned with the world.
    s00 = s01 = s02 = s11 = s12 = s22 = 0.0
    for leg in range(LEGS):
        x = y = 0.0
        for k in range(3):
            x += rotation[0, k] * (foot_in_base[leg, k] - center[k])
            y += rotation[1, k] * (foot_in_base[leg, k] - center[k])
        # moment of an upward force f at (x, y): M_x = y f, M_y = -x f.
        w = share[leg]
        s00 += w
        s01 += w * y
        s02 -= w * x
        s11 += w * y * y
        s12 -= w * x * y
        s22 += w * x * x
        foot_force[leg, 0], foot_force[leg, 1] = x, y
    total = s00
    if total < 1e-6:
        foot_force[:] = 0.0
        return
    # Lets go of moments that the feet cannot make.
    s00 += 1e-9
    s11 += 2e-3 * total
    s22 += 2e-3 * total
    c00, c01, c02 = s11 * s22 - s12 * s12, s02 * s12 - s01 * s22, s01 * s12 - s02 * s11
    c11, c12, c22 = s00 * s22 - s02 * s02, s01 * s02 - s00 * s12, s00 * s11 - s01 * s01
    determinant = s00 * c00 + s01 * c01 + s02 * c02
    y0 = (c00 * force + c01 * moment_x + c02 * moment_y) / determinant
    y1 = (c01 * force + c11 * moment_x + c12 * moment_y) / determinant
    y2 = (c02 * force + c12 * moment_x + c22 * moment_y) / determinant
    for leg in range(LEGS):
        x, y = foot_force[leg, 0], foot_force[leg, 1]
        f = share[leg] * (y0 + y * y1 - x * y2)
        f = min(most, max(0.0, f))
        for k in range(3):
            foot_force[leg, k] = rotation[2, k] * f


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
        f = 0.0
        for k in range(3):
            f += rotation[2, k] * foot_force[leg, k]
        for k in range(3):
            foot_force[leg, k] += f * (slope_x * rotation[0, k] + slope_y * rotation[1, k])


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
