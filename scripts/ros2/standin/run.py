"""`ros2 run`: becomes the executable, so that signals and the exit code are the node's own."""

import argparse
import os
import shlex
from pathlib import Path

from standin.ament import executables
from standin.arguments import argument, takes


@takes(
    argument(
        "--prefix",
        help="command to put before the executable, quoted (e.g. --prefix 'gdb -ex run --args')",
    ),
    argument("package_name", help="name of the ROS package"),
    argument("executable_name", help="name of the executable"),
    argument("argv", nargs=argparse.REMAINDER, help="arguments for the executable"),
)
def main(args: argparse.Namespace) -> str | None:
    """Replace this process by the executable; returns only when there is none."""
    executable = find_executable(args.package_name, args.executable_name)
    if executable is None:
        return "No executable found"
    command = [*shlex.split(args.prefix or ""), str(executable), *args.argv]
    os.execvp(command[0], command)


def find_executable(package: str, name: str) -> Path | None:
    """The executable of this name in the package, None when there is none.

    Raises RuntimeError when there is no such package or more than one such executable.
    """
    of_package = executables(package)
    if of_package is None:
        raise RuntimeError(f"Package '{package}' not found")
    found = [path for path in of_package if path.name == name]
    if len(found) > 1:
        raise RuntimeError("Multiple executables found:" + "".join(f"\n- {path}" for path in found))
    return found[0] if found else None
