"""Campaign file: a matrix of an experiment's options, and the runs that it stands for."""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from husky_experiments.options import parse_options

SEED = "seed"
"""Option that tells runs of the same conditions apart."""
KEEP = ("failed", "all", "none")
"""Runs whose bags and videos stay."""
RETRY = ("failed", "errors", "never")
"""Runs that are tried once more: failed ones; those that did not come to a result; none."""
_RESERVED = ("output", "no-video", "no-figures", "set", "help")
"""Options that a campaign gives itself; `set` is written NODE.PARAMETER."""
_KEYS = ("title", "experiment", "matrix", "metrics", "keep", "retry", "timeout")
_MOST_RUNS = 100_000
_LONGEST_NAME = 80

Scalar = bool | int | float | str | None
Value = Scalar | tuple[Scalar, ...]
"""Of an option: a tuple for one that takes several arguments, None for its default."""


class CampaignError(ValueError):
    """A campaign cannot be run as it is written; says what is wrong and what is allowed."""


@dataclass(frozen=True)
class PlannedRun:
    """One run of a campaign.

    Attributes:
        row: its place in the matrix and the table, from 0.
        experiment: name of the experiment.
        options: value by option, as the file names them; NODE.PARAMETER for a node's parameter.
        arguments: the same as a command line.
        label: the options that differ between runs, as a file name.
    """

    row: int
    experiment: str
    options: Mapping[str, Value]
    arguments: tuple[str, ...]
    label: str

    @property
    def key(self) -> str:
        """Digest of experiment and options: equal for the same run of an edited file."""
        each = [list(_arguments({name: value})) for name, value in sorted(self.options.items())]
        text = json.dumps([self.experiment, [arguments for arguments in each if arguments]])
        return hashlib.sha256(text.encode()).hexdigest()[:10]

    @property
    def name(self) -> str:
        """Name of the directory of its results."""
        return f"{self.label}-{self.key}"

    @property
    def command(self) -> str:
        """The command that does the same outside of a campaign."""
        return shlex.join(("scripts/experiment.sh", self.experiment, *self.arguments))


@dataclass(frozen=True)
class Policy:
    """Rules for the runs of a campaign.

    Attributes:
        keep: one of `KEEP`.
        retry: one of `RETRY`.
        timeout: wall time after which a run is ended [s].
    """

    keep: str = KEEP[0]
    retry: str = RETRY[0]
    timeout: float = 7200.0


@dataclass(frozen=True)
class Campaign:
    """A campaign file that has been read.

    Attributes:
        title: one line on it.
        experiment: name of the experiment.
        runs: all runs, in the order of the matrix.
        varied: options that differ between runs.
        metrics: those that page and figures show; none for the values of the criteria.
        policy: rules for all runs.
    """

    title: str
    experiment: str
    runs: tuple[PlannedRun, ...]
    varied: tuple[str, ...]
    metrics: tuple[str, ...]
    policy: Policy

    @property
    def conditions(self) -> tuple[str, ...]:
        """Options that differ between runs, without the seed."""
        return tuple(name for name in self.varied if name != SEED)


def read_campaign(source: Path | str | Mapping[str, Any]) -> Campaign:
    """Read a campaign.

    Args:
        source: a file, or what it holds.

    Raises:
        CampaignError: it is none, or its experiment refuses a run.
    """
    if isinstance(source, Mapping):
        return _campaign(source, "campaign")
    path = Path(source)
    try:
        content = YAML(typ="safe", pure=True).load(path.read_text("utf-8"))
    except (YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise CampaignError(f"{path} is not valid YAML: {' '.join(str(error).split())}") from error
    except OSError as error:
        raise CampaignError(f"{path}: {error.strerror}") from error
    try:
        return _campaign(content, path.stem)
    except CampaignError as error:
        raise CampaignError(f"{path}: {error}") from error


def _campaign(content: Any, title: str) -> Campaign:
    if not isinstance(content, Mapping) or not {"experiment", "matrix"} <= content.keys():
        raise CampaignError("a campaign has the keys experiment and matrix")
    if unknown := [key for key in content if key not in _KEYS]:
        raise CampaignError(f"unknown key {unknown[0]!r}; there are {', '.join(_KEYS)}")
    experiment = str(content["experiment"])
    blocks = content["matrix"]
    blocks = blocks if isinstance(blocks, list) else [blocks]
    conditions = [options for block in blocks for options in _combinations(block)]
    if not conditions:
        raise CampaignError("matrix: no runs")
    runs = _plan(experiment, conditions)
    return Campaign(
        title=str(content.get("title") or title),
        experiment=experiment,
        runs=runs,
        varied=_varied(conditions),
        metrics=_names(content.get("metrics", [])),
        policy=Policy(
            _choice(content, "keep", KEEP), _choice(content, "retry", RETRY), _timeout(content)
        ),
    )


# The matrix -------------------------------------------------------------------------------------
def _combinations(block: Any) -> Iterator[dict[str, Value]]:
    """Yield every combination of a block's values, the last option changing fastest."""
    if not isinstance(block, Mapping) or not block:
        raise CampaignError("matrix: a mapping of options to values is needed, or a list of those")
    values = {
        str(name).replace("_", "-") if "." not in str(name) else str(name): v
        for name, v in block.items()
    }
    if wrong := [name for name in values if not re.fullmatch(r"[\w.-]+", name)]:
        raise CampaignError(f"matrix: {wrong[0]!r} is no name of an option")
    if reserved := [name for name in values if name in _RESERVED]:
        hint = " (write NODE.PARAMETER: value)" if reserved[0] == "set" else ""
        raise CampaignError(f"matrix: {reserved[0]} is set by the campaign itself{hint}")
    lists = {name: _each(name, value) for name, value in values.items()}
    count = 1
    for name, each in lists.items():
        count *= len(each)
        if count > _MOST_RUNS:
            raise CampaignError(f"matrix: more than {_MOST_RUNS} runs with {name}")
    for chosen in itertools.product(*lists.values()):
        yield dict(zip(lists, chosen, strict=True))


def _each(name: str, value: Any) -> list[Value]:
    """Return the values that an option takes: one, those of a list, or those of a range."""
    if isinstance(value, Mapping):
        return _range(name, value)
    if not isinstance(value, list):
        return [_scalar(name, value)]
    if not value:
        raise CampaignError(f"matrix: {name} has an empty list")
    if "." in name and any(isinstance(each, list) for each in value):
        raise CampaignError(f"matrix: {name}: a node's parameter takes one value in a run, no list")
    return [
        tuple(_scalar(name, part) for part in each)
        if isinstance(each, list)
        else _scalar(name, each)
        for each in value
    ]


def _range(name: str, value: Mapping[str, Any]) -> list[Value]:
    """Return from, from + step, ... up to and with `to`."""
    numbers = [value.get("from"), value.get("to"), value.get("step", 1)]
    if not value.keys() <= {"from", "to", "step"} or not all(
        isinstance(n, int | float) and not isinstance(n, bool) for n in numbers
    ):
        raise CampaignError(f"matrix: {name}: a range has the numbers from, to and, if not 1, step")
    first, last, step = numbers
    if not (step > 0 and last >= first and last - first < _MOST_RUNS * step):
        raise CampaignError(
            f"matrix: {name}: from {first} to {last} by {step} is no range; step must be above 0, "
            f"to at least from, and no more than {_MOST_RUNS} values between"
        )
    steps = int((last - first) / step + 1e-9)
    if all(isinstance(n, int) for n in numbers):
        return [first + i * step for i in range(steps + 1)]
    return [round(float(first + i * step), 12) for i in range(steps + 1)]


def _scalar(name: str, value: Any) -> Scalar:
    if isinstance(value, str) and not value.isprintable():
        raise CampaignError(f"matrix: {name}: {value!r} has characters that cannot be printed")
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise CampaignError(f"matrix: {name}: {value!r} is no number, text, true or false")


def _varied(conditions: list[dict[str, Value]]) -> tuple[str, ...]:
    """Return the options that differ between runs, in the order of the file."""
    names = dict.fromkeys(name for options in conditions for name in options)
    return tuple(name for name in names if len({options.get(name) for options in conditions}) > 1)


# Runs -------------------------------------------------------------------------------------------
class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line as a CampaignError; knows options by their full names alone."""

    def __init__(self, **settings: Any):
        super().__init__(**settings, allow_abbrev=False)

    def error(self, message: str) -> NoReturn:
        raise CampaignError(message)


def _plan(experiment: str, conditions: list[dict[str, Value]]) -> tuple[PlannedRun, ...]:
    """Return the runs, each one accepted by the experiment's own command line."""
    varied, runs, rows = _varied(conditions), [], dict[str, int]()
    for row, options in enumerate(conditions):
        arguments = tuple(_arguments(options))
        try:
            parse_options(experiment, arguments, _Parser)
        except LookupError as error:
            raise CampaignError(str(error)) from error
        except CampaignError as error:
            raise CampaignError(f"row {row} ({shlex.join(arguments)}): {error}") from error
        run = PlannedRun(row, experiment, options, arguments, _label(options, varied))
        if (first := rows.setdefault(run.key, row)) != row:
            raise CampaignError(f"rows {first} and {row} are the same run: {run.command}")
        runs.append(run)
    return tuple(runs)


def _arguments(options: Mapping[str, Value]) -> Iterator[str]:
    """Yield the command line of a run; an option that is false or null is left out."""
    for name, value in options.items():
        if "." in name:
            yield f"--set={name}={_text(value)}"
        elif isinstance(value, tuple):
            yield from (f"--{name}", *map(_text, value))
        elif value is True:
            yield f"--{name}"
        elif value is not None and value is not False:
            yield f"--{name}={_text(value)}"


def _text(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _label(options: Mapping[str, Value], varied: tuple[str, ...]) -> str:
    """Return what tells a run from the others, fit for a file name and an address."""
    parts = [f"{name}_{_text(value)}" for name, value in options.items() if name in varied]
    label = re.sub(r"[^A-Za-z0-9._]+", "_", "_".join(parts) or "run")
    return label[:_LONGEST_NAME].strip("_.")


# The other keys ---------------------------------------------------------------------------------
def _choice(content: Mapping[str, Any], key: str, allowed: tuple[str, ...]) -> str:
    value = content.get(key, allowed[0])
    if value not in allowed:
        raise CampaignError(f"{key}: {value!r} is not one of {', '.join(allowed)}")
    return str(value)


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise CampaignError("metrics: a list of names of metrics is needed")
    return tuple(value)


def _timeout(content: Mapping[str, Any]) -> float:
    value = content.get("timeout", Policy.timeout)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e9:
        raise CampaignError(f"timeout: {value!r} is no time above 0 and below 1e9 [s]")
    return float(value)
