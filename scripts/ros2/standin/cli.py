"""Command line: imports only what a sub-command needs; exit codes are those of ros2cli."""

import argparse
import importlib
import signal
import sys
from collections.abc import Sequence

from standin.commands import COMMANDS, missing


def main(argv: Sequence[str]) -> int | str | None:
    """Run one command; the value is for sys.exit: a code, or what to say on stderr with code 1."""
    named = [argument for argument in argv if not argument.startswith("-")]
    if sentence := missing(named):
        print(sentence, file=sys.stderr)
        return 2
    parser = build_parser(named)
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


def build_parser(named: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of all commands, with the arguments of the one that the words named name."""
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
    commands = add_choices(
        parser, "ros2", {name: command.description for name, command in COMMANDS.items()}
    )
    for name, command in COMMANDS.items():
        command_parser = commands[name]
        command_parser.set_defaults(help_of=command_parser)
        if not named or named[0] != name:
            continue
        if not command.verbs:
            add_main(command_parser, command.module or name, "main")
            continue
        for declare in command.shared:
            declare(command_parser)
        verbs = add_choices(command_parser, f"ros2 {name}", command.verbs)
        for verb, verb_parser in verbs.items():
            if verb in named[1:]:
                verb_parser.set_defaults(help_of=verb_parser)
                add_main(verb_parser, command.apart.get(verb, name), f"{verb}_main")
    return parser


def add_main(parser: argparse.ArgumentParser, module: str, function: str) -> None:
    """Let a parser run a function of a module, with the arguments that this takes."""
    main = getattr(importlib.import_module(f"standin.{module}"), function)
    parser.set_defaults(main=main)
    for declare in main.arguments:
        declare(parser)


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
