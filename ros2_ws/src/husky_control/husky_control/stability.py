"""Stability of legged locomotion: support polygon, ZMP, friction cone, Poincare return map.

T15 static stability, T16 force closure, T14 stability of the closed-loop gait.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from husky_control.estimator import GRAVITY

Array = NDArray[np.float64]


# ------------------------------------------------------------------ polygon (T15)


def support_polygon(points: ArrayLike) -> Array:
    """Convex hull of contact points, counter-clockwise, by Andrew's monotone chain.

    Args:
        points: (n, 2) or (n, 3) m; a third column is ignored.

    Returns:
        (k, 2) m; one or two points when the contacts make no polygon.

    Raises:
        ValueError: there is no point, or one is not finite.
    """
    xy = np.asarray(points, dtype=np.float64)
    if xy.ndim != 2 or xy.shape[0] == 0 or xy.shape[1] < 2:
        raise ValueError(f"points must have shape (n, 2) with n >= 1, not {xy.shape}")
    if not np.isfinite(xy).all():
        raise ValueError("points must be finite")
    ordered = sorted({(float(x), float(y)) for x, y in xy[:, :2]})
    if len(ordered) <= 2:
        return np.array(ordered)

    def chain(sequence: list[tuple[float, float]]) -> list[tuple[float, float]]:
        hull: list[tuple[float, float]] = []
        for point in sequence:
            while len(hull) >= 2 and _turn(hull[-2], hull[-1], point) <= 0.0:
                hull.pop()
            hull.append(point)
        return hull[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Twice the signed area of a triangle; positive when it turns left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def static_margin(center_of_mass: ArrayLike, contacts: ArrayLike) -> float:
    """Distance of the centre of mass, projected along gravity, from the support polygon's edge.

    Args:
        center_of_mass: (2,) or (3,) m.
        contacts: (n, 2) or (n, 3) m, points of contact.

    Returns:
        m, positive inside and negative outside (T15); never positive on fewer than three feet.
    """
    if len(np.atleast_2d(np.asarray(contacts))) == 0 or np.size(contacts) == 0:
        return -math.inf
    polygon = support_polygon(contacts)
    com = np.asarray(center_of_mass, dtype=np.float64)
    x, y = float(com[0]), float(com[1])
    if len(polygon) == 1:
        return -math.hypot(x - polygon[0, 0], y - polygon[0, 1])
    inside, nearest, margin = len(polygon) >= 3, math.inf, math.inf
    corners = polygon.tolist()
    for k, (ax, ay) in enumerate(corners):
        bx, by = corners[(k + 1) % len(corners)]
        ex, ey = bx - ax, by - ay
        length = math.hypot(ex, ey)
        signed = (ex * (y - ay) - ey * (x - ax)) / length
        margin = min(margin, signed)
        along = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / (length * length)))
        nearest = min(nearest, math.hypot(x - ax - along * ex, y - ay - along * ey))
    return margin if inside and margin >= 0.0 else -nearest


# ------------------------------------------------------- ZMP, centre of pressure (T15)


def zero_moment_point(
    center_of_mass: ArrayLike, acceleration: ArrayLike, ground: float = 0.0
) -> Array:
    """Zero-moment point of a body whose angular momentum does not change (T15).

    Args:
        center_of_mass: (3,) m in world.
        acceleration: (3,) m/s^2 of the centre of mass in world.
        ground: m, height of the ground.

    Returns:
        (2,) m.

    Raises:
        ValueError: the body is in free fall or pulled down, and there is no such point.
    """
    com, acc = np.asarray(center_of_mass, float), np.asarray(acceleration, float)
    vertical = acc[2] + GRAVITY
    if vertical <= 0.0:
        raise ValueError("a body in free fall has no zero-moment point")
    point: Array = com[:2] - (com[2] - ground) * acc[:2] / vertical
    return point


def center_of_pressure(contacts: ArrayLike, forces: ArrayLike) -> Array:
    """Centre of pressure of point contacts on level ground.

    Args:
        contacts: (n, 2) or (n, 3) m.
        forces: (n, 3) N, of the ground on the feet.

    Raises:
        ValueError: no vertical force.
    """
    points, force = np.asarray(contacts, float)[:, :2], np.asarray(forces, float)
    total = force[:, 2].sum()
    if total <= 0.0:
        raise ValueError("there is no vertical ground force")
    point: Array = (points * force[:, 2:3]).sum(axis=0) / total
    return point


# ----------------------------------------------------------------- friction (T16)


def friction_ratio(force: ArrayLike) -> Array:
    """Tangential over normal force F_h / F_z of ground forces (..., 3) N; inf without pressure."""
    f = np.asarray(force, dtype=np.float64)
    tangential = np.hypot(f[..., 0], f[..., 1])
    normal = f[..., 2]
    ratio = np.full(normal.shape, np.inf)
    np.divide(tangential, normal, out=ratio, where=normal > 0.0)
    return ratio


def in_friction_cone(force: ArrayLike, friction: float) -> NDArray[np.bool_]:
    """Whether forces (..., 3) N satisfy F_h / F_z < mu and F_z > 0 (T16)."""
    inside: NDArray[np.bool_] = friction_ratio(force) < friction
    return inside


def friction_pyramid(friction: float, faces: int = 4) -> Array:
    """Linearised friction cone (T16): A f <= 0 for forces f (3,) in the pyramid inside of the cone.

    Args:
        friction: coefficient, > 0.
        faces: number of side faces, >= 3.

    Returns:
        A, (faces, 3).

    Raises:
        ValueError: an argument is out of range.
    """
    if not friction > 0.0 or faces < 3:
        raise ValueError(f"friction must be > 0 and faces >= 3, not {friction} and {faces}")
    angle = 2.0 * np.pi * np.arange(faces) / faces
    inner = friction * math.cos(math.pi / faces)
    return np.column_stack((np.cos(angle), np.sin(angle), np.full(faces, -inner)))


# ------------------------------------------------------------ Poincare map (T14)


@dataclass(frozen=True)
class ReturnMap:
    """Linearisation of a Poincare return map about its fixed point (T14).

    Attributes:
        fixed_point: (n,), in the units of the section states.
        jacobian: (n, n), d next / d state.
        eigenvalues: (n,) complex, largest modulus first.
        residual: root mean square of the fit, (n,), in the units of the section states.
    """

    fixed_point: Array
    jacobian: Array
    eigenvalues: NDArray[np.complex128]
    residual: Array

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of the eigenvalues."""
        return float(np.abs(self.eigenvalues[0]))

    @property
    def stable(self) -> bool:
        """Whether all eigenvalues lie inside the unit circle."""
        return self.spectral_radius < 1.0


def fit_return_map(states: ArrayLike, successors: ArrayLike) -> ReturnMap:
    """Fixed point and linearisation of a return map from pairs of section states, least squares.

    Fits next = J state + b. The pairs must excite every direction: perturb the gait, or use the
    noise of a long log.

    Args:
        states: (m, n) states at the section.
        successors: (m, n) states at the next return of each.

    Raises:
        ValueError: too few pairs, a direction that is not excited, or a map without a fixed point.
    """
    x, y = np.asarray(states, float), np.asarray(successors, float)
    if x.ndim != 2 or x.shape != y.shape:
        raise ValueError(f"states and successors must be (m, n) alike, not {x.shape}, {y.shape}")
    count, size = x.shape
    if count < size + 1:
        raise ValueError(f"{size} states need at least {size + 1} pairs, not {count}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError("section states must be finite")
    mean, scale = x.mean(axis=0), x.std(axis=0)
    if not (scale > 0.0).all():
        raise ValueError(f"state {int(np.argmin(scale))} does not vary: the map is not excited")
    design = np.column_stack(((x - mean) / scale, np.ones(count)))
    solution, _, rank, _ = np.linalg.lstsq(design, y, rcond=1e-10)
    if rank < size + 1:
        raise ValueError("the states do not excite every direction")
    jacobian = solution[:size].T / scale
    offset = solution[size] - jacobian @ mean
    left = np.eye(size) - jacobian
    # Of the scaled states, so that units do not count.
    if np.linalg.svd(left * scale / scale[:, None], compute_uv=False)[-1] < 1e-9:
        raise ValueError("the map has no isolated fixed point (an eigenvalue is 1)")
    eigenvalues = np.linalg.eigvals(jacobian).astype(np.complex128)
    order = np.argsort(-np.abs(eigenvalues), kind="stable")
    residual = np.sqrt(((y - x @ jacobian.T - offset) ** 2).mean(axis=0))
    return ReturnMap(np.linalg.solve(left, offset), jacobian, eigenvalues[order], residual)


def return_map_of_steps(section_states: ArrayLike) -> ReturnMap:
    """Return map from the states of consecutive steps of one log, (m, n); see fit_return_map."""
    states = np.asarray(section_states, float)
    if states.ndim != 2 or len(states) < 2:
        raise ValueError(f"section_states must be (m, n) with m >= 2, not {states.shape}")
    return fit_return_map(states[:-1], states[1:])


def perturbed_return_map(
    step: Callable[[Array], Array], guess: ArrayLike, perturbation: ArrayLike, rounds: int = 3
) -> ReturnMap:
    """Return map of a system that can be started at the section, by central differences.

    Args:
        step: maps a section state (n,) to the state at the next return.
        guess: (n,) near the fixed point.
        perturbation: (n,) or scalar, size of the perturbation of each state.
        rounds: Newton steps towards the fixed point.
    """
    point = np.array(guess, dtype=np.float64)
    size = np.broadcast_to(np.asarray(perturbation, float), point.shape)
    result: ReturnMap | None = None
    for _ in range(rounds):
        states = np.concatenate((point + np.diag(size), point - np.diag(size)))
        result = fit_return_map(states, np.array([step(state) for state in states]))
        point = result.fixed_point
    if result is None:
        raise ValueError("rounds must be at least 1")
    return result
