"""Array operations that NumPy and CasADi spell differently, so that a model is written once.

Vectors are (n,) in NumPy and (n, 1) in CasADi; `a[i]`, `a[i:j]`, `a[:, j]`, `+ - * /` and `@` are
common to both. CasADi is imported by the first of its expressions that comes along, not before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

Operation = Callable[..., Any]


@dataclass(frozen=True)
class ArrayNamespace:
    """Operations of one array library."""

    name: str  # `numpy` or `casadi`
    vector: Operation  # list of n scalars to a vector
    matrix: Operation  # list of rows, each a list of scalars, to a matrix
    concatenate: Operation  # list of vectors to one vector
    rows: Operation  # list of k vectors of n to a matrix (k, n)
    where: Operation  # condition, value if true, value if false, all scalars
    maximum: Operation  # greater of two scalars
    sin: Operation  # of scalars or element by element, as those below
    cos: Operation
    exp: Operation
    tanh: Operation
    sign: Operation

    def skew(self, a: Any) -> Any:
        """Return [a]_x (3, 3), with [a]_x b = a x b, of a vector (3)."""
        return self.matrix([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


NUMPY = ArrayNamespace(
    name="numpy",
    vector=np.array,
    matrix=np.array,
    concatenate=np.concatenate,
    rows=np.array,
    where=np.where,
    maximum=np.maximum,
    sin=np.sin,
    cos=np.cos,
    exp=np.exp,
    tanh=np.tanh,
    sign=np.sign,
)
"""NumPy's arrays of float."""


@lru_cache(maxsize=1)
def casadi_namespace() -> ArrayNamespace:
    """Return the operations for CasADi's SX, MX and DM.

    Raises:
        ModuleNotFoundError: CasADi is not installed.
    """
    import casadi as ca

    def matrix(rows: Sequence[Sequence[Any]]) -> Any:
        return ca.vertcat(*(ca.horzcat(*row) for row in rows))

    return ArrayNamespace(
        name="casadi",
        vector=lambda scalars: ca.vertcat(*scalars),
        matrix=matrix,
        concatenate=lambda vectors: ca.vertcat(*vectors),
        rows=lambda vectors: ca.vertcat(*(vector.T for vector in vectors)),
        where=ca.if_else,
        maximum=ca.fmax,
        sin=ca.sin,
        cos=ca.cos,
        exp=ca.exp,
        tanh=ca.tanh,
        sign=ca.sign,
    )


def is_casadi(value: Any) -> bool:
    """Whether a value is an expression or a matrix of CasADi."""
    return type(value).__module__.partition(".")[0] == "casadi"


def namespace_of(*values: Any) -> ArrayNamespace:
    """Return CasADi's operations when any of the values is CasADi's, NumPy's otherwise."""
    return casadi_namespace() if any(is_casadi(value) for value in values) else NUMPY


def checked_vector(name: str, value: Any, size: int) -> Any:
    """Return a vector as its library has it; a sequence of numbers as an array of float.

    Args:
        name: of the argument, for the message.
        value: (size,), or (size, 1) of CasADi.
        size: number of elements.

    Raises:
        ValueError: the shape is another one.
    """
    if is_casadi(value):
        if value.shape != (size, 1):
            raise ValueError(f"{name} must have shape ({size}, 1), not {value.shape}")
        return value
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), not {array.shape}")
    return array
