"""`python -m husky_bringup.parameter_file`: parameters of every node, as one ROS parameter file.

For nodes that something else starts, such as a container engine: each reads the same file, and what
is in it comes from the same table as the command lines of `scripts/bringup.sh`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from husky_bringup.bringup import add_robot_options, robot_of
from husky_bringup.system import NodeSpec, to_yaml


def parameter_file(specs: Sequence[NodeSpec]) -> str:
    """Return the text of a parameter file for these nodes."""
    lines: list[str] = []
    for spec in specs:
        if spec.parameters:
            lines += [f"{spec.name}:", "  ros__parameters:"]
            lines += [f"    {name}: {to_yaml(value)}" for name, value in spec.parameters.items()]
    return "".join(f"{line}\n" for line in lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the file."""
    parser = argparse.ArgumentParser(prog="python -m husky_bringup.parameter_file")
    add_robot_options(parser)
    options = parser.parse_args(arguments)
    try:
        print(parameter_file(robot_of(options)), end="")
    except ValueError as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
