"""Command lines: `--set NODE.PARAMETER=VALUE`, parameter files, help that says defaults."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import yaml

from husky_bringup.system import ParameterValue

Settings = dict[str, dict[str, ParameterValue]]
"""Values by node and parameter."""

_TRUE, _FALSE = ("y", "yes", "true", "on"), ("n", "no", "false", "off")
_INTEGER = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)")
_OCTAL = re.compile(r"[+-]?0[0-7]+")
_NUMBER = re.compile(
    r"[+-]?(([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|\.?(inf|Inf|INF)|\.?(nan|NaN|NAN))"
)


def read_value(text: str) -> bool | int | float | str:
    """Read a value as rcl reads it behind `-p NAME:=` (rcl_yaml_param_parser, `get_value`).

    Raises:
        ValueError: nothing, a list or a map, or a quote that nothing ends.
    """
    if text[:1] in ("'", '"'):
        try:
            return str(yaml.safe_load(text))
        except yaml.YAMLError:
            raise ValueError(f"{text} begins with a quote and does not end with one") from None
    if text[:1] in ("", "[", "{"):
        raise ValueError(f"{text!r} is no number, text, true or false; a text may be in quotes")
    if text in (text.lower(), text.upper(), text.capitalize()):
        if text.lower() in _TRUE:
            return True
        if text.lower() in _FALSE:
            return False
    if _INTEGER.fullmatch(text):
        try:
            number = int(text, 8 if _OCTAL.fullmatch(text) else 0)
            return number if -(2**63) <= number < 2**63 else float(number)
        except (OverflowError, ValueError):  # beyond a double; more digits than Python reads
            raise ValueError(f"{text[:20]}... is too large a number") from None
    if _NUMBER.fullmatch(text):
        return float(re.sub(r"\.(?=[a-zA-Z])", "", text))
    return text


def parse_setting(text: str) -> tuple[str, str, ParameterValue]:
    """Read `NODE.PARAMETER=VALUE`.

    Raises:
        argparse.ArgumentTypeError: anything else.
    """
    target, equals, value = text.partition("=")
    node, dot, parameter = target.partition(".")
    if not (equals and dot and node and parameter):
        raise argparse.ArgumentTypeError(f"{text!r} is not NODE.PARAMETER=VALUE")
    try:
        return node, parameter, read_value(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{target}: {error}") from None


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Says the default of each option that has one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default is None or action.default is False or action.default == []:
            return action.help
        return super()._get_help_string(action)


def add_set_option(parser: argparse.ArgumentParser, help_text: str) -> None:
    """Declare `--set NODE.PARAMETER=VALUE`, a list of what `parse_setting` returns."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=parse_setting,
        metavar="NODE.PARAMETER=VALUE",
        help=help_text,
    )


def collect(settings: Sequence[tuple[str, str, ParameterValue]]) -> Settings:
    """Sort single settings by node."""
    result: Settings = {}
    for node, parameter, value in settings:
        result.setdefault(node, {})[parameter] = value
    return result


def nodes_of_file(path: Path) -> set[str]:
    """Return which nodes a ROS parameter file names, without namespaces and patterns.

    Raises:
        ValueError: it is not; says why.
    """
    wanted = "a parameter file has NODE: {ros__parameters: {NAME: VALUE}}"
    try:
        content = yaml.safe_load(path.read_text("utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = " ".join(str(error).split())
        raise ValueError(f"{path} is no YAML in UTF-8: {where}") from error
    if not isinstance(content, dict) or not content:
        raise ValueError(f"{path} {'is empty' if content is None else 'has no nodes'}: {wanted}")
    names = set()
    for name, section in content.items():
        found = _nodes_below(str(name), section)
        if found is None:
            raise ValueError(f"{path}: {name} has no ros__parameters: {wanted}")
        names |= found
    return {name for name in names if "*" not in name}


def _nodes_below(name: str, section: object) -> set[str] | None:
    """Return the nodes of a section: its own, or those of a namespace; None if there are none."""
    if not (isinstance(section, dict) and section):
        return None
    if "ros__parameters" in section:
        return {name.rpartition("/")[2]} if isinstance(section["ros__parameters"], dict) else None
    below = [_nodes_below(str(each), inner) for each, inner in section.items()]
    return None if None in below else {found for names in below for found in names or ()}
