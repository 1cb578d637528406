"""Several workers: each file in one, containers in one of their own, real time alone at the end.

One begins with the first file, the others with the last one.
"""

from __future__ import annotations

import pytest
from inner_run import inner_run

FILES = (
    "bare/test_b",
    "docker/test_a",
    "test_first",
    "test_realtime_a",
    "test_realtime_b",
    "test_second",
    "test_third",
)
AWAITED = {"test_first": "test_second", "test_third": "test_first"}
"""What must have begun before a file's tests end: how fast the workers are does not matter."""
TEST = """
import os, pathlib, time
import pytest

@pytest.mark.parametrize("number", range(3))
def test_it(number, request):
    begin = time.monotonic()
    pathlib.Path("tests/{name}.begun").touch()
    while not pathlib.Path("tests/{awaited}.begun").exists():
        assert time.monotonic() < begin + 120.0, "{awaited} has not begun"
        time.sleep(0.01)
    with pathlib.Path("trace").open("a") as file:
        worker = os.environ["PYTEST_XDIST_WORKER"]
        print("{name}", worker, begin, time.monotonic(), file=file)
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple]]:
    """Worker, begin and end [s] of each test of each file."""
    root = tmp_path_factory.mktemp("root")
    files = {
        f"{name}.py": TEST.format(name=name, awaited=AWAITED.get(name, name)) for name in FILES
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
    """Those that are in no worker's own, the first and the last of them side by side."""
    begins = {name: tests[0][1] for name, tests in runs.items()}
    assert begins["test_third"] < begins["test_second"] < runs["test_first"][0][2]
    assert begins["test_first"] < runs["test_third"][0][2]
    assert workers(runs["test_first"]).isdisjoint(workers(runs["test_third"]))


def test_files_in_real_time_come_last_and_alone(runs):
    alone = [tests for name, tests in runs.items() if "realtime" in name]
    others = [tests for name, tests in runs.items() if "realtime" not in name]
    assert len(set().union(*map(workers, alone))) == 1
    begin = min(begin for tests in alone for _, begin, _ in tests)
    assert begin > max(end for tests in others for _, _, end in tests)
