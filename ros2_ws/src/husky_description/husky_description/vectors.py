"""Vectors of three numbers for compiled kernels: tuples, which cost no memory, beside arrays."""

from __future__ import annotations

from numba import njit

from husky_description.arrays import Array

Vector = tuple[float, float, float]


@njit(cache=True)
def vector(values: Array) -> Vector:
    """Return the elements of an array (3,)."""
    return values[0], values[1], values[2]


@njit(cache=True)
def column(matrix: Array, index: int) -> Vector:
    """Return a column of a matrix (3, 3)."""
    return matrix[0, index], matrix[1, index], matrix[2, index]


@njit(cache=True)
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def scaled(factor: float, a: Vector) -> Vector:
    """Return factor a."""
    return factor * a[0], factor * a[1], factor * a[2]


@njit(cache=True)
def product(matrix: Array, a: Vector) -> Vector:
    """Return a matrix (3, 3) times a."""
    return (
        matrix[0, 0] * a[0] + matrix[0, 1] * a[1] + matrix[0, 2] * a[2],
        matrix[1, 0] * a[0] + matrix[1, 1] * a[1] + matrix[1, 2] * a[2],
        matrix[2, 0] * a[0] + matrix[2, 1] * a[1] + matrix[2, 2] * a[2],
    )


@njit(cache=True)
def product_plus(matrix: Array, a: Vector, b: Vector) -> Vector:
    """Return b plus a matrix (3, 3) times a, added up from left to right."""
    return (
        b[0] + matrix[0, 0] * a[0] + matrix[0, 1] * a[1] + matrix[0, 2] * a[2],
        b[1] + matrix[1, 0] * a[0] + matrix[1, 1] * a[1] + matrix[1, 2] * a[2],
        b[2] + matrix[2, 0] * a[0] + matrix[2, 1] * a[1] + matrix[2, 2] * a[2],
    )


@njit(cache=True)
def difference(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True)
def transposed_product(matrix: Array, a: Vector) -> Vector:
    """Return the transpose of a matrix (3, 3) times a: a turned back by a rotation."""
    return dot(column(matrix, 0), a), dot(column(matrix, 1), a), dot(column(matrix, 2), a)


@njit(cache=True)
def write(values: Array, a: Vector) -> None:
    """Write a vector into an array (3,)."""
    values[0], values[1], values[2] = a


@njit(cache=True)
def solve_symmetric(diagonal: Vector, beside: Vector, right: Vector) -> Vector:
    """Return x with A x = right for a symmetric A; zero where A is singular.

    Args:
        diagonal: A00, A11, A22.
        beside: A01, A02, A12.
        right: right-hand side.
    """
    (a00, a11, a22), (a01, a02, a12) = diagonal, beside
    first = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    determinant = dot((a00, a01, a02), first)
    if determinant < 1e-18:
        return 0.0, 0.0, 0.0
    second = first[1], a00 * a22 - a02 * a02, a01 * a02 - a00 * a12
    third = first[2], second[2], a00 * a11 - a01 * a01
    return (
        dot(first, right) / determinant,
        dot(second, right) / determinant,
        dot(third, right) / determinant,
    )
