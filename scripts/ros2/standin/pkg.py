"""`ros2 pkg`: which packages are installed, where, and what they bring."""

import argparse
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from standin.ament import executables, package_prefix, resources
from standin.arguments import argument, flag, takes

NOT_FOUND = "Package not found"
PACKAGE_NAME = argument("package_name", help="name of the package")


@takes()
def list_main(_: argparse.Namespace) -> None:
    """Print the names of all packages in order."""
    for name in sorted(resources("packages")):
        print(name)


@takes(
    argument("package_name", nargs="?", help="name of the package (default: all)"),
    flag("--full-path", help="show where they are"),
)
def executables_main(args: argparse.Namespace) -> None:
    """Print what `ros2 run` can run."""
    for package in [args.package_name] if args.package_name else sorted(resources("packages")):
        paths = executables(package)
        if paths is None:
            raise RuntimeError(f"Package '{package}' not found")
        for path in paths:
            print(path if args.full_path else f"{package} {path.name}")


@takes(PACKAGE_NAME, flag("--share", help="show the package's share directory"))
def prefix_main(args: argparse.Namespace) -> str | None:
    """Print where a package is installed."""
    prefix = package_prefix(args.package_name)
    if prefix is None:
        return NOT_FOUND
    print(share(prefix, args.package_name) if args.share else prefix)
    return None


@takes(PACKAGE_NAME, argument("-t", "--tag", help="only the text of this element (e.g. 'version')"))
def xml_main(args: argparse.Namespace) -> str | None:
    """Print a package's manifest, or the text of one kind of its elements."""
    prefix = package_prefix(args.package_name)
    if prefix is None:
        return NOT_FOUND
    manifest = share(prefix, args.package_name) / "package.xml"
    if not manifest.is_file():
        return "Package XML manifest not found"
    tree = ElementTree.parse(manifest)
    if args.tag is None:
        ElementTree.dump(tree)
        return None
    elements = tree.getroot().findall(args.tag)
    for element in elements:
        print(element.text)
    return None if elements else "XML tag not found"


def share(prefix: Path, package: str) -> Path:
    """The directory of a package's files that are no programs."""
    return prefix / "share" / package
