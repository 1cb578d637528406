"""Reads sections of a parameter file into frozen dataclasses and checks every number."""

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar, get_type_hints

import numpy as np

from husky_description.arrays import Array

Section = TypeVar("Section")

_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)


class Bounds(NamedTuple):
    """Allowed range of a number, ends included, and the length of a vector (0: a scalar)."""

    lower: float
    upper: float
    size: int
    integer: bool


class Choice(NamedTuple):
    """Words that a field may be."""

    allowed: tuple[str, ...]


class Named(NamedTuple):
    """Sections of one kind under names of the file's own choice: how many there may be."""

    section: type[Any]
    fewest: int
    most: int


def choice(*allowed: str) -> Choice:
    """Words that a field may be."""
    return Choice(allowed)


def number(lower: float, upper: float) -> Bounds:
    """Bounds of a scalar field within [lower, upper]."""
    return Bounds(lower, upper, 0, False)


def count(lower: int, upper: int) -> Bounds:
    """Bounds of an integer field within [lower, upper]."""
    return Bounds(lower, upper, 0, True)


def vector(size: int, lower: float, upper: float) -> Bounds:
    """Bounds of a field that is an array of `size` numbers, each within [lower, upper]."""
    return Bounds(lower, upper, size, False)


def named(section: type[Any], fewest: int, most: int) -> Named:
    """From `fewest` to `most` sections of a kind, each under a name that a frame may have."""
    return Named(section, fewest, most)


def frozen(values: Any) -> Array:
    """Copy into an array of floats that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def read_section(section: type[Section], values: Any, name: str) -> Section:
    """Make a `section` from a mapping.

    Args:
        section: Dataclass whose fields are annotated with `number`, `count`, `vector`, `choice`
            or `named`, as in `mass: Annotated[float, number(0.1, 50.0)]`.
        values: Mapping from field names to values, as YAML gives it.
        name: Dotted name of the section, for messages.

    Raises:
        ValueError: A key is unknown or missing, or a number is not finite, of the wrong type or
            out of range, or a word is not allowed. The message names the dotted key, the value
            and what is allowed.
    """
    declared = bounds_of(section)
    check_keys(values, set(declared), name)
    return section(
        **{key: read_value(values[key], declared[key], f"{name}.{key}") for key in declared}
    )


def bounds_of(section: type[Any]) -> dict[str, Bounds | Choice | Named]:
    """Bounds, the words allowed, or the sections within, of every field of a section."""
    hints = get_type_hints(section, include_extras=True)
    return {key: hint.__metadata__[0] for key, hint in hints.items()}


def check_keys(values: Any, expected: set[str], name: str) -> None:
    """Raise ValueError unless `values` is a mapping with exactly the `expected` keys."""
    if not isinstance(values, Mapping):
        raise ValueError(f"{name or 'file'}: {values!r} is not a mapping of {sorted(expected)}")
    prefix = f"{name}." if name else ""
    for key in values:
        if key not in expected:
            raise ValueError(f"{prefix}{key}: unknown key, known are {sorted(expected)}")
    for key in sorted(expected):
        if key not in values:
            raise ValueError(f"{prefix}{key}: missing")


def read_value(value: Any, bounds: Bounds | Choice | Named, key: str) -> Any:
    """Check one value against its bounds.

    Returns:
        A float, an int, a frozen array, a word, or a mapping of names to sections.
    """
    if isinstance(bounds, Named):
        return _read_named(value, bounds, key)
    if isinstance(bounds, Choice):
        if value not in bounds.allowed:
            raise ValueError(f"{key}: {value!r} is not one of {', '.join(bounds.allowed)}")
        return value
    if bounds.size:
        if not isinstance(value, list | tuple | np.ndarray) or len(value) != bounds.size:
            raise ValueError(f"{key}: {value!r} is not a list of {bounds.size} numbers")
        return frozen([_check(item, bounds, f"{key}[{i}]") for i, item in enumerate(value)])
    return _check(value, bounds, key)


def _read_named(value: Any, bounds: Named, key: str) -> Mapping[str, Any]:
    allowed = f"{bounds.fewest} to {bounds.most} sections by name"
    if not isinstance(value, Mapping) or not bounds.fewest <= len(value) <= bounds.most:
        raise ValueError(f"{key}: {value!r} is not a mapping of {allowed}")
    for name in value:
        if not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise ValueError(f"{key}: {name!r} is not a name of a-z, 0-9 and _ after a letter")
    return {
        name: read_section(bounds.section, part, f"{key}.{name}") for name, part in value.items()
    }


def _check(value: Any, bounds: Bounds, key: str) -> float | int:
    kinds = (int, np.integer) if bounds.integer else (int, float, np.integer, np.floating)
    kind = "an integer" if bounds.integer else "a number"
    allowed = f"[{bounds.lower:g}, {bounds.upper:g}]"
    if isinstance(value, bool) or not isinstance(value, kinds):
        raise ValueError(f"{key}: {value!r} is not {kind}, allowed range {allowed}")
    if not math.isfinite(value) or not bounds.lower <= value <= bounds.upper:
        raise ValueError(f"{key}: {value!r} is outside the allowed range {allowed}")
    return int(value) if bounds.integer else float(value)
