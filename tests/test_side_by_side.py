"""Several workers: each file in one, containers in one of their own, real time alone at the end.

One begins with the first file, the others with the last one.
"""

from __future__ import annotations

import pytest
from inner_run import inner_run

FILES = (
    "bare/test_b",
    "docker/test_a",
    "test_long",
    "test_realtime_a",
    "test_realtime_b",
    "test_short",
    "test_third",
)
TEST = """
import os, pathlib, time
import pytest

@pytest.mark.parametrize("number", range(3))
def test_it(number, request):
    begin = time.monotonic()
    time.sleep({duration})
    with pathlib.Path("trace").open("a") as file:
        worker = os.environ["PYTEST_XDIST_WORKER"]
        print("{name}", worker, begin, time.monotonic(), file=file)
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple]]:
    """Worker, begin and end [s] of each test of each file."""
    root = tmp_path_factory.mktemp("root")
    files = {
        f"{name}.py": TEST.format(name=name, duration=0.3 if name == "test_long" else 0.05)
        for name in FILES
    }
    inner_run(root, files, "-n", "3")
    found: dict[str, list[tuple]] = {name: [] for name in FILES}
    for line in (root / "trace").read_text().splitlines():
        name, worker, begin, end = line.split()
        found[name].append((worker, float(begin), float(end)))
    assert all(len(tests) == 3 for tests in found.values())
    return found


def workers(tests: list[tuple]) -> set[str]:
    return {worker for worker, _, _ in tests}


def test_a_file_is_run_by_one_worker(runs):
    assert all(len(workers(tests)) == 1 for tests in runs.values())


def test_containers_have_a_worker_of_their_own(runs):
    (of_containers,) = workers(runs["docker/test_a"]) | workers(runs["bare/test_b"])
    others = [tests for name, tests in runs.items() if "/" not in name]
    assert of_containers not in set().union(*map(workers, others))


def test_files_are_begun_from_both_ends(runs):
    """Those that are in no worker's own: the longest is the first one."""
    begins = {name: tests[0][1] for name, tests in runs.items()}
    assert begins["test_third"] < begins["test_short"]
    assert workers(runs["test_long"]).isdisjoint(workers(runs["test_third"]))
    assert begins["test_long"] < runs["test_third"][-1][2]


def test_files_in_real_time_come_last_and_alone(runs):
    alone = [tests for name, tests in runs.items() if "realtime" in name]
    others = [tests for name, tests in runs.items() if "realtime" not in name]
    assert len(set().union(*map(workers, alone))) == 1
    begin = min(begin for tests in alone for _, begin, _ in tests)
    assert begin > max(end for tests in others for _, _, end in tests)
