"""Numbers of the reduced-order model: the robot as it stands, taken for one rigid body (T24)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from husky_control.planning.array_namespace import checked_vector, is_casadi, namespace_of
from husky_description.arrays import Array
from husky_description.gravity import GRAVITY

if TYPE_CHECKING:
    from husky_description.robot import Robot


@dataclass(frozen=True, eq=False)
class RomParameters:
    """Numbers of the reduced-order model."""

    mass: float  # kg, of the whole robot
    inertia: Array  # (3, 3) kg m^2 about the centre of mass, along the body's axes
    # (4, 3) m, l_h of T23: where each leg begins, in body, from the centre of mass
    hip_position: Array
    # (3,) m in base: where the body's origin lies on the robot
    center_of_mass: Array = field(default_factory=lambda: np.zeros(3))
    # (3,) m/s^2 in world; may be an expression of CasADi, so that a slope stays a parameter of what
    # is compiled
    gravity: Any = field(default_factory=lambda: np.array([0.0, 0.0, -GRAVITY]))
    # (6, 6) inverse of M of T25, kept because it is constant
    mass_matrix_inverse: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ValueError: a number is not finite, or not that of a rigid body, or of the wrong shape.
        """
        if not (np.isfinite(self.mass) and self.mass > 0.0):
            raise ValueError(f"mass must be finite and > 0 kg, not {self.mass}")
        shapes = {"inertia": (3, 3), "hip_position": (4, 3), "center_of_mass": (3,)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, _frozen(name, getattr(self, name), shape))
        if is_casadi(self.gravity):
            checked_vector("gravity", self.gravity, 3)
        else:
            object.__setattr__(self, "gravity", _frozen("gravity", self.gravity, (3,)))
        if np.abs(self.inertia - self.inertia.T).max() > 1e-9:
            raise ValueError(f"inertia must be symmetric, not {self.inertia.tolist()}")
        principal = np.linalg.eigvalsh(self.inertia)
        if principal[0] <= 0.0 or principal[2] > principal[0] + principal[1]:
            raise ValueError(
                f"inertia has principal values {principal.tolist()}: they must be > 0, and none "
                "above the sum of the other two"
            )
        inverse = np.zeros((6, 6))
        inverse[:3, :3] = np.eye(3) / self.mass
        inverse[3:, 3:] = np.linalg.inv(self.inertia)
        inverse.setflags(write=False)
        object.__setattr__(self, "mass_matrix_inverse", inverse)


def _frozen(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} must be {shape} finite numbers, not {array.tolist()}")
    array.setflags(write=False)
    return array


def rom_parameters(robot: Robot) -> RomParameters:
    """Return the reduced-order model of a robot: all its mass as it stands in one rigid body.

    Legs begin at `hips_in_base`, so that the standing robot has phi = gamma = 0 and
    r = robot.stand_height.

    Args:
        robot: its numbers.
    """
    # Brings MuJoCo, which a process that is given its parameters need not load.
    from husky_description.mujoco_model import composite_inertia

    center, inertia = composite_inertia(robot)
    return RomParameters(float(robot.mass), inertia, hips_in_base(robot) - center, center)


def hips_in_base(robot: Robot) -> Array:
    """Return where the model's legs begin, (4, 3) m in base.

    That is where the hip sagittal axis meets the plane of the leg while the hip frontal angle is
    zero: the robot's leg turns about a parallel of x, `lateral_offset` further inward.
    """
    hips = np.array(robot.hip_position)
    hips[:, 1] += robot.lateral_offset
    return hips


def in_slope_frame(parameters: RomParameters, slope: Any) -> RomParameters:
    """Return the same model in the frame of a slope: x uphill along it, y level, z its normal.

    Args:
        parameters: of the model; the size of its gravity is kept, its direction is not.
        slope: rad, a number or a scalar expression of CasADi.

    Raises:
        ValueError: the parameters' gravity is an expression already.
    """
    if is_casadi(parameters.gravity):
        raise ValueError("gravity must be numbers to be turned into a slope's frame")
    xp = namespace_of(slope)
    size = float(np.linalg.norm(parameters.gravity))
    gravity = xp.vector([-size * xp.sin(slope), 0.0, -size * xp.cos(slope)])
    return replace(parameters, gravity=gravity)
