"""`ros2 doctor`: what is wrong with the graph, above all quality of service that does not match."""

import argparse
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.utilities import get_rmw_implementation_identifier

from standin.arguments import NODE, flag, one_of, takes
from standin.graph import discover, graph_node, topics

OF_EVERY_NODE = ("/parameter_events", "/rosout")  # topics that are there without a listener
LOOPBACK, MULTICAST = 0x8, 0x1000  # flags of a network interface, linux/if.h

Items = list[tuple[str, object]]


class Finding(NamedTuple):
    """Something that is not as it should be; a warning alone does not fail a check."""

    is_error: bool
    text: str


@takes(
    one_of(
        flag("--report", "-r", help="print all reports"),
        flag("--report-failed", "-rf", help="print reports of failed checks only"),
    ),
    flag("--exclude-packages", "-ep", help="has no effect: none are checked"),
    flag("--include-warnings", "-iw", help="count warnings as failures, and name each topic"),
    *NODE,
)
def main(args: argparse.Namespace) -> None:
    """Print reports, or what the checks found."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        if args.report:
            print_reports(node, {category for category, _, _ in REPORTS})
            return
        failed = []
        for category, check in CHECKS:
            findings = list(dict.fromkeys(check(node)))
            for finding in findings if args.include_warnings else in_short(findings):
                error = "ERROR: " if finding.is_error else ""
                print(f"ros2 doctor: UserWarning: {error}{finding.text}", file=sys.stderr)
            if any(finding.is_error or args.include_warnings for finding in findings):
                failed.append(category)
        if failed:
            print(f"\n{len(failed)}/{len(CHECKS)} check(s) failed\n")
            print("Failed modules:", *dict.fromkeys(failed))
        else:
            print(f"\nAll {len(CHECKS)} checks passed\n")
        if args.report_failed:
            print_reports(node, set(failed))


def in_short(findings: list[Finding]) -> list[Finding]:
    """Return findings, those of topics that only one side uses as one.

    A healthy graph has many: nobody has to listen to a robot.
    """
    others = [each for each in findings if "detected on" not in each.text]
    if one_sided := len(findings) - len(others):
        text = f"{one_sided} topics with a publisher or a subscriber alone (-iw names them)."
        others.append(Finding(False, text))
    return others


def print_reports(node: Node, categories: set[str]) -> None:
    """Print the reports of some categories, each as a title and a table."""
    for category, title, report in REPORTS:
        if category not in categories:
            continue
        items = report(node)
        longest = max(len(name) for name, _ in items)
        width = longest + 4 if longest >= 8 else 8
        print("\n  ", title)
        for name, value in items:
            print(f"{name:{width}}: {value}")


# ------------------------------------------------------------------ checks
def network_findings(_: Node) -> Iterator[Finding]:
    """Look for interfaces for one machine, for several, and for discovery by multicast."""
    flags = [int(path.read_text(), 16) for path in Path("/sys/class/net").glob("*/flags")]
    if not any(each & LOOPBACK for each in flags):
        yield Finding(True, "No loopback IP address is found.")
    if not any(not each & LOOPBACK for each in flags):
        yield Finding(False, "Only loopback IP address is found.")
    if not any(each & MULTICAST for each in flags):
        yield Finding(False, "No multicast IP address is found.")


def topic_findings(node: Node) -> Iterator[Finding]:
    """Topics that only one side uses."""
    for name, publishers, subscribers in topic_counts(node):
        if publishers and not subscribers:
            yield Finding(False, f"Publisher without subscriber detected on {name}.")
        elif subscribers and not publishers:
            yield Finding(False, f"Subscriber without publisher detected on {name}.")


def qos_findings(node: Node) -> Iterator[Finding]:
    """Publishers and subscribers of one topic that do not hear each other, or may not."""
    for topic, _, _, _, compatibility, reason in pairs(node):
        if compatibility != QoSCompatibility.OK:
            is_error = compatibility == QoSCompatibility.ERROR
            kind = "error" if is_error else "warning"
            reason = re.sub(r"^(warning|error): ", "", reason, flags=re.IGNORECASE)
            yield Finding(is_error, f"QoS compatibility {kind} found on topic '{topic}': {reason}")


def topic_counts(node: Node) -> list[tuple[str, int, int]]:
    """Names of topics, with how many publish and subscribe each."""
    return [
        (name, node.count_publishers(name), node.count_subscribers(name))
        for name, _ in topics(node, hidden=True)
        if name not in OF_EVERY_NODE
    ]


def pairs(node: Node) -> Iterator[tuple[str, str, str, str, QoSCompatibility, str]]:
    """Topic, its type, publishing node, subscribing node, and how their qualities fit and why."""
    for name, _ in topics(node, hidden=True):
        for publisher in node.get_publishers_info_by_topic(name):
            for subscriber in node.get_subscriptions_info_by_topic(name):
                fit, reason = qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)
                type_ = publisher.topic_type
                yield name, type_, publisher.node_name, subscriber.node_name, fit, reason


# ------------------------------------------------------------------ reports
def platform_report(_: Node) -> Items:
    """The machine."""
    return [
        ("system", platform.system()),
        ("platform info", platform.platform()),
        ("release", platform.release()),
        ("processor", platform.processor()),
    ]


def ros_report(_: Node) -> Items:
    """The distribution of ROS."""
    return [("distribution name", os.environ.get("ROS_DISTRO", "").lower())]


def rmw_report(_: Node) -> Items:
    """The middleware."""
    return [("middleware name", get_rmw_implementation_identifier())]


def topic_report(node: Node) -> Items:
    """Topics with the number of their publishers and subscribers."""
    titles = ("topic", "publisher count", "subscriber count")
    rows = topic_counts(node) or [("none", 0, 0)]
    return [item for row in rows for item in zip(titles, row, strict=True)]


def qos_report(node: Node) -> Items:
    """Every publisher with every subscriber of its topic, and whether they hear each other."""
    items: Items = []
    for topic, type_, publisher, subscriber, compatibility, reason in pairs(node):
        items += [
            ("topic [type]", f"{topic} [{type_}]"),
            ("publisher node", publisher),
            ("subscriber node", subscriber),
            ("compatibility status", "OK" if compatibility == QoSCompatibility.OK else reason),
        ]
    return items or [("compatibility status", "No publisher/subscriber pairs found")]


# Each with the category that `--report-failed` chooses by, in ros2cli's order.
CHECKS: list[tuple[str, Callable[[Node], Iterator[Finding]]]] = [
    ("network", network_findings),
    ("middleware", qos_findings),
    ("topic", topic_findings),
]
REPORTS: list[tuple[str, str, Callable[[Node], Items]]] = [
    ("platform", "PLATFORM INFORMATION", platform_report),
    ("middleware", "QOS COMPATIBILITY LIST", qos_report),
    ("middleware", "RMW MIDDLEWARE", rmw_report),
    ("platform", "ROS 2 INFORMATION", ros_report),
    ("topic", "TOPIC LIST", topic_report),
]
