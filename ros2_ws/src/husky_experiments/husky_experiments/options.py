"""Command line of an experiment: the options that all have, and its own."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from husky_bringup.bringup import add_bus_option
from husky_bringup.settings import HelpFormatter, add_set_option, collect
from husky_experiments import catalogue
from husky_experiments.run import frame_frequency
from husky_runtime import graph


def parse_options(
    name: str,
    arguments: Sequence[str],
    kind: type[argparse.ArgumentParser] = argparse.ArgumentParser,
) -> argparse.Namespace:
    """Return the options of an experiment.

    Args:
        name: of the experiment.
        arguments: of its command line, without the name.
        kind: class of the parser, whose `error` reports a wrong command line.

    Raises:
        LookupError: there is no experiment of that name.
    """
    experiment = catalogue.find(name)
    parser = kind(
        prog=f"scripts/experiment.sh {name}",
        description=experiment.__doc__,
        formatter_class=HelpFormatter,
        conflict_handler="resolve",  # an experiment may take other values of an option
    )
    parser.add_argument("--output", type=Path, default=Path("out") / name, help="result directory")
    parser.add_argument("--no-video", action="store_true", help="do not render a video")
    parser.add_argument("--no-figures", action="store_true", help="do not draw figures")
    parser.add_argument(
        "--compliance",
        type=frame_frequency,
        metavar="HZ",
        help="eigenfrequency of the frame, 10 to 40, 0 for stiff (default: the robot's file)",
    )
    add_bus_option(parser)
    add_set_option(parser, "after the experiment's own parameters; may be given many times")
    experiment.add_options(parser)
    options = parser.parse_args(arguments)
    plant = collect(options.set).get(graph.PLANT, {})
    if options.compliance is not None and "frame_frequency" in plant:
        parser.error("argument --compliance: --set plant.frame_frequency is given too")
    return options
