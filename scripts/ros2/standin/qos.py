"""Quality of service: the options of `topic echo` and `topic pub`, and what fits publishers."""

import argparse
from collections.abc import Iterator
from enum import Enum
from typing import TypeVar

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSLivelinessPolicy,
    QoSPresetProfiles,
    QoSProfile,
    QoSReliabilityPolicy,
)

from standin.arguments import Declare, argument

Policy = TypeVar("Policy", bound=Enum)

POLICIES = {
    "history": QoSHistoryPolicy,
    "reliability": QoSReliabilityPolicy,
    "durability": QoSDurabilityPolicy,
    "liveliness": QoSLivelinessPolicy,
}


def qos_arguments(default: str) -> Iterator[Declare]:
    """A preset profile, `default` unless named, and overrides of its policies."""
    yield argument(
        "--qos-profile",
        choices=QoSPresetProfiles.short_keys(),
        default=default,
        help="preset quality of service (default: %(default)s)",
    )
    other = "in place of the profile's"
    yield argument("--qos-depth", metavar="N", type=int, help=f"queue size, {other}")
    for name, policy in POLICIES.items():
        yield argument(f"--qos-{name}", choices=policy.short_keys(), help=f"{name}, {other}")
    what = f"liveliness lease duration, {other}"
    yield argument("--qos-liveliness-lease-duration-seconds", type=float, help=what)


def chosen_profile(args: argparse.Namespace) -> QoSProfile:
    """The profile that the options say."""
    profile = QoSPresetProfiles.get_from_short_key(args.qos_profile)
    for name, policy in POLICIES.items():
        key = getattr(args, f"qos_{name}")
        if key is not None:
            setattr(profile, name, policy.get_from_short_key(key))
    lease = args.qos_liveliness_lease_duration_seconds
    if lease is not None and lease >= 0.0:
        profile.liveliness_lease_duration = Duration(seconds=lease)
    if args.qos_depth is not None and args.qos_depth > 0:
        profile.depth = args.qos_depth
    elif profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL and profile.depth == 0:
        profile.depth = 1
    return profile


def is_overridden(args: argparse.Namespace) -> bool:
    """Whether any option other than the preset is given."""
    names = (*POLICIES, "depth", "liveliness_lease_duration_seconds")
    return any(getattr(args, f"qos_{name}") is not None for name in names)


def compatible_profile(node: Node, topic: str, preset: str) -> QoSProfile:
    """The preset, with reliability and durability such that every publisher is heard."""
    profile = QoSPresetProfiles.get_from_short_key(preset)
    offered = [endpoint.qos_profile for endpoint in node.get_publishers_info_by_topic(topic)]
    if offered:
        profile.reliability = strongest_common(
            [each.reliability for each in offered],
            QoSReliabilityPolicy.RELIABLE,
            QoSReliabilityPolicy.BEST_EFFORT,
        )
        profile.durability = strongest_common(
            [each.durability for each in offered],
            QoSDurabilityPolicy.TRANSIENT_LOCAL,
            QoSDurabilityPolicy.VOLATILE,
        )
    return profile


def strongest_common(offered: list[Policy], strong: Policy, weak: Policy) -> Policy:
    """The strong policy where every publisher offers it, else the weak one.

    Says so when only some offer the strong one.
    """
    if all(policy == strong for policy in offered):
        return strong
    if any(policy == strong for policy in offered):
        kind = f"QoS{type(strong).__name__}"
        print(
            f"Some, but not all, publishers are offering {kind}.{strong.name}. "
            f"Falling back to {kind}.{weak.name} as it will connect to all publishers"
        )
    return weak
