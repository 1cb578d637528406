"""Force of a compliant ground on a foot: the contact model of the thesis (T27).

Positions and forces are in a frame whose z axis is the ground's outward normal: the world on level
ground, or a slope's. Every function serves NumPy and CasADi (`array_namespace`). Sets of numbers:
`husky_description.ground.GROUND_PRESETS`.
"""

from __future__ import annotations

from typing import Any

from husky_control.planning.array_namespace import checked_vector, namespace_of
from husky_control.planning.reduced_order import f_rom, foot_positions, foot_velocities
from husky_control.planning.rom_parameters import RomParameters
from husky_description.ground import GroundModel
from husky_description.kinematics import LEGS


def friction_coefficient(speed: Any, ground: GroundModel) -> Any:
    """Return s_j = mu_c - (mu_c - mu_s) exp(-v_j^2 / v_s^2) at a sliding speed v_j in m/s (T27)."""
    xp = namespace_of(speed)
    coulomb, static = ground.friction_coulomb, ground.friction_static
    ratio = speed / ground.stribeck_velocity
    return coulomb - (coulomb - static) * xp.exp(-ratio * ratio)


def ground_force(position: Any, velocity: Any, ground: GroundModel) -> Any:
    """Return the force on a foot, T27 as printed.

    Zero for z > 0, else u_z = -k1 z - k2 z', u_j = -s_j u_z sgn(v_j) - mu_v v_j for j = x, y. It is
    not smooth: it jumps with the damper at touchdown, and a resting foot has no friction. It pulls
    at a foot that leaves faster than k1 |z| / k2. Friction acts along x and y apart, so a diagonal
    slide meets up to sqrt(2) times as much.

    Args:
        position: (3) m, of the point of contact over the ground's plane.
        velocity: (3) m/s.
        ground: its numbers.

    Returns:
        (3) N on the foot.

    Raises:
        ValueError: an argument has another shape.
    """
    p, v = checked_vector("position", position, 3), checked_vector("velocity", velocity, 3)
    xp = namespace_of(p, v)
    normal = -ground.stiffness * p[2] - ground.damping * v[2]
    force = _with_friction(normal, v, ground, [xp.sign(v[0]), xp.sign(v[1])], 1.0)
    return xp.vector([xp.where(p[2] > 0.0, 0.0, component) for component in force])


def smooth_ground_force(position: Any, velocity: Any, ground: GroundModel) -> Any:
    """Return the force on a foot in a form that is continuous and never pulls.

    Three changes to `ground_force`, after the smooth spring-damper and stick-slip laws that the
    thesis names for its high-fidelity model: the force is taken up over `transition_width` of depth
    by the cubic 3 t^2 - 2 t^3; a pulling normal force is cut to zero; sgn(v) is tanh(v / v_s), so
    that a foot at rest can be held, at the price of creeping at less than v_s.

    Arguments and result as those of `ground_force`.
    """
    p, v = checked_vector("position", position, 3), checked_vector("velocity", velocity, 3)
    xp = namespace_of(p, v)
    depth = xp.maximum(0.0, -p[2]) / ground.transition_width
    share = xp.where(depth < 1.0, depth * depth * (3.0 - 2.0 * depth), 1.0)
    normal = share * xp.maximum(0.0, -ground.stiffness * p[2] - ground.damping * v[2])
    direction = [xp.tanh(v[j] / ground.stribeck_velocity) for j in range(2)]
    return xp.vector(_with_friction(normal, v, ground, direction, share))


def _with_friction(
    normal: Any, velocity: Any, ground: GroundModel, direction: list[Any], share: Any
) -> list[Any]:
    """Components of the force; the share scales viscous friction, which knows no normal force."""
    tangential = [
        -friction_coefficient(velocity[j], ground) * normal * direction[j]
        - share * ground.friction_viscous * velocity[j]
        for j in range(2)
    ]
    return [*tangential, normal]


def ground_forces(
    x: Any,
    parameters: RomParameters,
    ground: GroundModel,
    *,
    height: float = 0.0,
    smooth: bool = False,
) -> Any:
    """Return u_g (12) N, what a compliant ground does to the feet of the reduced-order model.

    Args:
        x: state of T26 (42).
        parameters: of the model.
        ground: its numbers.
        height: m, of the plane in which the model's feet, the centres of the robot's, touch down:
            the foot's radius over the ground.
        smooth: `smooth_ground_force` instead of T27 as printed.
    """
    law = smooth_ground_force if smooth else ground_force
    xp = namespace_of(x)
    plane = xp.vector([0.0, 0.0, height])
    position, velocity = foot_positions(x, parameters), foot_velocities(x, parameters)
    return xp.concatenate(
        [law(position[leg, :].T - plane, velocity[leg, :].T, ground) for leg in range(LEGS)]
    )


def f_rom_on_ground(
    x: Any,
    u_L: Any,
    u_T: Any,
    parameters: RomParameters,
    ground: GroundModel,
    *,
    height: float = 0.0,
    smooth: bool = False,
) -> Any:
    """Return x' (42) of the model on a compliant ground: f_ROM with u_g of `ground_forces`.

    Arguments as those of `reduced_order.f_rom` and `ground_forces`.
    """
    u_g = ground_forces(x, parameters, ground, height=height, smooth=smooth)
    return f_rom(x, u_L, u_g, u_T, parameters)
