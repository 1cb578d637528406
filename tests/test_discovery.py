"""Who hears of a node: env.sh keeps DDS on the loopback, unless its user opens it."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[1]
PROFILES, ON_LOOPBACK = (ROOT / f"scripts/{name}.xml" for name in ("fastdds", "fastdds_loopback"))
CHOICES = {
    "": ("SYSTEM_DEFAULT", str(ON_LOOPBACK)),
    "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST": ("SYSTEM_DEFAULT", str(ON_LOOPBACK)),
    "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET": ("SUBNET", str(PROFILES)),
    "ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT": ("SYSTEM_DEFAULT", str(PROFILES)),
    "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF": ("OFF", str(PROFILES)),
    "ROS_STATIC_PEERS=192.0.2.7": ("LOCALHOST", str(PROFILES)),
    "FASTRTPS_DEFAULT_PROFILES_FILE=/mine.xml": ("LOCALHOST", "/mine.xml"),
    "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp": ("LOCALHOST", str(PROFILES)),
}
"""What a user has set, and the range and the profile that env.sh chooses."""


def command(script: str) -> list[str]:
    """Return a command in a shell that has set nothing of its own and sources env.sh."""
    names = (*(choice.partition("=")[0] for choice in CHOICES if choice), "HUSKY_ROOT")
    return [
        "env", *(word for name in names for word in ("-u", name)),
        "bash", "-c", f"source_env() {{ . {ROOT}/scripts/env.sh; }}; {script}",
    ]  # fmt: skip


def told(script: str) -> str:
    return subprocess.run(
        command(script), stdout=subprocess.PIPE, text=True, timeout=120.0, check=True
    ).stdout


@pytest.mark.parametrize("setting", CHOICES)
def test_env_chooses_how_far_a_node_is_heard(setting: str) -> None:
    """Also where it was sourced before, without that setting."""
    show = 'echo "$ROS_AUTOMATIC_DISCOVERY_RANGE $FASTRTPS_DEFAULT_PROFILES_FILE"'
    export = f"export {setting}" if setting else ":"
    wanted = " ".join(CHOICES[setting]) + "\n"
    assert told(f"{export}; source_env; {show}; source_env; {show}") == 2 * wanted
    if "SYSTEM_DEFAULT" not in setting and "/mine" not in setting:  # it has said that itself
        assert told(f"source_env; {export}; source_env; {show}") == wanted


def test_profiles_discover_alike() -> None:
    def discovery(path: Path) -> list[tuple[str, str]]:
        found = [e for e in ElementTree.parse(path).iter() if e.tag.endswith("}discovery_config")]
        return [(item.tag, (item.text or "").strip()) for item in found[0].iter()]

    assert len(discovery(PROFILES)) > 5
    assert discovery(PROFILES) == discovery(ON_LOOPBACK)


@contextmanager
def sample(domain: int, setting: str = "") -> Iterator[int]:
    """Run the process of the sample nodes as from a terminal of its own; give its id."""
    node = f"exec {sys.executable} {ROOT}/tests/fixtures/sample_node.py"
    process = subprocess.Popen(
        command(f"export ROS_DOMAIN_ID={domain} {setting}; source_env; {node}"),
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "ready\n"
        yield process.pid
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60.0) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def addresses(process: int) -> set[str]:
    """Return the addresses to which a process's UDP and TCP sockets are bound."""
    inodes = set()
    for descriptor in Path(f"/proc/{process}/fd").iterdir():
        link = os.readlink(descriptor)
        if link.startswith("socket:["):
            inodes.add(link[len("socket:[") : -1])
    found = set()
    for table in ("udp", "udp6", "tcp", "tcp6"):
        for line in Path(f"/proc/{process}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes:
                raw = bytes.fromhex(fields[1].partition(":")[0])
                words = [raw[i : i + 4][::-1] for i in range(0, len(raw), 4)]  # of this processor
                family = socket.AF_INET if len(raw) == 4 else socket.AF_INET6
                found.add(socket.inet_ntop(family, b"".join(words)))
    return found


def test_a_node_listens_on_the_loopback_alone(domain: int) -> None:
    """And a second terminal sees it."""
    with sample(domain) as process:
        assert addresses(process) == {"127.0.0.1"}
        listed = told(
            f"export ROS_DOMAIN_ID={domain}; source_env; {ROOT}/scripts/ros2/bin/ros2 node list"
        )
        assert "/sample" in listed


def test_a_node_listens_to_the_subnet_if_it_is_told_to(domain: int) -> None:
    with sample(domain, "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET") as process:
        assert "0.0.0.0" in addresses(process)
