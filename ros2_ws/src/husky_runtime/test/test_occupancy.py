"""One of each node in a domain: locks of processes, seen from other processes."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from husky_runtime import domain_locks as occupancy
from husky_runtime.domain_locks import Claims, OccupiedError

DOMAIN = 7
HOLD = f"""
import sys, time
from husky_runtime import domain_locks as occupancy
occupancy._PATIENCE = 0.1
try:
    occupancy.hold("plant", {DOMAIN})
except OSError as error:
    sys.exit(str(error))
print("held", flush=True)
time.sleep(600)
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Of processes whose locks are their own."""
    path = os.pathsep.join(filter(None, sys.path))
    own = {occupancy.VARIABLE: str(tmp_path), "ROS_DOMAIN_ID": str(DOMAIN), "PYTHONPATH": path}
    return {**os.environ, **own}


@contextlib.contextmanager
def holder(environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """A process that holds the plant's name."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD], env=environment, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_second_node_of_a_name_is_told_of_the_first(environment) -> None:
    with holder(environment) as first:
        second = subprocess.run(
            [sys.executable, "-c", HOLD], env=environment, capture_output=True, text=True
        )
    assert second.returncode == 1
    assert second.stderr == (
        f"this robot runs already in ROS domain {DOMAIN}: plant (process {first.pid}); "
        "end it, or choose another domain with ROS_DOMAIN_ID\n"
    )


def test_a_killed_node_can_be_started_again_at_once(environment) -> None:
    with holder(environment) as first:
        first.send_signal(signal.SIGKILL)
        with holder(environment) as second:
            seen = occupancy.occupants(["plant", "planner"], DOMAIN, environment)
            assert seen == {"plant": f"process {second.pid}"}
    assert occupancy.occupants(["plant"], DOMAIN, environment) == {}


def test_looking_takes_nothing(environment) -> None:
    """Neither does a holder lose its lock by being looked at."""
    with holder(environment):
        for _ in range(3):
            assert occupancy.holder("plant", DOMAIN, environment)
    assert occupancy.holder("plant", DOMAIN, environment) is None
    with holder(environment):
        pass


def test_a_starter_gets_all_names_or_none(environment, monkeypatch) -> None:
    monkeypatch.setattr(occupancy, "_ORPHANS_PATIENCE", 0.1)
    claims = Claims(environment)
    with holder(environment) as process:
        with pytest.raises(OccupiedError, match=rf"domain 7: plant \(process {process.pid}\)"):
            claims.claim(["drive_bridge", "plant"])
        another = Claims(environment)
        another.claim(["drive_bridge"])
        another.give_up()
    claims.claim(["drive_bridge", "plant"])
    claims.give_up()


def test_of_two_starters_one_gets_the_domain(environment) -> None:
    """Also before any of its nodes runs."""
    first, second = Claims(environment), Claims(environment)
    first.claim(["plant", "drive_bridge", "recorder"])
    with pytest.raises(OccupiedError) as refusal:
        second.claim(["vn200_driver", "plant"])
    assert f"plant (started by process {os.getpid()})" in str(refusal.value)
    assert "vn200_driver" not in str(refusal.value)
    first.give_up(["plant"])
    second.claim(["plant", "recorder"])
    first.give_up()
    second.give_up()


def test_another_domain_is_free(environment) -> None:
    del environment[occupancy.VARIABLE]
    first = Claims({**environment, "ROS_DOMAIN_ID": "231"})
    second = Claims({**environment, "ROS_DOMAIN_ID": "232"})
    first.claim(["plant"])
    second.claim(["plant"])
    first.give_up()
    second.give_up()


@pytest.mark.parametrize("text", ["-1", "233", "x", "1.0"])
def test_no_domain(text: str) -> None:
    with pytest.raises(ValueError, match=f"ROS_DOMAIN_ID is '{text}', it must be 0 to 232"):
        occupancy.domain_of({"ROS_DOMAIN_ID": text})


def test_the_domain_of_an_environment() -> None:
    assert [occupancy.domain_of(e) for e in ({}, {"ROS_DOMAIN_ID": "42"})] == [0, 42]
