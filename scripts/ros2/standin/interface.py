"""`ros2 interface`: messages, services and actions that are installed, and how they are defined."""

import argparse
import sys
from collections.abc import Iterator

from standin.ament import interface_file, interfaces, package_prefix, resources
from standin.arguments import argument, flag, one_of, takes

TITLES = {"msg": "Messages", "srv": "Services", "action": "Actions"}
KINDS = (
    flag("-m", "--only-msgs", dest="msg", help="only messages"),
    flag("-s", "--only-srvs", dest="srv", help="only services"),
    flag("-a", "--only-actions", dest="action", help="only actions"),
)


def chosen_kinds(args: argparse.Namespace) -> list[str]:
    """The kinds that the options name, all when they name none."""
    return [kind for kind in TITLES if getattr(args, kind)] or list(TITLES)


def of_kind(package: str, kind: str) -> list[str]:
    """Full names of a package's interfaces of one kind."""
    return [f"{package}/{name}" for name in interfaces(package) if name.startswith(f"{kind}/")]


# ------------------------------------------------------------------ list, package, packages
@takes(*KINDS)
def list_main(args: argparse.Namespace) -> None:
    """Print all interfaces that are installed."""
    packages = sorted(resources("rosidl_interfaces"))
    for kind in chosen_kinds(args):
        print(f"{TITLES[kind]}:")
        for package in packages:
            for name in of_kind(package, kind):
                print(f"    {name}")


@takes(*KINDS, argument("package_name", help="name of the package (e.g. 'std_msgs')"))
def package_main(args: argparse.Namespace) -> str | None:
    """Print the interfaces of one package."""
    if package_prefix(args.package_name) is None:
        return f"Unknown package '{args.package_name}'"
    for kind in chosen_kinds(args):
        for name in of_kind(args.package_name, kind):
            print(name)
    return None


@takes(*KINDS)
def packages_main(args: argparse.Namespace) -> None:
    """Print the packages that have interfaces; with options, of the first kind that they name."""
    packages = sorted(resources("rosidl_interfaces"))
    kinds = [kind for kind in TITLES if getattr(args, kind)]
    for package in packages:
        if not kinds or of_kind(package, kinds[0]):
            print(package)


# ------------------------------------------------------------------ show, proto
class TypeOrPipe(argparse.Action):
    """A type's name; `-` reads it from standard input, as after `ros2 topic type /tf |`."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        """Store the name."""
        name = str(values)
        if name == "-":
            if sys.stdin.isatty():
                parser.error("expected stdin pipe")
            name = sys.stdin.readline().strip()
        if not name:
            parser.error("the passed value is empty")
        setattr(namespace, self.dest, name)


@takes(
    one_of(
        flag("--all-comments", help="show the comments of nested types as well"),
        flag("--no-comments", help="show no comments and no empty lines"),
    ),
    argument(
        "type",
        action=TypeOrPipe,
        help="name of the type (e.g. 'std_msgs/msg/String'); '-' reads it from standard input",
    ),
)
def show_main(args: argparse.Namespace) -> str | None:
    """Print a definition; below each field of a type of its own that type's, indented."""
    try:
        for line in definition(args.type, not args.no_comments, args.all_comments):
            print(line)
    except (ValueError, LookupError) as error:
        return str(error)
    return None


def definition(identifier: str, comments: bool, nested_comments: bool) -> Iterator[str]:
    """Lines of a definition, nested ones indented by tabs.

    Raises ValueError or LookupError when there is no such interface or it cannot be read.
    """
    from rosidl_adapter.parser import InvalidSpecification, parse_message_string

    path = interface_file(identifier)
    package, _, name = identifier.split("/")
    if path.suffix == ".idl":
        raise LookupError(f"Only the IDL of {identifier} is installed: {path}")
    for raw in path.read_text("utf-8").splitlines():
        line = raw.rstrip()
        if line == "---":
            yield line
            continue
        try:
            spec = parse_message_string(package, name, line)
        except InvalidSpecification as error:
            raise ValueError(f"{path}: {type(error).__name__}: {error}") from None
        members = [*spec.fields, *spec.constants]
        if comments:
            yield line
        elif line and not spec.annotations["comment"]:
            yield without_comment(line, members[0].annotations["comment"] if members else [])
        for field in spec.fields:
            if not field.type.is_primitive_type():
                nested = f"{field.type.pkg_name}/msg/{field.type.type}"
                for inner in definition(nested, nested_comments, nested_comments):
                    yield f"\t{inner}" if inner else inner


def without_comment(line: str, comment: list[str]) -> str:
    """A line up to its comment, as ros2cli cuts it: one character before the comment's words.

    Where a blank follows the #, that leaves the # (and a unit alone in brackets, which the parser
    does not count as a comment).
    """
    return line[: line.find(comment[0]) - 1].strip() if comment else line


@takes(
    argument("type", help="name of the type (e.g. 'std_msgs/msg/String')"),
    flag("--no-quotes", help="without quotes around it"),
)
def proto_main(args: argparse.Namespace) -> str | None:
    """Print a message, request or goal of default values as YAML, to be edited and sent."""
    from standin.messages import Shortening, interface_class, to_yaml

    kind = args.type.split("/")[1] if args.type.count("/") == 2 else "msg"
    try:
        found = interface_class(args.type, kind)
    except ValueError as error:
        return str(error)
    part = {"srv": "Request", "action": "Goal"}.get(kind)
    text = to_yaml((getattr(found, part) if part else found)(), Shortening())
    print(text if args.no_quotes else f'"{text}"')
    return None
