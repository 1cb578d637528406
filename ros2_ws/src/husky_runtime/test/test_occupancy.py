"""One of each node in a domain: locks of processes, seen from other processes."""

from __future__ import annotations

import contextlib
import os
import pwd
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from husky_runtime import domain_locks as occupancy
from husky_runtime import record_lock
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


# Other users --------------------------------------------------------------------------------------
@pytest.fixture
def shared() -> Iterator[Path]:
    """A directory below /tmp that everybody gets into, made under a umask that lets nobody."""
    with tempfile.TemporaryDirectory() as parent:
        Path(parent).chmod(0o755)
        before = os.umask(0o077)
        try:
            record_lock.make_directory(Path(parent) / "husky-7")
        finally:
            os.umask(before)
        yield Path(parent) / "husky-7"


def as_another_user(action: Callable[[], object]) -> str:
    """Return the error of an action of user nobody, or nothing."""
    told, tell = os.pipe()
    if (child := os.fork()) == 0:
        error = ""
        try:
            os.setuid(pwd.getpwnam("nobody").pw_uid)
            action()
        except OSError as failure:
            error = str(failure)
        os.write(tell, error.encode())
        os._exit(0)
    os.close(tell)
    with open(told, encoding="utf-8") as pipe:
        error = pipe.read()
    os.waitpid(child, 0)
    return error


def take(path: Path) -> int:
    """Take a lock; return its descriptor."""
    descriptor = record_lock.open_file(path)
    record_lock.take(descriptor)
    return descriptor


def test_locks_are_files_of_everybody(shared: Path) -> None:
    os.close(record_lock.open_file(shared / "plant.node"))
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (shared, shared / "plant.node")]
    assert modes == [0o1777, 0o666]


@pytest.mark.skipif(os.getuid() != 0, reason="root alone can become another user")
def test_users_share_the_locks_of_a_domain(shared: Path) -> None:
    """Each keeps the other out, and is named where a lock cannot be looked at."""
    ours, theirs = shared / "plant.node", shared / "planner.node"
    descriptor = take(ours)
    assert "unavailable" in as_another_user(lambda: take(ours))
    os.close(descriptor)
    assert as_another_user(lambda: (take(ours), take(theirs))) == ""
    os.close(take(theirs))
    ours.chmod(0o600)
    assert as_another_user(lambda: take(ours)) == (
        f"{ours} belongs to user root: choose another domain with ROS_DOMAIN_ID, or, if that "
        f"user's robot has ended, sudo rm -r {shared}"
    )


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
