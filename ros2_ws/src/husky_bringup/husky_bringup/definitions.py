"""Definitions of messages as a bag holds them: whole, with the comments that tell their units."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

_RULE = "=" * 80
_HALVES = re.compile(r"^---[ \t]*\n", re.MULTILINE)
_WORDS = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
"""Types whose names differ in Python's interfaces and in `.msg` files."""


class UnknownTypeError(LookupError):
    """A type of messages that is not installed here; says which and why."""


class Definitions:
    """What is installed of interfaces, read when it is first asked for.

    Attributes:
        typestore: the types that have been asked for, as rosbags knows them.
    """

    def __init__(self) -> None:
        """Know no type yet."""
        self.typestore: Any = get_typestore(Stores.EMPTY)
        self._texts: dict[str, str] = {}

    def text(self, message_type: str) -> str:
        """Return the definition of a type, and of all that it is made of, as rosbag2 writes it.

        Args:
            message_type: e.g. "sensor_msgs/msg/Imu"; or half of a service,
                "std_srvs/srv/Trigger_Request" or "..._Response".

        Raises:
            UnknownTypeError: there is no such type, or none that can be read.
        """
        first, *others = self._closure(message_type)
        parts = [self._texts[first]]
        parts += [
            f"{_RULE}\nMSG: {each.replace('/msg/', '/')}\n{self._texts[each]}" for each in others
        ]
        return "\n".join(parts)

    def _closure(self, message_type: str) -> list[str]:
        """Return a type and the types that it is made of, each once."""
        found = [message_type]
        for each in found:  # which grows
            self._learn(each)
            _, fields = self.typestore.fielddefs[_to_rosbags(each)]
            for _, field in fields:
                found += [name for name in _names(field) if name not in found]
        return found

    def _learn(self, message_type: str) -> None:
        if message_type in self._texts:
            return
        try:
            text = _installed(message_type)
            self.typestore.register(get_types_from_msg(text, _to_rosbags(message_type)))
        except Exception as error:  # of whatever somebody's package does when it is imported
            raise UnknownTypeError(f"{message_type}: {error}") from error
        self._texts[message_type] = text


def message_class(message_type: str) -> Any:
    """Return the class of a type such as "sensor_msgs/msg/Imu", with its type support loaded.

    Raises:
        ImportError, AttributeError: there is none.
        ValueError: it is no message.
    """
    package, kind, name = message_type.split("/")
    if kind != "msg":
        raise ValueError(f"{message_type} is no message")
    found = getattr(importlib.import_module(f"{package}.msg"), name)
    found.__class__.__import_type_support__()
    return found


def _installed(message_type: str) -> str:
    """Return the definition of a type as its file has it; without one, what its class tells."""
    package, kind, name = message_type.split("/")
    try:
        share = Path(get_package_share_directory(package), kind)
        if kind == "msg":
            return (share / f"{name}.msg").read_text("utf-8")
        service, _, half = name.rpartition("_")
        halves = _HALVES.split((share / f"{service}.srv").read_text("utf-8"))
        return halves[("Request", "Response").index(half)]
    except (PackageNotFoundError, OSError):
        fields = _class_of(package, kind, name).get_fields_and_field_types()
        return "".join(f"{_as_msg(what)} {field}\n" for field, what in fields.items())


def _to_rosbags(message_type: str) -> str:
    """Return a type's name as rosbags knows it, for which all are messages."""
    return message_type.replace("/srv/", "/msg/")


def _class_of(package: str, kind: str, name: str) -> Any:
    """Return the class of a message, or of half a service."""
    if kind == "msg":
        return message_class(f"{package}/{kind}/{name}")
    service, _, half = name.rpartition("_")
    return getattr(getattr(importlib.import_module(f"{package}.{kind}"), service), half)


def _as_msg(what: str) -> str:
    """Return a field's type as a `.msg` file has it."""
    if match := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", what):
        return f"{_as_msg(match[1])}[{f'<={match[2]}' if match[2] else ''}]"
    if match := re.fullmatch(r"(.+)\[(\d+)\]", what):
        return f"{_as_msg(match[1])}[{match[2]}]"
    if match := re.fullmatch(r"(w?string)<(\d+)>", what):
        return f"{match[1]}<={match[2]}"
    return _WORDS.get(what, what)


def _names(field: Any) -> Iterator[str]:
    """Yield the message types in a field of rosbags."""
    kind, inner = field
    if kind == Nodetype.NAME:
        yield inner
    elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        yield from _names(inner[0])
