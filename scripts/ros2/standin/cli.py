"""Command line: imports only what a sub-command needs; exit codes are those of ros2cli."""

import argparse
import importlib
import signal
import sys
from collections.abc import Sequence
from typing import NamedTuple


class Command(NamedTuple):
    """A first-level command: its description and its verbs (none: the command itself does it)."""

    description: str
    verbs: dict[str, str]


COMMANDS = {
    "lifecycle": Command(
        "Various lifecycle related sub-commands",
        {
            "get": "Get lifecycle state for one or more nodes",
            "list": "Output a list of available transitions",
            "nodes": "Output a list of nodes with lifecycle",
            "set": "Trigger lifecycle state transition",
        },
    ),
    "node": Command(
        "Various node related sub-commands",
        {"info": "Output information about a node", "list": "Output a list of available nodes"},
    ),
    "param": Command(
        "Various param related sub-commands",
        {
            "describe": "Show descriptive information about declared parameters",
            "dump": "Show all of the parameters of a node in a YAML file format",
            "get": "Get parameter",
            "list": "Output a list of available parameters",
            "set": "Set parameter",
        },
    ),
    "run": Command("Run a package specific executable", {}),
    "service": Command(
        "Various service related sub-commands",
        {
            "call": "Call a service",
            "list": "Output a list of available services",
            "type": "Output a service's type",
        },
    ),
    "topic": Command(
        "Various topic related sub-commands",
        {
            "echo": "Output messages from a topic",
            "hz": "Print the average publishing rate to screen",
            "info": "Print information about a topic",
            "list": "Output a list of available topics",
            "pub": "Publish a message to a topic",
            "type": "Print a topic's type",
        },
    ),
}

ELSEWHERE = (
    "action",
    "bag",
    "component",
    "control",
    "daemon",
    "doctor",
    "interface",
    "launch",
    "multicast",
    "pkg",
    "security",
)


def main(argv: Sequence[str]) -> int | str | None:
    """Run one command; the value is for sys.exit: a code, or what to say on stderr with code 1."""
    if argv and argv[0] in ELSEWHERE:
        print(
            f"ros2: '{argv[0]}' is not in this stand-in for the ros2 command; a full installation "
            "of ROS 2 has it (https://docs.ros.org/en/jazzy/Installation.html)",
            file=sys.stderr,
        )
        return 2
    parser = build_parser(argv)
    args = parser.parse_args(argv)
    if "main" not in args:
        args.help_of.print_help()
        return 0
    if not args.use_python_default_buffering:
        sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    return run_guarded(args)


def run_guarded(args: argparse.Namespace) -> int | str | None:
    """Run the chosen verb; interrupts and errors become exit codes."""
    try:
        code: int | str | None = args.main(args)
    except KeyboardInterrupt:
        return int(signal.SIGINT)
    except BrokenPipeError:  # `ros2 topic echo ... | head`
        sys.stderr.close()
        return 1
    except RuntimeError as error:
        return str(error)
    except Exception as error:
        # Named, not imported: `run` must not wait for rclpy.
        if type(error).__name__ == "ExternalShutdownException":
            return int(signal.SIGTERM)
        raise
    return code


def build_parser(argv: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of all commands, with the arguments of the one that argv names."""
    parser = argparse.ArgumentParser(
        prog="ros2",
        description="ros2 is an extensible command-line tool for ROS 2.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--use-python-default-buffering",
        action="store_true",
        help="do not flush stdout at every line",
    )
    parser.set_defaults(help_of=parser)
    named = [argument for argument in argv if not argument.startswith("-")]
    commands = add_choices(
        parser, "ros2", {name: command.description for name, command in COMMANDS.items()}
    )
    for name, command in COMMANDS.items():
        command_parser = commands[name]
        command_parser.set_defaults(help_of=command_parser)
        if not named or named[0] != name:
            continue
        module = importlib.import_module(f"standin.{name}")
        if not command.verbs:
            module.add_arguments(command_parser)
            command_parser.set_defaults(main=module.main)
            continue
        module.add_shared_arguments(command_parser)
        verbs = add_choices(command_parser, f"ros2 {name}", command.verbs)
        for verb, verb_parser in verbs.items():
            if verb not in named[1:]:
                continue
            verb_parser.set_defaults(help_of=verb_parser, main=getattr(module, f"{verb}_main"))
            getattr(module, f"add_{verb}_arguments")(verb_parser)
    return parser


def add_choices(
    parser: argparse.ArgumentParser, program: str, descriptions: dict[str, str]
) -> dict[str, argparse.ArgumentParser]:
    """Sub-parsers below `parser`, one for each name, with their one-line descriptions."""
    width = max(map(len, descriptions))
    choices = parser.add_subparsers(
        title="Commands",
        description="\n".join(
            f"{name.ljust(width)}  {text}" for name, text in descriptions.items()
        ),
        metavar=f"Call `{program} <command> -h` for more detailed usage.",
    )
    return {
        name: choices.add_parser(
            name, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        for name, text in descriptions.items()
    }
