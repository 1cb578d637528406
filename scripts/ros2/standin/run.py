"""`ros2 run`: becomes the executable, so that signals and the exit code are the node's own."""

import argparse
import os
import shlex
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `ros2 run`."""
    parser.add_argument(
        "--prefix",
        help="command to put before the executable, quoted (e.g. --prefix 'gdb -ex run --args')",
    )
    parser.add_argument("package_name", help="name of the ROS package")
    parser.add_argument("executable_name", help="name of the executable")
    parser.add_argument("argv", nargs=argparse.REMAINDER, help="arguments for the executable")


def main(args: argparse.Namespace) -> str | None:
    """Replace this process by the executable; returns only when there is none."""
    executable = find_executable(args.package_name, args.executable_name)
    if executable is None:
        return "No executable found"
    command = [*shlex.split(args.prefix or ""), str(executable), *args.argv]
    os.execvp(command[0], command)


def package_prefix(package: str) -> Path | None:
    """The install prefix that holds a package, the first on AMENT_PREFIX_PATH."""
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if (Path(prefix) / "share/ament_index/resource_index/packages" / package).is_file():
            return Path(prefix)
    return None


def find_executable(package: str, name: str) -> Path | None:
    """The executable below lib/<package> of the package's prefix, None when there is none.

    Raises RuntimeError when there is no such package or more than one such executable.
    """
    prefix = package_prefix(package)
    if prefix is None:
        raise RuntimeError(f"Package '{package}' not found")
    found = [
        path
        for path in sorted((prefix / "lib" / package).rglob(name))
        if path.is_file()
        and os.access(path, os.X_OK)
        and not any(part.startswith(".") for part in path.parent.parts[-1:])
    ]
    if len(found) > 1:
        raise RuntimeError("Multiple executables found:" + "".join(f"\n- {path}" for path in found))
    return found[0] if found else None
