"""A planned gait cycle on a slope: body motion, ground forces, thrust; kept, saved, interpolated.

Everything is in the *slope frame*: x up the slope along its tangent, y left, z out of the slope
along its normal. Its origin lies on the slope, under the nominal body at the start of the cycle.
A plan is periodic: each cycle repeats the one before, `speed * period` further along x.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_control.rotation import (
    rotation_from_vector,
    vector_from_rotation,
    vector_rate,
)
from husky_description.arrays import Array
from husky_runtime.stored_file import DamagedFileError, read_sealed, write_sealed

Mask = NDArray[np.bool_]

PLAN_VERSION = 2
"""Version of the file format; another one is refused. Version 1 had no checksum."""

THRUST_MODES = ("vector", "body_z", "none")
"""What the fans can do: a 3-D force at the centre of mass, a force along body z, nothing."""


class PlanFileError(ValueError):
    """A file is damaged, no plan, or of another version; the message names it and says why."""


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
    """One cycle of a gait on a slope; M points in time, a switch of the stance has two."""

    slope: float  # angle of the ground against the horizontal, x uphill [rad]
    speed: float  # mean velocity along x, negative goes down [m/s]
    friction: float  # coefficient of friction that was assumed [-]
    friction_margin: float  # share of it that the plan leaves unused, 0 to 1 [-]
    thrust_mode: str  # one of THRUST_MODES
    gait: str  # name of the row of the gait table
    period: float  # of the cycle [s]
    duty: float  # share of the period that each leg stands [-]
    touchdown_phase: Array  # of each leg, share of the period in [0, 1) (4,)
    height: float  # nominal distance of the centre of mass from the slope [m]
    mass: float  # of the robot that was planned for [kg]
    thrust_limit: float  # of all fans together [N]
    center_of_mass: Array  # of the robot that was planned for, in base [m] (3,)
    time: Array  # of each point, from 0 to period, not decreasing [s] (M,)
    position: Array  # centre of mass in the slope frame [m] (M, 3)
    rotation: Array  # body to slope frame (M, 3, 3)
    velocity: Array  # of the centre of mass, slope frame [m/s] (M, 3)
    angular_velocity: Array  # of the body, in body [rad/s] (M, 3)
    acceleration: Array  # of the centre of mass, slope frame [m/s^2] (M, 3)
    angular_acceleration: Array  # of the body, in body [rad/s^2] (M, 3)
    foot_force: Array  # of the ground on each foot, slope frame, zero in its swing [N] (M, 4, 3)
    thrust: Array  # of the fans on the body at the centre of mass, slope frame [N] (M, 3)
    stance: Mask  # whether each leg stands, from this point to the next (M, 4)
    # where each leg touches the ground (z = 0, below the centre of its foot) in the stance that it
    # begins in this cycle, slope frame [m] (4, 3)
    foothold: Array
    mesh_error: MeshError  # of the collocation, see MeshError
    cost: float  # value of the cost that was minimised [-]

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
        for name in NUMBERS:
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} is {getattr(self, name)}, it must be finite")
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
        """Write the plan as a NumPy archive (.npz) with a checksum behind it, whole or not at all.

        Raises:
            OSError: it cannot be written; an earlier file stays.
        """
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
        archive = io.BytesIO()
        np.savez_compressed(archive, meta=np.array(json.dumps(meta)), **arrays)
        write_sealed(Path(path), archive.getvalue())


def load_plan(path: Path | str) -> Plan:
    """Read a plan that `Plan.save` wrote.

    Raises:
        OSError: the file cannot be read.
        PlanFileError: it is damaged, not a plan, of another version, or incomplete.
    """
    try:
        content = read_sealed(Path(path))
    except DamagedFileError as error:
        raise PlanFileError(f"{error}; plan it again") from error
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            fields: dict[str, Any] = dict(archive)
        meta = json.loads(str(fields.pop("meta")))
        format_name = meta.pop("format")
    except Exception as error:  # of a file that is whole, but somebody else's: zip, NumPy, JSON
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


NUMBERS = tuple(field.name for field in dataclasses.fields(Plan) if field.type == "float")
"""The fields that are one number."""
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
