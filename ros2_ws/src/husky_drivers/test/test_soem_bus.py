"""The bus "soem" before it has a wire; with one it is tested in husky_sim and in the graph."""

import os
import subprocess
import sys

import pytest

from husky_description.robot import load_robot
from husky_drivers.ethercat.bus import BusOptions, find_bus
from husky_drivers.ethercat.interface import check_interface
from husky_drivers.ethercat.soem_bus import SoemBus

LOOPBACK = "lo"


def may_open_raw_sockets():
    try:
        check_interface(LOOPBACK, promiscuous=True)
    except PermissionError:
        return False
    return True


needs_raw_sockets = pytest.mark.skipif(
    not may_open_raw_sockets(), reason="needs CAP_NET_RAW and CAP_NET_ADMIN"
)


def test_it_is_found_by_name():
    assert find_bus("soem") is SoemBus


@needs_raw_sockets
def test_an_interface_that_is_not_there_is_named_with_those_that_are():
    with pytest.raises(OSError, match=r"no network interface 'nosuch0'; there are .*\blo\b"):
        SoemBus(load_robot(), BusOptions("nosuch0")).open()


@needs_raw_sockets
def test_a_segment_without_slaves_says_where_to_look():
    """Frames on the loopback interface come back untouched."""
    bus = SoemBus(load_robot(), BusOptions(LOOPBACK))
    with pytest.raises(OSError, match="no EtherCAT slave answers on lo: is it cabled"):
        bus.open()
    assert bus.slave_count == 0
    bus.close()


@pytest.mark.parametrize(
    ("promiscuous", "needed", "given"),
    [
        (False, "CAP_NET_RAW", "cap_net_raw"),
        (True, "CAP_NET_RAW and CAP_NET_ADMIN", "cap_net_raw,cap_net_admin"),
    ],
)
def test_without_a_capability_it_says_how_to_get_it(promiscuous, needed, given):
    """In a process that has given its privileges away, if it had any."""
    code = (
        "import os\n"
        "from husky_drivers.ethercat.interface import check_interface\n"
        "if os.getuid() == 0: os.setuid(65534)\n"
        f"check_interface('lo', promiscuous={promiscuous})\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
    )
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(f"PermissionError: EtherCAT frames on lo need {needed}: run as root")
    assert f"sudo setcap {given}+ep" in last
