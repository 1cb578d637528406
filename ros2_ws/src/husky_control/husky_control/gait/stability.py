"""Stability of legged locomotion: the support polygon (T15), the Poincare return map (T14)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from husky_description.arrays import Array

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


# ------------------------------------------------------------ Poincare map (T14)


@dataclass(frozen=True)
class ReturnMap:
    """Linearisation of a Poincare return map about its fixed point (T14)."""

    fixed_point: Array  # (n,), in the units of the section states
    jacobian: Array  # (n, n), d next / d state
    eigenvalues: NDArray[np.complex128]  # (n,) complex, largest modulus first
    residual: Array  # root mean square of the fit, (n,), in the units of the section states

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
