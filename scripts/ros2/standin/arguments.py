"""Numbers on the command line, checked where they are read."""

import argparse
import sys


def positive_float(text: str) -> float:
    """A number greater than zero."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError("Expects a floating point number") from None
    if not value > 0.0:
        raise argparse.ArgumentTypeError("Value must be positive")
    return value


def positive_int(text: str) -> int:
    """A whole number greater than zero."""
    return whole_number(text, 1, "value must be a positive integer")


def non_negative_int(text: str) -> int:
    """A whole number, zero or greater."""
    return whole_number(text, 0, "value must be non-negative integer")


def whole_number(text: str, least: int, complaint: str) -> int:
    """A whole number of at least `least`."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(complaint) from None
    if value < least:
        raise argparse.ArgumentTypeError(complaint)
    return value


def given_values(args: argparse.Namespace) -> str | bytes:
    """The YAML of a message or request, from the command line or from standard input."""
    return sys.stdin.buffer.read() if args.stdin else args.values
