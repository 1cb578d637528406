"""Hard real time on Linux: lock memory, take a priority, and find what this machine lacks.

Checks read files below a root, `/` but in tests, and change nothing. Each thing that is missing
comes with the command that mends it. The bus of real drives needs all of it: a Gold Twitter whose
frames come at disturbed times falls out of "operation enabled" (docs/drives.md).
"""

from __future__ import annotations

import ctypes
import os
import resource
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_CAP_IPC_LOCK = 14
_POLICY_FIELD = 41
"""Of `/proc/<pid>/stat`, from 1 (proc(5))."""
_REAL_TIME_POLICIES = (os.SCHED_FIFO, os.SCHED_RR)


class Lack(NamedTuple):
    """Something that hard real time needs and this machine or process does not have.

    Attributes:
        what: is missing.
        remedy: command or setting.
    """

    what: str
    remedy: str

    def __str__(self) -> str:
        """Return both in a line."""
        return f"not hard real time: {self.what}; {self.remedy}"


# The machine ------------------------------------------------------------------------------------
def machine_lacks(root: Path = Path("/")) -> Iterator[Lack]:
    """Return what the kernel and its settings lack."""
    if _read(root / "sys/kernel/realtime") != "1":
        yield Lack(
            "the kernel is not PREEMPT_RT",
            "install one: sudo apt install linux-image-rt-amd64 (Debian), sudo pro enable "
            "realtime-kernel (Ubuntu)",
        )
    slow = [name for name, governor in _governors(root) if governor != "performance"]
    if slow:
        yield Lack(
            f"the frequency governor of {', '.join(slow)} is not performance",
            "sudo cpupower frequency-set -g performance",
        )
    if not _read(root / "sys/devices/system/cpu/isolated"):
        yield Lack(
            "no processor is isolated",
            "start the kernel with isolcpus=3 nohz_full=3 rcu_nocbs=3, and the bridge with "
            "taskset -c 3",
        )


def _governors(root: Path) -> Iterator[tuple[str, str]]:
    """Return each processor that has a governor, with the governor's name."""
    for path in sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor")):
        yield path.parent.parent.name, _read(path)


# The process ------------------------------------------------------------------------------------
def process_lacks(root: Path = Path("/"), process: str = "self") -> Iterator[Lack]:
    """Return what a process lacks: a real-time priority of its threads, and locked memory."""
    here = root / "proc" / process
    policies = {_policy(_read(path)) for path in here.glob("task/*/stat")}
    if not policies or not policies <= set(_REAL_TIME_POLICIES):
        yield Lack(
            f"no real-time priority (largest that is permitted: {_limit(here, 'realtime priority')}"
            ")",
            "in /etc/security/limits.d/husky.conf: @husky - rtprio 90; log in anew; and set "
            "drive_bridge.priority",
        )
    if not _locked(_read(here / "status")):
        yield Lack(
            f"memory is not locked (most that is permitted: {_limit(here, 'locked memory')})",
            "in /etc/security/limits.d/husky.conf: @husky - memlock unlimited; log in anew",
        )


def _policy(stat: str) -> int:
    """Return the scheduling policy in a `stat` file, -1 when it cannot be read."""
    fields = stat.rpartition(")")[2].split()  # the name in front may hold anything
    try:
        return int(fields[_POLICY_FIELD - 3])
    except (IndexError, ValueError):
        return -1


def _locked(status: str) -> bool:
    """Return whether a `status` file tells of locked memory."""
    for line in status.splitlines():
        if line.startswith("VmLck:"):
            return int(line.split()[1]) > 0
    return False


def _limit(process: Path, name: str) -> str:
    """Return the hard limit of a process in `limits`, "unknown" without one."""
    for line in _read(process / "limits").splitlines():
        if line.startswith(f"Max {name}"):
            return line.removeprefix(f"Max {name}").split()[1]
    return "unknown"


def _read(path: Path) -> str:
    """Return what a file holds, "" without the file."""
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""


# Taking it --------------------------------------------------------------------------------------
def take_real_time(priority: int) -> list[Lack]:
    """Lock this process's memory and give all its threads a priority; return what is missing.

    Threads that are started later inherit the priority of the one that starts them.

    Args:
        priority: of SCHED_FIFO, 1 to 98; 0 leaves threads and memory as they are.
    """
    if priority > 0:
        _lock_memory()
        _take_priority(priority)
    return [*machine_lacks(), *process_lacks()]


def _take_priority(priority: int) -> None:
    """Put every thread under SCHED_FIFO, where the kernel lets this process."""
    for task in os.listdir("/proc/self/task"):
        try:
            os.sched_setscheduler(int(task), os.SCHED_FIFO, os.sched_param(priority))
        except (PermissionError, ProcessLookupError):  # a thread that has ended meanwhile
            continue


def _lock_memory() -> None:
    """Keep all pages of this process in memory, also later ones.

    Below a limit, memory that is asked for later would be refused: then nothing is locked.
    """
    _, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if hard == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    elif not _has_capability(_CAP_IPC_LOCK):
        return
    ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE)


def _has_capability(number: int) -> bool:
    """Return whether a capability is effective in this process."""
    for line in _read(Path("/proc/self/status")).splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> number & 1)
    return False
