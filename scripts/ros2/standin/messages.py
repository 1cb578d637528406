"""Messages to YAML and CSV as `ros2 topic echo` prints them, and fields from a dictionary."""

import argparse
import array
import importlib
import sys
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
import yaml
from rosidl_parser import definition as idl

NowSetter = Callable[[Any], None]

MARKS = {"msg": "SLOT_TYPES", "srv": "Request", "action": "Goal"}  # kind: what its classes have


def interface_class(identifier: str, kind: str) -> Any:
    """The class of `package/msg/Name` or `package/Name`, kind being msg, srv or action.

    Raises ValueError when there is no such type.
    """
    *namespaces, name = identifier.split("/")
    if len(namespaces) == 1:
        namespaces.append(kind)
    try:
        found = getattr(importlib.import_module(".".join(namespaces)), name)
    except (AttributeError, ModuleNotFoundError, ValueError):
        raise ValueError(f"no such type: {identifier}") from None
    if not hasattr(found, MARKS[kind]):
        raise ValueError(f"not a {kind}: {identifier}")
    return found


def fields(message: Any) -> list[tuple[str, Any]]:
    """Names and IDL types of a message's fields."""
    return list(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))


# ------------------------------------------------------------------ to text
class Shortening:
    """How much of a message is shown: length of strings and arrays, and whether they are at all."""

    def __init__(
        self, length: int | None = None, no_arrays: bool = False, no_strings: bool = False
    ) -> None:
        self.length = length
        self.no_arrays = no_arrays
        self.no_strings = no_strings

    @classmethod
    def chosen(cls, args: argparse.Namespace) -> "Shortening":
        """As the options say."""
        return cls(None if args.full_length else args.truncate_length, args.no_arr, args.no_str)

    def too_long(self, value: Any) -> bool:
        """Whether a string or array is beyond the limit."""
        return self.length is not None and len(value) > self.length

    def text(self, value: str) -> str:
        """A string as it is shown."""
        if self.no_strings:
            return f"<string length: <{len(value)}>>"
        return value[: self.length] + "..." if self.too_long(value) else value


def to_yaml(message: Any, shortening: Shortening, flow: bool = False) -> str:
    """A message as YAML, its fields in the order of its definition."""
    return dump(plain(message, shortening), flow)


def dump(fields_by_name: Any, flow: bool) -> str:
    """A message that has been made plain as YAML; with flow, each of its lists on one line."""
    return yaml.dump(
        fields_by_name,
        Dumper=MessageDumper,
        sort_keys=False,
        allow_unicode=True,
        width=sys.maxsize,
        default_flow_style=flow,
    )


class MessageDumper(yaml.Dumper):
    """Mappings stay in block style, whatever style sequences have."""

    def represent_mapping(
        self, tag: str, mapping: Any, flow_style: bool | None = None
    ) -> yaml.MappingNode:
        """A mapping node in block style."""
        return super().represent_mapping(tag, mapping, flow_style=False)


def plain(value: Any, shortening: Shortening, idl_type: Any = None) -> Any:
    """A message, or a field of one, as dictionaries, lists and scalars."""
    if isinstance(value, bytes):
        text = value.decode("latin-1")
        return text[: shortening.length] + "..." if shortening.too_long(value) else text
    if isinstance(value, str):
        return shortening.text(value)
    if isinstance(value, list | tuple | array.array | np.ndarray):
        if shortening.no_arrays and idl_type is not None:
            return array_description(value, idl_type)
        shown = [plain(item, shortening) for item in value[: shortening.length]]
        return [*shown, "..."] if shortening.too_long(value) else shown
    if isinstance(value, np.number):
        return value.item()
    if isinstance(value, bool | int | float):
        return value
    return {name: plain(getattr(value, name), shortening, kind) for name, kind in fields(value)}


def to_csv(message: Any, shortening: Shortening) -> str:
    """All fields of a message, depth first, separated by commas."""
    return joined(
        csv_field(getattr(message, name), shortening, kind) for name, kind in fields(message)
    )


def joined(parts: Iterable[str]) -> str:
    """The parts, separated by commas; ros2cli has no comma after empty parts at the beginning."""
    text = ""
    for part in parts:
        text = f"{text},{part}" if text else part
    return text


def csv_field(value: Any, shortening: Shortening, idl_type: Any = None) -> str:
    """One field, its own fields or elements separated by commas."""
    if isinstance(value, list | tuple | array.array | np.ndarray):
        if shortening.no_arrays and idl_type is not None:
            return array_description(value, idl_type)
        shown = [csv_field(item, shortening) for item in value[: shortening.length]]
        return joined([*shown, "..."] if shortening.too_long(value) else shown)
    if isinstance(value, bytes):
        return str(value[: shortening.length] + b"..." if shortening.too_long(value) else value)
    if isinstance(value, str):
        return shortening.text(value)
    if isinstance(value, bool | int | float | np.number):
        return str(value)
    return to_csv(value, shortening)


def array_description(value: Any, idl_type: Any) -> str:
    """What stands for an array that is not shown."""
    element = type_name(idl_type.value_type)
    if isinstance(idl_type, idl.Array):
        return f"<array type: {element}[{idl_type.size}]>"
    if isinstance(idl_type, idl.BoundedSequence):
        return f"<sequence type: {element}[{idl_type.maximum_size}], length: {len(value)}>"
    return f"<sequence type: {element}, length: {len(value)}>"


def type_name(idl_type: Any) -> str:
    """An element's type as the IDL names it."""
    if isinstance(idl_type, idl.NamespacedType):
        return "/".join(idl_type.namespaced_name())
    if isinstance(idl_type, idl.AbstractString):
        return "string"
    if isinstance(idl_type, idl.AbstractWString):
        return "wstring"
    return str(getattr(idl_type, "typename", "unknown"))


# ------------------------------------------------------------------ from text
def load_values(text: str | bytes) -> Any:
    """YAML from the command line; RuntimeError when it is none."""
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise RuntimeError(f"The passed values are not valid YAML: {error}") from None


def fill(message: Any, values: Any, expand_now: bool = False) -> list[NowSetter]:
    """Set a message's fields from nested dictionaries.

    With expand_now, the value `now` of a time and `auto` of a header are left to the returned
    setters, each to be called with the time at which the message is sent. Raises what the
    message's own setters raise (AttributeError, AssertionError, TypeError, ValueError) when a name
    or a value does not fit.
    """
    if not isinstance(values, dict):
        raise TypeError(
            f"Value '{values}' is expected to be a dictionary but is a {type(values).__name__}"
        )
    setters: list[NowSetter] = []
    kinds = dict(fields(message))
    for name, value in values.items():
        current = getattr(message, name)
        if expand_now and value == "auto" and type_of(current) == "std_msgs/Header":
            setters.append(partial(setattr, current, "stamp"))
        elif expand_now and value == "now" and type_of(current) == "builtin_interfaces/Time":
            setters.append(partial(setattr, message, name))
        elif hasattr(current, "SLOT_TYPES"):
            setters += fill(current, value, expand_now)
        else:
            setattr(message, name, field_value(current, value, kinds[name], expand_now, setters))
    return setters


def field_value(
    current: Any, value: Any, kind: Any, expand_now: bool, setters: list[NowSetter]
) -> Any:
    """A value for a field that is no message itself, in the type that the field has now."""
    if isinstance(current, np.ndarray):
        return np.array(value, dtype=current.dtype)
    if isinstance(current, array.array):
        return array.array(current.typecode, value)
    if isinstance(kind, idl.AbstractNestedType) and isinstance(kind.value_type, idl.NamespacedType):
        element_class = interface_class("/".join(kind.value_type.namespaced_name()), "msg")
        elements = [element_class() for _ in value]
        for element, its_values in zip(elements, value, strict=True):
            setters += fill(element, its_values, expand_now)
        return elements
    return value if type(value) is type(current) else type(current)(value)


def type_of(message: Any) -> str:
    """`package/Name` of a message; of anything else, something that is no message's."""
    return f"{type(message).__module__.split('.')[0]}/{type(message).__name__}"
