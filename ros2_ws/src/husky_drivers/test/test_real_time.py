"""Find what hard real time lacks in made-up files of /proc and /sys."""

import os

import pytest

from husky_drivers.real_time import machine_lacks, process_lacks, take_real_time

STAT = "7 (drive) bridge) S " + " ".join(["0"] * 37) + " {policy} 0\n"
"""Of proc(5): the policy is field 41."""
LIMITS = (
    "Limit                     Soft Limit           Hard Limit           Units     \n"
    "Max locked memory         8388608              8388608              bytes     \n"
    "Max realtime priority     0                    90                   \n"
)


@pytest.fixture
def root(tmp_path):
    """A machine and a process that lack nothing."""
    files = {
        "sys/kernel/realtime": "1\n",
        "sys/devices/system/cpu/isolated": "3\n",
        "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance\n",
        "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "performance\n",
        "proc/self/task/7/stat": STAT.format(policy=1),
        "proc/self/task/8/stat": STAT.format(policy=1),
        "proc/self/status": "VmPeak:\t 9 kB\nVmLck:\t 1024 kB\n",
        "proc/self/limits": LIMITS,
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def lacks(root):
    return [*machine_lacks(root), *process_lacks(root)]


def test_a_machine_in_hard_real_time_lacks_nothing(root):
    assert lacks(root) == []


@pytest.mark.parametrize(
    ("name", "text", "what", "remedy"),
    [
        ("sys/kernel/realtime", "0", "PREEMPT_RT", "linux-image-rt-amd64"),
        ("sys/kernel/realtime", None, "PREEMPT_RT", "linux-image-rt-amd64"),
        (
            "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
            "powersave",
            "governor of cpu1 is not",
            "cpupower",
        ),
        ("sys/devices/system/cpu/isolated", "\n", "no processor is isolated", "isolcpus"),
        (
            "proc/self/task/8/stat",
            STAT.format(policy=0),
            "no real-time priority (largest that is permitted: 90)",
            "rtprio",
        ),
        ("proc/self/task/8/stat", "", "no real-time priority", "rtprio"),
        ("proc/self/status", "VmLck:\t 0 kB\n", "not locked (most that is permitted: ", "memlock"),
        ("proc/self/status", None, "memory is not locked", "memlock"),
    ],
)
def test_each_thing_that_is_missing_is_told_with_its_remedy(root, name, text, what, remedy):
    if text is None:
        (root / name).unlink()
    else:
        (root / name).write_text(text)
    (lack,) = lacks(root)
    assert what in lack.what and remedy in lack.remedy
    assert str(lack) == f"not hard real time: {lack.what}; {lack.remedy}"


def test_a_machine_that_hides_its_governors_is_not_blamed_for_them(root):
    for path in root.glob("sys/devices/system/cpu/cpu?/cpufreq/scaling_governor"):
        path.unlink()
    assert lacks(root) == []


def test_priority_0_leaves_the_process_as_it_is():
    policy = os.sched_getscheduler(0)
    told = take_real_time(0)
    assert os.sched_getscheduler(0) == policy
    assert any("no real-time priority" in lack.what for lack in told)
