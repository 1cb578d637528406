"""Point the CMake targets exported by the ROS wheels at this virtual environment.

The wheels were built in a container and name its header directories, such as
`/opt/python/cp311-cp311/include/python3.11`, which CMake refuses because they do not exist here.
Run with the virtual environment's own Python.
"""

import re
import sys
import sysconfig
from pathlib import Path

BUILDER = re.compile(r"/opt/python/cp\d+-cp\d+t?/(?P<inside>[^;\"]+)")


def here(match: re.Match[str], numpy_include: str, python_include: str) -> str:
    """The directory of this installation that stands for one of the builder's."""
    return numpy_include if "/numpy/" in match["inside"] else python_include


def relocate(prefix: Path, numpy_include: str, python_include: str) -> int:
    """Rewrite every exported target below prefix/share; the number of files that changed."""
    changed = 0
    for path in prefix.glob("share/*/cmake/*.cmake"):
        text = path.read_text("utf-8")
        new = BUILDER.sub(lambda match: here(match, numpy_include, python_include), text)
        if new != text:
            path.write_text(new, "utf-8")
            changed += 1
    return changed


def main() -> None:
    """Relocate the wheels of the running interpreter's virtual environment."""
    import numpy

    changed = relocate(Path(sys.prefix), numpy.get_include(), sysconfig.get_path("include"))
    print(f"{changed} exported CMake targets pointed at {sys.prefix}")


if __name__ == "__main__":
    main()
