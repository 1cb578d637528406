"""Parameters that are given to a node and that it does not have: rclpy passes over them."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node

_OF_GROUP = 0.3
"""How alike a name of the same group must be: the group's name counts, too [-]."""


def refuse_unknown(node: Node, arguments: Sequence[str]) -> None:
    """Check that a node, which has declared its own, has every parameter that is given to it.

    What a file says about nodes of any name (`/**`) may be for another node and is let by.

    Args:
        node: has declared its parameters.
        arguments: its process's, without the program.

    Raises:
        ValueError: says which one is not there, and which are like it.
    """
    for name in given(node.get_name(), node.get_namespace(), arguments):
        if not node.has_parameter(name):
            known = [each.split("/")[-1] for each in node.get_parameters_by_prefix("")]
            raise ValueError(
                f"there is no parameter {name}; there is {', '.join(like(name, known))}"
            )


def like(name: str, known: Sequence[str]) -> list[str]:
    """Return the names of parameters that somebody may have meant by one that is not there.

    Those of the same group that are spelled alike, else any that are, else those that share a part
    with it between dots; all of them where there is none.
    """
    group = [each for each in known if each.startswith(name.split(".")[0] + ".")]
    return (
        difflib.get_close_matches(name, group, n=3, cutoff=_OF_GROUP)
        or difflib.get_close_matches(name, known, n=3)
        or [each for each in known if set(name.split(".")) & set(each.split("."))]
        or sorted(known)
    )


def given(name: str, namespace: str, arguments: Sequence[str]) -> Iterator[str]:
    """Yield the names of the parameters that a command line gives to a node.

    Args:
        name: of the node.
        namespace: of the node.
        arguments: `-p NAME:=VALUE`, `-p NODE:NAME:=VALUE`, `--params-file FILE` behind
            `--ros-args`.
    """
    ros = False
    for option, value in pairwise(arguments):
        ros = option == "--ros-args" or (ros and option != "--")
        if ros and option in ("-p", "--param"):
            node, _, parameter = value.partition(":=")[0].rpartition(":")
            if node in ("", name):
                yield parameter
        elif ros and option == "--params-file":
            yield from _in_file(Path(value), {name, f"{namespace.rstrip('/')}/{name}"})


def _in_file(path: Path, names: set[str]) -> Iterator[str]:
    """Yield the parameters that a file, which rcl has read already, has for a node by its name."""
    for node, section in (yaml.safe_load(path.read_text("utf-8")) or {}).items():
        if node in names:
            yield from _flat((section or {}).get("ros__parameters") or {})


def _flat(section: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in section.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"
