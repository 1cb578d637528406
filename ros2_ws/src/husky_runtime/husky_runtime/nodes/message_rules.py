"""What a message or a request must hold to be let in: a table by kind, and the check made of it.

Every number is finite and not absurd, every stamp is one, every text and list has a bound; the
table says more of the messages that a tick works with. Limits are far beyond what the robot can do:
they keep nonsense out, and judge no measurement. Numbers of commands are checked by their owners,
which refuse them whole and count them (`SELF_CHECKED`).
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    Array,
    BasicType,
    NamespacedType,
)

Check = Callable[[Any], str]
"""Returns why a message is refused, "" when it is not."""

_TEXT = 4096
"""Characters of a text that has no bound of its own."""
_LENGTH = 4096
"""Entries of a list that has no bound of its own."""
_BYTES = 65_536
"""Of a message whose kind allows for any length [B], unless it is one of `_LONG`."""
_LONG = {
    "grid_map_msgs/GridMap": 32_000_000,
    "nav_msgs/OccupancyGrid": 2_000_000,
    "sensor_msgs/Image": 4_000_000,
}
"""The same of images and maps [B]: 1280 x 720 pixels of 4 bytes, 1000 x 1000 cells of 7 layers."""
_HUGE = 1e9
"""No number of the graph is beyond this, whatever its unit."""
MOST_PARAMETERS = 512
"""Of one request; a node has a fourth of that."""
_NORM_TOLERANCE = 0.01
"""Of a rotation's norm, which is 1 but for rounding by whoever sent it."""
_SHOWN = 40
"""Characters of a bad value that a reason shows."""


@dataclass(frozen=True)
class Numbers:
    """What numbers of one field may be.

    Attributes:
        upper: greatest.
        lower: least; minus the greatest by default.
        count: how many a list must hold; None for any.
        most: how many it may hold, where it may hold any.
        unknown: whether NaN is allowed, for what is not known.
    """

    upper: float = _HUGE
    lower: float | None = None
    count: int | None = None
    most: int = _LENGTH
    unknown: bool = False


_JOINTS = 12
_SMALL = ("boolean", "octet", "int8", "uint8")
"""Types of numbers whose every value is one: pixels and costs are not looked through."""
_UNKNOWN = Numbers(unknown=True)
_POINT = Numbers(1e6)

RULES: Mapping[str, Mapping[str, Numbers]] = {
    "sensor_msgs/JointState": {
        "position": Numbers(100.0, count=_JOINTS),  # rad
        "velocity": Numbers(1e3, count=_JOINTS),  # rad/s
        "effort": Numbers(1e3, count=_JOINTS),  # N m
    },
    "nav_msgs/Odometry": {
        "pose.pose.position": _POINT,  # m
        "twist.twist.linear": Numbers(1e3),  # m/s
        "twist.twist.angular": Numbers(1e3),  # rad/s
    },
    "sensor_msgs/Image": {"data": Numbers(most=4_000_000)},
    "grid_map_msgs/GridMap": {"data.data": Numbers(most=1_000_000, unknown=True)},  # m, rad
    "nav_msgs/OccupancyGrid": {"data": Numbers(most=2_000_000)},
    "sensor_msgs/BatteryState": dict.fromkeys(
        (
            "voltage",
            "temperature",
            "current",
            "charge",
            "capacity",
            "design_capacity",
            "percentage",
            "cell_voltage",
            "cell_temperature",
        ),
        _UNKNOWN,
    ),
    "husky_msgs/ControllerState": {"static_margin": _UNKNOWN},
    "husky_msgs/DriveStatusArray": {"drives": Numbers(count=_JOINTS)},
    "husky_msgs/ServoState": {
        "current": Numbers(1e3),  # A
        "bus_voltage": Numbers(1e3),  # V
    },
    "husky_msgs/FanCommand": {
        "pwm": Numbers(2500.0, 0.0),  # us
        "tilt": Numbers(2500.0, 0.0),  # us
    },
    "husky_msgs/FlightSensors": {
        "angular_velocity": Numbers(1e3),  # rad/s
        "specific_force": Numbers(1e4),  # m/s^2
        "magnetic_field": Numbers(1e2),  # gauss
        "pressure": Numbers(2e5, 0.0),  # Pa
        "battery_voltage": Numbers(1e2, -1.0),  # V
        "battery_current": Numbers(1e3),  # A
        "fan_speed": Numbers(1e5, unknown=True),  # rad/s
        "fan_current": Numbers(1e3, unknown=True),  # A
    },
    "husky_msgs/PropulsionState": {
        "collective_desired": _UNKNOWN,
        "fan_speed": Numbers(1e5, unknown=True),  # rad/s
        "thrust_limit": _UNKNOWN,
        "voltage": _UNKNOWN,
        "current": _UNKNOWN,
    },
    "rcl_interfaces/GetParameters_Request": {"names": Numbers(most=MOST_PARAMETERS)},
    "rcl_interfaces/SetParameters_Request": {"parameters": Numbers(most=MOST_PARAMETERS)},
    "rcl_interfaces/SetParametersAtomically_Request": {"parameters": Numbers(most=64)},
}
"""By kind and path; a path of a vector means its components. Requests cost less than a tick."""

SELF_CHECKED = frozenset(
    (
        "geometry_msgs/Twist",
        "geometry_msgs/TwistStamped",
        "husky_msgs/JointCommand",
        "husky_msgs/PropulsionCommand",
        "husky_msgs/ServoCommand",
    )
)
"""Commands: their owners refuse them whole, with the limits of now, and count that."""


def kind_of(message_type: type) -> str:
    """Return the kind of a message, e.g. `sensor_msgs/JointState`."""
    return f"{message_type.__module__.split('.')[0]}/{message_type.__name__}"


def make_check(message_type: type) -> Check:
    """Return the check of a kind of messages or requests."""
    kind = kind_of(message_type)
    checks = _checks(message_type, "", RULES.get(kind, {}), numbers=kind not in SELF_CHECKED)

    def check(message: Any) -> str:
        for part in checks:
            reason = part(message)
            if reason:
                return reason
        return ""

    return check


def most_bytes(message_type: type) -> int | None:
    """Return how long a serialised message of a kind may be [B], None where that is fixed."""
    slots = message_type.SLOT_TYPES  # type: ignore[attr-defined]
    if all(map(_is_fixed, slots)):
        return None
    return _LONG.get(kind_of(message_type), _BYTES)


def _is_fixed(slot: Any) -> bool:
    """Return whether a field is as long in every message."""
    if isinstance(slot, AbstractNestedType):
        return isinstance(slot, Array) and _is_fixed(slot.value_type)
    if isinstance(slot, NamespacedType):
        return all(map(_is_fixed, _class_of(slot).SLOT_TYPES))
    return not isinstance(slot, AbstractString)


# Checks of parts: each gets the whole message -----------------------------------------------------
def _checks(
    message_type: Any, prefix: str, rules: Mapping[str, Numbers], *, numbers: bool = True
) -> list[Check]:
    """Return the checks of a type's fields, of numbers only if wanted.

    `prefix` is the path to the fields, with its dot.
    """
    checks: list[Check] = []
    fields = message_type.get_fields_and_field_types()
    for name, slot in zip(fields, message_type.SLOT_TYPES, strict=True):
        checks += _field_checks(slot, prefix + name, rules) if numbers or _counts(slot) else []
    return checks


def _counts(slot: Any) -> bool:
    """Return whether a field that is no number is to be looked at: a stamp, a text."""
    return isinstance(slot, AbstractString) or getattr(slot, "name", "") == "Time"


def _field_checks(slot: Any, path: str, rules: Mapping[str, Numbers]) -> list[Check]:
    rule = rules.get(path)
    if isinstance(slot, AbstractNestedType):
        inner = {"entry" + each[len(path) :]: rules[each] for each in rules if _is_in(each, path)}
        return [_list_check(slot, path, rule, inner)]
    if isinstance(slot, AbstractString):
        return [_text_check(path, getattr(slot, "maximum_size", None) or _TEXT)]
    if isinstance(slot, BasicType):
        return _number_checks(slot, path, rule)
    kind = "/".join((slot.namespaces[0], slot.name))
    if kind == "builtin_interfaces/Time":
        return [_stamp_check(path)]
    if kind == "geometry_msgs/Quaternion":
        return [_quaternion_check(path)]
    if kind in ("geometry_msgs/Vector3", "geometry_msgs/Point"):
        return [_vector_check(path, rule or Numbers())]
    return _checks(_class_of(slot), path + ".", rules)


def _is_in(path: str, field: str) -> bool:
    """Return whether a path is that of a field, or of a part of it."""
    return path == field or path.startswith(field + ".")


def _class_of(slot: NamespacedType) -> Any:
    return getattr(importlib.import_module(".".join(slot.namespaces)), slot.name)


def _number_checks(slot: BasicType, path: str, rule: Numbers | None) -> list[Check]:
    if slot.typename not in ("float", "double") and rule is None:
        return []
    numbers = rule or Numbers()
    get, lower, upper = attrgetter(path), _lower(numbers), numbers.upper

    def check(message: Any) -> str:
        value = get(message)
        if lower <= value <= upper or (numbers.unknown and value != value):
            return ""
        return _beyond(path, value, numbers)

    return [check]


def _vector_check(path: str, numbers: Numbers) -> Check:
    get, square = attrgetter(path), numbers.upper**2

    def check(message: Any) -> str:
        v = get(message)
        if v.x * v.x + v.y * v.y + v.z * v.z <= square:
            return ""
        return f"{path} is ({v.x:.4g}, {v.y:.4g}, {v.z:.4g}), longer than {numbers.upper:g}"

    return check


def _quaternion_check(path: str) -> Check:
    get = attrgetter(path)

    def check(message: Any) -> str:
        q = get(message)
        square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
        if abs(square - 1.0) <= 2.0 * _NORM_TOLERANCE:
            return ""
        return f"{path} is no rotation: its norm is {square**0.5:.4g}, it must be 1"

    return check


def _stamp_check(path: str) -> Check:
    get = attrgetter(path)

    def check(message: Any) -> str:
        stamp = get(message)
        if stamp.sec >= 0 and stamp.nanosec < 1_000_000_000:
            return ""
        return f"{path} is {stamp.sec} s and {stamp.nanosec} ns: no time at or after 0"

    return check


def _text_check(path: str, bound: int) -> Check:
    get = attrgetter(path)

    def check(message: Any) -> str:
        length = len(get(message))
        return "" if length <= bound else f"{path} has {length} characters, {bound} are allowed"

    return check


def _list_check(
    slot: AbstractNestedType, path: str, rule: Numbers | None, inner: Mapping[str, Numbers]
) -> Check:
    """Return the check of an array or a sequence: its length, then what it holds.

    `inner` are the rules of its entries, whose paths begin with `entry`.
    """
    get, element = attrgetter(path), slot.value_type
    numbers = rule or Numbers()
    fixed = slot.size if isinstance(slot, Array) else numbers.count
    most = getattr(slot, "maximum_size", None) or numbers.most
    inside = _element_check(element, path, rule, numbers, inner)

    def check(message: Any) -> str:
        values = get(message)
        if fixed is not None:
            if len(values) != fixed:
                return f"{path} holds {len(values)} values, it must be {fixed}"
        elif len(values) > most:
            return f"{path} holds {len(values)} values, {most} are allowed"
        return inside(values) if inside is not None else ""

    return check


def _element_check(
    element: Any,
    path: str,
    rule: Numbers | None,
    numbers: Numbers,
    inner: Mapping[str, Numbers],
) -> Callable[[Any], str] | None:
    """Return the check of what a list holds, given the list."""
    if isinstance(element, BasicType):
        if element.typename in _SMALL:
            return None
        floats = element.typename in ("float", "double")
        return _values_check(path, numbers) if floats or rule is not None else None
    if isinstance(element, AbstractString):
        bound = getattr(element, "maximum_size", None) or _TEXT

        def texts(values: Sequence[str]) -> str:
            longest = max(map(len, values), default=0)
            return "" if longest <= bound else f"{path} has a text of {longest} characters"

        return texts
    # The checks of a field work on a message that has it; here the list's entry is the message.
    holder = _Entry()
    checks = _field_checks(element, "entry", inner)

    def entries(values: Sequence[Any]) -> str:
        for number, value in enumerate(values):
            holder.entry = value
            for check in checks:
                reason = check(holder)
                if reason:
                    return reason.replace("entry", f"{path}[{number}]", 1)
        return ""

    return entries


class _Entry:
    entry: Any = None


def _values_check(path: str, numbers: Numbers) -> Callable[[Any], str]:
    """Return the check of many numbers: for nearly all that come one look decides."""
    upper, lower = numbers.upper, _lower(numbers)
    symmetric = lower <= -upper

    def check(values: Any) -> str:
        given = values.tolist()
        if not given:
            return ""
        if symmetric:
            good = math.hypot(*given) <= upper
        else:  # a sum with NaN is NaN
            good = lower <= min(given) and max(given) <= upper and not math.isnan(sum(given))
        if good:
            return ""
        array = np.array(given)
        bad = ~((array >= lower) & (array <= upper))
        if numbers.unknown:
            bad &= ~np.isnan(array)
        if not bad.any():
            return ""
        index = int(bad.argmax())
        return _beyond(f"{path}[{index}]", array[index], numbers)

    return check


def _lower(numbers: Numbers) -> float:
    return -numbers.upper if numbers.lower is None else numbers.lower


def _beyond(path: str, value: Any, numbers: Numbers) -> str:
    allowed = f"{_lower(numbers):g} to {numbers.upper:g}"
    return f"{path} is {str(value)[:_SHOWN]}, allowed is {allowed}"
