"""Shared by tests of processes, whose helpers it makes importable under import mode importlib."""

import contextlib
import gc
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_HERE = Path(__file__).resolve().parent
_SOURCES = _HERE.parent / "ros2_ws/src"
sys.path[:0] = [str(_HERE), *(str(_SOURCES / name / "test") for name in ("husky_pu", "husky_sim"))]
pytest.register_assert_rewrite("node_faults")

_PLACES = {
    "tests/docker": 0,
    "tests/bare": 0,
    "tests/graph/propulsion": 1,
    "tests/graph": 2,
    "tests/closed_loop": 5,
    "tests": 4,
    "": 3,
}
"""Of files in a run, by how their path begins: graphs at one end, other long ones at the other,
short ones between. `side_by_side` begins at both ends."""


def pytest_configure(config: pytest.Config) -> None:
    """What every run has: a second try for tests of processes, a word on what is left out, and an
    end.
    """
    from left_out import LeftOut
    from second_try import SecondTry
    from watchdog import Watchdog

    config.pluginmanager.register(LeftOut(config))
    config.pluginmanager.register(SecondTry())
    if config.pluginmanager.hasplugin("timeout") and not config.getoption("usepdb"):
        config.pluginmanager.register(Watchdog(config))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The order of files when they are handed out to several workers, and when they are not.

    Those that share a graph (a fixture `..._of_module`) follow one another; one that has two graphs
    stands between those that have the one and those that have the other.
    """
    shared: dict[Path, set[str]] = {}
    for item in items:
        names = getattr(item, "fixturenames", ())
        shared.setdefault(item.path, set()).update(n for n in names if n.endswith("_of_module"))

    def rank(item: pytest.Item) -> tuple[bool, int, list[str]]:
        place = next(p for start, p in _PLACES.items() if item.nodeid.startswith(start))
        return "realtime" in item.path.name, place, sorted(shared[item.path])

    items.sort(key=rank)
    contained = [
        item
        for item in items
        if item.get_closest_marker("docker") or item.get_closest_marker("bare")
    ]
    if contained and config.pluginmanager.hasplugin("timeout"):
        from docker_engine import BUILD_PERIOD

        for item in contained:  # the first one waits for the image
            item.add_marker(pytest.mark.timeout(BUILD_PERIOD + 600.0))


def pytest_collection_finish() -> None:
    """Leave thousands of tests and what they import out of every collection of garbage: of pure
    code a twentieth of the time.
    """
    gc.collect()
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Sweep up behind processes that were killed; those of a graph have been (`Processes`)."""
    if "node_bench" in sys.modules:
        sys.modules["node_bench"].end_fork_server()
    with contextlib.suppress(ImportError):  # not in the environment of the workspace
        from husky_bringup import shared_memory

        shared_memory.sweep()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Several workers: who runs what."""
    from side_by_side import SideBySide

    return SideBySide(config, log)


@pytest.fixture(scope="session")
def engine() -> Iterator[Any]:
    """A Docker engine (`docker_engine.Engine`); skipped where there can be none."""
    from docker_engine import engine

    with engine() as found:
        yield found


@pytest.fixture(scope="module")
def domain(request: pytest.FixtureRequest) -> Iterator[int]:
    """A ROS domain of the module's own, in the environment too."""
    from ros_domain import own_domain

    with own_domain(request.node.nodeid) as number:
        yield number


@pytest.fixture
def node(domain: int) -> Iterator[Any]:
    """A node of rclpy in a context and a domain of its own."""
    rclpy = pytest.importorskip("rclpy")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("tested", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture(scope="module")
def gateway_of_module(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A `foxglove_gateway` without a robot: its process takes longer to start than a test."""
    from gateway_bench import AloneBench

    gateway = AloneBench(domain, tmp_path_factory.mktemp("gateway"))
    yield gateway
    gateway.close()


@pytest.fixture
def gateway(gateway_of_module: Any) -> Iterator[Any]:
    """The gateway before its first client (`gateway_bench.AloneBench`)."""
    gateway_of_module.serve(connections=20)
    yield gateway_of_module
    gateway_of_module.begin_anew()
