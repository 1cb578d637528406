"""Experiments through the full graph in lockstep: one file each, with its script and criteria.

A module here is an experiment: its docstring says what it shows, `add_options` declares its command
line, `run` drives the graph and states what must hold.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
from typing import Protocol

from husky_experiments.run import Run


class Experiment(Protocol):
    """What a module in this package offers."""

    __doc__: str

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Declare the experiment's own options."""

    def run(self, run: Run) -> None:
        """Drive the graph, fill the metrics, state the criteria."""


def names() -> list[str]:
    """Return the names of all experiments."""
    return sorted(
        module.name for module in pkgutil.iter_modules(__path__) if module.name != "__main__"
    )


def find(name: str) -> Experiment:
    """Return an experiment by name.

    Raises:
        LookupError: there is none of that name; lists those there are.
    """
    if name not in names():
        raise LookupError(f"no experiment {name!r}; there are {', '.join(names())}")
    module: Experiment = importlib.import_module(f"{__name__}.{name}")  # type: ignore[assignment]
    return module
