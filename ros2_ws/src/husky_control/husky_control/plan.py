"""A planned gait cycle on a slope: body motion, ground forces, thrust; kept, saved, interpolated.

Everything is in the *slope frame*: x up the slope along its tangent, y left, z out of the slope
along its normal. Its origin lies on the slope, under the nominal body at the start of the cycle.
A plan is periodic: each cycle repeats the one before, `speed * period` further along x.
"""

from __future__ import annotations

import dataclasses
import json
import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_control.rotation_vector import (
    rotation_from_vector,
    vector_from_rotation,
    vector_rate,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PLAN_VERSION = 1
"""Version of the file format; another one is refused."""

THRUST_MODES = ("vector", "body_z", "none")
"""What the fans can do: a 3-D force at the centre of mass, a force along body z, nothing."""


class PlanFileError(ValueError):
    """A file is not a plan, or a plan of another version; the message says what was wrong."""


class PlanSample(NamedTuple):
    """A plan at one time, in the slope frame; `angular_velocity` in body."""

    position: Array  # (3,) m, centre of mass
    rotation: Array  # (3, 3), body to slope frame
    velocity: Array  # (3,) m/s
    angular_velocity: Array  # (3,) rad/s, in body
    foot_force: Array  # (4, 3) N, of the ground on each foot
    thrust: Array  # (3,) N, of the fans on the body
    stance: Mask  # (4,) which legs stand
    foothold: Array  # (4, 3) m, where each foot stands, or will stand after its swing


@dataclass(frozen=True)
class MeshError:
    """How far the plan's cubics are from the equations of motion integrated between its points.

    The greatest over all intervals; each is integrated from its first point with the plan's inputs.
    """

    position: float  # m
    rotation: float  # rad
    velocity: float  # m/s
    angular_velocity: float  # rad/s

    def within(self, tolerance: float) -> bool:
        """Whether no error exceeds a number, taken in m, rad, m/s and rad/s alike."""
        return bool(max(dataclasses.astuple(self)) <= tolerance)


@dataclass(frozen=True, eq=False)
class Plan:
    """One cycle of a gait on a slope; M points in time, a switch of the stance has two.

    Attributes:
        slope: angle of the ground against the horizontal, x uphill [rad].
        speed: mean velocity along x, negative goes down [m/s].
        friction: coefficient of friction that was assumed [-].
        friction_margin: share of it that the plan leaves unused, 0 to 1 [-].
        thrust_mode: one of THRUST_MODES.
        gait: name of the row of the gait table.
        period: of the cycle [s].
        duty: share of the period that each leg stands [-].
        touchdown_phase: of each leg, share of the period in [0, 1) (4,).
        height: nominal distance of the centre of mass from the slope [m].
        mass: of the robot that was planned for [kg].
        thrust_limit: of all fans together [N].
        center_of_mass: of the robot that was planned for, in base [m] (3,).
        time: of each point, from 0 to period, not decreasing [s] (M,).
        position: centre of mass in the slope frame [m] (M, 3).
        rotation: body to slope frame (M, 3, 3).
        velocity: of the centre of mass, slope frame [m/s] (M, 3).
        angular_velocity: of the body, in body [rad/s] (M, 3).
        acceleration: of the centre of mass, slope frame [m/s^2] (M, 3).
        angular_acceleration: of the body, in body [rad/s^2] (M, 3).
        foot_force: of the ground on each foot, slope frame, zero in its swing [N] (M, 4, 3).
        thrust: of the fans on the body at the centre of mass, slope frame [N] (M, 3).
        stance: whether each leg stands, from this point to the next (M, 4).
        foothold: where each leg touches the ground (z = 0, below the centre of its foot) in the
            stance that it begins in this cycle, slope frame [m] (4, 3).
        mesh_error: of the collocation, see MeshError.
        cost: value of the cost that was minimised [-].
    """

    slope: float
    speed: float
    friction: float
    friction_margin: float
    thrust_mode: str
    gait: str
    period: float
    duty: float
    touchdown_phase: Array
    height: float
    mass: float
    thrust_limit: float
    center_of_mass: Array
    time: Array
    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array
    foot_force: Array
    thrust: Array
    stance: Mask
    foothold: Array
    mesh_error: MeshError
    cost: float

    def __post_init__(self) -> None:
        """Check shapes and values, and freeze the arrays.

        Raises:
            ValueError: a field has a wrong shape or value; the message names it.
        """
        if self.thrust_mode not in THRUST_MODES:
            raise ValueError(f"thrust_mode is {self.thrust_mode!r}, it must be in {THRUST_MODES}")
        points = np.shape(self.time)[0] if np.ndim(self.time) == 1 else 0
        if points < 2:
            raise ValueError(f"time has shape {np.shape(self.time)}, it needs 2 points or more")
        for name, tail in _POINT_SHAPES.items():
            self._freeze(name, (points, *tail), bool if name == "stance" else float)
        self._freeze("touchdown_phase", (4,), float)
        self._freeze("center_of_mass", (3,), float)
        self._freeze("foothold", (4, 3), float)
        if self.time[0] != 0.0 or np.any(np.diff(self.time) < 0.0):
            raise ValueError("time must begin at 0 and not decrease")
        if not self.period > 0.0 or abs(self.time[-1] - self.period) > 1e-9:
            raise ValueError(f"time ends at {self.time[-1]} s, the period is {self.period} s")

    def _freeze(self, name: str, shape: tuple[int, ...], kind: type) -> None:
        array: NDArray[Any] = np.array(getattr(self, name), dtype=kind)
        if array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}, it must have {shape}")
        if not np.all(np.isfinite(array)):
            raise ValueError(f"{name} has values that are not finite")
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    @property
    def stride(self) -> float:
        """Way along x in one cycle [m]."""
        return self.speed * self.period

    @property
    def world_from_slope(self) -> Array:
        """Rotation from the slope frame to a world with z up and x uphill (3, 3)."""
        return slope_rotation(self.slope)

    def at(self, time: float) -> PlanSample:
        """The plan at a time, of any cycle: cubics for the body, lines for the inputs (T29).

        Args:
            time: since the start of the first cycle [s], negative in the cycles before it.
        """
        cycle = math.floor(time / self.period)
        local = time - cycle * self.period
        k = int(np.searchsorted(self.time, local, side="right")) - 1
        k = min(max(k, 0), len(self.time) - 2)
        step = float(self.time[k + 1] - self.time[k])
        s = (local - float(self.time[k])) / step
        position, velocity = self._motion(k, s, step)
        rotation, angular_velocity = self._turn(k, s, step)
        position[0] += cycle * self.stride
        return PlanSample(
            position,
            rotation,
            velocity,
            angular_velocity,
            (1.0 - s) * self.foot_force[k] + s * self.foot_force[k + 1],
            (1.0 - s) * self.thrust[k] + s * self.thrust[k + 1],
            self.stance[k],
            self.foothold_at(time),
        )

    def _motion(self, k: int, s: float, step: float) -> tuple[Array, Array]:
        position = _cubic(
            s, step, self.position[k], self.velocity[k], self.position[k + 1], self.velocity[k + 1]
        )
        velocity = _cubic(
            s,
            step,
            self.velocity[k],
            self.acceleration[k],
            self.velocity[k + 1],
            self.acceleration[k + 1],
        )
        return position, velocity

    def _turn(self, k: int, s: float, step: float) -> tuple[Array, Array]:
        first, last = self.rotation[k], self.rotation[k + 1]
        whole = vector_from_rotation(first.T @ last)
        rate = vector_rate(whole, self.angular_velocity[k + 1])
        turned = _cubic(s, step, np.zeros(3), self.angular_velocity[k], whole, rate)
        angular_velocity = _cubic(
            s,
            step,
            self.angular_velocity[k],
            self.angular_acceleration[k],
            self.angular_velocity[k + 1],
            self.angular_acceleration[k + 1],
        )
        return first @ rotation_from_vector(turned), angular_velocity

    def foothold_at(self, time: float) -> Array:
        """Where each foot stands at a time, or will stand after its swing [m] (4, 3)."""
        since = time / self.period - self.touchdown_phase
        begun = np.floor(since)
        begun += (since - begun) >= self.duty - 1e-9
        foothold = self.foothold.copy()
        foothold[:, 0] += begun * self.stride
        return foothold

    def save(self, path: Path | str) -> None:
        """Write the plan as a NumPy archive (.npz)."""
        meta: dict[str, Any] = {"format": "husky plan", "version": PLAN_VERSION}
        arrays: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                arrays[field.name] = value
            elif isinstance(value, MeshError):
                meta[field.name] = dataclasses.asdict(value)
            else:
                meta[field.name] = value
        with open(path, "wb") as file:  # np.savez would add .npz to another name
            np.savez_compressed(file, meta=np.array(json.dumps(meta)), **arrays)


def load_plan(path: Path | str) -> Plan:
    """Read a plan that `Plan.save` wrote.

    Raises:
        OSError: the file cannot be read.
        PlanFileError: it is not a plan, of another version, or incomplete.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            fields: dict[str, Any] = dict(archive)
        meta = json.loads(str(fields.pop("meta")))
        format_name = meta.pop("format")
    except (ValueError, KeyError, AttributeError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise PlanFileError(f"{path} is not a plan: {error}") from error
    version = meta.pop("version", None)
    if format_name != "husky plan" or version != PLAN_VERSION:
        raise PlanFileError(
            f"{path} is a {format_name!r} of version {version}, readable is 'husky plan' of "
            f"version {PLAN_VERSION}: plan it again"
        )
    fields.update(meta)
    wanted = {field.name for field in dataclasses.fields(Plan)}
    if fields.keys() != wanted:
        odd = sorted(fields.keys() ^ wanted)
        raise PlanFileError(f"{path} is not a whole plan: missing or unknown are {odd}")
    try:
        fields["mesh_error"] = MeshError(**fields["mesh_error"])
        return Plan(**fields)
    except (ValueError, TypeError) as error:
        raise PlanFileError(f"{path} holds a plan that cannot be: {error}") from error


def slope_rotation(slope: float) -> Array:
    """Rotation from the slope frame to a world with z up and x uphill (3, 3); slope in rad."""
    c, s = math.cos(slope), math.sin(slope)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _cubic(s: float, step: float, y0: Array, d0: Array, y1: Array, d1: Array) -> Array:
    """The cubic through y0, y1 with slopes d0, d1 at share s of a step (T29)."""
    r = 1.0 - s
    value: Array = (
        (1.0 + 2.0 * s) * r * r * y0
        + s * s * (3.0 - 2.0 * s) * y1
        + (s * r * step) * (r * d0 - s * d1)
    )
    return value


_POINT_SHAPES: dict[str, tuple[int, ...]] = {
    "time": (),
    "position": (3,),
    "rotation": (3, 3),
    "velocity": (3,),
    "angular_velocity": (3,),
    "acceleration": (3,),
    "angular_acceleration": (3,),
    "foot_force": (4, 3),
    "thrust": (3,),
    "stance": (4,),
}
"""Shapes of the arrays that have a row for each point."""
